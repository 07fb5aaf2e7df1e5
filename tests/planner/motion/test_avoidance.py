"""Motions that are led around discs, and when leading is given up."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest

from baxter_kin import JointLimits
from planner import Trajectory, plan_joint_move
from planner.motion.avoidance import (
    BY_ROUND,
    LESS_TRUST,
    MOST_FAILURES,
    ROUNDS,
    SHORT_OF_M,
    TRUST_RAD,
    Motions,
    led_around,
)
from planner.motion.program.clearance_rows import Clearances
from planner.motion.program.motion_program import MotionProgram
from planner.motion.program.phases import MotionTask, Phase
from planner.splines import Sketch
from tests.planner import toy_world
from tests.planner.toy_world import AROUND_DISC, Disc, ToyObstacles, ToySpace, least_distance

INTERVALS = 20

LIMITS = JointLimits(
    tuple(f"joint {i}" for i in range(7)),
    q_min=np.full(7, -2.0),
    q_max=np.full(7, 2.0),
    v_max=np.full(7, 1.5),
    a_max=np.full(7, 2.0),
    j_max=np.full(7, 20.0),
)
LEFT, RIGHT = (np.array([x, y, *np.zeros(5)]) for x, y in (toy_world.LEFT, toy_world.RIGHT))
TASK = MotionTask(LEFT, q_goal=RIGHT)

MARGIN_M = 0.05
BESIDE = ToySpace((Disc(0.0, 1.8, 0.5),))
"""A disc that the straight way does not meet."""

STRAIGHT = plan_joint_move(LEFT, RIGHT, LIMITS)
SKETCH = Sketch.of(STRAIGHT, INTERVALS)
BENT = Sketch(
    SKETCH.q + 0.6 * np.outer(np.sin(np.linspace(0.0, np.pi, INTERVALS + 1)) ** 2, np.eye(7)[1]),
    SKETCH.v_ends,
    SKETCH.duration_s,
)
"""Into the disc as well, but beside its middle."""


@pytest.fixture(scope="module")
def program() -> MotionProgram:
    return MotionProgram([Phase(INTERVALS, rests=True, at_goal=True)], 7)


def around(
    program: MotionProgram, space: ToySpace = AROUND_DISC, enough_s: float = 0.0
) -> list[Trajectory]:
    def solve(sketches: Sequence[Sketch], near: Clearances) -> Motions | None:
        return program.solve(sketches, TASK, None, LIMITS, near)

    obstacles = ToyObstacles(space.with_margin(MARGIN_M, LEFT, RIGHT))
    return [motion for (motion,) in led_around(solve, [obstacles], [BENT], enough_s=enough_s)]


class Script:
    """Answers a solver gives, the last one again and again; what it was asked."""

    def __init__(self, *answers: Trajectory | None) -> None:
        self.answers, self.trusts_rad = answers, list[float]()

    def __call__(self, _: Sequence[Sketch], near: Clearances) -> Motions | None:
        number = min(len(self.trusts_rad), len(self.answers) - 1)
        self.trusts_rad.append(near.trust_rad)
        answer = self.answers[number]
        return None if answer is None else (answer,)

    def found(self, space: ToySpace) -> list[Motions]:
        return led_around(self, [ToyObstacles(space)], [SKETCH])


def test_what_is_found_keeps_nearly_all_of_the_margin_where_it_is_bounded(
    program: MotionProgram,
) -> None:
    found = around(program)
    assert least_distance(AROUND_DISC, BENT.q) < 0.0
    assert found
    for motion in found:
        middles_s = (np.arange(INTERVALS) + 0.5) / INTERVALS * motion.duration
        qs = motion.sample(middles_s).q
        assert least_distance(AROUND_DISC, qs) > MARGIN_M - SHORT_OF_M - 1e-9


def test_motions_go_from_start_to_goal_within_the_limits(program: MotionProgram) -> None:
    for motion in around(program):
        np.testing.assert_allclose([motion.q_start, motion.q_goal], [LEFT, RIGHT], atol=1e-9)
        assert max(motion.peak_ratios()) <= 1.0 + 1e-9


def test_motions_that_are_fast_enough_end_the_search(program: MotionProgram) -> None:
    every = around(program)
    (first,) = around(program, enough_s=np.inf)
    assert len(every) > 1
    assert first.q.tolist() == every[-1].q.tolist()


def test_the_last_found_comes_first_and_hardly_differs_from_the_one_before(
    program: MotionProgram,
) -> None:
    durations = [motion.duration for motion in around(program)]
    assert durations[0] == pytest.approx(min(durations), rel=0.01)


def test_a_clear_way_is_left_as_it_is_and_asked_for_twice() -> None:
    script = Script(STRAIGHT)
    assert script.found(BESIDE) == [(STRAIGHT,)] * 2
    assert len(script.trusts_rad) == 2


def test_a_program_without_solution_is_given_up() -> None:
    script = Script(None)
    assert not script.found(AROUND_DISC)
    assert len(script.trusts_rad) == MOST_FAILURES + 1


def test_after_a_failure_bounds_are_trusted_less() -> None:
    script = Script(None, STRAIGHT)
    script.found(BESIDE)
    assert script.trusts_rad[:2] == [TRUST_RAD, LESS_TRUST * TRUST_RAD]


def test_motions_that_stay_in_collision_are_given_up() -> None:
    script = Script(STRAIGHT)
    assert not script.found(AROUND_DISC)
    assert len(script.trusts_rad) == BY_ROUND


def test_from_half_of_the_rounds_on_bounds_are_trusted_less_and_less() -> None:
    """Durations that keep changing end after all rounds."""
    slower = [
        plan_joint_move(LEFT, RIGHT, LIMITS.scaled(share))
        for share in np.linspace(0.2, 1.0, ROUNDS)
    ]
    script = Script(*slower)
    assert len(script.found(BESIDE)) == ROUNDS
    assert script.trusts_rad[: ROUNDS // 2] == [TRUST_RAD] * (ROUNDS // 2)
    later = script.trusts_rad[ROUNDS // 2 + 1 :]
    assert all(after < before for before, after in pairwise(later))
