"""The independent checker contradicts plans that are wrong in known ways, and no right one."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from planner import (
    Attachment,
    Body,
    Box,
    Grip,
    GripperAction,
    LineTolerance,
    Manipulator,
    Move,
    Part,
    PathMove,
    PickAndPlace,
    Plan,
    Polyline,
    Scene,
    Sphere,
    State,
    Trajectory,
    make_block,
    overhead_grasp,
    plan_joint_move,
    plan_path_move,
    plan_straight_move,
)
from tests.bodies import grasp_of
from tests.conftest import at, overhead

FloatArray = NDArray[np.float64]
TABLE_TOP_M = -0.155
PICK_M = (0.70, 0.15)

ELBOW_AT_CUBE = (
    (-0.735794, -0.289685, -0.875965, 1.041983, 0.942534, 1.178361, -0.809664),
    (-0.760328, -0.205746, -0.841832, 0.990912, 0.963803, 1.125675, -0.797957),
)
"""Ends of the demo's descent to its second pose, as it was once planned and proven 18 mm clear."""


def check(plan: Plan, **options: Any) -> list[Any]:
    found: list[Any] = importlib.import_module("referee.checker").check_plan(plan, **options)
    return found


def said(findings: list[Any]) -> set[tuple[str, str, str]]:
    """Kind and pair of each finding, the pair in alphabetical order."""
    return {(f.kind, *sorted((f.first, f.second))) for f in findings}


def cube(name: str, edge_m: Sequence[float], x: float, y: float, z: float) -> Body:
    a, b, c = edge_m
    return Body(name, (Part(Box((a, b, c)), at(0, 0, 0)),), at(x, y, z))


def block(height_m: float = 0.05, width_m: float = 0.03) -> Body:
    centre = at(*PICK_M, TABLE_TOP_M + height_m / 2)
    return make_block("block", centre, edge_m=(width_m, width_m, height_m))


def grasp_q(
    m: Manipulator, body: Body, lift_m: float = 0.0, tip_m: float | None = None
) -> FloatArray:
    """The arm where the hand is about to close on a body, or above that."""
    T = overhead_grasp(m.hand, body)
    z = T.translation[2] if tip_m is None else TABLE_TOP_M + tip_m
    goal = pin.SE3(T.rotation, np.array([*T.translation[:2], z + lift_m]))
    found = m.ik.solve(goal, current=m.arm.start)
    assert found.is_valid
    return np.array(found.q)


def plan_of(
    m: Manipulator,
    scene: Scene,
    steps: Sequence[Move | Grip],
    q: FloatArray,
    *,
    finger_m: float | None = None,
    held: tuple[Attachment, ...] = (),
) -> Plan:
    """A plan made by hand."""
    state = State.of(m, scene, held, q)
    if finger_m is not None:
        joints = {**state.joints, **m.hand.finger_joints(finger_m)}
        state = State(scene, joints, held)
    return Plan(state, tuple(steps), limb=m.arm.side)


CLOSE = Grip("close", GripperAction.CLOSE, "block")
OPEN = Grip("open", GripperAction.OPEN)


def lift(m: Manipulator, q: FloatArray, height_m: float = 0.06) -> Move:
    T = m.arm.T_base_tip(q)
    up = pin.SE3(T.rotation, T.translation + np.array([0.0, 0.0, height_m]))
    return Move("lift", plan_straight_move(m.arm, q, up, m.limits), is_straight=True)


# The robot


@pytest.mark.slow
def test_no_two_links_that_are_not_joined_overlap_at_rest(manipulator: Manipulator) -> None:
    q = np.array(manipulator.arm.neutral)
    still = Move("stay", Trajectory.stay(q, manipulator.limits))
    assert check(plan_of(manipulator, Scene.of(), [still], q)) == []


