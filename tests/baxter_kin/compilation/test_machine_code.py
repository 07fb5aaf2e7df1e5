from __future__ import annotations

import logging
import os
import shlex
import shutil
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from baxter_kin.compilation import compiler, kernel_cache
from baxter_kin.compilation.kernel_cache import KernelCache
from baxter_kin.compilation.machine_code import compiled
from tests.baxter_kin.compilation.conftest import Compile, Provide
from tests.baxter_kin.compilation.test_compiler import ends

FAILS = "exit 3"


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "baxter-kin"


def function_of(formula: Callable[[ca.SX], ca.SX], *, has_sum: bool = True) -> ca.Function:
    x = ca.SX.sym("x", 2)
    return ca.Function("square", [x], [formula(x), ca.sum1(x)] if has_sum else [formula(x)])


SQUARE, CUBE = function_of(lambda x: x * x), function_of(lambda x: x**3)


@pytest.fixture(scope="session")
def compile_square(compile_once: Compile) -> str:
    """The script of a compiler that can compile `SQUARE` alone, in no time."""
    return f'cp {shlex.quote(str(compile_once(SQUARE)))} "$output"'


@pytest.fixture
def works(compile_square: str, provide: Provide) -> None:
    """The only compiler is that one."""
    provide(cc=compile_square)


def value(functions: tuple[ca.Function, ...] | None) -> list[float]:
    assert functions is not None
    squares, total = functions[0]([3.0, 4.0])
    return [*np.array(squares).ravel(), float(total)]


def libraries(cache: Path) -> list[Path]:
    return sorted(cache.glob("*.so"))


