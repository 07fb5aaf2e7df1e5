from __future__ import annotations

import logging
import os
import shlex
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from baxter_kin import Arm
from baxter_kin.compilation import compiler, kernel_cache, machine_code
from baxter_kin.compilation.compiler import compilers
from baxter_kin.compilation.kernel_cache import KernelCache, private_folder, user_folder
from baxter_kin.compilation.machine_code import compiled
from baxter_kin.errors import FileError
from baxter_kin.ik.search.map_search import search_functions
from baxter_kin.ik.search.search_function import ArmNumbers
from baxter_kin.ik.tolerance import EXACT, Task
from baxter_kin.kinematics.dh_parameters import DHParameters
from tests.baxter_kin.compilation.test_compiler import ends

Provide = Callable[..., None]


@pytest.fixture(autouse=True)
def new_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Forget what a process remembers."""
    monkeypatch.setattr(machine_code, "_FAILED", set())
    private_folder.cache_clear()


@pytest.fixture
def empty_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache of ours; that of `ziglang`, its own run-time library, takes 10 s to fill."""
    monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", str(_usual_folder(tmp_path).with_name("zig")))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "baxter-kin"


def _usual_folder(otherwise: Path) -> Path:
    try:
        return user_folder()
    except FileError:
        return otherwise


@pytest.fixture
def cache(empty_cache: Path) -> Path:
    """The empty cache, if there is a compiler."""
    if not compilers():
        pytest.skip("machine code needs a C compiler; pip install ziglang brings one")
    return empty_cache


