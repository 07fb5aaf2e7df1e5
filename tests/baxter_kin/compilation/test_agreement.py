from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from baxter_kin.compilation import agreement
from baxter_kin.compilation.agreement import AGREEMENT, agrees
from tests.baxter_kin.compilation.conftest import Compile


def power(exponent: int, *, size: int = 2, off: float = 0.0, name: str = "power") -> ca.Function:
    x = ca.SX.sym("x", size)
    return ca.Function(name, [x], [x**exponent + off])


@pytest.fixture(scope="module")
def library(compile_once: Compile) -> Path:
    """The square of a vector, compiled."""
    return compile_once(power(2))


@pytest.mark.parametrize(
    ("other", "is_same"),
    [
        (power(2), True),
        (power(2, off=0.5 * AGREEMENT), True),
        (power(2, off=2.0 * AGREEMENT), False),
        (power(2, off=np.nan), False),
        (power(3), False),
        (power(2, size=3), False),
        (power(2, name="another"), False),
    ],
    ids=str,
)
def test_only_a_library_of_the_same_function_agrees(
    library: Path, other: ca.Function, is_same: bool
) -> None:
    assert agrees([other], str(library)) == is_same


def test_a_library_that_does_not_load_does_not_agree(tmp_path: Path) -> None:
    assert not agrees([power(2)], str(tmp_path / "nowhere.so"))


@pytest.mark.parametrize(("exponent", "status"), [(2, 0), (3, 1)])
def test_the_program_exits_with_status_0_when_all_agree(
    library: Path, tmp_path: Path, exponent: int, status: int
) -> None:
    saved = tmp_path / "power.casadi"
    power(exponent).save(str(saved))
    command = [sys.executable, agreement.__file__, str(library), str(saved)]
    assert subprocess.run(command, check=False, timeout=60).returncode == status
