from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from baxter_kin.compilation import compiler
from baxter_kin.compilation.compiler import ZIG, Compiler, compilers


@pytest.fixture
def programs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that is all of PATH; no package `ziglang`."""
    folder = tmp_path / "bin"
    folder.mkdir()
    monkeypatch.setenv("PATH", str(folder))
    monkeypatch.setattr(compiler, "find_spec", lambda _: None)
    return folder


def add(folder: Path, name: str, script: str = "") -> Path:
    path = folder / name
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)
    return path


def test_where_there_is_no_compiler_none_is_found(programs: Path) -> None:
    assert compilers() == ()


def test_compilers_on_path_come_in_their_order(programs: Path) -> None:
    for name in "clang", "gcc", "cc", "tcc":
        add(programs, name)
    assert [Path(found.command[0]).name for found in compilers()] == ["cc", "gcc", "clang"]


def test_on_a_relative_path_they_are_found_from_elsewhere_too(
    programs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    add(programs, "cc")
    monkeypatch.chdir(programs.parent)
    monkeypatch.setenv("PATH", programs.name)
    assert compilers()[0].command == (str(programs / "cc"),)


def test_the_package_ziglang_comes_last_and_is_called_through_python(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = tmp_path / "said"
    (tmp_path / "ziglang").mkdir()
    (tmp_path / "ziglang" / "__init__.py").touch()
    (tmp_path / "ziglang" / "__main__.py").write_text(
        f"import sys; open({str(said)!r}, 'w').write(' '.join(sys.argv[1:])); sys.exit(3)"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.syspath_prepend(tmp_path)
    add(tmp_path, "cc")
    monkeypatch.setenv("PATH", str(tmp_path))
    on_path, package = compilers()
    assert (on_path.command, package.command) == ((str(tmp_path / "cc"),), ZIG)
    assert package.answer_s > on_path.answer_s
    with pytest.raises(subprocess.CalledProcessError):
        package.compile("", tmp_path)
    assert said.read_text().startswith("cc -mcpu=baseline -g0 -O2 -fPIC -shared")


def test_a_compiler_is_asked_for_a_line_before_it_is_given_the_rest(
    programs: Path, tmp_path: Path
) -> None:
    found = Compiler((str(add(programs, "cc", "echo $5 >> calls")),), programs / "cc", 10.0)
    assert found.compile("int x;\n", tmp_path) == tmp_path / "kernel.so"
    calls = (tmp_path / "calls").read_text().splitlines()
    assert [Path(call).name for call in calls] == ["line.c", "kernel.c"]
    assert (tmp_path / "kernel.c").read_text() == "int x;\n"


def test_its_version_changes_with_the_program_alone(programs: Path) -> None:
    found = Compiler((str(add(programs, "cc")),), programs / "cc", 10.0)
    (programs / "gcc").symlink_to("cc")
    other_name = Compiler((str(programs / "gcc"),), programs / "gcc", 10.0)
    before = found.version_key
    assert other_name.version_key == found.version_key == before
    os.utime(programs / "cc", ns=(1, 1))
    assert found.version_key != before
