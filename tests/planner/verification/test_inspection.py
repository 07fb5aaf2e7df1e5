"""A good plan passes every check; each way to spoil one fails at the checks it concerns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter, IKService, pose_from_quaternion
from planner import (
    Body,
    Box,
    Certificate,
    Manipulator,
    Move,
    Part,
    PickAndPlace,
    Plan,
    PlanFailure,
    Scene,
    Situation,
    Trajectory,
    plan_file,
    plan_joint_move,
    plan_pick_and_place,
    plan_straight_move,
    verify,
)
from planner.errors import TaskError
from planner.verification import Tolerances
from tests.conftest import at
from tests.planner.conftest import without_statements

T = TypeVar("T")

DOWN = (0.0, 1.0, 0.0, 0.0)
PICK = pose_from_quaternion((0.70, 0.15, -0.129), DOWN)
PLACE = pose_from_quaternion((0.75, 0.0, -0.129), DOWN)
BLOCK = at(0.675, 0.125, -0.155)
"""The block of the README, whose origin is its minimum corner, on the table."""

CLEARANCE = {"clearance", "clearance between samples"}
FINGER_CLEARANCE = {"clearance of fingers", "clearance of fingers between samples"}
NO_ROOM = {"room in the open hand", "gap of closed pads", "press of contacts"}
"""What fails when the fingers come down onto the body."""

CLAIMS = {"stated limits of those judged by", "acceleration of limit", "jerk of limit"}
"""What fails when a plan moves harder than the robot, as it says."""

LINES = {"distance from line", "turn from line"}
"""What fails when a move that shall be straight is not."""

COAL_M = 1e-6
"""Accuracy of coal's distances as it is set by default."""

PAD_M = 0.00035
"""How much further in the pads of the meshes stand than the URDF's boxes."""


def forged(value: T, **changes: Any) -> T:
    """A copy with other fields, past every check of its class."""
    copy = object.__new__(type(value))
    for field in fields(value):  # type: ignore[arg-type]
        object.__setattr__(copy, field.name, changes.get(field.name, getattr(value, field.name)))
    return copy


def spoiled(plan: Plan, label: str, **changes: Any) -> Plan:
    """The plan with another trajectory in one move, past every check."""
    steps = [
        forged(step, trajectory=forged(step.trajectory, **changes))
        if isinstance(step, Move) and step.label == label
        else step
        for step in plan
    ]
    return forged(plan, steps=tuple(steps))


def with_moves(plan: Plan, trajectories: dict[str, Trajectory]) -> Plan:
    """The plan with other trajectories in some moves."""
    steps = [
        replace(step, trajectory=trajectories[step.label])
        if isinstance(step, Move) and step.label in trajectories
        else step
        for step in plan
    ]
    return replace(plan, steps=tuple(steps))


def said_to_be_straight(plan: Plan, label: str) -> Plan:
    """The plan with one move marked as straight."""
    steps = [
        replace(step, is_straight=True) if isinstance(step, Move) and step.label == label else step
        for step in plan
    ]
    return replace(plan, steps=tuple(steps))


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


def move_of(plan: Plan, label: str) -> Move:
    return next(move for move in plan.moves if move.label == label)


def failed(certificate: Certificate) -> set[str]:
    return {check.name for check in certificate.failures}


def shifted(array: np.ndarray[Any, Any], row: int, joint: int, by: float) -> Any:
    changed = np.array(array)
    changed[row, joint] += by
    return changed


@pytest.fixture(scope="module")
def world(table: Body, block: Body) -> Scene:
    return Scene.of([table, block.at(BLOCK)])


@pytest.fixture(scope="module")
def plan(manipulator: Manipulator, world: Scene) -> Plan:
    task = PickAndPlace("block", PICK, PLACE)
    made = plan_pick_and_place(task, manipulator, world, manipulator.arm.neutral)
    assert made.is_valid, str(made.failure)
    return without_statements(replace(made, situation=Situation.of(manipulator, world)))


@pytest.fixture(scope="module")
def stopping(plan: Plan, manipulator: Manipulator) -> Plan:
    """The same waypoints by joint moves from rest to rest, so that any one can be exchanged."""
    steps = [
        replace(
            step,
            trajectory=plan_joint_move(
                step.trajectory.q_start, step.trajectory.q_goal, manipulator.limits
            ),
            is_straight=False,
        )
        if isinstance(step, Move)
        else step
        for step in plan
    ]
    return replace(plan, steps=tuple(steps))


