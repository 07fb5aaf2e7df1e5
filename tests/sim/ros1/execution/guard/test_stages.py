"""Stages: what is clear by how much, and what is meant to touch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from baxter_kin.kinematics.arm import JOINTS
from planner import Body, Box, Manipulator, Part, Plan
from planner.situation import Situation
from sim.ros1.execution.guard.stages import (
    GripStage,
    MoveStage,
    NotClearError,
    Room,
    inner_joints,
    stages_of,
)
from sim.ros1.execution.ready_plan import ReadyPlan
from tests.conftest import at

ACCURACY_M = 2e-5


@pytest.fixture(scope="module")
def rooms(ready: ReadyPlan) -> dict[str, Room]:
    return {
        room.label: room
        for stage in ready.stages
        if isinstance(stage, MoveStage)
        for room in stage.rooms
    }


def test_every_move_has_a_room_that_agrees_with_what_the_plan_proved(
    rooms: dict[str, Room], demo_plan: Plan
) -> None:
    assert list(rooms) == [move.label for move in demo_plan.moves]
    for move in demo_plan.moves:
        assert move.proof is not None
        nearest_m = move.proof.nearest.distance_m
        assert 0.85 * nearest_m < min(rooms[move.label].clear_m) <= nearest_m + ACCURACY_M


def test_what_is_meant_to_touch_is_told_and_nothing_else(rooms: dict[str, Room]) -> None:
    meant = {label: room.on_purpose for label, room in rooms.items()}
    assert meant["pick: approach"] is None
    assert meant["place: approach"] is None
    for label in ("pick: descend", "place: retract"):
        near = meant[label]
        assert near is not None
        assert "block" in (near.first, near.second)
    for label in ("pick: retract", "place: descend"):
        near = meant[label]
        assert near is not None
        assert {near.first, near.second} == {"block", "table"}


def test_samples_of_every_pair_keep_what_their_room_says(ready: ReadyPlan) -> None:
    """By distances at instants, where the rooms are proven over intervals."""
    stage = next(stage for stage in ready.stages if isinstance(stage, MoveStage))
    checker, move, room = stage.context.checker, stage.moves[0], stage.rooms[0]
    full, inner = np.array(stage.context.q_others), inner_joints(checker)
    least = np.full(len(JOINTS) + 1, np.inf)
    for t in np.linspace(0.0, move.trajectory.duration, 40).tolist():
        full[checker.motion_bounds.q_index] = move.trajectory.sample(t).q
        found = checker.distances_m(full, range(len(inner)))
        for joint, distance_m in zip(inner.tolist(), found, strict=True):
            least[joint] = min(least[joint], distance_m)
    assert (np.array(room.clear_m) <= least + ACCURACY_M).all()


def test_the_fingers_act_in_between(ready: ReadyPlan) -> None:
    grips = [stage for stage in ready.stages if isinstance(stage, GripStage)]
    assert [stage.grip.action.value for stage in grips] == ["open", "close", "open"]
    opened, closed, _ = (stage.finger_m for stage in grips)
    assert closed < opened


def test_a_body_in_the_way_is_named(demo_plan: Plan, manipulator: Manipulator) -> None:
    """A pole where the plan knows none."""
    known = demo_plan.situation
    assert known is not None
    middle = demo_plan.moves[0].trajectory.sample(0.5).q
    where = manipulator.arm.T_base_tip(middle).translation
    pole = Body("pole", (Part(Box((0.02, 0.02, 0.02)), at(0.0, 0.0, 0.0)),), at(*where))
    changed = replace(known, scene=known.scene.with_body(pole))
    with pytest.raises(NotClearError, match=r"pick: approach.*pole"):
        stages_of(demo_plan, manipulator, changed)


def test_without_a_change_it_is_the_situation_of_the_plan(
    demo_plan: Plan, manipulator: Manipulator
) -> None:
    assert isinstance(demo_plan.situation, Situation)
    stages = stages_of(demo_plan, manipulator, demo_plan.situation)
    assert [type(stage).__name__ for stage in stages] == [
        *("GripStage", "MoveStage", "GripStage", "MoveStage", "GripStage", "MoveStage"),
    ]
