from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Arm
from planner import plan_joint_move
from planner.errors import MotionError
from planner.motion.joint_move import rest_to_rest_s

ROUNDING = 1e-6


@given(
    seed=st.integers(0, 2**32 - 1),
    nearness=st.floats(1e-4, 1.0),
    speed=st.floats(0.01, 3.0),
    jerk=st.floats(0.2, 200.0),
)
def test_it_is_the_duration_that_ruckig_finds(
    left: Arm, seed: int, nearness: float, speed: float, jerk: float
) -> None:
    rng = np.random.default_rng(seed)
    limits = replace(
        left.limits, v_max=left.limits.v_max * speed, j_max=left.limits.j_max * jerk / 20.0
    )
    start, other = left.random_configuration(rng), left.random_configuration(rng)
    goal = start + nearness * (other - start)
    expected = plan_joint_move(start, goal, limits).duration
    assert rest_to_rest_s(goal - start, limits) == pytest.approx(expected, rel=ROUNDING)


def test_many_ways_are_timed_at_once(left: Arm) -> None:
    rng = np.random.default_rng(1)
    ways = rng.uniform(-1.0, 1.0, (3, 4, 7))
    together = rest_to_rest_s(ways, left.limits)
    assert together.shape == (3, 4)
    assert together[2, 1] == rest_to_rest_s(ways[2, 1], left.limits)


def test_staying_takes_no_time(left: Arm) -> None:
    assert rest_to_rest_s(np.zeros(7), left.limits) == 0.0


@pytest.mark.parametrize("way", [np.zeros(6), 1.0, np.full(7, np.nan), "far"])
def test_what_is_no_displacement_is_refused(left: Arm, way: object) -> None:
    with pytest.raises(MotionError):
        rest_to_rest_s(way, left.limits)  # type: ignore[arg-type]
