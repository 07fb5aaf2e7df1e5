"""Cycles that stop above pick and place."""

from __future__ import annotations

import numpy as np
import pytest

from baxter_kin.validation import FloatArray
from planner import Manipulator, PickAndPlace, Plan, Scene
from planner.pick_place.cycle import MOVES, Cycle, StoppingCycles
from planner.pick_place.phases import PhaseMaker
from planner.pick_place.plan_builder import NoSolutionError
from planner.pick_place.task import PlanRequest
from planner.trajectory import CONTINUITY_TOLERANCE
from tests.planner.pick_place.conftest import PICK, PLACE, TASK


def test_a_cycle_is_much_shorter_than_one_that_stops_above_pick_and_place(
    plan: Plan, manipulator: Manipulator, scene: Scene
) -> None:
    start = manipulator.arm.start
    nearest = (manipulator.ik.solve(T, current=start).q for T in (PICK, PLACE))
    request = PlanRequest(manipulator, scene, start)
    cycles = StoppingCycles(request, TASK, PhaseMaker(request, TASK).made().contexts)
    assert plan.motion_time_s <= 0.85 * cycles.of(*nearest).duration_s


@pytest.fixture(scope="module")
def cycles(manipulator: Manipulator, scene: Scene) -> StoppingCycles:
    return cycles_of(manipulator, scene, TASK)


def cycles_of(manipulator: Manipulator, scene: Scene, task: PickAndPlace) -> StoppingCycles:
    request = PlanRequest(manipulator, scene, manipulator.arm.start)
    return StoppingCycles(request, task, PhaseMaker(request, task).made().contexts)


@pytest.fixture(scope="module")
def ends(manipulator: Manipulator) -> tuple[FloatArray, FloatArray]:
    """At pick and place."""
    start = manipulator.arm.start
    q_pick, q_place = (manipulator.ik.solve(T, current=start).q for T in (PICK, PLACE))
    return q_pick, q_place


@pytest.fixture(scope="module")
def cycle(cycles: StoppingCycles, ends: tuple[FloatArray, FloatArray]) -> Cycle:
    return cycles.of(*ends)


def test_it_goes_by_the_configurations_that_it_is_asked_for(
    cycle: Cycle, ends: tuple[FloatArray, FloatArray]
) -> None:
    np.testing.assert_array_equal([cycle.q_pick, cycle.q_place], ends)


def test_it_rests_between_any_two_motions(cycle: Cycle, manipulator: Manipulator) -> None:
    q = manipulator.arm.start
    for motion in cycle:
        np.testing.assert_allclose(motion.q_start, q, atol=CONTINUITY_TOLERANCE)
        assert np.abs(motion.v[[0, -1]]).max() == np.abs(motion.a[[0, -1]]).max() == 0.0
        q = motion.q_goal


def test_it_takes_as_long_as_its_motions_together(cycle: Cycle) -> None:
    assert tuple(cycle.by_stage) == MOVES
    times = [motion.duration for motion in cycle.by_stage.values()]
    assert cycle.duration_s == pytest.approx(sum(times), abs=1e-12)


def test_every_motion_is_clear_in_its_situation(
    cycle: Cycle, manipulator: Manipulator, scene: Scene
) -> None:
    contexts = PhaseMaker(PlanRequest(manipulator, scene, manipulator.arm.start), TASK).made()
    for stage, motion in cycle.by_stage.items():
        assert contexts.contexts[stage].prove(motion).is_clear, stage


def test_lines_of_one_solution_are_planned_once(
    cycles: StoppingCycles, cycle: Cycle, ends: tuple[FloatArray, FloatArray]
) -> None:
    again = cycles.of(*ends)
    assert again.up_from_pick is cycle.up_from_pick
    assert again.up_from_place is cycle.up_from_place


def test_a_line_that_the_arm_cannot_follow_is_refused_each_time(
    manipulator: Manipulator, scene: Scene, ends: tuple[FloatArray, FloatArray]
) -> None:
    cycles = cycles_of(manipulator, scene, PickAndPlace("block", PICK, PLACE, hover_m=0.9))
    for _ in range(2):
        with pytest.raises(NoSolutionError, match=r"^place: retract: the straight line ends"):
            cycles.of(*ends)
