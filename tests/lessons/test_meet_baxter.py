"""The checks of notebook 1: every right answer passes, typical mistakes get their sentence."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Baxter
from baxter_kin.frames import T_world_base
from lessons.meet_baxter import CUP_WORLD, check_bend, check_cup, check_rise
from tests.lessons.told import assert_told

ROBOT = Baxter.load()
ARM = ROBOT.arm("left")
T_BASE_TIP = ARM.T_base_tip(ARM.neutral)
T_WORLD_TIP = T_world_base() * T_BASE_TIP
CUP = np.array(CUP_WORLD)
SEEN = T_WORLD_TIP.actInv(CUP)
J = ARM.jacobian(ARM.neutral)
LEFT_OVER = np.linalg.svd(J)[2][-1]
UP = np.array([0.0, 0.0, 0.05, 0.0, 0.0, 0.0])
RISE = np.linalg.pinv(J) @ UP


@pytest.mark.parametrize("answer", [1.868, 1.87, np.float64(1.868), [1.868]])
def test_the_bend_may_be_rounded(answer: Any) -> None:
    assert check_bend(answer).is_right


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        (107.03, "in degrees"),
        (0.8, "to the lowest angle"),
        (2.618, "the highest angle itself"),
        (-1.868, "sign"),
        (1.047 + 0.55, "left_s1, not of left_e1"),
        (2.094 - 1.26, "left_w1, not of left_e1"),
        (1.0, r"arm\.limits\.q_max"),
        (ARM.neutral, r"shape \(7,\)"),
        ("1.868", "it is '1.868'"),
    ],
)
def test_a_wrong_bend_is_explained(answer: Any, told: str) -> None:
    assert_told(check_bend(answer), told)


@pytest.mark.parametrize("answer", [SEEN, SEEN.round(3), tuple(SEEN), list(SEEN), SEEN[:, None]])
def test_the_cup_may_come_in_any_form(answer: Any) -> None:
    assert check_cup(answer).is_right


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        (1e3 * SEEN, "millimetres"),
        (CUP, "where world sees it"),
        (T_world_base().actInv(CUP), "where base sees it"),
        (T_WORLD_TIP.act(CUP), "the wrong way"),
        (T_BASE_TIP.actInv(CUP), "as if it were given in base"),
        (T_BASE_TIP.actInv(T_world_base().act(CUP)), "world and base are the wrong way"),
        (CUP - T_WORLD_TIP.translation, "along the axes of base"),
        ((T_world_base() * ROBOT.arm("right").T_base_tip(ROBOT.arm("right").neutral)).actInv(CUP),
         "right hand"),
        (pin.SE3.Identity(), r"\.translation"),
        ((0.1, 0.2), r"shape \(2,\)"),
        ((0.0, 0.0, 0.0), "inner names cancel"),
    ],
)  # fmt: skip
def test_a_wrong_point_is_explained(answer: Any, told: str) -> None:
    assert_told(check_cup(answer), told)


@given(st.floats(-0.9, 0.9))
def test_any_velocity_that_lifts_the_hand_is_right(share: float) -> None:
    assert check_rise(RISE + share * LEFT_OVER).is_right


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        (np.degrees(RISE), "degrees per second"),
        (100.0 * RISE, "100 times too fast"),
        (1000.0 * RISE, "1,000 times too fast"),
        (-RISE, "sinks"),
        (np.linalg.pinv(J) @ np.roll(UP, 3), "linear comes first"),
        (
            np.linalg.pinv(J) @ np.append(0.05 * T_BASE_TIP.rotation[:, 2], np.zeros(3)),
            "own z axis",
        ),
        (RISE[::-1], "wrong order"),
        (np.linalg.pinv(J[:3]) @ UP[:3], "but turns at"),
        (RISE + 9.0 * LEFT_OVER, "faster than its limit"),
        (UP, "those of the seven joints"),
        (np.zeros(7), r"moves at \(0\.00, 0\.00, 0\.00\)"),
    ],
)
def test_a_wrong_velocity_is_explained(answer: Any, told: str) -> None:
    assert_told(check_rise(answer), told)