@pytest.fixture(scope="module")
def certificate(plan: Plan) -> Certificate:
    return verify(plan)


def with_bodies(plan: Plan, change: Callable[[Scene], Scene]) -> Plan:
    assert plan.situation is not None
    situation = replace(plan.situation, scene=change(plan.situation.scene))
    return replace(plan, situation=situation)


def test_the_plan_of_the_readme_passes_every_check(certificate: Certificate) -> None:
    assert certificate.is_valid, certificate.verdict


def test_a_plan_that_stops_at_every_waypoint_passes(stopping: Plan) -> None:
    found = verify(stopping)
    assert found.is_valid, found.verdict


def test_the_right_arm_passes_too(robot: Baxter, table: Body) -> None:
    right = Manipulator.of(robot, "right")
    part = Part(Box((0.04, 0.04, 0.05)), at(0.0, 0.0, 0.025))
    narrow = Body("block", (part,), at(0.70, -0.15, -0.155), is_movable=True)
    scene = Scene.of([table, narrow])
    task = PickAndPlace("block", pose_from_quaternion((0.70, -0.15, -0.129), DOWN), PLACE)
    made = plan_pick_and_place(task, right, scene, right.arm.neutral)
    found = verify(made, Situation.of(right, scene))
    assert found.is_valid, found.verdict


def test_a_wrong_jerk_does_not_fit_the_knots(plan: Plan) -> None:
    move = move_of(plan, "pick: approach")
    jerks = np.array(move.trajectory.j)
    jerks[0, np.argmax(np.abs(jerks[0]))] *= 0.99  # less, so that no limit is exceeded
    assert failed(verify(spoiled(plan, move.label, j=jerks))) == {
        "position jump at knots",
        "velocity jump at knots",
        "acceleration jump at knots",
    }


def test_a_jerk_above_its_limit_is_found(plan: Plan) -> None:
    move = move_of(plan, "pick: approach")
    peak = move.trajectory.peak_ratios().jerk
    limits = replace(move.trajectory.limits, j_max=move.trajectory.limits.j_max * peak / 1.01)
    found = verify(spoiled(plan, move.label, limits=limits))
    assert failed(found) == {"jerk of limit"}
    assert found["jerk of limit"].value == pytest.approx(1.01)


@pytest.mark.parametrize(
    ("name", "noticed"),
    [
        ("q", {"position jump at knots"}),
        ("v", {"position jump at knots", "velocity jump at knots"}),
        (
            "a",
            {"position jump at knots", "velocity jump at knots", "acceleration jump at knots"},
        ),
    ],
)
def test_a_knot_off_by_a_millionth_is_found(stopping: Plan, name: str, noticed: set[str]) -> None:
    trajectory = move_of(stopping, "place: approach").trajectory
    assert trajectory.knots_s[2] - trajectory.knots_s[1] > 0.2  # long enough to add up
    before = getattr(trajectory, name)
    state = shifted(before, 1, 3, -1e-6 * np.sign(before[1, 3]))  # and no limit is exceeded
    found = verify(spoiled(stopping, "place: approach", **{name: state}))
    assert failed(found) == noticed
    assert "place: approach" in found.failures[0].where
    assert "left_e1" in found.failures[0].where


def test_swapped_moves_do_not_join(plan: Plan) -> None:
    order = [0, 1, 2, 3, 4, 5, 6, 7, 8]
    order[5], order[6] = 6, 5
    swapped = forged(plan, steps=tuple(plan.steps[i] for i in order))
    assert "position jump between moves" in failed(verify(swapped))


def test_a_jump_of_velocity_between_moves_is_found(
    stopping: Plan, manipulator: Manipulator
) -> None:
    move = move_of(stopping, "place: approach").trajectory
    fast = plan_joint_move(move.q_start, move.q_goal, manipulator.limits, v_start=np.full(7, 1e-3))
    found = verify(with_moves(stopping, {"place: approach": fast}))
    assert failed(found) == {"velocity jump between moves"}
    assert found["velocity jump between moves"].value == pytest.approx(1e-3)