def test_what_is_wholly_inside_a_mesh_is_seen(manipulator: Manipulator) -> None:
    q = np.array(manipulator.arm.neutral)
    T_base_elbow = importlib.import_module("referee.robot").load_robot()
    joints = State.of(manipulator, Scene.of()).joints
    names = manipulator.arm.joint_names
    T = T_base_elbow.poses({**joints, **dict(zip(names, q, strict=True))})["left_upper_elbow"]
    inside = T @ np.array([0.0, 0.0, 0.14, 1.0])
    ball = Body("ball", (Part(Sphere(0.004), at(*inside[:3])),), at(0, 0, 0))
    still = Move("stay", Trajectory.stay(q, manipulator.limits))
    kinds = said(check(plan_of(manipulator, Scene.of([ball]), [still], q)))
    assert kinds == {("inside", "ball", "left_upper_elbow")}


# Moves


def test_an_arm_through_a_box_is_contradicted(manipulator: Manipulator) -> None:
    m = manipulator
    q, goal = np.array(m.arm.neutral), np.array(m.arm.neutral)
    goal[0] += 0.8
    way = plan_joint_move(q, goal, m.limits)
    x, y, z = m.arm.T_base_tip(way.sample(way.duration / 2).q).translation
    moves = [Move("across", way)]
    assert check(plan_of(m, Scene.of(), moves, q)) == []
    thin = cube("plate", (0.02, 0.02, 0.001), x, y, z)
    found = check(plan_of(m, Scene.of([thin]), moves, q))
    assert any(f.kind == "touches" and f.second == "plate" for f in found)
    assert all(0.0 < f.time_s < way.duration for f in found)


def test_a_cube_that_only_the_mesh_of_the_elbow_meets_is_found(
    manipulator: Manipulator, table: Body
) -> None:
    q, goal = np.array(ELBOW_AT_CUBE)
    small = cube("cube", (0.02, 0.02, 0.02), 0.482, 0.271, 0.345)
    way = Move("descend", plan_joint_move(q, goal, manipulator.limits))
    found = check(plan_of(manipulator, Scene.of([table, small]), [way], q))
    assert said(found) == {("touches", "cube", "left_lower_elbow")}
    assert found[0].amount == pytest.approx(0.0096, abs=5e-4)


def test_a_margin_is_measured_to_the_meshes(manipulator: Manipulator) -> None:
    m, body = manipulator, block()
    q = grasp_q(m, body, 0.1)
    x, y, z = m.arm.T_base_tip(q).translation
    post = cube("post", (0.02, 0.08, 0.02), x, y, z - 0.04)
    move = Move("up", lift(m, q).trajectory)
    plan = plan_of(m, Scene.of([post]), [move], q)
    assert check(plan) == []
    assert check(plan, margin_m=0.02) == []
    near = said(check(plan, margin_m=0.03))
    assert ("closer than the margin", "l_gripper_l_finger_tip", "post") in near


def test_a_held_body_that_meets_a_wall_is_contradicted(
    manipulator: Manipulator, table: Body
) -> None:
    m, body = manipulator, block(height_m=0.08)
    q = grasp_q(m, body)
    steps: list[Move | Grip] = [CLOSE, lift(m, q, 0.10)]
    assert check(plan_of(m, Scene.of([table, body]), steps, q)) == []
    # beside the fingers and low enough for nothing else
    lid = cube("lid", (0.01, 0.2, 0.01), PICK_M[0] + 0.011, PICK_M[1], TABLE_TOP_M + 0.1)
    found = check(plan_of(m, Scene.of([table, body, lid]), steps, q))
    assert any(sorted((f.first, f.second)) == ["block", "lid"] for f in found)


def test_a_body_that_is_dragged_over_the_table_slides(
    manipulator: Manipulator, table: Body
) -> None:
    m, body = manipulator, block()
    q = grasp_q(m, body)
    T = m.arm.T_base_tip(q)
    aside = pin.SE3(T.rotation, T.translation + np.array([0.0, 0.03, 0.0]))
    drag = Move("drag", plan_straight_move(m.arm, q, aside, m.limits))
    found = check(plan_of(m, Scene.of([table, body]), [CLOSE, drag], q))
    assert ("slides while touching", "block", "table") in said(found)


# Fingers


