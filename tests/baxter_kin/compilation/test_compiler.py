from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from baxter_kin.compilation.compiler import ZIG, Compiler, compilers, run_within
from tests.baxter_kin.compilation.conftest import Provide

LONG_S = 30.0
"""Time limit that none of these programs reaches."""

SHORT_S = 1.0
"""Enough for a shell to start."""

WITH_A_CHILD = "sleep 1000 & echo $! > child; wait"


def ends(process: int) -> bool:
    """Whether a process ends soon, or is a zombie; a signal takes a moment to arrive."""
    for _ in range(100):
        try:
            status = Path(f"/proc/{process}/stat").read_text("ascii")
        except (FileNotFoundError, ProcessLookupError):
            return True
        if status.rpartition(")")[2].split()[0] == "Z":
            return True
        time.sleep(0.05)
    return False


def test_compilers_on_path_are_in_order_of_preference_each_program_once(
    provide: Provide, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    provide()
    assert compilers() == ()
    provide(clang="", gcc="", cc="")
    assert [Path(found.command[0]).name for found in compilers()] == ["clang", "gcc", "cc"]
    (tmp_path / "bin" / "gcc").unlink()
    (tmp_path / "bin" / "gcc").symlink_to("clang")
    assert [Path(found.command[0]).name for found in compilers()] == ["clang", "cc"]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", "bin")
    assert compilers()[0].command == (str(tmp_path / "bin" / "clang"),)


def test_the_package_ziglang_comes_last_and_is_called_through_python(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = tmp_path / "given"
    (tmp_path / "ziglang").mkdir()
    (tmp_path / "ziglang" / "__init__.py").touch()
    (tmp_path / "ziglang" / "__main__.py").write_text(
        f"import sys; open({str(given)!r}, 'w').write(' '.join(sys.argv[1:])); sys.exit(3)"
    )
    (tmp_path / "cc").touch(0o755)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PATH", str(tmp_path))
    on_path, package = compilers()
    assert (on_path.command, package.command) == ((str(tmp_path / "cc"),), ZIG)
    assert package.answer_s > on_path.answer_s
    with pytest.raises(subprocess.CalledProcessError):
        package.compile("", tmp_path)
    assert given.read_text().startswith("cc -mcpu=baseline -g0 -O2 -fPIC -shared")


def test_a_compiler_must_compile_one_line_first(provide: Provide, tmp_path: Path) -> None:
    provide(cc="for word in $given; do case $word in *.c) echo $word >> calls;; esac; done")
    assert compilers()[0].compile("int x;\n", tmp_path) == tmp_path / "kernel.so"
    calls = (tmp_path / "calls").read_text().splitlines()
    assert [Path(call).name for call in calls] == ["line.c", "kernel.c"]
    assert (tmp_path / "kernel.c").read_text() == "int x;\n"


def test_a_program_runs_silently_in_the_folder_with_the_variables(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    command = "sh", "-c", "cat; echo out; echo err >&2; echo $WORD > here"
    run_within(LONG_S, command, tmp_path, {**os.environ, "WORD": "given"})
    assert (tmp_path / "here").read_text() == "given\n"
    assert tuple(capfd.readouterr()) == ("", "")


def test_programs_that_fail_or_are_not_there_raise(tmp_path: Path) -> None:
    with pytest.raises(subprocess.CalledProcessError) as failure:
        run_within(LONG_S, ("sh", "-c", "exit 3"), tmp_path)
    assert failure.value.returncode == 3
    with pytest.raises(FileNotFoundError):
        run_within(LONG_S, (str(tmp_path / "nothing"),), tmp_path)


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


def test_compilers_are_named_by_program_or_package() -> None:
    assert [str(Compiler(command)) for command in (("/bin/cc",), ZIG)] == [
        *("/bin/cc", "the package ziglang")
    ]
