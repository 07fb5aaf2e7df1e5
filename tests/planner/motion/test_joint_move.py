"""The fastest motion between two states, and every trap of the library that computes it."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import planner.motion.joint_move
from baxter_kin import Arm, JointLimits
from baxter_kin.errors import ConfigurationError
from baxter_kin.fields import evolve
from baxter_kin.frames import raised
from planner import (
    Manipulator,
    PickAndPlace,
    Plan,
    Scene,
    Trajectory,
    plan_free_move,
    plan_joint_move,
    plan_pick_and_place,
    plan_retract,
    plan_start_move,
    plan_straight_move,
    verify,
)
from planner.errors import MotionError
from planner.motion.joint_move import (
    MAX_CLIP_RAD,
    MAX_MOTION_S,
    POSITION_TOLERANCE_RAD,
    RATIO_TOLERANCE,
    rest_to_rest_s,
)
from tests.conftest import overhead

TIME_TOLERANCE_S = 1e-9
"""Ruckig solves polynomials of degree six; its times are good to about 1e-12 of some seconds."""

ROUNDING_RAD = 1e-9

REST_TIME_ROUNDING = 1e-6
"""Relative, of a closed form against the polynomials of Ruckig."""

seeds = st.integers(0, 2**32 - 1)
FloatArray = NDArray[np.float64]


def least_time_s(distance: float, v: float, a: float, j: float) -> float:
    """Shortest time of one joint from rest to rest, in closed form.

    Acceleration rises, holds and falls; so does deceleration, with a cruise between them if the
    distance is long enough. See Biagiotti and Melchiorri 2008, section 3.4 (double S profile).
    """
    d = abs(distance)
    ramp_s = 2 * math.sqrt(v / j) if v * j < a * a else v / a + a / j
    if d >= v * ramp_s:
        return 2 * ramp_s + (d - v * ramp_s) / v
    if d >= 2 * a**3 / j**2:
        return a / j + math.sqrt((a / j) ** 2 + 4 * d / a)
    return float(4 * (d / (2 * j)) ** (1 / 3))


def slowest_joint_s(q_start: FloatArray, q_goal: FloatArray, limits: JointLimits) -> float:
    rows = zip(q_goal - q_start, limits.v_max, limits.a_max, limits.j_max, strict=True)
    return max(least_time_s(*map(float, row)) for row in rows)


def inside(limits: JointLimits, rng: np.random.Generator, margin: float = 0.0) -> FloatArray:
    span = limits.q_max - limits.q_min
    return rng.uniform(limits.q_min + margin * span, limits.q_max - margin * span)


def with_rates(limits: JointLimits, v: Any, a: Any, j: Any) -> JointLimits:
    return JointLimits(limits.names, limits.q_min, limits.q_max, v, a, j)


def one_joint(v: float = 1.0, a: float = 2.0, j: float = 20.0) -> JointLimits:
    q_max, v_max, a_max, j_max = (np.array([x]) for x in (3.0, v, a, j))
    return JointLimits(("elbow",), -q_max, q_max, v_max, a_max, j_max)


def assert_within_limits(motion: Trajectory) -> None:
    assert max(motion.peak_ratios()) <= 1.0 + RATIO_TOLERANCE
    low, high = motion.position_extrema()
    assert (low >= motion.limits.q_min - POSITION_TOLERANCE_RAD).all()
    assert (high <= motion.limits.q_max + POSITION_TOLERANCE_RAD).all()


@given(seeds)
def test_any_move_from_rest_to_rest_keeps_every_limit_and_never_overshoots(
    arm: Arm, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    q_start, q_goal = inside(arm.limits, rng), inside(arm.limits, rng)
    still = rng.random(7) < 0.2
    q_goal[still] = q_start[still]
    motion = plan_joint_move(q_start, q_goal, arm.limits)
    assert_within_limits(motion)
    for t, q in ((0.0, q_start), (motion.duration, q_goal)):
        state = motion.sample(t)
        assert state.q.tolist() == q.tolist()
        assert not state.v.any()
        assert not state.a.any()
    low, high = motion.position_extrema()
    assert low == pytest.approx(np.minimum(q_start, q_goal), abs=ROUNDING_RAD)
    assert high == pytest.approx(np.maximum(q_start, q_goal), abs=ROUNDING_RAD)
    assert np.abs([low - q_start, high - q_start])[:, still].max(initial=0.0) <= 1e-15
    again = plan_joint_move(q_start, q_goal, arm.limits)
    assert all(
        getattr(motion, name).tolist() == getattr(again, name).tolist()
        for name in ("knots_s", "q", "v", "a", "j")
    )


@given(seeds)
def test_duration_is_least_under_any_limits(left: Arm, seed: int) -> None:
    rng = np.random.default_rng(seed)
    limits = left.limits
    if seed % 2:
        limits = with_rates(left.limits, *10.0 ** rng.uniform(-1.5, 1.5, (3, 7)))
    q_start, q_goal = inside(limits, rng), inside(limits, rng)
    motion = plan_joint_move(q_start, q_goal, limits)
    expected = slowest_joint_s(q_start, q_goal, limits)
    assert motion.duration == pytest.approx(expected, rel=TIME_TOLERANCE_S)
    assert_within_limits(motion)


@given(seeds)
def test_with_equal_limits_the_joints_move_along_a_straight_line(left: Arm, seed: int) -> None:
    rng = np.random.default_rng(seed)
    limits = with_rates(left.limits, np.full(7, 1.5), np.full(7, 2.0), np.full(7, 20.0))
    q_start, q_goal = inside(limits, rng), inside(limits, rng)
    motion = plan_joint_move(q_start, q_goal, limits)
    q = motion.sample(np.linspace(0.0, motion.duration, 101)).q
    way = q_goal - q_start
    share = (q - q_start) @ way / (way @ way)
    assert q == pytest.approx(q_start + share[:, None] * way, abs=ROUNDING_RAD)


@given(seeds, st.floats(-17.0, -2.0))
def test_tiny_moves_keep_every_limit_and_end_exactly(left: Arm, seed: int, power: float) -> None:
    rng = np.random.default_rng(seed)
    q_start = inside(left.limits, rng, margin=0.1)
    q_goal = q_start + 10.0**power * rng.uniform(-1.0, 1.0, 7)
    motion = plan_joint_move(q_start, q_goal, left.limits)
    assert_within_limits(motion)
    assert motion.q_goal.tolist() == q_goal.tolist()
    if power > -11.0:
        expected = slowest_joint_s(q_start, q_goal, left.limits)
        assert motion.duration == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("distance", [1e-15, 1e-100, 5e-324])
def test_a_move_smaller_than_rounding_takes_no_time(left: Arm, distance: float) -> None:
    motion = plan_joint_move(np.zeros(7), np.full(7, distance), left.limits)
    assert motion.duration == 0.0
    assert motion.q_goal.tolist() == [distance] * 7


@pytest.mark.parametrize("speed", [0.0, 0.1])
def test_a_move_to_where_the_arm_is_takes_no_time(left: Arm, speed: float) -> None:
    v, q = np.full(7, speed), left.neutral
    motion = plan_joint_move(q, q, left.limits, v_start=v, v_goal=v)
    assert motion.duration == 0.0
    assert motion.sample(0.0).v.tolist() == v.tolist()
    assert motion.q_goal.tolist() == q.tolist()
    assert motion.peak_ratios() == (speed / left.limits.v_max.min(), 0.0, 0.0)


@given(seeds, st.sampled_from([1.0, 0.5, 0.1, 1e-3, 1e-9]))
def test_states_in_motion_meet_every_limit_or_are_refused(
    left: Arm, seed: int, scale: float
) -> None:
    rng = np.random.default_rng(seed)
    limits = left.limits
    q_start, q_goal = (inside(limits, rng, margin=0.2) for _ in range(2))
    v_start, v_goal = (scale * rng.uniform(-1, 1, 7) * limits.v_max for _ in range(2))
    a_start, a_goal = (scale * rng.uniform(-1, 1, 7) * limits.a_max for _ in range(2))
    try:
        motion = plan_joint_move(
            q_start, q_goal, limits, v_start=v_start, a_start=a_start, v_goal=v_goal, a_goal=a_goal
        )
    except MotionError:
        return
    assert_within_limits(motion)
    first, last = motion.sample(0.0), motion.sample(motion.duration)
    for state, expected in (
        (first, (q_start, v_start, a_start)),
        (last, (q_goal, v_goal, a_goal)),
    ):
        assert [values.tolist() for values in state] == [values.tolist() for values in expected]


@given(seeds)
def test_slow_states_in_motion_well_inside_the_limits_are_always_joined(
    left: Arm, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    limits = left.limits
    q_start, q_goal = (inside(limits, rng, margin=0.3) for _ in range(2))
    v_start, v_goal = (0.2 * rng.uniform(-1, 1, 7) * limits.v_max for _ in range(2))
    assert_within_limits(plan_joint_move(q_start, q_goal, limits, v_start=v_start, v_goal=v_goal))


@pytest.mark.parametrize("excess", [0.0, 1e-16, RATIO_TOLERANCE])
@pytest.mark.parametrize("which", ["v_start", "v_goal"])
def test_a_speed_above_the_limit_by_rounding_is_moved_inside_it(
    left: Arm, which: str, excess: float
) -> None:
    v: Any = np.zeros(7)
    v[3] = left.limits.v_max[3] * (1 + excess)
    motion = plan_joint_move(left.neutral, left.start, left.limits, **{which: v})
    assert_within_limits(motion)
    reached = motion.v[0 if which == "v_start" else -1]
    assert reached == pytest.approx(v, rel=RATIO_TOLERANCE, abs=0.0)


@pytest.mark.parametrize("less", [0.0, 1e-12, 1e-9])
@pytest.mark.parametrize("which", ["start", "goal"])
def test_a_speed_that_reaches_its_limit_when_the_acceleration_ends_costs_no_time(
    left: Arm, which: str, less: float
) -> None:
    """1.499 rad/s at 0.2 rad/s^2 come to 1.5 rad/s with 20 rad/s^3, the limit; or come from it."""
    v, a, q_start, q_goal = np.zeros(7), np.zeros(7), left.neutral.copy(), left.neutral.copy()
    v[0], a[0] = 1.499 - less, 0.2 if which == "start" else -0.2
    q_start[0], q_goal[0] = -1.5, 1.5
    rates: dict[str, Any] = {f"v_{which}": v, f"a_{which}": a}
    motion = plan_joint_move(q_start, q_goal, left.limits, **rates)
    assert motion.duration == pytest.approx(2.425002, abs=1e-6)
    assert_within_limits(motion)


def test_an_arm_that_is_where_it_shall_be_may_still_have_rates_of_rounding(left: Arm) -> None:
    v = np.zeros(7)
    v[0] = 6e-17
    assert plan_joint_move(left.neutral, left.neutral, left.limits, v_start=v).duration < 1e-8
    q = [-0.17278714, 0.08203635, -1.79600434, 1.06796589, -1.54676486, 0.59718264, -0.83015473]
    v = np.array([-4.48e-17, 4.38e-17, -5.29e-17, -1.43e-17, -8.43e-18, -1.34e-18, 5.72e-17])
    a = np.array([5.51e-16, -3.82e-16, -4.60e-16, 7.26e-16, 7.65e-16, 2.14e-17, -3.11e-16])
    assert plan_joint_move(q, q, left.limits, v_start=v, a_start=a).duration < 1e-8


@pytest.mark.parametrize("distance", [1e-12, -1e-9, 1e-17])
def test_a_state_and_its_mirror_image_are_joined_without_a_crash(distance: float) -> None:
    """Ruckig 0.19 finds more profiles than its array holds: the whole process ended."""
    v, a = 0.1911652819600179, -6.1251263179504924
    limits = one_joint(v, 7.764963490403938, 98.12757846557213)
    motion = plan_joint_move(
        [0.0], [distance], limits, v_start=[v], a_start=[a], v_goal=[-v], a_goal=[a]
    )
    assert motion.duration > 0.0
    assert_within_limits(motion)


REPLANNED_S = 1e-6
"""By how much planning again from a sample may lengthen a motion."""

BRIEF_S = 1e-3
"""In the last millisecond, correcting the rounding of a position takes a part of the time."""


@pytest.mark.parametrize("seed", range(12))
def test_a_loop_that_plans_again_from_samples_ends_when_the_first_plan_does(
    left: Arm, seed: int
) -> None:
    assert_planned_again(left, seed, REPLANNED_S)


def assert_planned_again(left: Arm, seed: int, longer_s: float) -> None:
    rng = np.random.default_rng(seed)
    motion = plan_joint_move(inside(left.limits, rng), inside(left.limits, rng), left.limits)
    left_s = motion.duration
    for _ in range(4):
        step_s = rng.uniform(0.0, motion.duration) if rng.random() < 0.5 else 0.01
        state = motion.sample(min(step_s, motion.duration))
        left_s = max(left_s - step_s, 0.0)
        motion = plan_joint_move(
            state.q, motion.q_goal, left.limits, v_start=state.v, a_start=state.a
        )
        assert motion.duration <= left_s + longer_s or motion.duration < BRIEF_S
        assert_within_limits(motion)
        for before, after in zip(state, motion.sample(0.0), strict=True):
            assert after == pytest.approx(before, rel=RATIO_TOLERANCE, abs=1e-14)


@given(seeds)
def test_a_moving_start_on_the_boundary_of_what_can_stay_in_the_limits_costs_no_time(
    left: Arm, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    limits = left.limits
    q_start, q_goal = (inside(limits, rng, margin=0.25) for _ in range(2))
    a = rng.uniform(0.0, 0.5, 7) * limits.a_max * rng.choice([-1.0, 1.0], 7)
    v = 0.3 * rng.uniform(-1.0, 1.0, 7) * limits.v_max
    for i in np.flatnonzero(rng.random(7) < 0.5):
        v[i] = np.sign(a[i]) * (limits.v_max[i] - a[i] ** 2 / (2 * limits.j_max[i]))
    roomy = evolve(limits, q_min=limits.q_min - 10.0, q_max=limits.q_max + 10.0)
    motion = plan_joint_move(q_start, q_goal, roomy, v_start=v, a_start=a)
    slower = plan_joint_move(q_start, q_goal, roomy, v_start=v * (1 - 1e-9), a_start=a)
    assert motion.duration <= slower.duration + REPLANNED_S
    assert_within_limits(motion)


ELBOW = one_joint()


@pytest.mark.parametrize(
    ("ends", "options", "reason"),
    [
        (([2.95], [0.0]), {"v_start": [1.0]}, r"elbow = 3\.\d+ rad is outside -3 \.\. 3"),
        (([-3.0], [-2.99]), {"v_goal": [0.9]}, "elbow"),
        (([0.0], [1.0]), {"v_start": [1.0], "a_start": [2.0]}, r"elbow|velocity 1\.\d+ x"),
        *(
            (([0.0], [0.0]), {which: [1.0 + 2.0 * RATIO_TOLERANCE]}, f"{which} asks 1.00.* elbow")
            for which in ("v_start", "v_goal")
        ),
        *(
            (([0.0], [0.0]), {which: [-2.5]}, f"{which} asks -2.5 of elbow, whose limit is 2")
            for which in ("a_start", "a_goal")
        ),
        (([-1.0], [1.0]), {"limits": one_joint(v=1e-4)}, r"elbow needs at least 2e\+04 s"),
        (([-1.0], [1.0]), {"limits": one_joint(a=1e-9)}, f"longer than {MAX_MOTION_S:g} s"),
        *((([0.0], [1.0]), {"limits": bad}, "limits") for bad in list[Any]([None, "limits", []])),
    ],
)
def test_motions_that_break_a_limit_are_refused(
    ends: tuple[Any, Any], options: dict[str, Any], reason: str
) -> None:
    with pytest.raises(MotionError, match=reason):
        plan_joint_move(*ends, **{"limits": ELBOW, **options})


BAD_VECTORS: list[Any] = [
    *([0.0] * 6, [0.0] * 8, [[0.0] * 7], [np.nan] * 7, [np.inf] * 7, "fast", [], 0.0, [None] * 7),
    *(["0"] * 7, [1j] * 7, [10**400] * 7),
]


@pytest.mark.parametrize("which", ["q_start", "q_goal", "v_start", "a_start", "v_goal", "a_goal"])
def test_malformed_states_are_refused_by_name(left: Arm, which: str) -> None:
    error = ConfigurationError if which.startswith("q") else MotionError
    outside = [[0.0, 0.0, 0.0, 2.7, 0.0, 0.0, 0.0], None] if which.startswith("q") else []
    for bad in (*BAD_VECTORS, *outside):
        ends = {"q_start": left.neutral, "q_goal": left.start, which: bad}
        with pytest.raises(error, match=which):
            plan_joint_move(limits=left.limits, **ends)


@pytest.mark.parametrize("scale", [1e-300, 1e-10, 1e10, 1e300])
@pytest.mark.parametrize("which", [0, 1, 2])
def test_absurd_limits_are_kept_or_refused(left: Arm, scale: float, which: int) -> None:
    rates = [left.limits.v_max, left.limits.a_max, left.limits.j_max]
    rates[which] = scale * rates[which]
    try:
        motion = plan_joint_move(left.neutral, left.start, with_rates(left.limits, *rates))
    except MotionError as refusal:
        reason = str(refusal)
    else:
        reason = ""
        assert_within_limits(motion)
    assert "\n" not in reason
    assert "left_" in reason or scale > 1e-300


def test_no_waypoints_are_ever_handed_to_ruckig_which_would_post_them_to_a_server() -> None:
    source = Path(planner.motion.joint_move.__file__).read_text(encoding="utf-8")
    assert "intermediate_positions" not in source


class TestRestTime:
    """How long the fastest motion from rest to rest takes, in closed form."""

    @given(
        seed=st.integers(0, 2**32 - 1),
        nearness=st.floats(1e-4, 1.0),
        speed=st.floats(0.01, 3.0),
        jerk=st.floats(0.2, 200.0),
    )
    def test_it_is_the_duration_that_ruckig_finds(
        self, left: Arm, seed: int, nearness: float, speed: float, jerk: float
    ) -> None:
        rng = np.random.default_rng(seed)
        limits = evolve(
            left.limits, v_max=left.limits.v_max * speed, j_max=left.limits.j_max * jerk / 20.0
        )
        start, other = left.random_configuration(rng), left.random_configuration(rng)
        goal = start + nearness * (other - start)
        expected = plan_joint_move(start, goal, limits).duration
        assert rest_to_rest_s(goal - start, limits) == pytest.approx(
            expected, rel=REST_TIME_ROUNDING
        )

    def test_many_ways_are_timed_at_once(self, left: Arm) -> None:
        rng = np.random.default_rng(1)
        ways = rng.uniform(-1.0, 1.0, (3, 4, 7))
        together = rest_to_rest_s(ways, left.limits)
        assert together.shape == (3, 4)
        assert together[2, 1] == rest_to_rest_s(ways[2, 1], left.limits)

    def test_staying_takes_no_time(self, left: Arm) -> None:
        assert rest_to_rest_s(np.zeros(7), left.limits) == 0.0


class TestAStartOutsideTheLimits:
    """Every planner takes it alike: joint w2 is turned beyond its end."""

    MotionPlanner = Callable[..., Trajectory | Plan]

    @pytest.fixture(
        params=[
            "joint move",
            "free move",
            "straight move",
            "start move",
            "retract",
            "pick and place",
        ]
    )
    def plan_from(
        self, request: pytest.FixtureRequest, manipulator: Manipulator, scene: Scene
    ) -> MotionPlanner:
        arm, limits = manipulator.arm, manipulator.limits
        context = manipulator.context(scene)
        pick, place = overhead(0.70, 0.15, -0.129), overhead(0.75, 0.0, -0.129)
        task = PickAndPlace("block", pick, place)
        planners: dict[str, TestAStartOutsideTheLimits.MotionPlanner] = {
            "joint move": lambda q, **how: plan_joint_move(q, arm.neutral, limits, **how),
            "free move": lambda q, **how: plan_free_move(q, arm.neutral, limits, context, **how),
            "straight move": lambda q, **how: plan_straight_move(
                arm, q, raised(arm.T_base_tip(self.at_end(arm)), 0.05), limits, **how
            ),
            "start move": lambda q, **how: plan_start_move(manipulator, scene, q, **how),
            "retract": lambda q, **how: plan_retract(manipulator, scene, q, 0.05, **how),
            "pick and place": lambda q, **how: plan_pick_and_place(
                task, manipulator, scene, q, **how
            ),
        }
        return planners[str(request.param)]

    @staticmethod
    def at_end(arm: Arm, beyond_rad: float = 0.0) -> NDArray[np.float64]:
        q = np.array(arm.start)
        q[6] = arm.limits.q_max[6] + beyond_rad
        return q

    def test_by_rounding_is_taken_in(
        self, plan_from: MotionPlanner, left: Arm, caplog: pytest.LogCaptureFixture
    ) -> None:
        found = plan_from(self.at_end(left, 9e-7))
        assert found.q_start.tolist() == self.at_end(left).tolist()
        assert not caplog.records

    def test_farther_out_is_refused_with_how_far_and_what_to_do(
        self, plan_from: MotionPlanner, left: Arm
    ) -> None:
        with pytest.raises(ConfigurationError, match=r"by 0\.05 rad .*clip_start=True"):
            plan_from(self.at_end(left, 0.05))
        with pytest.raises(ConfigurationError, match=r"by 0\.11 rad"):
            plan_from(self.at_end(left, 0.11), clip_start=True)

    def test_it_is_clipped_if_asked_for_and_the_log_says_so(
        self, plan_from: MotionPlanner, left: Arm, caplog: pytest.LogCaptureFixture
    ) -> None:
        with caplog.at_level(logging.WARNING):
            found = plan_from(self.at_end(left, MAX_CLIP_RAD), clip_start=True)
        assert found.q_start.tolist() == self.at_end(left).tolist()
        assert "outside the joint limits by up to 0.1 rad" in caplog.text
        assert "left_w2" in caplog.text
        if isinstance(found, Plan):
            assert verify(found).is_valid
