"""What was believed of a plan and is not any more: each test names it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter, pose_from_quaternion
from baxter_kin.description import RobotDescription
from planner import (
    Body,
    Box,
    Certificate,
    Grip,
    GripperAction,
    Held,
    Manipulator,
    Move,
    Part,
    PickAndPlace,
    Plan,
    Scene,
    Situation,
    plan_joint_move,
    plan_pick_and_place,
    verify,
)
from planner.clearance import Clearance, ContinuousProof
from planner.verification.body.distances import SolidDistances
from planner.verification.body.nearest import nearest
from planner.verification.body.robot_body import robot_body
from planner.verification.body.stretches import Stretches
from planner.verification.fingers import Fingers
from planner.verification.story import Run, Story
from planner.verification.urdf_robot import UrdfRobot
from tests.conftest import at
from tests.planner.conftest import without_statements

DOWN = (0.0, 1.0, 0.0, 0.0)
TABLE_M = -0.155
"""Height of the table's top in base."""


def failed(certificate: Certificate) -> set[str]:
    return {check.name for check in certificate.failures}


def box(name: str, size: tuple[float, float, float], x: float, y: float, z: float) -> Body:
    """A box that stands at a height."""
    part = Part(Box(size), at(0.0, 0.0, size[2] / 2))
    return Body(name, (part,), at(x, y, z), is_movable=name == "block")


def in_scene(plan: Plan, change: Callable[[Scene], Scene]) -> Plan:
    assert plan.situation is not None
    return replace(plan, situation=replace(plan.situation, scene=change(plan.situation.scene)))


@pytest.fixture(scope="module")
def small(table: Body) -> Scene:
    """A cube of 2 cm on the table."""
    return Scene.of([table, box("block", (0.02, 0.02, 0.02), 0.70, 0.15, TABLE_M)])


@pytest.fixture(scope="module")
def plan(manipulator: Manipulator, small: Scene) -> Plan:
    """The cube taken and put 15 cm aside, nothing else around."""
    pick, place = (
        pose_from_quaternion((x, y, TABLE_M + 0.01), DOWN) for x, y in ((0.70, 0.15), (0.75, 0.0))
    )
    task = PickAndPlace("block", pick, place)
    made = plan_pick_and_place(task, manipulator, small, manipulator.arm.neutral)
    assert made.is_valid, str(made.failure)
    return without_statements(replace(made, situation=Situation.of(manipulator, small)))


@pytest.fixture(scope="module")
def certificate(plan: Plan) -> Certificate:
    return verify(plan)


def test_the_plan_with_nothing_in_the_way_is_valid(certificate: Certificate) -> None:
    assert certificate.is_valid, certificate.verdict


@pytest.mark.parametrize("is_movable", [False, True])
def test_a_finger_may_not_close_through_a_post_that_stands_between_open_and_closed_pad(
    plan: Plan, is_movable: bool
) -> None:
    post = replace(
        box("post", (0.010, 0.008, 0.05), 0.70 + 0.015, 0.15 + 0.0226, TABLE_M),
        is_movable=is_movable,
    )
    found = verify(in_scene(plan, lambda scene: scene.with_body(post)))
    assert "clearance of fingers" in failed(found)
    assert "post" in found["clearance of fingers"].where


def test_fingers_may_not_open_through_a_post_beside_the_place(plan: Plan) -> None:
    post = box("post", (0.010, 0.008, 0.05), 0.75 + 0.015, 0.0226, TABLE_M)
    found = verify(in_scene(plan, lambda scene: scene.with_body(post)))
    assert "clearance of fingers" in failed(found)
    assert found["clearance of fingers"].where.startswith("place: open, each finger ")


def test_fingers_that_open_half_way_stay_clear_of_the_post(plan: Plan) -> None:
    post = box("post", (0.010, 0.008, 0.05), 0.75 + 0.015, 0.0226, TABLE_M)
    steps = tuple(
        replace(step, opening_m=0.006)
        if isinstance(step, Grip) and step.label == "place: open"
        else step
        for step in plan
    )
    found = verify(in_scene(replace(plan, steps=steps), lambda scene: scene.with_body(post)))
    assert found["clearance of fingers"].is_passed, found.verdict
    assert found["clearance of fingers"].value < 0.01


def test_a_body_that_a_finger_pushes_may_not_be_pushed_into_its_neighbour(plan: Plan) -> None:
    beside = box("beside", (0.02, 0.008, 0.004), 0.70, 0.15 + 0.012, TABLE_M)
    aside = in_scene(plan, lambda scene: scene.moved("block", at(0.70, 0.15 - 0.004, TABLE_M)))
    assert verify(aside).is_valid
    found = verify(in_scene(aside, lambda scene: scene.with_body(beside)))
    assert "clearance of fingers" in failed(found)


