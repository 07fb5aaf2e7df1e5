"""What comes too near is found, and contacts only where they are meant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter, IKService, pose_from_quaternion
from planner import (
    Body,
    Box,
    Grip,
    Manipulator,
    Move,
    Part,
    PickAndPlace,
    Plan,
    Scene,
    State,
    Trajectory,
    plan_joint_move,
    plan_pick_and_place,
    plan_straight_move,
    verify,
)
from planner.verification import Tolerances
from tests.conftest import at
from tests.planner.conftest import without_statements
from tests.planner.verification.conftest import (
    DOWN,
    PICK,
    TABLE_M,
    failed,
    move_of,
    standing_box,
    with_bodies,
)

CLEARANCE = {"clearance", "clearance between samples"}
FINGER_CLEARANCE = {"clearance of fingers", "clearance of fingers between samples"}

COAL_M = 1e-6
"""Accuracy of coal's distances as it is set by default."""


def up_and_down(
    plan: Plan, label: str, manipulator: Manipulator
) -> tuple[Trajectory, Trajectory, pin.SE3]:
    """From rest where a descent ends, 5 cm straight up; down again; and the pose at the bottom."""
    move = move_of(plan, label)
    assert move.T_base_tip is not None
    low = move.T_base_tip
    high = pin.SE3(low.rotation, low.translation + np.array([0.0, 0.0, 0.05]))
    up = plan_straight_move(manipulator.arm, move.trajectory.q_goal, high, manipulator.limits)
    return up, up.reversed(), low


def beside_a_finger(scene: Scene) -> Scene:
    """The block so far aside that a finger presses it by 0.04 mm on its way straight down."""
    return scene.moved("block", at(0.675, 0.12887, -0.155))


def test_a_finger_may_touch_the_block_right_before_it_closes(plan: Plan) -> None:
    found = verify(with_bodies(plan, beside_a_finger))
    assert found.is_valid, found.verdict
    assert found["press of contacts"].value > 3e-5


def test_a_finger_may_not_touch_the_block_earlier(plan: Plan, manipulator: Manipulator) -> None:
    up, down, low = up_and_down(plan, "pick: descend", manipulator)
    steps = list(plan)
    steps[3:3] = [Move("up again", up), Move("second try", down, low)]
    found = verify(with_bodies(replace(plan, steps=tuple(steps)), beside_a_finger))
    assert failed(found) == {*CLEARANCE, "contacts out of turn"}
    assert found["contacts out of turn"].where.startswith("pick: descend, ")


def test_a_block_sunk_into_the_table_presses(plan: Plan) -> None:
    moved = with_bodies(plan, lambda scene: scene.moved("block", at(0.675, 0.125, -0.165)))
    found = verify(moved)
    assert failed(found) == {"press of contacts"}  # it is drawn straight out, not sideways
    assert found["press of contacts"].value == pytest.approx(0.01, abs=COAL_M)


def test_a_box_in_the_way_of_the_arm_is_found(plan: Plan) -> None:
    way = move_of(plan, "place: retract").trajectory
    tip = np.array([0.75, 0.0, -0.129 + 0.2])
    box = Body("box", (Part(Box((0.02, 0.02, 0.02)), at(0, 0, 0)),), at(*tip))
    assert way.duration > 0.0
    found = verify(with_bodies(plan, lambda scene: scene.with_body(box)))
    assert failed(found) == {*CLEARANCE, "bodies inside a link"}
    assert "box" in found["clearance"].where


def test_a_box_in_the_way_of_the_carried_block_alone_is_found(
    plan: Plan, manipulator: Manipulator
) -> None:
    way = move_of(plan, "place: approach").trajectory
    x, y, z = manipulator.arm.T_base_tip(way.sample(way.duration / 2).q).translation
    below_fingers = at(x, y, z - 0.018 - 0.005)  # the block reaches 26 mm below the tip, they 5 mm
    box = Body("box", (Part(Box((0.02, 0.02, 0.01)), at(0, 0, 0)),), below_fingers)
    found = verify(with_bodies(plan, lambda scene: scene.with_body(box)))
    assert failed(found) == CLEARANCE
    assert "block with box" in found["clearance"].where


def test_a_block_set_down_on_the_way_is_found(plan: Plan, manipulator: Manipulator) -> None:
    up, down, low = up_and_down(plan, "place: descend", manipulator)
    steps = list(plan)
    steps[7:7] = [Move("lift", up), Move("set down again", down, low)]
    found = verify(replace(plan, steps=tuple(steps)))
    assert failed(found) == {*CLEARANCE, "contacts out of turn"}
    assert found["contacts out of turn"].where.startswith("place: descend, ")
    assert "block with table" in found["contacts out of turn"].where


def test_a_block_dragged_along_the_table_is_found(plan: Plan, manipulator: Manipulator) -> None:
    held = move_of(plan, "pick: retract").trajectory
    aside = pin.SE3(PICK.rotation, PICK.translation + np.array([0.0, -0.02, 0.0]))
    drag = plan_straight_move(manipulator.arm, held.q_start, aside, manipulator.limits)
    back = plan_joint_move(drag.q_goal, held.q_start, manipulator.limits)
    steps = list(plan)
    steps[4:4] = [Move("drag", drag, aside), Move("drag back", back)]
    found = verify(replace(plan, steps=tuple(steps)))
    assert "slide in contact" in failed(found)
    assert found["slide in contact"].value == pytest.approx(0.02, abs=1e-3)