@pytest.fixture
def provide(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Provide:
    """Install shell scripts as the compilers on PATH."""
    folder = tmp_path / "bin"
    folder.mkdir()

    def provided(**scripts: str) -> None:
        for name, script in scripts.items():
            (folder / name).write_text(f"#!/bin/sh\n{WRITES_INTO}\n{script}\n")
            (folder / name).chmod(0o755)
        monkeypatch.setattr(compiler, "COMPILERS", tuple(scripts))
        monkeypatch.setattr(compiler, "find_spec", lambda _: None)
        monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")

    return provided


WRITES_INTO = 'given="$*"; while [ "$1" != -o ]; do shift; done; output=$2'
"""A script's output is the file that its caller wants."""

FAILS = "exit 3"


def working() -> str:
    """The script of a compiler that works."""
    return f"exec {shlex.join(compilers()[0].command)} $given"


def counting(calls: Path, script: str) -> str:
    return f"echo called >> {shlex.quote(str(calls))}\n{script}"


def hanging(child: Path) -> str:
    return f"sleep 1000 & echo $! >> {shlex.quote(str(child))}; wait"


def count(calls: Path) -> int:
    return len(calls.read_text().splitlines())


@pytest.fixture
def square() -> ca.Function:
    return function_of(lambda x: x * x)


def function_of(formula: Callable[[ca.SX], ca.SX]) -> ca.Function:
    x = ca.SX.sym("x", 2)
    return ca.Function("square", [x], [formula(x), ca.sum1(x)])


def value(functions: tuple[ca.Function, ...] | None) -> list[float]:
    assert functions is not None
    squares, total = functions[0]([3.0, 4.0])
    return [*np.array(squares).ravel(), float(total)]


def libraries(cache: Path) -> list[Path]:
    return sorted(cache.glob("*.so"))


def test_machine_code_computes_the_same(cache: Path, square: ca.Function) -> None:
    assert value(compiled([square])) == [9.0, 16.0, 7.0]
    assert len(libraries(cache)) == 1


def test_several_functions_share_a_library(cache: Path, square: ca.Function) -> None:
    x = ca.SX.sym("x", 2)
    both = compiled([square, ca.Function("cubes", [x], [x**3, x])])
    assert value(both) == [9.0, 16.0, 7.0]
    assert both is not None
    assert np.array(both[1]([1.0, 2.0])[0]).ravel().tolist() == [1.0, 8.0]
    assert len(libraries(cache)) == 1


def test_searches_give_the_same_as_in_the_virtual_machine(cache: Path, any_arm: Arm) -> None:
    numbers = ArmNumbers.of(any_arm)
    functions = search_functions(numbers.shape)
    machine_code = compiled(functions)
    assert machine_code is not None
    task = Task.of(any_arm, EXACT).numbers(DHParameters.of(any_arm).T_last_tip)
    rng = np.random.default_rng(0)
    for _ in range(50):
        T = any_arm.T_base_tip(any_arm.random_configuration(rng)).homogeneous
        inputs = (any_arm.random_configuration(rng), T, task, numbers.within())
        for i, function in enumerate(functions):
            given = (T, *inputs[1:]) if i > 0 else inputs
            both = function(*given), machine_code[i](*given)
            for expected, found in zip(*both, strict=True):
                np.testing.assert_allclose(np.array(found), np.array(expected), atol=1e-9)


def test_further_kernels_are_compiled_once(cache: Path, square: ca.Function) -> None:
    cube, asked = function_of(lambda x: x * x * x), []

    def alongside() -> list[list[ca.Function]]:
        asked.append(cube)
        return [[cube]]

    for _ in range(2):
        assert value(compiled([square], alongside)) == [9.0, 16.0, 7.0]
    assert len(asked) == 1
    before = [path.stat().st_mtime_ns for path in libraries(cache)]
    assert value(compiled([cube])) == [27.0, 64.0, 7.0]
    assert [path.stat().st_mtime_ns for path in libraries(cache)] == before
    assert len(before) == 2


def test_second_time_the_cached_library_is_used(cache: Path, square: ca.Function) -> None:
    compiled([square])
    written = libraries(cache)[0].stat().st_mtime_ns
    assert value(compiled([square])) == [9.0, 16.0, 7.0]
    assert libraries(cache)[0].stat().st_mtime_ns == written


def test_another_function_gets_another_file(cache: Path, square: ca.Function) -> None:
    compiled([square])
    compiled([function_of(lambda x: x * x * x)])
    assert len(libraries(cache)) == 2


@pytest.mark.parametrize("damage", [b"", b"no library at all", None])
def test_damaged_library_is_compiled_anew(
    cache: Path, square: ca.Function, damage: bytes | None
) -> None:
    """Loading a truncated one would kill the interpreter."""
    compiled([square])
    library = libraries(cache)[0]
    intact = library.read_bytes()
    library.unlink()  # it is mapped into this process; never write into it
    library.write_bytes(intact[: len(intact) // 2] if damage is None else damage)
    assert value(compiled([square])) == [9.0, 16.0, 7.0]
    assert len(libraries(cache)[0].read_bytes()) == len(intact)


def test_intact_library_of_something_else_is_compiled_anew(
    cache: Path, square: ca.Function
) -> None:
    compiled([square])
    compiled([function_of(lambda x: x * x + 1.0)])
    first, second = libraries(cache)
    keys, digests = zip(*(path.stem.split("-") for path in (first, second)), strict=True)
    first.rename(cache / "kept")
    second.rename(cache / f"{keys[0]}-{digests[1]}.so")
    (cache / "kept").rename(cache / f"{keys[1]}-{digests[0]}.so")
    assert value(compiled([square])) == [9.0, 16.0, 7.0]


def test_nothing_but_the_library_is_left(cache: Path, square: ca.Function) -> None:
    compiled([square])
    assert [path.suffix for path in cache.iterdir()] == [".so"]
    assert {path.stat().st_mode & 0o777 for path in cache.iterdir()} == {0o600}


def test_from_a_folder_that_others_may_write_to_nothing_is_loaded(
    cache: Path, square: ca.Function, caplog: pytest.LogCaptureFixture
) -> None:
    compiled([square])
    planted = libraries(cache)[0]
    os.utime(planted, ns=(0, 0))
    cache.chmod(0o777)
    for _ in range(2):
        assert value(compiled([square])) == [9.0, 16.0, 7.0]
    assert planted.stat().st_mtime_ns == 0
    assert len(libraries(cache)) == 1
    warned = [record for record in caplog.records if record.levelno == logging.WARNING]
    assert len(warned) == 1
    assert "for this process only" in warned[0].getMessage()


def test_in_a_cache_that_cannot_be_made_it_works_all_the_same(
    cache: Path, tmp_path: Path, square: ca.Function, monkeypatch: pytest.MonkeyPatch
) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocked))
    assert value(compiled([square])) == [9.0, 16.0, 7.0]


def test_a_cache_that_can_only_be_read_is_read(
    cache: Path, square: ca.Function, monkeypatch: pytest.MonkeyPatch
) -> None:
    compiled([square])
    monkeypatch.setattr(KernelCache, "is_writable", False)
    monkeypatch.setattr(kernel_cache, "private_folder", None)
    assert value(compiled([square])) == [9.0, 16.0, 7.0]


def test_without_a_compiler_the_result_is_none(
    empty_cache: Path, square: ca.Function, provide: Provide
) -> None:
    provide()
    assert compiled([square]) is None
    assert not empty_cache.exists()


@pytest.fixture
def some_library(monkeypatch: pytest.MonkeyPatch) -> None:
    """A foreign library for scripts to copy."""
    folder = Path(np.__file__).parent / "_core"
    monkeypatch.setenv("LIBRARY", str(next(folder.glob("_multiarray_umath*.so"))))


@pytest.mark.usefixtures("some_library")
@pytest.mark.parametrize(
    "script",
    [
        FAILS,
        "exit 0",
        'echo rubbish > "$output"',
        'mkdir "$output"',
        'head -c 20000 "$LIBRARY" > "$output"',
        'cp "$LIBRARY" "$output"',
    ],
    ids=["fails", "nothing", "rubbish", "folder", "truncated", "another library"],
)
def test_output_of_a_broken_compiler_is_neither_loaded_nor_kept(
    empty_cache: Path,
    square: ca.Function,
    provide: Provide,
    caplog: pytest.LogCaptureFixture,
    script: str,
) -> None:
    provide(cc=script)
    assert compiled([square]) is None
    assert "CasADi's virtual machine" in caplog.text
    assert list(empty_cache.iterdir()) == []


@pytest.mark.parametrize("script", [FAILS, "exit 0", 'echo rubbish > "$output"'])
def test_a_broken_compiler_does_not_hide_a_working_one(
    cache: Path, square: ca.Function, provide: Provide, script: str
) -> None:
    provide(cc=script, gcc=working())
    assert value(compiled([square])) == [9.0, 16.0, 7.0]
    assert len(libraries(cache)) == 1


def test_a_script_that_the_system_cannot_run_does_not_hide_a_working_one(
    cache: Path, square: ca.Function, provide: Provide, tmp_path: Path
) -> None:
    provide(cc=FAILS, gcc=working())
    (tmp_path / "bin" / "cc").write_text("#!/no/such/shell\n")
    assert value(compiled([square])) == [9.0, 16.0, 7.0]


def test_broken_compiler_is_tried_once(
    empty_cache: Path, square: ca.Function, provide: Provide, tmp_path: Path
) -> None:
    provide(cc=counting(tmp_path / "calls", FAILS))
    for _ in range(3):
        assert compiled([square]) is None
    assert count(tmp_path / "calls") == 1


def test_kept_libraries_do_not_depend_on_the_compiler(
    cache: Path, square: ca.Function, provide: Provide
) -> None:
    compiled([square])
    provide(cc=FAILS)
    assert value(compiled([square])) == [9.0, 16.0, 7.0]


WORKS_S = 6.0
"""A compiler that works has answered by then, beside other tests too; where it takes 0.05 s alone,
it has taken more than one second."""


@pytest.fixture
def short_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """How long compilers may take for a line: 1 s."""
    monkeypatch.setattr(compiler, "ANSWER_S", 1.0)


@pytest.mark.usefixtures("short_answer", "empty_cache")
def test_a_compiler_that_hangs_is_ended_with_its_children_and_remembered(
    square: ca.Function,
    provide: Provide,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    provide(cc=hanging(tmp_path / "children"))
    assert compiled([square]) is None
    assert "no answer within 1 s" in caplog.text
    assert ends(int((tmp_path / "children").read_text()))
    for _ in "here", "in the next process":
        assert compiled([square]) is None
        monkeypatch.setattr(machine_code, "_FAILED", set())
    assert count(tmp_path / "children") == 1
    assert [path.suffix for path in (tmp_path / "baxter-kin").iterdir()] == [".note"]


@pytest.mark.usefixtures("short_answer", "empty_cache")
def test_two_names_of_a_compiler_that_hangs_cost_its_time_once(
    square: ca.Function, provide: Provide, tmp_path: Path
) -> None:
    provide(cc=hanging(tmp_path / "children"), gcc=FAILS)
    (tmp_path / "bin" / "gcc").unlink()
    (tmp_path / "bin" / "gcc").symlink_to("cc")
    assert compiled([square]) is None
    assert count(tmp_path / "children") == 1


@pytest.mark.usefixtures("short_answer", "cache")
def test_hanging_compiler_is_tried_again_after_a_change(
    square: ca.Function, provide: Provide, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    works = working()
    provide(cc=hanging(tmp_path / "children"))
    assert compiled([square]) is None
    monkeypatch.setattr(machine_code, "_FAILED", set())
    monkeypatch.setattr(compiler, "ANSWER_S", WORKS_S)
    provide(cc=works)
    assert value(compiled([square])) == [9.0, 16.0, 7.0]


@pytest.mark.usefixtures("cache")
def test_a_compiler_that_hangs_does_not_hide_a_working_one(
    square: ca.Function, provide: Provide, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compiler, "ANSWER_S", WORKS_S)
    provide(cc=hanging(tmp_path / "children"), gcc=working())
    assert value(compiled([square])) == [9.0, 16.0, 7.0]


def test_machine_code_that_disagrees_is_neither_used_nor_kept(
    cache: Path, square: ca.Function, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = function_of(lambda x: x * x + 1e-6)
    monkeypatch.setattr(machine_code._Functions, "source", _dump(other))
    assert compiled([square]) is None
    assert libraries(cache) == []


def test_machine_code_of_another_shape_is_neither_used_nor_kept(
    cache: Path, square: ca.Function, monkeypatch: pytest.MonkeyPatch
) -> None:
    x = ca.SX.sym("x", 2)
    other = ca.Function("square", [x], [x * x])
    monkeypatch.setattr(machine_code._Functions, "source", _dump(other))
    assert compiled([square]) is None
    assert libraries(cache) == []


def _dump(function: ca.Function) -> str:
    generator = ca.CodeGenerator(function.name())
    generator.add(function)
    return str(generator.dump())


def test_compiling_is_logged_and_loading_is_not(
    cache: Path, square: ca.Function, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO):
        compiled([square])
    assert len(caplog.messages) == 1
    assert f"takes some seconds, once; kept in {cache}" in caplog.text
    caplog.clear()
    with caplog.at_level(logging.INFO):
        compiled([square])
    assert caplog.messages == []