def test_closing_as_the_hand_says_is_not_contradicted(
    manipulator: Manipulator, table: Body
) -> None:
    body = block()
    q = grasp_q(manipulator, body)
    assert check(plan_of(manipulator, Scene.of([table, body]), [CLOSE], q)) == []


@pytest.mark.parametrize("is_movable", [False, True])
def test_a_finger_through_a_post_while_closing_is_contradicted(
    manipulator: Manipulator, table: Body, is_movable: bool
) -> None:
    m, body = manipulator, block(0.02, 0.02)
    axis = m.arm.T_base_tip(grasp_q(m, body)).rotation[:, 1]
    x, y, _ = np.array([*PICK_M, 0.0]) + 0.0226 * axis
    post = cube("post", (0.008, 0.010, 0.05), x + 0.015, y, TABLE_TOP_M + 0.025)
    still = Body("post", post.parts, post.T_base_body, is_movable)
    found = check(plan_of(m, Scene.of([table, body, still]), [CLOSE], grasp_q(m, body)))
    assert {f.kind for f in found} == {"touches"}
    assert {f.second for f in found} == {"post"}


def test_a_pushed_body_that_meets_another_is_contradicted(
    manipulator: Manipulator, table: Body
) -> None:
    m, body = manipulator, block(0.04, 0.02)
    q = grasp_q(m, body)
    side = body.at(at(0.0, 0.012, 0.0) * body.T_base_body)  # off the middle: it will be pushed
    y = PICK_M[1] + 0.012 - 0.010 - 0.002 - 0.006
    post = cube("post", (0.003, 0.003, 0.01), PICK_M[0], y, TABLE_TOP_M + 0.005)
    found = check(plan_of(m, Scene.of([table, side, post]), [CLOSE], q))
    assert ("touches", "block", "post") in said(found)


def test_fingers_that_open_into_a_wall_are_contradicted(manipulator: Manipulator) -> None:
    m = manipulator
    q = grasp_q(m, block(), 0.1)
    T = m.arm.T_base_tip(q)
    x, y, z = T.translation + T.rotation @ np.array([0.0, 0.030, 0.0])
    wall = cube("wall", (0.05, 0.004, 0.05), x, y, z)
    scene = Scene.of([wall])
    assert said(check(plan_of(m, scene, [OPEN], q, finger_m=0.005))) >= {
        ("touches", "l_gripper_l_finger_tip", "wall")
    }
    less = Grip("open", GripperAction.OPEN, opening_m=0.006)
    assert check(plan_of(m, scene, [less], q, finger_m=0.005)) == []


def test_a_hand_inside_the_body_it_grasps_is_contradicted(
    manipulator: Manipulator, table: Body
) -> None:
    m, body = manipulator, block(height_m=0.20, width_m=0.03)
    q = grasp_q(m, body, tip_m=0.02)
    found = check(plan_of(m, Scene.of([table, body]), [CLOSE], q))
    assert any(f.kind in ("touches", "inside") and "base" in f.first + f.second for f in found)


def test_fingers_inside_a_crossbar_are_contradicted(manipulator: Manipulator, table: Body) -> None:
    m = manipulator
    stem = block(height_m=0.08, width_m=0.02)
    bar = Part(Box((0.02, 0.055, 0.02)), at(0.0, 0.0, 0.03))
    body = Body("block", (*stem.parts, bar), stem.T_base_body, is_movable=True)
    q, above = grasp_q(m, stem, tip_m=0.02), grasp_q(m, stem, tip_m=0.10)
    goal = m.arm.T_base_tip(q)
    down = Move("descend", plan_straight_move(m.arm, above, goal, m.limits), is_straight=True)
    assert check(plan_of(m, Scene.of([table, stem]), [down, CLOSE], above)) == []
    found = said(check(plan_of(m, Scene.of([table, body]), [down, CLOSE], above)))
    assert ("presses too deep", "block", "l_gripper_l_finger") in found