def test_the_hand_may_not_stand_inside_the_body_it_grasps_by_its_stem(plan: Plan) -> None:
    stem = Part(Box((0.02, 0.02, 0.08)), at(0.0, 0.0, 0.04))
    bar = Part(Box((0.02, 0.05, 0.02)), at(0.0, 0.0, 0.07))
    tee = Body("block", (stem, bar), at(0.70, 0.15, TABLE_M), is_movable=True)
    found = verify(in_scene(plan, lambda scene: scene.without("block").with_body(tee)))
    assert "gap of closed pads" in failed(found)  # the fingers meet the crossbar first
    assert found["gap of closed pads"].value > 0.005


def test_a_palm_may_not_stand_inside_what_the_fingers_hold(plan: Plan) -> None:
    tall = box("block", (0.02, 0.02, 0.16), 0.70, 0.15, TABLE_M)
    found = verify(in_scene(plan, lambda scene: scene.without("block").with_body(tall)))
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
    found = verify(believed, Situation.of(manipulator, scene.with_body(cube)))
    # where the hand lets go, the cube's centre is inside the elbow: the winding number there is 1
    inside = "bodies inside a link"
    assert failed(found) == {"clearance", "clearance between samples", inside}
    assert "elbow with cube" in found["clearance"].where
    assert found[inside].where == "left_lower_elbow with cube"


def stated(plan: Plan, label: str, proof: ContinuousProof) -> Plan:
    steps = [
        replace(step, proof=proof) if isinstance(step, Move) and step.label == label else step
        for step in plan
    ]
    return replace(plan, steps=tuple(steps))


def claim(
    proven_m: float, margin_m: float = 0.0, nearest_m: float | None = None
) -> ContinuousProof:
    near = Clearance(proven_m if nearest_m is None else nearest_m, "finger", "table", 0.0)
    return ContinuousProof(proven_m, near, margin_m, 1, 1)


def test_a_stated_proof_of_five_metres_is_not_believed(plan: Plan) -> None:
    found = verify(stated(plan, "pick: approach", claim(5.0)))
    assert failed(found) == {"stated proofs beyond what is measured"}
    assert "5000.000 mm" in found.verdict


def test_a_stated_distance_of_five_metres_is_not_believed(plan: Plan) -> None:
    found = verify(stated(plan, "pick: approach", claim(0.001, nearest_m=5.0)))
    assert failed(found) == {"stated proofs beyond what is measured"}


def test_a_true_claim_is_accepted(plan: Plan) -> None:
    assert verify(stated(plan, "pick: approach", claim(0.001))).is_valid


def test_a_margin_above_its_proof_is_not_believed(plan: Plan) -> None:
    found = verify(stated(plan, "pick: approach", claim(0.001, margin_m=0.002)))
    assert failed(found) == {"stated proofs that contradict themselves"}


def test_a_stated_margin_must_be_kept(plan: Plan) -> None:
    found = verify(stated(plan, "pick: descend", claim(0.1, margin_m=0.1)))
    assert "clearance beyond the stated margin" in failed(found)


@pytest.fixture
def holding(plan: Plan, manipulator: Manipulator) -> Situation:
    """The same world, and a stick in the right hand."""
    assert plan.situation is not None
    joints = dict(plan.situation.joints)
    for name, sign in (("l", 1.0), ("r", -1.0)):
        joints[f"r_gripper_{name}_finger_joint"] = sign * 0.002
    right = manipulator.robot.arm("right")
    tip = right.T_base_tip(np.array([joints[name] for name in right.joint_names]))
    hold = Held("right", "stick", pin.SE3.Identity())
    stick = Body("stick", (Part(Box((0.006, 0.006, 0.03)), at(0, 0, 0)),), tip, is_movable=True)
    return Situation(plan.situation.scene.with_body(stick), joints, (hold,))


def test_a_plan_of_one_arm_while_the_other_hand_holds_something_is_valid(
    plan: Plan, holding: Situation
) -> None:
    found = verify(plan, holding)
    assert found.is_valid, found.verdict


def test_what_is_held_stands_where_its_hand_is(plan: Plan, holding: Situation) -> None:
    away = holding.scene["stick"].T_base_body * at(0.0, 0.0, 0.01)
    elsewhere = replace(holding, scene=holding.scene.moved("stick", away))
    assert failed(verify(plan, elsewhere)) == {"held bodies off their hands"}


def test_what_the_other_hand_holds_is_in_the_way(plan: Plan, holding: Situation) -> None:
    crossing = at(0.70, 0.15, TABLE_M + 0.06)
    rod = Body("stick", (Part(Box((0.3, 0.006, 0.006)), at(0, 0, 0)),), crossing)
    tip, scene = holding.scene["stick"].T_base_body, holding.scene.without("stick")
    held = replace(holding.held[0], T_tip_body=tip.inverse() * crossing)
    found = verify(plan, Situation(scene.with_body(rod), holding.joints, (held,)))
    assert not found["clearance"].is_passed or not found["clearance of fingers"].is_passed
    assert "stick" in found.verdict


