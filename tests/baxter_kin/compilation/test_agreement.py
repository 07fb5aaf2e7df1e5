from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from baxter_kin.compilation import agreement
from baxter_kin.compilation.agreement import AGREEMENT, agrees
from baxter_kin.compilation.compiler import compilers


def power(exponent: int, *, size: int = 2, off: float = 0.0) -> ca.Function:
    """A function that always has the same name."""
    x = ca.SX.sym("x", size)
    return ca.Function("power", [x], [x**exponent + off])


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The square of a vector, compiled."""
    if not compilers():
        pytest.skip("machine code needs a C compiler; pip install ziglang brings one")
    generator = ca.CodeGenerator("power")
    generator.add(power(2))
    folder = tmp_path_factory.mktemp("library")
    return compilers()[0].compile(str(generator.dump()), folder)


def test_a_library_of_the_same_function_agrees(library: Path) -> None:
    assert agrees([power(2)], str(library))


def test_differences_below_rounding_agree(library: Path) -> None:
    assert agrees([power(2, off=0.5 * AGREEMENT)], str(library))
    assert not agrees([power(2, off=2.0 * AGREEMENT)], str(library))


@pytest.mark.parametrize(
    "other", [power(3), power(2, size=3), power(2, off=np.nan), power(2, off=1e-6)], ids=str
)
def test_a_library_of_another_function_does_not_agree(library: Path, other: ca.Function) -> None:
    assert not agrees([other], str(library))


def test_a_library_without_the_function_does_not_agree(library: Path, tmp_path: Path) -> None:
    x = ca.SX.sym("x")
    assert not agrees([ca.Function("another", [x], [x])], str(library))
    assert not agrees([power(2)], str(tmp_path / "nowhere.so"))


@pytest.mark.parametrize(("exponent", "status"), [(2, 0), (3, 1)])
def test_the_program_exits_with_status_0_when_all_agree(
    library: Path, tmp_path: Path, exponent: int, status: int
) -> None:
    saved = tmp_path / "power.casadi"
    power(exponent).save(str(saved))
    command = [sys.executable, agreement.__file__, str(library), str(saved)]
    assert subprocess.run(command, check=False, timeout=60).returncode == status
