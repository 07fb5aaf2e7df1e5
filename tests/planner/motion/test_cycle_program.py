"""The motions of a pick and place as one program."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from baxter_kin import Arm
from planner import Manipulator, PickAndPlace
from planner.choice import Choice, Choices
from planner.cycle import Cycle, Cycles
from planner.motion import cycle_program
from planner.motion.cycle_program import CycleProgram
from tests.conftest import overhead

PICK, PLACE = overhead(0.70, 0.15, -0.129), overhead(0.75, 0.00, -0.129)
TASK = PickAndPlace("block", PICK, PLACE)
HAND_OVER = 1e-8
"""Of states, from one motion to the next: what certificates allow."""


def choice_of(manipulator: Manipulator, task: PickAndPlace = TASK) -> Choice:
    arm = manipulator.arm
    choices = Choices.of(manipulator.ik, manipulator.limits, arm.start, task.lines)
    return choices.at(*next(choices.pairs()))


@pytest.fixture(scope="module")
def cycle(manipulator: Manipulator) -> Cycle:
    found = program_of(manipulator).of(choice_of(manipulator))
    assert found is not None
    return found


def program_of(manipulator: Manipulator, task: PickAndPlace = TASK) -> CycleProgram:
    return CycleProgram(manipulator, manipulator.arm.start, task.lines)


def test_motions_go_on_as_the_ones_before_ended(cycle: Cycle) -> None:
    motions = list(cycle.by_stage.values())
    for before, after in pairwise(motions):
        for name in ("q", "v", "a"):
            jump = np.abs(getattr(before, name)[-1] - getattr(after, name)[0]).max()
            assert jump <= HAND_OVER, name


def test_it_rests_only_to_grasp_to_release_and_at_the_end(cycle: Cycle) -> None:
    ends = [np.abs(motion.v[-1]).max() for motion in cycle.by_stage.values()]
    assert [end == 0.0 for end in ends] == [False, True, False, False, True, True]


def test_every_limit_is_kept(cycle: Cycle, left: Arm) -> None:
    for motion in cycle.by_stage.values():
        assert max(motion.peak_ratios()) <= 1.0 + 1e-12
        low, high = motion.position_extrema()
        assert (low >= left.limits.q_min).all()
        assert (high <= left.limits.q_max).all()


def test_it_is_faster_than_the_parts_one_by_one(cycle: Cycle, manipulator: Manipulator) -> None:
    arm, lines = manipulator.arm, TASK.lines
    parts = Cycles(manipulator, arm.start, lines).of(choice_of(manipulator))
    assert cycle.duration_s < 0.95 * parts.duration_s


def test_the_guess_hardly_matters(cycle: Cycle, manipulator: Manipulator) -> None:
    arm, lines = manipulator.arm, TASK.lines
    parts = Cycles(manipulator, arm.start, lines).of(choice_of(manipulator))
    near = program_of(manipulator).near(parts)
    assert near is not None
    assert near.duration_s == pytest.approx(cycle.duration_s, rel=3e-3)


def test_a_grid_twice_as_fine_gains_less_than_a_hundredth(
    cycle: Cycle, manipulator: Manipulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("ENTRY", "ACROSS", "LEAST_ON_LINE"):
        monkeypatch.setattr(cycle_program, name, 2 * getattr(cycle_program, name))
    monkeypatch.setattr(cycle_program, "INTERVAL_M", 0.5 * cycle_program.INTERVAL_M)
    finer = program_of(manipulator).of(choice_of(manipulator))
    assert finer is not None
    assert cycle.duration_s <= 1.01 * finer.duration_s


def test_between_the_lines_the_tip_stays_above_their_upper_ends(cycle: Cycle, left: Arm) -> None:
    least_m = min(T.translation[2] for T in (PICK, PLACE)) + TASK.clear_m
    heights = [left.T_base_tip(q).translation[2] for q in cycle.to_place.q]
    assert min(heights) >= least_m - 1e-8


@pytest.mark.parametrize(("clear_m", "hover_m"), [(0.001, 0.001), (0.02, 0.3), (0.05, 0.05)])
def test_other_heights_will_do(manipulator: Manipulator, clear_m: float, hover_m: float) -> None:
    task = PickAndPlace("block", PICK, PLACE, hover_m=hover_m, clear_m=clear_m)
    found = program_of(manipulator, task).of(choice_of(manipulator, task))
    assert found is not None
    end = manipulator.arm.T_base_tip(found.up_from_place.q_goal).translation
    above = PLACE.translation + np.array([0.0, 0.0, hover_m])
    np.testing.assert_allclose(end, above, atol=1e-8)


def test_a_line_that_cannot_be_followed_is_told_by_none(manipulator: Manipulator) -> None:
    task = PickAndPlace("block", PICK, PLACE, hover_m=2.0)
    assert program_of(manipulator, task).of(choice_of(manipulator)) is None