def test_a_jump_of_acceleration_between_moves_is_found(
    stopping: Plan, manipulator: Manipulator
) -> None:
    move = move_of(stopping, "place: approach").trajectory
    fast = plan_joint_move(move.q_start, move.q_goal, manipulator.limits, a_start=np.full(7, 1e-3))
    assert failed(verify(with_moves(stopping, {"place: approach": fast}))) == {
        "acceleration jump between moves"
    }


def test_starting_from_rest_where_the_arm_arrives_in_motion_is_found(
    plan: Plan, manipulator: Manipulator
) -> None:
    resting = joined(plan, manipulator, "place: descend")
    found = verify(with_moves(plan, {"place: descend": resting}))
    assert failed(found) >= {"velocity jump between moves", "acceleration jump between moves"}
    arriving = move_of(plan, "place: approach").trajectory.v[-1]
    assert found["velocity jump between moves"].value == pytest.approx(np.abs(arriving).max())


def test_passing_a_waypoint_in_motion_is_fine(stopping: Plan, manipulator: Manipulator) -> None:
    v = np.full(7, 0.01)
    moves = {
        "pick: approach": joined(stopping, manipulator, "pick: approach", v_goal=v),
        "pick: descend": joined(stopping, manipulator, "pick: descend", v_start=v),
    }
    assert verify(with_moves(stopping, moves)).is_valid


def test_closing_the_hand_in_motion_is_found(stopping: Plan, manipulator: Manipulator) -> None:
    v = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1e-4])
    moves = {
        "pick: descend": joined(stopping, manipulator, "pick: descend", v_goal=v),
        "pick: retract": joined(stopping, manipulator, "pick: retract", v_start=v),
    }
    found = verify(with_moves(stopping, moves))
    assert failed(found) == {"velocity at stops"}
    assert found["velocity at stops"].where == "pick: close, left_w2"


def test_ending_in_motion_is_found(stopping: Plan, manipulator: Manipulator) -> None:
    v = np.full(7, 1e-4)
    moves = {"place: retract": joined(stopping, manipulator, "place: retract", v_goal=v)}
    assert "velocity at stops" in failed(verify(with_moves(stopping, moves)))


def joined(plan: Plan, manipulator: Manipulator, label: str, **rates: Any) -> Trajectory:
    move = move_of(plan, label).trajectory
    return plan_joint_move(move.q_start, move.q_goal, manipulator.limits, **rates)


def test_a_velocity_limit_exceeded_for_a_millisecond_is_found(plan: Plan) -> None:
    trajectory = move_of(plan, "pick: approach").trajectory
    knot, joint = np.unravel_index(np.abs(trajectory.v).argmax(), trajectory.v.shape)
    jerk = abs(trajectory.j[knot - 1, joint])
    below = abs(trajectory.v[knot, joint]) - jerk * 0.5e-3**2 / 2  # 0.5 ms to either side
    v_max = np.array(trajectory.limits.v_max)
    v_max[joint] = below
    found = verify(spoiled(plan, "pick: approach", limits=replace(trajectory.limits, v_max=v_max)))
    assert failed(found) == {"velocity of limit"}
    assert trajectory.limits.names[joint] in found["velocity of limit"].where


def test_the_urdfs_velocity_counts_where_a_plan_claims_more(
    stopping: Plan, manipulator: Manipulator
) -> None:
    generous = replace(
        manipulator.limits,
        v_max=2 * manipulator.limits.v_max,
        a_max=np.full(7, 50.0),
        j_max=np.full(7, 1e3),
    )
    far = move_of(stopping, "pick: approach").trajectory
    fast = plan_joint_move(far.q_start, far.q_goal, generous)
    found = verify(with_moves(stopping, {"pick: approach": fast}))
    assert failed(found) == {"velocity of limit", *CLAIMS}
    assert found["stated limits of those judged by"].value == 50.0
    generously = verify(with_moves(stopping, {"pick: approach": fast}), limits=generous)
    assert generously.is_valid, generously.verdict
    assert "judged by 50 rad/s^2 and 1000 rad/s^3" in generously.verdict


