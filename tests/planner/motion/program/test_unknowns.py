"""Where each unknown and each number of a motion program stands."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Arm
from baxter_kin.frames import raised
from planner import StraightLine
from planner.motion.program.unknowns import (
    MotionTask,
    Numbers,
    Phase,
    Unknowns,
    ends_of,
    geometry_numbers,
    numbers_of,
    piece_numbers,
)

CYCLE = (Phase(4), Phase(5, 0, (1.0, 0.0), rests=True), Phase(4, 0), Phase(6, 1, rests=True))
TO_GOAL = (Phase(4), Phase(5, rests=True, at_goal=True))
AT_SPEED = (Phase(5, 0, enters=True), Phase(4, 0, leaves=True))

every = pytest.mark.parametrize(
    "phases", [CYCLE, TO_GOAL, AT_SPEED], ids=("cycle", "goal", "speed")
)


@every
def test_every_unknown_stands_somewhere_and_at_one_place(phases: tuple[Phase, ...]) -> None:
    found = Unknowns.of(phases, 7)
    controls = {int(i) for each in found.controls for i in each.ravel() if i < found.count}
    others = [
        *found.durations.tolist(),
        *(i for each in found.fractions if each is not None for i in each.tolist()),
    ]
    assert len(set(others)) == len(others)
    assert not controls & set(others)
    assert controls | set(others) == set(range(found.count))


@every
def test_each_phase_has_controls_fractions_and_a_duration_of_its_own(
    phases: tuple[Phase, ...],
) -> None:
    found = Unknowns.of(phases, 7)
    assert len(set(found.durations.tolist())) == len(phases)
    for phase, controls, fractions in zip(phases, found.controls, found.fractions, strict=True):
        assert controls.shape == (phase.intervals + 3, 7)
        knots = None if phase.piece is None else phase.intervals + 1
        assert (None if fractions is None else len(fractions)) == knots


def test_where_the_arm_rests_three_controls_are_one_and_the_next_phase_begins_with_it() -> None:
    found = Unknowns.of(CYCLE, 7)
    resting = np.concatenate([found.controls[1][-3:], found.controls[2][:3]])
    assert (resting == resting[0]).all()
    assert (resting < found.count).all()
    passing = np.concatenate([found.controls[0][-3:], found.controls[1][:3]])
    assert len(np.unique(passing)) == passing.size


@pytest.mark.parametrize("phases", [CYCLE, TO_GOAL])
def test_the_arm_begins_at_the_start_that_is_given(phases: tuple[Phase, ...]) -> None:
    found = Unknowns.of(phases, 7)
    start = found.count + np.arange(7)
    np.testing.assert_array_equal(found.controls[0][:3], np.tile(start, (3, 1)))


def test_it_ends_at_the_goal_that_is_given() -> None:
    found = Unknowns.of(TO_GOAL, 7)
    goal = found.count + np.arange(7, 14)
    np.testing.assert_array_equal(found.controls[-1][-3:], np.tile(goal, (3, 1)))


def test_where_it_enters_at_speed_the_first_controls_are_unknown() -> None:
    found = Unknowns.of(AT_SPEED, 7)
    assert (found.controls[0] < found.count).all()


@pytest.mark.parametrize("unit_s", [1.0, 0.25])
def test_each_number_of_a_task_stands_where_the_program_reads_it(arm: Arm, unit_s: float) -> None:
    T, limits = arm.T_base_tip(arm.neutral), arm.limits
    tilted = pin.SE3(pin.exp3(np.array([0.3, 0.0, 0.0])) @ T.rotation, T.translation)
    lines = StraightLine(T, raised(T, 0.1)), StraightLine(T, tilted)
    task = MotionTask(
        arm.start, lines, (1e-5, 2e-5), (0.1,), q_goal=arm.neutral, rates=(0.1, 0.2, 0.3, 0.4)
    )
    numbers, given = Numbers(CYCLE, 7), numbers_of(task, arm, limits, unit_s)
    expected: dict[str, Any] = {
        "q_ends": [*arm.start, *arm.neutral],
        "limits": [*limits.v_max * unit_s, *limits.a_max * unit_s**2, *limits.j_max * unit_s**3],
        "geometry": geometry_numbers(arm),
        "tolerance": task.tolerance,
        "rates": [0.1 * unit_s, 0.2 * unit_s**2, 0.3 * unit_s, 0.4 * unit_s**2],
        "heights": task.heights_m,
    }
    asked = [*(getattr(numbers, name) for name in expected), *numbers.pieces]
    found = ca.Function("read", [numbers.all], asked).call([given])
    wanted = [*expected.values(), *(piece_numbers(line, arm) for line in lines)]
    for one, other in zip(found, wanted, strict=True):
        np.testing.assert_allclose(one.full().ravel(), other, rtol=1e-12)


def test_without_a_goal_the_start_stands_in_its_place(left: Arm) -> None:
    assert [each.tolist() for each in ends_of(MotionTask(left.start))] == [left.start.tolist()] * 2


@pytest.mark.parametrize(
    ("phase", "keeps_height"),
    [
        (Phase(4), True),
        (Phase(4, rests=True), True),
        (Phase(4, piece=0), False),
        (Phase(4, piece=1, enters=True), False),
        (Phase(4, rests=True, at_goal=True), False),
    ],
)
def test_the_tip_keeps_a_height_where_it_is_on_no_line_and_goes_to_no_configuration(
    phase: Phase, keeps_height: bool
) -> None:
    assert phase.keeps_height is keeps_height
