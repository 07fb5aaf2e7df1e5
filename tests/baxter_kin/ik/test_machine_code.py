from __future__ import annotations

import logging
import os
import stat
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from baxter_kin import Arm
from baxter_kin.ik import compiler
from baxter_kin.ik.compiler import ZIG, cache_folder, compiled, compiler_command
from baxter_kin.ik.kernel import bounds_of, search_function
from baxter_kin.ik.restarts import map_search_function
from baxter_kin.ik.seeds import NullSpaceMap


@pytest.fixture
def empty_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache of ours; that of `ziglang`, its own run-time library, takes 10 s to fill."""
    monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", str(cache_folder().with_name("zig")))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "baxter-kin"


@pytest.fixture
def cache(empty_cache: Path) -> Path:
    """The same, where there is a compiler."""
    if compiler_command() is None:
        pytest.skip("machine code needs a C compiler; pip install ziglang brings one")
    return empty_cache


@pytest.fixture
def square() -> ca.Function:
    x = ca.SX.sym("x", 2)
    return ca.Function("square", [x], [x * x, ca.sum1(x)])


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


def test_searches_give_the_same_as_in_the_virtual_machine(cache: Path, left: Arm) -> None:
    functions = search_function(left), map_search_function(left, NullSpaceMap(left))
    machine_code = compiled(functions)
    assert machine_code is not None
    rng = np.random.default_rng(0)
    for _ in range(50):
        T = left.T_base_tip(left.random_configuration(rng)).homogeneous
        inputs = (left.random_configuration(rng), T, bounds_of(left))
        for i, function in enumerate(functions):
            both = function(*inputs[i:]), machine_code[i](*inputs[i:])
            for expected, found in zip(*both, strict=True):
                np.testing.assert_allclose(np.array(found), np.array(expected), atol=1e-9)


def test_second_time_the_cached_library_is_used(cache: Path, square: ca.Function) -> None:
    compiled([square])
    written = libraries(cache)[0].stat().st_mtime_ns
    assert value(compiled([square])) == [9.0, 16.0, 7.0]
    assert libraries(cache)[0].stat().st_mtime_ns == written


def test_another_function_gets_another_file(cache: Path, square: ca.Function) -> None:
    x = ca.SX.sym("x", 2)
    compiled([square])
    compiled([ca.Function("square", [x], [x * x * x, ca.sum1(x)])])
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


def test_nothing_but_libraries_and_checksums_is_left(cache: Path, square: ca.Function) -> None:
    compiled([square])
    assert {path.suffix for path in cache.iterdir()} == {".so", ".sha256"}


def without_compilers_on_path(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(folder))


def with_package(folder: Path, monkeypatch: pytest.MonkeyPatch, program: str | None) -> None:
    """Let the package `ziglang` be that program, or none at all."""
    if program is None:
        monkeypatch.setattr(compiler, "find_spec", lambda _: None)
        return
    (folder / "ziglang").mkdir()
    (folder / "ziglang" / "__init__.py").touch()
    (folder / "ziglang" / "__main__.py").write_text(program)
    monkeypatch.setenv("PYTHONPATH", str(folder))
    monkeypatch.syspath_prepend(folder)


def test_without_a_compiler_there_is_none(
    empty_cache: Path, square: ca.Function, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    without_compilers_on_path(tmp_path, monkeypatch)
    with_package(tmp_path, monkeypatch, None)
    assert compiler_command() is None
    assert compiled([square]) is None


def test_without_a_compiler_on_path_the_package_ziglang_is_asked(
    empty_cache: Path, square: ca.Function, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = tmp_path / "said"
    program = f"import sys; open({str(said)!r}, 'w').write(' '.join(sys.argv[1:])); sys.exit(3)"
    without_compilers_on_path(tmp_path, monkeypatch)
    with_package(tmp_path, monkeypatch, program)
    assert compiler_command() == ZIG
    assert compiled([square]) is None
    assert said.read_text().startswith("cc -mcpu=baseline -g0 -O2 -fPIC -shared")


def test_a_compiler_that_fails_is_reported_and_not_fatal(
    empty_cache: Path,
    square: ca.Function,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    broken = tmp_path / "bin" / "cc"
    broken.parent.mkdir()
    broken.write_text("#!/bin/sh\nexit 3\n")
    broken.chmod(broken.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{broken.parent}{os.pathsep}{os.environ['PATH']}")
    with caplog.at_level(logging.WARNING):
        assert compiled([square]) is None
    assert "using CasADi's virtual machine" in caplog.text
    assert libraries(empty_cache) == []


def test_a_cache_that_cannot_be_written_is_not_fatal(
    tmp_path: Path, square: ca.Function, monkeypatch: pytest.MonkeyPatch
) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocked))
    assert compiled([square]) is None


def test_machine_code_that_disagrees_is_not_used(
    cache: Path, square: ca.Function, monkeypatch: pytest.MonkeyPatch
) -> None:
    x = ca.SX.sym("x", 2)
    other = ca.Function("square", [x], [x * x + 1e-6, ca.sum1(x)])
    monkeypatch.setattr(compiler, "_source", lambda _: _dump(other))
    assert compiled([square]) is None


def _dump(function: ca.Function) -> str:
    generator = ca.CodeGenerator(function.name())
    generator.add(function)
    return str(generator.dump())


def test_cache_folder_follows_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    assert cache_folder() == Path.home() / ".cache" / "baxter-kin"
