from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin.ik.redundancy.root_finding import least, root


@given(where=st.floats(0.01, 0.99), power=st.sampled_from([1, 3]))
def test_root_is_found(where: float, power: int) -> None:
    found = root(lambda x: (x - where) ** power, 0.0, 1.0)
    flat = 1e-3 if power == 3 else 1e-9  # where the function is within 1e-12 of zero
    assert found == pytest.approx(where, abs=flat)


def test_root_at_the_lower_end_is_found() -> None:
    assert root(lambda x: x, 0.0, 1.0) == 0.0


@pytest.mark.parametrize(("lower", "upper"), [(0.6, 1.0), (0.0, 0.4), (1.0, 0.0)])
def test_no_change_from_negative_to_positive_is_no_root(lower: float, upper: float) -> None:
    assert root(lambda x: x - 0.5, lower, upper) is None


@given(where=st.floats(0.0, 1.0))
def test_least_value_is_found(where: float) -> None:
    value, x = least(lambda x: math.fabs(x - where), 0.0, 1.0, 1e-9)
    assert x == pytest.approx(where, abs=1e-9)
    assert value == math.fabs(x - where)
