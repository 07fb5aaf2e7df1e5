"""The kernel in C."""

from __future__ import annotations

import pytest

from planner.prover.kernel import Kernel, rows_kernel


@pytest.fixture(scope="session")
def own_kernel() -> Kernel:
    found = rows_kernel()
    assert found is not None, "the tests need a C compiler"
    return found
