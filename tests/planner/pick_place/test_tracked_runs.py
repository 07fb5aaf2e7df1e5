"""Runs of moves: their division, their tubes, and the two ways to ask whether they pass."""

from __future__ import annotations

import numpy as np
import pytest

from planner import Manipulator, Plan, Response
from planner.completion import move_contexts
from planner.errors import TrajectoryError
from planner.motion.tracking_tube import JointRange
from planner.pick_place.tracked_runs import (
    TrackedRun,
    TrackingRequirements,
    bounding_box,
    box_corners,
    check_rests,
    corners_at_tip,
    padded,
    runs_of,
)
from planner.plan import Move

SLOW = Response((0.35, 0.45), 0.001, 0.3)
FAST = SLOW.at_speed(1.0)

REQUIRED = TrackingRequirements(margin_m=0.0, max_deviation_m=0.04, start_rad=0.02)

TOLERANCE_M = 1e-6
"""Tolerance for rounding, and for the solution of inverse kinematics at the pick."""

FINGERS_M = 0.15
"""Maximum size of the gripper beyond the held block along any axis."""


@pytest.fixture(scope="module")
def run(tracked_plan: Plan, manipulator: Manipulator) -> TrackedRun:
    """The first run of the plan: the approach and the descent to the block."""
    return next(runs_of(tracked_plan.moves, move_contexts(tracked_plan, manipulator)))


def start_of(plan: Plan, width_rad: float = 0.02) -> JointRange:
    return plan.q_start - width_rad, plan.q_start + width_rad


def test_the_last_value_is_repeated() -> None:
    assert padded(np.array([1.0, 2.0]), 4).tolist() == [1.0, 2.0, 2.0, 2.0]
    assert padded(np.array([1.0, 2.0]), 2).tolist() == [1.0, 2.0]
    assert padded(np.array([1.0, 2.0, 3.0]), 2).tolist() == [1.0, 2.0]


def test_a_box_has_eight_corners() -> None:
    corners = box_corners(np.array([0.0, 1.0, 2.0]), np.array([1.0, 3.0, 5.0]))
    assert corners.shape == (8, 3)
    assert len(np.unique(corners, axis=0)) == 8
    assert corners.min(axis=0).tolist() == [0.0, 1.0, 2.0]
    assert corners.max(axis=0).tolist() == [1.0, 3.0, 5.0]
    boxes = [(np.full(7, -1.0), np.full(7, 0.5)), (np.full(7, 0.0), np.full(7, 2.0))]
    low, high = bounding_box(boxes)
    assert low.tolist() == [-1.0] * 7
    assert high.tolist() == [2.0] * 7


def test_the_corners_at_the_tip_are_around_the_held_body(
    tracked_plan: Plan, manipulator: Manipulator
) -> None:
    """In the move that sets the block down, the block may touch the table."""
    labels = [move.label for move in tracked_plan.moves]
    number = labels.index("place: descend")
    context, state = (
        move_contexts(tracked_plan, manipulator)[number],
        tracked_plan.moves[number].state,
    )
    assert state is not None
    held = state.holding("left")
    assert held is not None
    corners = corners_at_tip(context, np.flatnonzero(context.checker.may_touch))
    assert corners.shape == (8, 3)
    block = state.scene[held.body]
    for axis, (low, high) in enumerate(zip(corners.min(axis=0), corners.max(axis=0), strict=True)):
        T_base_tip = manipulator.arm.T_base_tip(state.q(manipulator.arm.joint_names))
        direction = T_base_tip.rotation[:, axis]
        first, last = np.array(block.extent_m(direction)) - direction @ T_base_tip.translation
        assert low - TOLERANCE_M <= first
        assert last <= high + TOLERANCE_M
        assert high - low <= last - first + FINGERS_M


def test_runs_end_where_the_arm_rests(tracked_plan: Plan, manipulator: Manipulator) -> None:
    contexts = move_contexts(tracked_plan, manipulator)
    starts = [start_of(tracked_plan)]
    labels = []
    for run in runs_of(tracked_plan.moves, contexts):
        moves = run.track_moves(run.tubes_for(SLOW, starts), REQUIRED)
        labels.append([move.label for move in moves])
    assert [label for run in labels for label in run] == [m.label for m in tracked_plan.moves]
    assert labels[0] == ["pick: approach", "pick: descend"]
    assert len(list(runs_of(tracked_plan.moves[:1], contexts[:1]))) == 1  # which does not rest
    assert not list(runs_of([], []))


def test_an_arm_must_rest_where_fingers_act(tracked_plan: Plan) -> None:
    check_rests(tracked_plan.steps)
    approach = next(step for step in tracked_plan.steps if isinstance(step, Move))
    with pytest.raises(TrajectoryError, match="where the arm must rest"):
        check_rests([approach])


def test_the_hull_contains_the_tube_from_each_start(run: TrackedRun, tracked_plan: Plan) -> None:
    q, half = tracked_plan.q_start, np.full(7, 0.01)
    tubes = run.tubes_for(SLOW, [(q - half, q), (q, q + half)])
    assert len(tubes.by_start) == 2
    for part in tubes.by_start:
        cells = min(part.tube.cells, tubes.hull.tube.cells)
        assert (tubes.hull.tube.lowest[:cells] <= part.tube.lowest[:cells]).all()
        assert (tubes.hull.tube.highest[:cells] >= part.tube.highest[:cells]).all()
        assert part.tube.cells <= tubes.hull.tube.cells
    assert tubes.starts == tubes.hull.starts


@pytest.mark.parametrize(
    ("response", "required", "failing"),
    [
        (SLOW, REQUIRED, []),
        (FAST, REQUIRED, ["pick: descend"]),
        (SLOW, REQUIRED._replace(max_deviation_m=0.01), ["pick: descend"]),
        (SLOW, REQUIRED._replace(margin_m=0.05), ["pick: descend"]),
    ],
    ids=["slow", "fast", "small deviation", "margin"],
)
def test_a_run_passes_exactly_if_no_move_fails(
    run: TrackedRun,
    tracked_plan: Plan,
    response: Response,
    required: TrackingRequirements,
    failing: list[str],
) -> None:
    tubes = run.tubes_for(response, [start_of(tracked_plan)])
    moves = list(run.track_moves(tubes, required))
    assert [move.label for move in moves if move.failure is not None] == failing
    assert run.passes(tubes, required) is not bool(failing)
    assert all(move.label not in str(move.failure) for move in moves)
    assert [move.settled_tip_m is None for move in moves] == [True, False]
