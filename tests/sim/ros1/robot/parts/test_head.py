"""The head pans after its set-point and nods once."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.ros1.robot.parts.head import Head
from sim.ros1.robot.parts.joint_order import BadOrderError


@given(st.floats(-1.3963, 1.3963), st.integers(1, 100))
def test_is_a_first_order_element_of_a_fifth_of_a_second(angle: float, ticks: int) -> None:
    head = Head()
    head.pan(angle)
    for _ in range(ticks):
        head.step(0.01)
    assert head.pan_rad == pytest.approx(angle * (1 - math.exp(-ticks * 0.05)), abs=1e-12)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_never_looks_farther_than_its_joint_turns(angle: float) -> None:
    head = Head()
    head.pan(angle)
    head.step(10.0)
    assert abs(head.pan_rad) <= 1.3963
    assert not head.is_turning


def test_a_nod_takes_a_second_and_no_other_begins_meanwhile() -> None:
    head = Head()
    head.nod()
    seen = []
    for _ in range(150):
        seen.append(head.is_nodding)
        head.step(0.01)
        if head.is_nodding:
            head.nod()
    assert sum(seen) == pytest.approx(100, abs=1)
    assert not head.is_nodding


def test_refuses_an_angle_that_is_no_number_and_holds_on() -> None:
    head = Head()
    with pytest.raises(BadOrderError, match="got nan"):
        head.pan(math.nan)
    head.pan(1.0)
    head.step(0.1)
    head.hold()
    before = head.pan_rad
    head.step(5.0)
    assert head.pan_rad == before