def test_a_miss_is_found(manipulator: Manipulator, table: Body) -> None:
    q = grasp_q(manipulator, block(), 0.1)
    found = check(plan_of(manipulator, Scene.of([table, block()]), [CLOSE], q))
    assert said(found) == {("missed by the fingers", "", "block")}


@pytest.mark.parametrize("off_m", [-0.008, 0.0, 0.005])
def test_bodies_are_pushed_as_the_hand_says(
    manipulator: Manipulator, table: Body, off_m: float
) -> None:
    # pads of the meshes stand further in than the URDF's boxes, by less than a millimetre
    m, body = manipulator, block()
    q = grasp_q(m, body)
    T = m.arm.T_base_tip(q)
    pushed = body.at(pin.SE3(np.eye(3), off_m * T.rotation[:, 1]) * body.T_base_body)
    said_by_hand = grasp_of(m.hand, T, pushed, m.hand.stroke_m)
    assert said_by_hand is not None
    stage = importlib.import_module("referee.stage").Stage
    robot = importlib.import_module("referee.robot").load_robot()
    plan = plan_of(m, Scene.of([table, pushed]), [CLOSE], q)
    here = stage.of(plan, plan.start, robot)
    found = importlib.import_module("referee.stage").closing(here, here.things["block"])
    assert found.holds
    assert found.openings_m[-1] == pytest.approx(said_by_hand.finger_m, abs=1e-3)
    moved = T.rotation[:, 1] @ (found.T_things[-1][:3, 3] - pushed.T_base_body.translation)
    assert moved == pytest.approx(said_by_hand.push_m, abs=1e-4)


# Releases, hands, states


@pytest.mark.slow
def test_a_body_let_go_in_the_air_falls(manipulator: Manipulator, table: Body) -> None:
    m, body = manipulator, block()
    q = grasp_q(m, body)
    let_go = Grip("open", GripperAction.OPEN, "block")
    high = check(plan_of(m, Scene.of([table, body]), [CLOSE, lift(m, q, 0.03), let_go], q))
    assert said(high) == {("falls", "", "block")}
    low = check(plan_of(m, Scene.of([table, body]), [CLOSE, lift(m, q, 0.008), let_go], q))
    assert low == []


def test_what_the_other_hand_holds_is_an_obstacle(robot: Baxter, manipulator: Manipulator) -> None:
    m, right = manipulator, robot.arm("right")
    joints = State.of(m, Scene.of()).joints
    q_right = np.array([joints[name] for name in right.joint_names])
    T_tip_body = at(0.0, 0.0, 0.01)
    held = cube("held", (0.02, 0.02, 0.3), 0, 0, 0).at(right.T_base_tip(q_right) * T_tip_body)
    q = np.array(m.arm.neutral)
    still = Move("stay", Trajectory.stay(q, m.limits))
    holding = (Attachment("held", "right_gripper", T_tip_body),)
    assert check(plan_of(m, Scene.of([held]), [still], q, held=holding)) == []
    elsewhere = held.at(at(0.0, 0.1, 0.0) * held.T_base_body)
    found = said(check(plan_of(m, Scene.of([elsewhere]), [still], q, held=holding)))
    assert found == {("is not where it is held", "held", "right hand")}


def test_joints_out_of_their_range_are_found(manipulator: Manipulator) -> None:
    m = manipulator
    q = np.array(m.arm.neutral)
    goal = q + np.array([0, 0, 0, 0, 0, 0, 0.2])
    way = plan_joint_move(q, goal, m.limits)
    shift = np.array([0, 0, 0, 0, 0, 0, 3.0])
    beyond = Trajectory(m.limits, way.knots_s, way.q + shift, way.v, way.a, way.j)
    found = check(plan_of(m, Scene.of(), [Move("turn", beyond)], q + shift))
    assert ("position limit", "", "left_w2") in said(found)