def test_limits_that_a_file_states_are_not_believed(
    stopping: Plan, manipulator: Manipulator
) -> None:
    harder = replace(manipulator.limits, a_max=np.full(7, 2.2), j_max=np.full(7, 22.0))
    far = move_of(stopping, "pick: approach").trajectory
    fast = plan_joint_move(far.q_start, far.q_goal, harder)
    found = verify(with_moves(stopping, {"pick: approach": fast}))
    assert failed(found) == CLAIMS
    assert "2.2 rad/s^2 stated, judged by 2 rad/s^2" in found.verdict
    assert verify(with_moves(stopping, {"pick: approach": fast}), limits=harder).is_valid


def test_a_claim_alone_is_named(plan: Plan) -> None:
    limits = move_of(plan, "pick: descend").trajectory.limits
    claimed = replace(limits, j_max=np.full(7, 21.0))
    found = verify(spoiled(plan, "pick: descend", limits=claimed))
    assert failed(found) == {"stated limits of those judged by"}


def test_limits_of_other_joints_are_refused(plan: Plan, robot: Baxter) -> None:
    with pytest.raises(TaskError, match="the left arm has: left_s0"):
        verify(plan, limits=robot.arm("right").limits)


def slowed(trajectory: Trajectory, times: float) -> Trajectory:
    """The same way in a multiple of its time."""
    rates = (getattr(trajectory, name) / times**n for n, name in enumerate("vaj", start=1))
    return Trajectory(trajectory.limits, trajectory.knots_s * times, trajectory.q, *rates)


@pytest.mark.parametrize("times", [1e3, 1e6, 1e9])
def test_a_slow_plan_costs_no_more_than_a_fast_one(plan: Plan, times: float) -> None:
    slow = with_moves(plan, {move.label: slowed(move.trajectory, times) for move in plan.moves})
    before, after = verify(plan), verify(slow)
    assert after.is_valid, after.verdict
    assert after.samples == pytest.approx(before.samples, abs=10)


def test_fingers_start_within_their_stroke(plan: Plan) -> None:
    assert plan.situation is not None
    joints = dict(plan.situation.joints)
    for name in ("l_gripper_l_finger_joint", "l_gripper_r_finger_joint"):
        joints[name] *= 1.01
    found = verify(replace(plan, situation=replace(plan.situation, joints=joints)))
    assert "finger start outside the stroke" in failed(found)
    assert "l_gripper_" in found["finger start outside the stroke"].where


def test_fingers_start_equally_open(plan: Plan) -> None:
    assert plan.situation is not None
    joints = {**plan.situation.joints, "l_gripper_r_finger_joint": -0.02}
    found = verify(replace(plan, situation=replace(plan.situation, joints=joints)))
    assert "fingers unequally open" in failed(found)


@pytest.mark.parametrize(("name", "count"), [("steps", 9), ("bodies", 1), ("parts", 3)])
def test_a_plan_too_large_is_refused(
    plan: Plan, monkeypatch: pytest.MonkeyPatch, name: str, count: int
) -> None:
    monkeypatch.setattr(plan_file, "MOST", {**plan_file.MOST, name: count - 1})
    with pytest.raises(TaskError, match=f"{name}; at most {count - 1} can be checked"):
        verify(plan)


def test_an_acceleration_limit_is_the_plans(plan: Plan) -> None:
    trajectory = move_of(plan, "pick: descend").trajectory
    limits, peak = trajectory.limits, trajectory.peak_ratios().acceleration
    strict = replace(limits, a_max=limits.a_max * peak * (1 - 1e-6))
    found = verify(spoiled(plan, "pick: descend", limits=strict))
    assert failed(found) == {"acceleration of limit"}


def test_a_joint_beyond_its_range_between_knots_is_found(plan: Plan) -> None:
    trajectory = move_of(plan, "place: approach").trajectory
    reached = trajectory.position_extrema()[1]
    q_max = np.array(trajectory.limits.q_max)
    q_max[3] = reached[3] - 1e-7
    found = verify(spoiled(plan, "place: approach", limits=replace(trajectory.limits, q_max=q_max)))
    assert failed(found) == {"position margin"}
    assert "left_e1" in found["position margin"].where


def test_a_tip_beside_its_waypoint_is_found(plan: Plan) -> None:
    move = move_of(plan, "place: approach")
    assert move.T_base_tip is not None
    asked = pin.SE3(move.T_base_tip.rotation, move.T_base_tip.translation + np.array([0, 0, 2e-6]))
    steps = tuple(replace(s, T_base_tip=asked) if s is move else s for s in plan)
    found = verify(replace(plan, steps=steps))
    assert failed(found) == {"tip position"}
    assert found["tip position"].value == pytest.approx(2e-6, rel=1e-3)