@pytest.mark.usefixtures("compile_once")
def test_several_functions_are_compiled_together_and_nothing_else_is_left(
    cache: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """With a real compiler."""
    x = ca.SX.sym("x", 2)
    both = [SQUARE, ca.Function("cubes", [x], [x**3, x])]
    with caplog.at_level(logging.INFO):
        found = compiled(both)
    assert value(found) == [9.0, 16.0, 7.0]
    assert found is not None
    assert np.array(found[1]([1.0, 2.0])[0]).ravel().tolist() == [1.0, 8.0]
    assert len(caplog.messages) == 1
    assert f"takes some seconds, once; kept in {cache}" in caplog.text
    assert [path.suffix for path in cache.iterdir()] == [".so"]
    caplog.clear()
    with caplog.at_level(logging.INFO):
        assert value(compiled(both)) == [9.0, 16.0, 7.0]
    assert caplog.messages == []


@pytest.mark.usefixtures("works")
def test_a_kept_library_is_used_whatever_the_compiler(cache: Path, provide: Provide) -> None:
    compiled([SQUARE])
    before = [(path, path.stat().st_mtime_ns) for path in libraries(cache)]
    provide(cc=FAILS)
    assert value(compiled([SQUARE])) == [9.0, 16.0, 7.0]
    assert [(path, path.stat().st_mtime_ns) for path in libraries(cache)] == before
    assert compiled([CUBE]) is None


@pytest.mark.usefixtures("works")
def test_further_kernels_are_compiled_once(
    cache: Path, compile_once: Compile, provide: Provide
) -> None:
    cube = f'cp {shlex.quote(str(compile_once(CUBE)))} "$output"'
    asked = []

    def alongside() -> list[list[ca.Function]]:
        asked.append(CUBE)
        provide(cc=cube)
        return [[CUBE]]

    assert value(compiled([SQUARE], alongside)) == [9.0, 16.0, 7.0]
    provide(cc=FAILS)
    assert value(compiled([SQUARE], alongside)) == [9.0, 16.0, 7.0]
    assert len(asked) == 1
    assert value(compiled([CUBE])) == [27.0, 64.0, 7.0]
    assert len(libraries(cache)) == 2


@pytest.mark.usefixtures("works")
@pytest.mark.parametrize("damage", [b"no library at all", None])
def test_a_damaged_library_is_compiled_anew(cache: Path, damage: bytes | None) -> None:
    """Loading a truncated one would kill the interpreter."""
    compiled([SQUARE])
    library = libraries(cache)[0]
    intact = library.read_bytes()
    library.unlink()  # it is mapped into this process; never write into it
    library.write_bytes(intact[: len(intact) // 2] if damage is None else damage)
    assert value(compiled([SQUARE])) == [9.0, 16.0, 7.0]
    assert len(libraries(cache)[0].read_bytes()) == len(intact)


@pytest.mark.usefixtures("works")
def test_an_intact_library_under_another_name_is_compiled_anew(
    cache: Path, compile_once: Compile
) -> None:
    compiled([SQUARE])
    library = libraries(cache)[0]
    library.unlink()
    shutil.copy(compile_once(CUBE), library)
    assert value(compiled([SQUARE])) == [9.0, 16.0, 7.0]


@pytest.mark.usefixtures("works")
def test_nothing_is_loaded_from_a_folder_that_others_may_write_to(
    cache: Path, caplog: pytest.LogCaptureFixture
) -> None:
    compiled([SQUARE])
    planted = libraries(cache)[0]
    os.utime(planted, ns=(0, 0))
    cache.chmod(0o777)
    for _ in range(2):
        assert value(compiled([SQUARE])) == [9.0, 16.0, 7.0]
    assert planted.stat().st_mtime_ns == 0
    assert len(libraries(cache)) == 1
    warned = [record for record in caplog.records if record.levelno == logging.WARNING]
    assert len(warned) == 1
    assert "for this process only" in warned[0].getMessage()


@pytest.mark.usefixtures("works")
def test_a_cache_that_can_only_be_read_is_read(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compiled([SQUARE])
    monkeypatch.setattr(KernelCache, "is_writable", False)
    monkeypatch.setattr(kernel_cache, "temporary_folder", None)
    assert value(compiled([SQUARE])) == [9.0, 16.0, 7.0]


def test_without_a_compiler_the_result_is_none(cache: Path, provide: Provide) -> None:
    provide()
    assert compiled([SQUARE]) is None
    assert not cache.exists()


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
def test_the_output_of_a_broken_compiler_is_neither_loaded_nor_kept(
    cache: Path, provide: Provide, caplog: pytest.LogCaptureFixture, script: str
) -> None:
    """Nor is the compiler tried again."""
    foreign = next((Path(np.__file__).parent / "_core").glob("_multiarray_umath*.so"))
    calls = cache.with_name("calls")
    provide(cc=f"echo called >> {calls}; LIBRARY={shlex.quote(str(foreign))}\n{script}")
    assert compiled([SQUARE]) is None
    assert "CasADi's virtual machine" in caplog.text
    assert list(cache.iterdir()) == []
    tried = calls.read_text()
    assert compiled([SQUARE]) is None
    assert calls.read_text() == tried


@pytest.mark.parametrize(
    "other",
    [
        function_of(lambda x: x * x + 1e-6),
        function_of(lambda x: x * x, has_sum=False),
    ],
    ids=["other values", "another shape"],
)
def test_machine_code_that_disagrees_is_neither_used_nor_kept(
    cache: Path, compile_once: Compile, provide: Provide, other: ca.Function
) -> None:
    provide(cc=f'cp {shlex.quote(str(compile_once(other)))} "$output"')
    assert compiled([SQUARE]) is None
    assert libraries(cache) == []


@pytest.mark.parametrize("script", [FAILS, "#!/no/such/shell"])
def test_a_broken_compiler_does_not_hide_a_working_one(
    cache: Path, compile_square: str, provide: Provide, tmp_path: Path, script: str
) -> None:
    provide(cc=script, gcc=compile_square)
    if script.startswith("#!"):
        (tmp_path / "bin" / "cc").write_text(script)
    assert value(compiled([SQUARE])) == [9.0, 16.0, 7.0]
    assert len(libraries(cache)) == 1


@pytest.mark.usefixtures("cache")
def test_a_compiler_that_hangs_is_ended_with_its_children_and_not_tried_again(
    compile_square: str,
    provide: Provide,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(compiler.Compiler.__init__, "__defaults__", (1.0,))
    children = tmp_path / "children"
    provide(cc=f"sleep 1000 & echo $! >> {shlex.quote(str(children))}; wait")
    for _ in range(2):
        assert compiled([SQUARE]) is None
    assert "timed out after 1" in caplog.text
    assert ends(int(children.read_text()))
    provide(cc="", gcc=compile_square)  # cc is known as broken
    assert value(compiled([SQUARE])) == [9.0, 16.0, 7.0]
