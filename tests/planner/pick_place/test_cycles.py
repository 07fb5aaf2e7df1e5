"""The motions of a pick and place as one program."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
import pytest

from baxter_kin import Arm
from baxter_kin.validation import FloatArray
from planner import Body, Box, Manipulator, Part, PickAndPlace, Scene
from planner.collision.context import CollisionContext
from planner.pick_place.candidates import CandidatePair, Candidates
from planner.pick_place.cycles import Cycle, CycleProgram, StoppingCycles
from planner.pick_place.phases import PhaseMaker
from planner.pick_place.plan_builder import NoSolutionError
from planner.pick_place.task import MOVES, PlanRequest
from planner.trajectory import CONTINUITY_TOLERANCE
from tests.conftest import at
from tests.planner.pick_place.conftest import PICK, PLACE, TASK

HAND_OVER = 1e-8
"""Of states, from one motion to the next: what certificates allow."""


def request_of(manipulator: Manipulator, *bodies: Body) -> PlanRequest:
    return PlanRequest(manipulator, Scene.of(bodies), manipulator.arm.start)


def pair_of(manipulator: Manipulator, task: PickAndPlace = TASK) -> CandidatePair:
    found = Candidates(request_of(manipulator), task)
    return found.pair(*found.order[0])


@pytest.fixture(scope="module")
def cycle(manipulator: Manipulator) -> Cycle:
    found = program_of(manipulator).of(pair_of(manipulator))
    assert found is not None
    return found


def program_of(manipulator: Manipulator, task: PickAndPlace = TASK) -> CycleProgram:
    return CycleProgram(request_of(manipulator), task)


def test_motions_go_on_as_the_ones_before_ended(cycle: Cycle) -> None:
    for before, after in pairwise(cycle.motions):
        for name in ("q", "v", "a"):
            jump = np.abs(getattr(before, name)[-1] - getattr(after, name)[0]).max()
            assert jump <= HAND_OVER, name


def test_it_rests_only_to_grasp_to_release_and_at_the_end(cycle: Cycle) -> None:
    ends = [np.abs(motion.v[-1]).max() for motion in cycle.motions]
    assert [end == 0.0 for end in ends] == [False, True, False, False, True, True]


def test_every_limit_is_kept(cycle: Cycle, left: Arm) -> None:
    for motion in cycle.motions:
        assert max(motion.peak_ratios()) <= 1.0 + 1e-12
        low, high = motion.position_extrema()
        assert (low >= left.limits.q_min).all()
        assert (high <= left.limits.q_max).all()


@pytest.fixture(scope="module")
def stopping(manipulator: Manipulator, scene: Scene) -> Cycle:
    """The same, one motion at a time."""
    request = request_of(manipulator, *scene)
    contexts = PhaseMaker(request, TASK).phases().contexts
    cycle, _ = StoppingCycles(request, TASK, contexts).of(*pair_of(manipulator))
    return cycle


def test_it_is_faster_than_the_parts_one_by_one(cycle: Cycle, stopping: Cycle) -> None:
    assert cycle.duration_s < 0.85 * stopping.duration_s


def test_the_guess_hardly_matters(cycle: Cycle, stopping: Cycle, manipulator: Manipulator) -> None:
    near = program_of(manipulator).near(stopping)
    assert near is not None
    assert near.duration_s == pytest.approx(cycle.duration_s, rel=3e-3)


def test_a_grid_twice_as_fine_gains_less_than_a_hundredth(
    cycle: Cycle, manipulator: Manipulator
) -> None:
    finer = CycleProgram(request_of(manipulator), TASK, fineness=2)
    found = finer.of(pair_of(manipulator))
    assert found is not None
    assert cycle.duration_s <= 1.01 * found.duration_s


def test_between_the_lines_the_tip_stays_above_their_upper_ends(cycle: Cycle, left: Arm) -> None:
    least_m = min(T.translation[2] for T in (PICK, PLACE)) + TASK.clear_m
    heights = [left.T_base_tip(q).translation[2] for q in cycle.by_label["place: approach"].q]
    assert min(heights) >= least_m - 1e-8


@pytest.mark.parametrize(("clear_m", "hover_m"), [(0.001, 0.001), (0.02, 0.3)])
def test_other_heights_will_do(manipulator: Manipulator, clear_m: float, hover_m: float) -> None:
    task = PickAndPlace("block", PICK, PLACE, hover_m=hover_m, clear_m=clear_m)
    found = program_of(manipulator, task).of(pair_of(manipulator, task))
    assert found is not None
    end = manipulator.arm.T_base_tip(found.motions[-1].q_goal).translation
    above = PLACE.translation + np.array([0.0, 0.0, hover_m])
    np.testing.assert_allclose(end, above, atol=1e-8)


def test_a_line_that_cannot_be_followed_is_told_by_none(manipulator: Manipulator) -> None:
    task = PickAndPlace("block", PICK, PLACE, hover_m=0.8)
    assert program_of(manipulator, task).of(pair_of(manipulator)) is None


@pytest.fixture(scope="module")
def walled(manipulator: Manipulator, scene: Scene) -> Mapping[str, CollisionContext]:
    """A wall between pick and place, which the fastest cycle runs through."""
    wall = Body("wall", (Part(Box((0.3, 0.02, 0.2)), at(0, 0, 0)),), at(0.72, 0.075, -0.055))
    return PhaseMaker(request_of(manipulator, *scene, wall), TASK).phases().contexts


@pytest.fixture(scope="module")
def led(
    manipulator: Manipulator, cycle: Cycle, walled: Mapping[str, CollisionContext]
) -> list[Cycle]:
    """The cycles around that wall."""
    return program_of(manipulator).around(cycle, walled)


@pytest.mark.slow
def test_what_is_led_around_a_wall_is_proven_clear_of_it(
    cycle: Cycle, led: list[Cycle], walled: Mapping[str, CollisionContext]
) -> None:
    def is_clear(each: Cycle) -> bool:
        return all(walled[s].prove(motion).is_clear for s, motion in each.by_label.items())

    assert not is_clear(cycle)
    assert is_clear(led[0])
    durations = [each.duration_s for each in led]
    assert durations[0] <= 1.01 * min(durations)
    assert cycle.duration_s < durations[0] < 1.05 * cycle.duration_s
    assert all(max(motion.peak_ratios()) <= 1.0 + 1e-12 for motion in led[0].motions)


def test_nothing_comes_of_a_place_that_is_covered(
    manipulator: Manipulator, cycle: Cycle, scene: Scene
) -> None:
    x, y, z = PLACE.translation.tolist()
    lid = Body("lid", (Part(Box((0.4, 0.4, 0.02)), at(0, 0, 0)),), at(x, y, z + 0.2))
    maker = PhaseMaker(request_of(manipulator, *scene, lid), TASK)
    assert not program_of(manipulator).around(cycle, maker.phases().contexts)


@pytest.fixture(scope="module")
def cycles(manipulator: Manipulator, scene: Scene) -> StoppingCycles:
    return cycles_of(manipulator, scene, TASK)


def cycles_of(manipulator: Manipulator, scene: Scene, task: PickAndPlace) -> StoppingCycles:
    request = PlanRequest(manipulator, scene, manipulator.arm.start)
    return StoppingCycles(request, task, PhaseMaker(request, task).phases().contexts)


@pytest.fixture(scope="module")
def ends(manipulator: Manipulator) -> tuple[FloatArray, FloatArray]:
    """At pick and place."""
    start = manipulator.arm.start
    q_pick, q_place = (manipulator.ik.solve(T, current=start).q for T in (PICK, PLACE))
    return q_pick, q_place


@pytest.fixture(scope="module")
def stopped(cycles: StoppingCycles, ends: tuple[FloatArray, FloatArray]) -> Cycle:
    cycle, _ = cycles.of(*ends)
    return cycle


def test_a_stopping_cycle_rests_between_any_two_motions(
    stopped: Cycle, ends: tuple[FloatArray, FloatArray], manipulator: Manipulator
) -> None:
    placed = stopped.by_label["place: descend"].q_goal
    np.testing.assert_array_equal([stopped.q_pick, placed], ends)
    assert tuple(stopped.by_label) == MOVES
    times = [motion.duration for motion in stopped.by_label.values()]
    assert stopped.duration_s == pytest.approx(sum(times), abs=1e-12)
    q = manipulator.arm.start
    for motion in stopped.motions:
        np.testing.assert_allclose(motion.q_start, q, atol=CONTINUITY_TOLERANCE)
        assert np.abs(motion.v[[0, -1]]).max() == np.abs(motion.a[[0, -1]]).max() == 0.0
        q = motion.q_goal


def test_every_motion_is_clear_in_its_situation(
    stopped: Cycle, manipulator: Manipulator, scene: Scene
) -> None:
    contexts = PhaseMaker(PlanRequest(manipulator, scene, manipulator.arm.start), TASK).phases()
    for stage, motion in stopped.by_label.items():
        assert contexts.contexts[stage].prove(motion).is_clear, stage


def test_lines_of_one_solution_are_planned_once(
    cycles: StoppingCycles, stopped: Cycle, ends: tuple[FloatArray, FloatArray]
) -> None:
    again, _ = cycles.of(*ends)
    for label in ("pick: retract", "place: retract"):
        assert again.by_label[label] is stopped.by_label[label]


def test_a_line_that_the_arm_cannot_follow_is_refused_each_time(
    manipulator: Manipulator, scene: Scene, ends: tuple[FloatArray, FloatArray]
) -> None:
    cycles = cycles_of(manipulator, scene, PickAndPlace("block", PICK, PLACE, hover_m=0.9))
    for _ in range(2):
        with pytest.raises(NoSolutionError, match=r"^place: retract: the straight line ends"):
            cycles.of(*ends)
