"""Response: what an arm may be said to do, and what it is sent."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Arm
from planner import Response, Trajectory, plan_joint_move
from planner.errors import ResponseError
from planner.motion.response import left_over

ROUNDING = 1e-12


@pytest.fixture(scope="module")
def move(left: Arm) -> Trajectory:
    return plan_joint_move(left.neutral, left.start, left.limits)


def test_one_pair_and_one_error_stand_for_all_joints() -> None:
    response = Response((0.3, 0.5), 0.001)
    assert response.lag_s.tolist() == [[0.3, 0.5]] * 7
    assert response.settled_error_rad.tolist() == [0.001] * 7


def test_each_joint_may_have_its_own() -> None:
    lags = [[0.1 * k, 0.1 * k + 0.05] for k in range(7)]
    response = Response(lags, np.linspace(0.0, 0.01, 7))
    assert response.lag_s.tolist() == lags
    assert response.settled_error_rad[-1] == 0.01


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"lag_s": (0.5, 0.3)}, "least and greatest"),
        ({"lag_s": (-0.1, 0.3)}, "least and greatest"),
        ({"lag_s": (300.0, 500.0)}, "from 0 to 5 s"),
        ({"lag_s": 0.4}, "shape"),
        ({"lag_s": (0.3, float("nan"))}, "finite"),
        ({"settled_error_rad": -1e-3}, "from 0 to 0.2 rad"),
        ({"settled_error_rad": 1.0}, "from 0 to 0.2 rad"),
        ({"settled_error_rad": [0.0] * 6}, "shape"),
        ({"speed": 0.0}, "above 0"),
        ({"speed": 1.1}, "at most 1"),
        ({"speed": True}, "speed"),
        ({"lead_s": -0.1}, "from 0 to 1 s"),
        ({"late_s": 20.0}, "from 0 to 1 s"),
    ],
)
def test_refuses_what_no_arm_does(given: dict[str, Any], said: str) -> None:
    with pytest.raises(ResponseError, match=said):
        Response(**{"lag_s": (0.3, 0.5), **given})


@given(speed=st.floats(0.05, 1.0), share=st.floats(0.0, 1.0))
def test_a_set_point_is_the_plan_slowed_down(move: Trajectory, speed: float, share: float) -> None:
    t_s = share * move.duration / speed
    sent = Response((0.0, 0.0), speed=speed).command(move, t_s)
    planned = move.sample(speed * t_s)
    assert sent.q.tolist() == planned.q.tolist()
    np.testing.assert_allclose(sent.v, speed * planned.v, atol=ROUNDING)


@given(speed=st.floats(0.05, 1.0), lead_s=st.floats(0.0, 1.0), share=st.floats(0.0, 1.0))
def test_the_lead_is_along_the_velocity_within_the_limits(
    move: Trajectory, speed: float, lead_s: float, share: float
) -> None:
    sent = Response((0.0, 0.0), speed=speed, lead_s=lead_s).command(
        move, share * move.duration / speed
    )
    planned = move.sample(speed * (share * move.duration / speed))
    free = planned.q + lead_s * sent.v
    limits = move.limits
    assert (sent.q >= limits.q_min).all()
    assert (sent.q <= limits.q_max).all()
    inside = (free >= limits.q_min) & (free <= limits.q_max)
    np.testing.assert_allclose(sent.q[inside], free[inside], atol=ROUNDING)


def test_a_led_plan_is_followed_by_the_joint_of_that_lag(move: Trajectory) -> None:
    """u = q + L q' is solved by q itself: checked by differences of what is sent."""
    t_s = np.linspace(0.0, move.duration / 0.5, 2001)
    sent = Response((0.4, 0.4), speed=0.5, lead_s=0.4).command(move, t_s)
    q = move.sample(0.5 * t_s).q
    slope = np.gradient(q, t_s, axis=0)
    is_free = (sent.q > move.limits.q_min).all(1) & (sent.q < move.limits.q_max).all(1)
    np.testing.assert_allclose((sent.q - q)[is_free] / 0.4, slope[is_free], atol=1e-3)


def test_after_its_end_the_motion_rests(move: Trajectory) -> None:
    sent = Response((0.4, 0.4), speed=0.5, lead_s=0.3).command(move, [1e3])
    assert sent.q.tolist() == [move.q_goal.tolist()]
    assert np.abs(sent.v).max() == 0.0


def test_is_shown_in_one_line() -> None:
    assert repr(Response((0.35, 0.45), 0.001, 0.3, 0.4)) == (
        "Response(lag 0.35 .. 0.45 s, error 0.001 rad, speed 0.3, lead 0.40 s, 20 ms late)"
    )


def test_lags_however_short_leave_nothing_over() -> None:
    least = np.nextafter(0.0, 1.0)
    assert left_over(0.01, np.array([0.0, least, 1e-300])).tolist() == [0.0, 0.0, 0.0]
    assert left_over(0.0, np.array([0.0, least, 0.4])).tolist() == [1.0, 1.0, 1.0]