def test_a_hand_that_holds_something_carries_it_from_the_start(
    plan: Plan, manipulator: Manipulator
) -> None:
    assert plan.situation is not None
    place = [step.label for step in plan].index("place: approach")
    rest = plan.steps[place:]
    assert isinstance(rest[0], Move)
    q = rest[0].trajectory.q_start
    way = plan_joint_move(q, rest[0].trajectory.q_goal, manipulator.limits)
    down = rest[1]
    assert isinstance(down, Move)
    lower = plan_joint_move(way.q_goal, down.trajectory.q_goal, manipulator.limits)
    steps = (
        replace(rest[0], trajectory=way),
        replace(down, trajectory=lower, is_straight=False),
        *rest[2:],
    )
    closed = verify_opening(plan)
    joints = {
        **plan.situation.joints,
        "l_gripper_l_finger_joint": closed,
        "l_gripper_r_finger_joint": -closed,
    }
    T_tip_body = pin.SE3(pin.utils.rotate("x", np.pi), np.array([0.0, 0.0, 0.01]))
    body = plan.situation.scene["block"].at(manipulator.arm.T_base_tip(q) * T_tip_body)
    scene = plan.situation.scene.without("block").with_body(body)
    situation = Situation(scene, joints, (Held("left", "block", T_tip_body),))
    found = verify(Plan("left", q, steps, situation=situation))
    assert not found["gripper actions out of order"].value, found.verdict
    assert failed(found) <= {"slide in contact"}, found.verdict


def verify_opening(plan: Plan) -> float:
    """How far each finger is open on the body it holds, m."""
    where = verify(plan)["gap of closed pads"].where
    return float(where.split("each finger ")[1].split(" mm")[0]) / 1e3


def test_an_open_that_lets_nothing_go_is_found(plan: Plan) -> None:
    steps = tuple(
        replace(step, opening_m=0.001)
        if isinstance(step, Grip) and step.label == "place: open"
        else step
        for step in plan
    )
    found = verify(replace(plan, steps=steps))
    assert "gripper actions out of order" in failed(found)
    assert "lets nothing go" in found["gripper actions out of order"].where


def test_an_open_beyond_the_stroke_is_found(plan: Plan) -> None:
    opening = Grip("wide", GripperAction.OPEN, None, 0.03)
    found = verify(replace(plan, steps=(opening, *plan.steps)))
    assert failed(found) == {"gripper actions out of order"}
    assert "its stroke is 20.833 mm" in found.verdict


def test_a_certificate_is_that_of_the_plan_and_world_it_was_made_of(
    plan: Plan, certificate: Certificate
) -> None:
    assert plan.situation is not None
    again = Situation(Scene(plan.situation.scene.bodies), plan.situation.joints)
    assert certificate.is_of(plan)
    assert certificate.is_of(plan, again)
    assert not certificate.is_of(replace(plan))
    moved = replace(again, scene=again.scene.moved("block", at(0.70, 0.15, TABLE_M + 1e-12)))
    assert not certificate.is_of(plan, moved)
    turned = replace(again, joints={**again.joints, "head_pan": 1e-12})
    assert not certificate.is_of(plan, turned)


def test_a_certificate_that_somebody_wrote_is_of_no_plan(plan: Plan) -> None:
    assert not Certificate("left", 1.0, 1, ()).is_of(plan)


def test_the_nearest_is_that_of_all_pairs_at_all_samples(plan: Plan) -> None:
    assert plan.situation is not None
    files = RobotDescription.installed()
    robot, solids = UrdfRobot(files, plan.limb), robot_body(files).solids
    standing = robot.standing(plan.situation.joints)
    story = Story(plan, plan.situation, robot, Fingers(robot, solids))
    stretches = Stretches(robot, solids, standing, [], ())
    runs = [stage for stage in story.stages if isinstance(stage, Run) and stage.moves]
    assert runs[1].carried is not None
    for run in runs:
        stretch = stretches.of_run(run, 0.03)
        pairs = stretches.pairs_of_run(run, stretch)
        distances, numbers = SolidDistances(robot, stretch, pairs), [*range(len(pairs))]
        numbers = [i for i in numbers if pairs[i].body is None]
        found, _ = nearest(distances, numbers, 0, len(stretch.q) - 1)
        least = 1.0
        for sample in range(len(stretch.q)):
            for number in numbers:
                least = min(least, distances.shapes_apart(number, sample, least))
        assert found.least_m == pytest.approx(least, abs=1e-6)
        assert found.proven_m < least


def test_without_the_meshes_it_judges_by_the_planners_body_and_says_so(
    robot: Baxter, plan: Plan, manipulator: Manipulator, small: Scene, tmp_path: Path
) -> None:
    bare = replace(robot.description, stock=replace(robot.description.stock, package_dir=tmp_path))
    found = verify(plan, description=bare)
    assert found.is_valid, found.verdict
    assert "measured on the planner's own body, since cannot read" in found.verdict
    assert str(tmp_path) in found.verdict
    cube = Body("cube", (Part(Box((0.02, 0.02, 0.02)), at(0, 0, 0)),), at(0.482, 0.271, 0.345))
    there = Situation.of(manipulator, small.with_body(cube))
    assert not verify(plan, there, description=bare).is_valid