def test_a_grasp_turned_from_what_was_asked_is_found(plan: Plan) -> None:
    move = move_of(plan, "pick: descend")
    assert move.T_base_tip is not None
    turn = pin.exp3(np.array([0.0, 0.0, 2e-6]))
    asked = pin.SE3(move.T_base_tip.rotation @ turn, move.T_base_tip.translation)
    steps = tuple(replace(s, T_base_tip=asked) if s is move else s for s in plan)
    found = verify(replace(plan, steps=steps))
    assert failed(found) == {"tip orientation", "tip orientation at grips"}


def test_a_grasp_that_nobody_asked_for_is_found(plan: Plan) -> None:
    move = move_of(plan, "pick: descend")
    steps = tuple(replace(s, T_base_tip=None) if s is move else s for s in plan)
    found = verify(replace(plan, steps=steps))
    assert failed(found) == {"tip position at grips", "tip orientation at grips"}
    assert (
        found.as_dict()["checks"][found.checks.index(found["tip position at grips"])]["value"]
        is None
    )


def test_a_block_beside_the_hand_has_no_room(plan: Plan) -> None:
    moved = with_bodies(plan, lambda scene: scene.moved("block", at(0.675, 0.135, -0.155)))
    assert failed(verify(moved)) == NO_ROOM


def test_a_block_that_the_fingers_push_by_3_mm_passes(plan: Plan) -> None:
    moved = with_bodies(plan, lambda scene: scene.moved("block", at(0.675, 0.128, -0.155)))
    found = verify(moved)
    assert found.is_valid, found.verdict
    assert found["room in the open hand"].value == pytest.approx(0.000833 - PAD_M, abs=1e-5)


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


def test_a_block_out_of_the_hand_is_missed(plan: Plan) -> None:
    moved = with_bodies(plan, lambda scene: scene.moved("block", at(0.775, 0.125, -0.155)))
    found = verify(moved)
    assert {"gap of closed pads", "gripper actions out of order"} <= failed(found)
    assert "the hand holds nothing, not block" in found["gripper actions out of order"].where


def test_a_block_sunk_into_the_table_presses(plan: Plan) -> None:
    moved = with_bodies(plan, lambda scene: scene.moved("block", at(0.675, 0.125, -0.165)))
    found = verify(moved)
    assert failed(found) == {"press of contacts"}  # it is drawn straight out, not sideways
    assert found["press of contacts"].value == pytest.approx(0.01, abs=COAL_M)


def test_a_block_let_go_in_the_air_falls(plan: Plan) -> None:
    moved = with_bodies(plan, lambda scene: scene.moved("block", at(0.675, 0.125, -0.14)))
    found = verify(moved)
    assert failed(found) == {"drop at release"}
    assert found["drop at release"].value == pytest.approx(0.015, abs=COAL_M)


def test_a_block_too_wide_for_the_hand_is_found(plan: Plan, block: Body) -> None:
    part = Part(Box((0.05, 0.07, 0.05)), at(0.025, 0.025, 0.025))
    wide = Body("block", (part,), BLOCK, is_movable=True)
    found = verify(with_bodies(plan, lambda scene: scene.without("block").with_body(wide)))
    assert failed(found) == NO_ROOM


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
    assert plan.situation is not None
    right = robot.arm("right")
    reached = IKService(right).solve(pose_from_quaternion((0.75, 0.0, 0.03), DOWN))
    assert reached.is_valid
    joints = {**plan.situation.joints, **right.joints(reached.q)}
    found = verify(replace(plan, situation=replace(plan.situation, joints=joints)))
    assert failed(found) == CLEARANCE
    assert "right_" in found["clearance"].where or "r_gripper" in found["clearance"].where


def test_a_plate_thinner_than_a_planning_step_is_not_jumped_over(plan: Plan) -> None:
    plate = Body("plate", (Part(Box((0.2, 0.2, 0.0005)), at(0, 0, 0)),), at(0.70, 0.15, 0.02))
    found = verify(with_bodies(plan, lambda scene: scene.with_body(plate)))
    assert failed(found) >= CLEARANCE


