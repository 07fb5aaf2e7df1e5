from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from baxter_kin.compilation import compiler
from baxter_kin.compilation.compiler import ZIG, Compiler, compilers, run_within


@pytest.fixture
def programs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that is the only one on PATH, without the package `ziglang`."""
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


def test_without_compilers_none_is_found(programs: Path) -> None:
    assert compilers() == ()


def test_compilers_on_path_are_in_order_of_preference(programs: Path) -> None:
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


def test_compiler_must_compile_one_line_first(programs: Path, tmp_path: Path) -> None:
    found = Compiler((str(add(programs, "cc", "echo $5 >> calls")),), programs / "cc", 10.0)
    assert found.compile("int x;\n", tmp_path) == tmp_path / "kernel.so"
    calls = (tmp_path / "calls").read_text().splitlines()
    assert [Path(call).name for call in calls] == ["line.c", "kernel.c"]
    assert (tmp_path / "kernel.c").read_text() == "int x;\n"


def test_version_key_depends_on_the_program_alone(programs: Path) -> None:
    found = Compiler((str(add(programs, "cc")),), programs / "cc", 10.0)
    (programs / "gcc").symlink_to("cc")
    other_name = Compiler((str(programs / "gcc"),), programs / "gcc", 10.0)
    before = found.version_key
    assert other_name.version_key == found.version_key == before
    os.utime(programs / "cc", ns=(1, 1))
    assert found.version_key != before


# Programs with a time limit

LONG_S = 30.0
"""Time limit that none of these programs reaches."""

SHORT_S = 1.0
"""Enough for a shell to start."""

WITH_A_CHILD = "sleep 1000 & echo $! > child; wait"


def is_running(process: int) -> bool:
    """Whether a process exists and is not a zombie."""
    try:
        status = Path(f"/proc/{process}/stat").read_text("ascii")
    except (FileNotFoundError, ProcessLookupError):
        return False
    return status.rpartition(")")[2].split()[0] != "Z"


def ends(process: int) -> bool:
    """Whether a process ends soon; a signal takes a moment to arrive."""
    for _ in range(100):
        if not is_running(process):
            return True
        time.sleep(0.05)
    return False


def test_program_runs_in_the_folder_with_the_variables(tmp_path: Path) -> None:
    command = "sh", "-c", "echo $WORD > here"
    run_within(LONG_S, command, tmp_path, {**os.environ, "WORD": "said"})
    assert (tmp_path / "here").read_text() == "said\n"


def test_failure_raises_with_the_exit_status(tmp_path: Path) -> None:
    with pytest.raises(subprocess.CalledProcessError) as failure:
        run_within(LONG_S, ("sh", "-c", "exit 3"), tmp_path)
    assert failure.value.returncode == 3


def test_output_is_discarded_and_input_is_empty(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    run_within(LONG_S, ("sh", "-c", "cat; echo out; echo err >&2"), tmp_path)
    assert tuple(capfd.readouterr()) == ("", "")


def test_a_program_that_hangs_is_ended_with_its_children(tmp_path: Path) -> None:
    with pytest.raises(subprocess.TimeoutExpired):
        run_within(SHORT_S, ("sh", "-c", WITH_A_CHILD), tmp_path)
    assert ends(int((tmp_path / "child").read_text()))


def test_ctrl_c_ends_it_with_its_children(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(process: subprocess.Popen[bytes], timeout: float | None = None) -> int:
        while not (child := tmp_path / "child").exists() or not child.read_text():
            time.sleep(0.05)
        monkeypatch.undo()
        raise KeyboardInterrupt

    monkeypatch.setattr(subprocess.Popen, "wait", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_within(LONG_S, ("sh", "-c", WITH_A_CHILD), tmp_path)
    assert ends(int((tmp_path / "child").read_text()))


def test_a_program_that_is_not_there_raises(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        run_within(LONG_S, (str(tmp_path / "nothing"),), tmp_path)


def test_python_does_not_import_from_where_it_was_called(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Called in `/tmp`, it would import what other users have put there."""
    (tmp_path / "shared").mkdir()
    (tmp_path / "own").mkdir()
    (tmp_path / "shared" / "planted.py").write_text("")
    monkeypatch.chdir(tmp_path / "shared")
    with pytest.raises(subprocess.CalledProcessError):
        run_within(LONG_S, (sys.executable, "-m", "planted"), tmp_path / "own")
