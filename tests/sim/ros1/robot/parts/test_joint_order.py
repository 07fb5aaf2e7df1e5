"""Joint orders: a message is taken whole or ignored whole."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin.kinematics.arm import JOINTS
from sim.ros1.robot.parts.joint_order import BadOrderError, JointMode, JointOrder

NAMES = tuple(f"left_{joint}" for joint in JOINTS)
NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
ORDERS = st.lists(st.tuples(st.sampled_from(NAMES), NUMBERS), unique_by=lambda pair: pair[0])


@given(ORDERS, st.sampled_from([1, 2, 4]))
def test_takes_any_joints_in_any_order(pairs: list[tuple[str, float]], mode: int) -> None:
    order = JointOrder.of(NAMES, mode, [n for n, _ in pairs], [v for _, v in pairs])
    assert order.mode == mode
    assert {NAMES[index]: value for index, value in order.values} == dict(pairs)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_rejects_what_is_not_finite_and_names_the_joint(bad: float) -> None:
    with pytest.raises(BadOrderError, match=r"left_e1 = -?(nan|inf)"):
        JointOrder.of(NAMES, 1, ["left_s0", "left_e1"], [0.0, bad])


@pytest.mark.parametrize(
    ("names", "values", "said"),
    [
        (["right_s0"], [0.0], "'right_s0' is no joint"),
        (["left_s0", "left_s0"], [0.0, 0.1], "left_s0 comes twice"),
        (["left_s0"], [0.0, 0.1], "1 names came with 2 values"),
        (["left_s0", "left_s1"], [0.0], "2 names came with 1 values"),
    ],
)
def test_rejects_joints_that_make_no_sense(
    names: list[str], values: list[float], said: str
) -> None:
    with pytest.raises(BadOrderError, match=said):
        JointOrder.of(NAMES, 1, names, values)


def test_refuses_torques_and_unknown_modes() -> None:
    with pytest.raises(BadOrderError, match=r"mode 3 \(torque\) is not simulated"):
        JointOrder.of(NAMES, 3, ["left_s0"], [1.0])
    for mode in (0, 5, -1, 2**31 - 1):
        with pytest.raises(BadOrderError, match=f"mode {mode} is unknown"):
            JointOrder.of(NAMES, mode, ["left_s0"], [1.0])


def test_no_joints_are_an_order_that_asks_nothing() -> None:
    assert JointOrder.of(NAMES, 1, [], []) == JointOrder(JointMode.POSITION, ())


def test_is_shown_in_one_line() -> None:
    assert repr(JointOrder.of(NAMES, 2, ["left_s1"], [0.5])) == "JointOrder(velocity, 1: 0.5)"