def test_a_safety_margin_can_be_asked_for(plan: Plan) -> None:
    found = verify(plan, tolerances=Tolerances(clearance_m=0.025))
    assert failed(found) == {*CLEARANCE, *FINGER_CLEARANCE}


def test_gripper_actions_out_of_order_are_found(plan: Plan) -> None:
    steps = tuple(s for s in plan if s.label != "pick: close")
    found = verify(forged(plan, steps=steps))
    assert "gripper actions out of order" in failed(found)


def test_a_body_that_is_not_there_is_found(plan: Plan) -> None:
    found = verify(with_bodies(plan, lambda scene: scene.without("block")))
    assert failed(found) == {"gripper actions out of order"}
    assert "no movable body 'block'" in found["gripper actions out of order"].where


def test_a_failed_plan_says_so(plan: Plan) -> None:
    found = verify(replace(plan, failure=PlanFailure("place: retract", "no way up")))
    assert failed(found) == {"failed steps"}
    assert found["failed steps"].where == "place: retract: no way up"


def test_a_plan_for_the_other_arm_is_found(plan: Plan) -> None:
    assert "foreign joints" in failed(verify(forged(plan, limb="right")))


def test_the_straight_moves_of_a_plan_keep_to_their_lines(
    plan: Plan, certificate: Certificate
) -> None:
    straight = {move.label for move in plan.moves if move.is_straight}
    assert straight == {"pick: descend", "pick: retract", "place: descend", "place: retract"}
    for name in LINES:
        assert certificate[name].is_passed
        assert certificate[name].where.split(",")[0] in straight  # they were looked at


def test_a_joint_move_said_to_be_straight_is_found(stopping: Plan) -> None:
    found = verify(stopping, straight=["pick: descend"])
    assert failed(found) == LINES
    assert all(found[name].where.startswith("pick: descend, ") for name in LINES)


def test_a_joint_move_that_a_plan_says_is_straight_is_found(stopping: Plan) -> None:
    found = verify(said_to_be_straight(stopping, "place: retract"))
    assert failed(found) == LINES
    assert all(found[name].where.startswith("place: retract, ") for name in LINES)


def test_a_mark_counts_for_its_move_not_for_its_label(stopping: Plan) -> None:
    mixed = [replace(move, label="go", is_straight=False) for move in stopping.moves]
    stay = Trajectory.stay(mixed[-1].trajectory.q_goal, mixed[-1].trajectory.limits)
    again = replace(stopping, steps=(*mixed, Move("go", stay, is_straight=True)))
    assert not failed(verify(again)) & LINES
    assert failed(verify(again, straight=["go"])) >= LINES


def test_a_plan_without_steps_is_valid(manipulator: Manipulator, world: Scene) -> None:
    plan = Plan("left", manipulator.arm.neutral, (), situation=Situation.of(manipulator, world))
    found = verify(plan)
    assert found.is_valid
    assert found.verdict.startswith("valid: left arm, a plan without steps, all ")


def test_a_move_that_stays_is_valid(manipulator: Manipulator, world: Scene) -> None:
    stay = Move("stay", Trajectory.stay(manipulator.arm.neutral, manipulator.limits))
    plan = Plan("left", manipulator.arm.neutral, (stay,))
    assert verify(plan, Situation.of(manipulator, world)).is_valid


def test_a_plan_without_situation_is_refused(plan: Plan) -> None:
    with pytest.raises(TaskError, match="does not say for which situation"):
        verify(replace(plan, situation=None))


def test_a_situation_of_another_robot_is_refused(plan: Plan, world: Scene) -> None:
    with pytest.raises(TaskError, match="lacks joint 'head_pan'"):
        verify(plan, Situation(world, {}))


def test_an_unknown_straight_move_is_refused(plan: Plan) -> None:
    with pytest.raises(TaskError, match="no move 'pick: lift'"):
        verify(plan, straight=["pick: lift"])


def test_no_plan_is_refused() -> None:
    with pytest.raises(TaskError, match="plan must be of class Plan"):
        verify("plan")  # type: ignore[arg-type]


def test_the_table_names_every_check(certificate: Certificate) -> None:
    assert all(check.name in certificate.table() for check in certificate.checks)


def test_the_data_has_every_check(certificate: Certificate) -> None:
    data = certificate.as_dict()
    assert data["is_valid"] is True
    assert [check["name"] for check in data["checks"]] == [c.name for c in certificate.checks]