def test_a_plan_that_does_not_end_at_rest_is_found(manipulator: Manipulator) -> None:
    m = manipulator
    q = np.array(m.arm.neutral)
    way = plan_joint_move(q, q + 0.3, m.limits)
    n = len(way.knots_s) // 2 + 1
    knots, q_cut, v, a = (x[:n] for x in (way.knots_s, way.q, way.v, way.a))
    cut = Trajectory(m.limits, knots, q_cut, v, a, way.j[: n - 1])
    kinds = {f.kind for f in check(plan_of(m, Scene.of(), [Move("half", cut)], q))}
    assert kinds == {"moves where it should rest"}


@pytest.fixture(scope="module")
def followed(manipulator: Manipulator) -> PathMove:
    corners = [overhead(*xyz) for xyz in ((0.69, 0.15, 0.0), (0.72, 0.15, 0.0), (0.72, 0.17, 0.02))]
    return plan_path_move(manipulator, None, Polyline(corners), speed_m_s=0.05)


@pytest.mark.parametrize(
    ("changes", "kind"),
    [
        ({}, None),
        ({"tolerance": LineTolerance(1e-5)}, "leaves its path"),
        ({"slower_s": np.zeros((0, 2))}, "leaves its speed"),
        ({"speed_m_s": 0.052}, "leaves its speed"),
    ],
)
def test_a_tip_that_leaves_its_path_or_its_speed_is_found(
    manipulator: Manipulator, followed: PathMove, changes: dict[str, Any], kind: str | None
) -> None:
    move = Move("follow", followed.trajectory, path=evolve(followed.path, **changes))
    plan = plan_of(manipulator, Scene.of(), [move], followed.trajectory.q_start)
    assert said(check(plan)) == (set() if kind is None else {(kind, "path", "tip")})


def test_a_plan_that_does_nothing_does_not_do_its_task(
    manipulator: Manipulator, table: Body
) -> None:
    task_faults = importlib.import_module("referee.checker").task_faults
    body = block()
    T = overhead_grasp(manipulator.hand, body)
    task = PickAndPlace("block", T, T)
    q = grasp_q(manipulator, body)
    nothing = plan_of(manipulator, Scene.of([table, body]), [], q)
    assert [f.kind for f in task_faults(nothing, task, None)] == ["does not carry it"]
    away = [f.kind for f in task_faults(nothing, None, q + 0.1)]
    assert away == ["does not reach its goal"]
    let_go = Grip("open", GripperAction.OPEN, "block")
    done = plan_of(manipulator, Scene.of([table, body]), [CLOSE, let_go], q)
    assert list(task_faults(done, task, None)) == []
    elsewhere = PickAndPlace("block", T, at(0.01, 0.0, 0.0) * T)
    missed = [f.kind for f in task_faults(done, elsewhere, None)]
    assert missed == ["is not where it was asked to be"]


# The harness


@pytest.mark.slow
def test_problems_are_the_same_for_the_same_seed() -> None:
    problems = importlib.import_module("referee.problems")
    for family in ("obstacles", "odd bodies", "rods", "other hand holding"):
        first, again = (problems.make_problem(family, 1, 7) for _ in range(2))
        assert list(first.scene.bodies) == list(again.scene.bodies)
        for one, other in zip(first.scene, again.scene, strict=True):
            assert one.T_base_body.isApprox(other.T_base_body, 0.0)
        np.testing.assert_array_equal(first.q_start, again.q_start)


def test_the_table_counts() -> None:
    trials: list[dict[str, Any]] = [
        {"planning_s": 0.5, "motion_s": 3.0},
        {"planning_s": 0.7, "motion_s": 3.0, "contradicted": ["touches"]},
        {"planning_s": 0.2, "refusal": "no way"},
        {"error": "Traceback"},
    ]
    row = importlib.import_module("check_plans")._row("plain", trials)
    assert row == "| plain | 4 | 2 | 1 | 1 | 0 | 1 | 0.20, 0.20 | 0.60 |"


@pytest.mark.slow
def test_one_problem_from_start_to_end() -> None:
    found = importlib.import_module("check_plans").run_trial("plain", 0, 0)
    assert "error" not in found
    assert found["planning_s"] > 0.0
    assert "refusal" in found or found["check_s"] > 0.0