def test_the_other_arm_in_the_way_is_found(plan: Plan, robot: Baxter) -> None:
    right = robot.arm("right")
    reached = IKService(right).solve(pose_from_quaternion((0.75, 0.0, 0.03), DOWN))
    assert reached.is_valid
    joints = {**plan.start.joints, **right.joints(reached.q)}
    found = verify(replace(plan, start=replace(plan.start, joints=joints)))
    assert failed(found) == CLEARANCE
    assert "right_" in found["clearance"].where or "r_gripper" in found["clearance"].where


def test_a_plate_thinner_than_a_planning_step_is_not_jumped_over(plan: Plan) -> None:
    plate = Body("plate", (Part(Box((0.2, 0.2, 0.0005)), at(0, 0, 0)),), at(0.70, 0.15, 0.02))
    found = verify(with_bodies(plan, lambda scene: scene.with_body(plate)))
    assert failed(found) >= CLEARANCE


def test_a_safety_margin_can_be_asked_for(plan: Plan) -> None:
    found = verify(plan, tolerances=Tolerances(clearance_m=0.025))
    assert failed(found) == {*CLEARANCE, *FINGER_CLEARANCE}


@pytest.mark.parametrize("is_movable", [False, True])
def test_a_finger_may_not_close_through_a_post_that_stands_between_open_and_closed_pad(
    cube_plan: Plan, is_movable: bool
) -> None:
    post = replace(
        standing_box("post", (0.010, 0.008, 0.05), 0.70 + 0.015, 0.15 + 0.0226, TABLE_M),
        is_movable=is_movable,
    )
    found = verify(with_bodies(cube_plan, lambda scene: scene.with_body(post)))
    assert "clearance of fingers" in failed(found)
    assert "post" in found["clearance of fingers"].where


def test_fingers_may_not_open_through_a_post_beside_the_place(cube_plan: Plan) -> None:
    post = standing_box("post", (0.010, 0.008, 0.05), 0.75 + 0.015, 0.0226, TABLE_M)
    found = verify(with_bodies(cube_plan, lambda scene: scene.with_body(post)))
    assert "clearance of fingers" in failed(found)
    assert found["clearance of fingers"].where.startswith("place: open, each finger ")


def test_fingers_that_open_half_way_stay_clear_of_the_post(cube_plan: Plan) -> None:
    post = standing_box("post", (0.010, 0.008, 0.05), 0.75 + 0.015, 0.0226, TABLE_M)
    steps = tuple(
        replace(step, opening_m=0.006)
        if isinstance(step, Grip) and step.label == "place: open"
        else step
        for step in cube_plan
    )
    found = verify(
        with_bodies(replace(cube_plan, steps=steps), lambda scene: scene.with_body(post))
    )
    assert found["clearance of fingers"].is_passed, found.verdict
    assert found["clearance of fingers"].value < 0.01


def test_a_body_that_a_finger_pushes_may_not_be_pushed_into_its_neighbour(cube_plan: Plan) -> None:
    beside = standing_box("beside", (0.02, 0.008, 0.004), 0.70, 0.15 + 0.012, TABLE_M)
    aside = with_bodies(
        cube_plan, lambda scene: scene.moved("block", at(0.70, 0.15 - 0.004, TABLE_M))
    )
    assert verify(aside).is_valid
    found = verify(with_bodies(aside, lambda scene: scene.with_body(beside)))
    assert "clearance of fingers" in failed(found)


def test_a_palm_may_not_stand_inside_what_the_fingers_hold(cube_plan: Plan) -> None:
    tall = standing_box("block", (0.02, 0.02, 0.16), 0.70, 0.15, TABLE_M)
    found = verify(with_bodies(cube_plan, lambda scene: scene.without("block").with_body(tall)))
    assert {"clearance", "clearance of fingers"} <= failed(found)
    assert "left_gripper_base with block" in found["clearance of fingers"].where or (
        "left_" in found["clearance of fingers"].where
    )


def test_an_elbow_may_not_go_into_a_cube_that_the_urdfs_cylinder_misses(
    manipulator: Manipulator, table: Body, block: Body
) -> None:
    scene = Scene.of([table, block.at(at(0.675, 0.125, TABLE_M))])
    poses = [pose_from_quaternion(p, DOWN) for p in ((0.70, 0.15, -0.129), (0.75, 0.0, -0.129))]
    task = PickAndPlace("block", *poses)
    made = plan_pick_and_place(task, manipulator, scene, manipulator.arm.neutral)
    cube = Body("cube", (Part(Box((0.02, 0.02, 0.02)), at(0, 0, 0)),), at(0.482, 0.271, 0.345))
    believed = without_statements(made)
    found = verify(believed, State.of(manipulator, scene.with_body(cube)))
    # where the hand lets go, the cube's centre is inside the elbow: the winding number there is 1
    inside = "bodies inside a link"
    assert failed(found) == {"clearance", "clearance between samples", inside}
    assert "elbow with cube" in found["clearance"].where
    assert found[inside].where == "left_lower_elbow with cube"


def test_what_the_other_hand_holds_is_in_the_way(cube_plan: Plan, holding: State) -> None:
    crossing = at(0.70, 0.15, TABLE_M + 0.06)
    rod = Body("stick", (Part(Box((0.3, 0.006, 0.006)), at(0, 0, 0)),), crossing)
    tip, scene = holding.scene["stick"].T_base_body, holding.scene.without("stick")
    held = replace(holding.attachments[0], T_link_body=tip.inverse() * crossing)
    found = verify(cube_plan, State(scene.with_body(rod), holding.joints, (held,)))
    assert not found["clearance"].is_passed or not found["clearance of fingers"].is_passed
    assert "stick" in found.verdict
