"""Stages: what is clear by how much, and what is meant to touch."""

from __future__ import annotations

import numpy as np
import pytest

from baxter_kin.fields import evolve
from baxter_kin.kinematics.arm import JOINTS
from planner import Body, Box, Grip, GripperAction, Manipulator, Move, Part, Plan
from planner.collision.context import CollisionContext
from planner.completion import complete, move_contexts
from sim.ros1.execution.guard.stages import (
    GripStage,
    MoveStage,
    NotClearError,
    Room,
    guarded,
    shared_joints,
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
    meant = {label: room.intended for label, room in rooms.items()}
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
    full, inner = np.array(stage.context.q_others), shared_joints(checker)
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
    known = demo_plan.start
    middle = demo_plan.moves[0].trajectory.sample(0.5).q
    where = manipulator.arm.T_base_tip(middle).translation
    pole = Body("pole", (Part(Box((0.02, 0.02, 0.02)), at(0.0, 0.0, 0.0)),), at(*where))
    changed = evolve(known, scene=known.scene.with_body(pole))
    with pytest.raises(NotClearError, match=r"pick: approach.*pole"):
        stages_for(evolve(demo_plan, start=changed), manipulator)


def test_without_a_change_it_is_the_situation_of_the_plan(
    demo_plan: Plan, manipulator: Manipulator
) -> None:
    stages = stages_for(demo_plan, manipulator)
    assert [type(stage).__name__ for stage in stages] == [
        *("GripStage", "MoveStage", "GripStage", "MoveStage", "GripStage", "MoveStage"),
    ]


class TestContactsAreThoseOfThePlanner:
    """Where the guard once derived contacts of its own, and these plans told both apart."""

    def test_a_released_body_is_where_it_lands(
        self, demo_plan: Plan, manipulator: Manipulator
    ) -> None:
        """The hand is tilted by a degree, the body is let go above the table, and stands level."""
        stages = stages_for(demo_plan, manipulator)
        last = stages[-1]
        assert isinstance(last, MoveStage)
        planned = move_contexts(demo_plan, manipulator)[-1]
        assert placements(last.context, "block") == pytest.approx(
            placements(planned, "block"), abs=1e-12
        )

    def test_an_opening_beyond_the_stroke_is_the_stroke(
        self, demo_plan: Plan, manipulator: Manipulator
    ) -> None:
        wide = tuple(
            evolve(step, opening_m=0.05)
            if isinstance(step, Grip) and step.action is GripperAction.OPEN
            else step
            for step in demo_plan.steps
        )
        stages = stages_for(evolve(demo_plan, steps=wide), manipulator)
        opened = [
            stage.finger_m
            for stage in stages
            if isinstance(stage, GripStage) and stage.grip.action is GripperAction.OPEN
        ]
        assert opened == [manipulator.hand.stroke_m] * 2

    def test_a_held_body_may_touch_its_old_support_in_the_first_move_alone(
        self, demo_plan: Plan, manipulator: Manipulator
    ) -> None:
        """It is lifted, put back on the table without being let go, and lifted again."""
        steps = list(demo_plan.steps)
        at_retract = next(i for i, step in enumerate(steps) if step.label == "pick: retract")
        lift = steps[at_retract]
        assert isinstance(lift, Move)
        back = evolve(lift, label="back", trajectory=lift.trajectory.reversed())
        again = evolve(lift, label="again")
        steps[at_retract : at_retract + 1] = [lift, back, again]
        touching = evolve(demo_plan, steps=tuple(steps))
        with pytest.raises(NotClearError, match=r"back: .*block.*table"):
            stages_for(touching, manipulator)


def stages_for(plan: Plan, manipulator: Manipulator) -> tuple[MoveStage | GripStage, ...]:
    """Of a plan that is completed for its start."""
    return guarded(complete(plan, manipulator=manipulator), manipulator)


def placements(context: CollisionContext, name: str) -> list[float]:
    """Where the shapes of a body are placed."""
    shapes = context.checker.geometry.geometryObjects
    mine = [shape.placement.homogeneous for shape in shapes if shape.name.startswith(f"{name}/")]
    assert mine
    return [float(number) for number in np.ravel(mine)]
