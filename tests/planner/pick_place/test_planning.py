"""Pick and place: the demo's cycle, and every way in which one can be impossible."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from baxter_kin import Baxter, ElectricGripper
from baxter_kin.errors import ConfigurationError, LimitsError, PoseError, UnknownNameError
from baxter_kin.frames import raised
from planner import (
    Body,
    Box,
    Grip,
    GripperAction,
    LineTolerance,
    Manipulator,
    Mesh,
    Move,
    Part,
    PickAndPlace,
    Plan,
    RobotBody,
    Scene,
    Situation,
    load_object,
    load_plan,
    plan_joint_move,
    plan_pick_and_place,
    plan_retract,
    plan_start_move,
    save_plan,
    verify,
)
from planner.collision import ClearanceChecker
from planner.errors import MotionError, SceneError, TaskError
from planner.pick_place.candidates import transfer_bound_s
from planner.pick_place.cycle import StoppingCycles
from planner.pick_place.phases import PhaseMaker
from planner.pick_place.request import PlanRequest
from planner.scene.contact import touching
from planner.scene.held import Held
from planner.trajectory import CONTINUITY_TOLERANCE
from tests.bodies import grasp_of
from tests.conftest import at, overhead

PICK, PLACE = overhead(0.70, 0.15, -0.129), overhead(0.75, 0.00, -0.129)
TASK = PickAndPlace("block", PICK, PLACE)
ORIGIN = at(0.0, 0.0, 0.0)

REACHED_M = 1e-6
"""What a valid IK result promises, in m and rad."""

RATIO_TOLERANCE = 1e-9

SAMPLING_M = 1e-3
"""What checks 25 ms apart may miss: at 1 m/s the tip covers 25 mm between them, but the least
clearance of these moves is at their ends, where the arm stands still."""

SIDEWAYS = ("pick: approach", "place: approach")

STAGES = [
    "pick: open",
    "pick: approach",
    "pick: descend",
    "pick: close",
    "pick: retract",
    "place: approach",
    "place: descend",
    "place: open",
    "place: retract",
]


@pytest.fixture(scope="module")
def plan(manipulator: Manipulator, scene: Scene) -> Plan:
    return planned(TASK, manipulator, scene)


def planned(task: PickAndPlace, manipulator: Manipulator, scene: Scene) -> Plan:
    return plan_pick_and_place(task, manipulator, scene, manipulator.arm.start)


def box(name: str, size: tuple[float, float, float], x: float, y: float, z: float) -> Body:
    return Body(name, (Part(Box(size), ORIGIN),), at(x, y, z))


def post_below_the_carried_block(
    plan: Plan, manipulator: Manipulator, scene: Scene, gap_m: float
) -> Body:
    """A post in the middle of the way to the place, a gap below the lowest block near it."""
    grasp = grasp_of(manipulator.hand, PICK, scene["block"], manipulator.hand.stroke_m)
    assert grasp is not None
    way = next(move for move in plan.moves if move.label == "place: approach").trajectory
    carried = [
        scene["block"].at(manipulator.arm.T_base_tip(q) * grasp.T_tip_body)
        for q in way.sample(np.linspace(0.0, way.duration, 500)).q
    ]
    x, y, _ = carried[len(carried) // 2].centre_base
    above = [b for b in carried if np.hypot(*(b.centre_base[:2] - (x, y))) < 0.034]
    top = min(body.extent_m((0, 0, 1))[0] for body in above) - gap_m
    return box("post", (0.001, 0.001, 0.02), x, y, top - 0.01)


def labels(plan: Plan) -> list[str]:
    return [step.label for step in plan]


def test_the_demos_cycle_has_a_plan(plan: Plan) -> None:
    assert plan.is_valid, str(plan.failure)


def test_the_stages_are_those_of_the_original_in_order(plan: Plan) -> None:
    assert labels(plan) == STAGES


def test_the_gripper_opens_closes_on_the_block_and_opens_again(plan: Plan) -> None:
    grips = [(step.action, step.body) for step in plan if isinstance(step, Grip)]
    assert grips == [
        (GripperAction.OPEN, None),
        (GripperAction.CLOSE, "block"),
        (GripperAction.OPEN, "block"),
    ]


def test_waypoints_are_the_poses_5_cm_above_them_and_15_cm_at_the_end(plan: Plan) -> None:
    heights = {"pick: descend": 0.0, "place: descend": 0.0, "place: retract": 0.15}
    for move in plan.moves:
        pose = PICK if move.label.startswith("pick") else PLACE
        height = np.array([0.0, 0.0, heights.get(move.label, 0.05)])
        assert move.T_base_tip is not None
        assert move.T_base_tip.translation == pytest.approx(pose.translation + height, abs=1e-15)
        assert move.T_base_tip.rotation.tolist() == pose.rotation.tolist()


def test_every_waypoint_is_reached_by_the_tip_of_the_whole_robots_urdf(
    robot: Baxter, plan: Plan
) -> None:
    model = pin.buildModelFromUrdf(str(robot.description.stock.urdf))
    data = model.createData()
    tip = model.getFrameId("left_gripper")
    for move in plan.moves:
        assert move.T_base_tip is not None
        q = pin.neutral(model)
        for name, value in robot.arm("left").joints(move.trajectory.q_goal).items():
            q[model.joints[model.getJointId(name)].idx_q] = value
        pin.framesForwardKinematics(model, data, q)
        error = pin.log6(move.T_base_tip.inverse() * data.oMf[tip]).vector
        assert np.linalg.norm(error[:3]) <= REACHED_M
        assert np.linalg.norm(error[3:]) <= REACHED_M


def test_every_waypoint_is_asked_of_the_service_and_its_answer_is_told(
    plan: Plan, manipulator: Manipulator
) -> None:
    """From where the arm stood before, as by hand; and how far the move ends from that."""
    for move in plan.moves:
        asked = manipulator.ik.solve(move.T_base_tip, current=move.trajectory.q_start)
        assert move.ik is not None
        assert move.ik.q.tolist() == asked.q.tolist()
        assert move.ik.seed_type is asked.seed_type
        moved_rad = np.abs(move.trajectory.q_goal - asked.q).max()
        assert move.moved_rad == moved_rad
        label = asked.seed_type.label
        told = f"{label}, moved by {moved_rad:.2f} rad" if moved_rad > 0.005 else label
        assert move.seed_label == told


def test_a_move_in_joint_angles_has_no_seed(plan: Plan) -> None:
    move = replace(plan.moves[0], T_base_tip=None, ik=None)
    assert (move.seed_label, move.moved_rad) == ("(joint angles)", 0.0)


def test_every_move_goes_on_as_the_one_before_ended(plan: Plan, manipulator: Manipulator) -> None:
    q, v, a = manipulator.arm.start, np.zeros(7), np.zeros(7)
    for move in plan.moves:
        first = move.trajectory.sample(0.0)
        np.testing.assert_allclose(first.q, q, atol=CONTINUITY_TOLERANCE)
        np.testing.assert_allclose(first.v, v, atol=CONTINUITY_TOLERANCE)
        np.testing.assert_allclose(first.a, a, atol=CONTINUITY_TOLERANCE)
        q, v, a = move.trajectory.sample(move.trajectory.duration)
    assert np.abs(v).max() == np.abs(a).max() == 0.0


def test_it_stops_only_where_the_gripper_acts_and_at_the_end(plan: Plan) -> None:
    for move in plan.moves:
        speed = np.abs(move.trajectory.v[-1]).max()
        if move.label in ("pick: descend", "place: descend", "place: retract"):
            assert speed == 0.0
        else:
            assert speed > 0.1


def test_lines_are_straight_by_the_whole_robots_urdf(
    robot: Baxter, plan: Plan, manipulator: Manipulator
) -> None:
    ends = {"pick: descend": PICK, "pick: retract": PICK}
    straight = [move for move in plan.moves if move.is_straight]
    assert [move.label for move in straight] == [*ends, "place: descend", "place: retract"]
    for move in straight:
        pose = ends.get(move.label, PLACE)
        for q in move.trajectory.sample(np.linspace(0.0, move.trajectory.duration, 200)).q:
            data = robot.model.createData()
            full = robot.configuration(manipulator.arm.joints(q))
            pin.framesForwardKinematics(robot.model, data, full)
            T = pose.actInv(data.oMf[robot.model.getFrameId("left_gripper")])
            lift = pose.rotation.T @ np.array([0.0, 0.0, 1.0])
            off = T.translation - (T.translation @ lift) * lift
            assert np.linalg.norm(off) <= 1e-4
            assert np.linalg.norm(pin.log3(T.rotation)) <= np.deg2rad(0.02)


def test_the_cycle_takes_three_quarters_of_stopping_everywhere(
    plan: Plan, manipulator: Manipulator
) -> None:
    """From the start: to 15 cm above, down, up, across, down, up; each from rest to rest."""
    q, total = manipulator.arm.start, 0.0
    above = [raised(pose, 0.15) for pose in (PICK, PLACE)]
    for T in (above[0], PICK, above[0], above[1], PLACE, above[1]):
        goal = manipulator.ik.solve(T, current=q).q
        total, q = total + plan_joint_move(q, goal, manipulator.limits).duration, goal
    assert plan.motion_time_s <= 0.75 * total


def test_a_cycle_is_much_shorter_than_one_that_stops_above_pick_and_place(
    plan: Plan, manipulator: Manipulator, scene: Scene
) -> None:
    start = manipulator.arm.start
    nearest = (manipulator.ik.solve(T, current=start).q for T in (PICK, PLACE))
    request = PlanRequest(manipulator, scene, start)
    cycles = StoppingCycles(request, TASK, PhaseMaker(request, TASK).made().contexts)
    assert plan.motion_time_s <= 0.85 * cycles.of(*nearest).duration_s


def test_no_transfer_is_faster_than_its_bound(plan: Plan, manipulator: Manipulator) -> None:
    labels_ = ("pick: retract", "place: approach", "place: descend")
    taken = sum(m.trajectory.duration for m in plan.moves if m.label in labels_)
    bound = transfer_bound_s(manipulator.ik, manipulator.limits, PICK, PLACE)
    assert 0.5 < bound < taken < 2.0 * bound


def test_the_bound_to_a_pose_out_of_reach_is_infinite(manipulator: Manipulator) -> None:
    far = at(2.0, 0.0, 0.0)
    assert transfer_bound_s(manipulator.ik, manipulator.limits, PICK, far) == np.inf


def test_every_move_keeps_every_limit(plan: Plan) -> None:
    for move in plan.moves:
        assert max(move.trajectory.peak_ratios()) <= 1.0 + RATIO_TOLERANCE


def test_every_move_is_clear_of_everything(plan: Plan) -> None:
    for move in plan.moves:
        assert move.clearance is not None
        assert move.clearance.distance_m > 0.0


def test_the_least_clearance_is_that_of_the_fingers_above_the_table(plan: Plan) -> None:
    assert plan.clearance is not None
    assert plan.clearance.distance_m == pytest.approx(22.1e-3, abs=0.05e-3)
    assert plan.clearance.second == "table"
    assert "finger" in plan.clearance.first


def test_clearances_agree_with_a_check_ten_times_as_dense(
    plan: Plan, manipulator: Manipulator, scene: Scene
) -> None:
    hand, block = manipulator.hand, scene["block"]
    grasp = grasp_of(hand, PICK, block, hand.stroke_m)
    assert grasp is not None
    placed = scene.moved("block", PLACE * grasp.T_tip_body)
    held, stood = Held("left", "block", grasp.T_tip_body), touching(block, scene)
    full = hand.stroke_m
    for move in plan.moves:
        carries = move.label in ("pick: retract", "place: approach", "place: descend")
        checker = (
            ClearanceChecker(
                manipulator.shapes,
                manipulator.arm,
                scene,
                held=held,
                supports=() if move.label in SIDEWAYS else stood,
            )
            if carries
            else ClearanceChecker(
                manipulator.shapes,
                manipulator.arm,
                placed if move.label == "place: retract" else scene,
                touchable=None if move.label == "pick: approach" else "block",
            )
        )
        times = np.linspace(0.0, move.trajectory.duration, int(400 * move.trajectory.duration))
        qs = manipulator.configurations(
            move.trajectory.sample(times).q, grasp.finger_m if carries else full
        )
        dense = min(checker.clearance(q).distance_m for q in qs)
        assert move.clearance is not None
        assert move.proof is not None
        assert 0.0 < move.proof.proven_m <= dense
        assert move.clearance.distance_m == pytest.approx(dense, abs=SAMPLING_M)


def test_the_plan_passes_an_independent_verification(plan: Plan) -> None:
    certificate = verify(plan)
    assert certificate.is_valid, certificate.table()


def test_what_is_proven_of_the_plan_is_the_least_of_its_steps(plan: Plan) -> None:
    proofs = [step.proof for step in plan]
    assert plan.proven_clearance_m == min(proof.proven_m for proof in proofs if proof is not None)
    assert None not in proofs


def test_a_plate_in_the_way_is_found_however_thin(
    plan: Plan, manipulator: Manipulator, scene: Scene
) -> None:
    """A tenth of a millimetre: samples 10 ms apart are centimetres apart."""
    plate = box("plate", (0.3, 0.0001, 0.2), 0.72, 0.075, -0.05)
    failed = verify(plan, Situation.of(manipulator, scene.with_body(plate)))
    assert not failed.is_valid
    assert "plate" in str(failed)
    around = planned(TASK, manipulator, scene.with_body(plate))
    assert verify(around).is_valid


def test_the_same_task_gives_the_same_plan(
    plan: Plan, manipulator: Manipulator, scene: Scene
) -> None:
    again = planned(TASK, manipulator, scene)
    for first, second in zip(plan.moves, again.moves, strict=True):
        assert first.trajectory.q.tolist() == second.trajectory.q.tolist()
        assert first.trajectory.knots_s.tolist() == second.trajectory.knots_s.tolist()


def test_planning_leaves_the_scene_as_it_was(manipulator: Manipulator, scene: Scene) -> None:
    before = {body.name: body.T_base_body.homogeneous.tolist() for body in scene}
    planned(TASK, manipulator, scene)
    assert {body.name: body.T_base_body.homogeneous.tolist() for body in scene} == before


@settings(max_examples=8)
@given(st.floats(0.62, 0.80), st.floats(-0.05, 0.25), st.floats(0.05, 0.20))
def test_neighbouring_tasks_have_plans_too(
    manipulator: Manipulator, scene: Scene, x: float, y: float, hover: float
) -> None:
    shifted = scene.moved("block", at(x - 0.0275, y - 0.0235, -0.155))
    task = PickAndPlace("block", overhead(x, y, -0.129), PLACE, hover)
    plan = planned(task, manipulator, shifted)
    assert plan.is_valid, str(plan.failure)
    assert labels(plan) == STAGES


def test_picking_and_placing_at_one_pose_is_allowed(manipulator: Manipulator, scene: Scene) -> None:
    plan = planned(PickAndPlace("block", PICK, PICK), manipulator, scene)
    assert plan.is_valid, str(plan.failure)
    assert plan.moves[3].label == "place: approach"


@pytest.mark.parametrize(
    ("hover_m", "clear_m", "above_m"), [(0.08, 0.05, 0.05), (0.03, 0.05, 0.03), (0.2, 0.2, 0.2)]
)
def test_heights_are_those_asked_for_and_never_above_the_hover_distance(
    manipulator: Manipulator, scene: Scene, hover_m: float, clear_m: float, above_m: float
) -> None:
    plan = planned(PickAndPlace("block", PICK, PLACE, hover_m, clear_m), manipulator, scene)
    assert plan.is_valid, str(plan.failure)
    heights = [move.T_base_tip.translation[2] + 0.129 for move in plan.moves if move.T_base_tip]
    assert heights == pytest.approx([above_m, 0.0, above_m, above_m, 0.0, hover_m])


def test_half_the_speed_keeps_half_the_velocity_limits(robot: Baxter, scene: Scene) -> None:
    slow = planned(TASK, Manipulator.of(robot, "left", speed_ratio=0.5), scene)
    for move in slow.moves:
        assert move.trajectory.peak_ratios(robot.arm("left").limits).velocity <= 0.5 + 1e-9


class TestImpossible:
    """What cannot be done is said, with stage, names and numbers, and nothing is raised."""

    def test_a_pose_out_of_reach_fails_with_how_far(
        self, manipulator: Manipulator, scene: Scene
    ) -> None:
        task = PickAndPlace("block", PICK, overhead(1.5, 0.0, 0.5))
        plan = planned(task, manipulator, scene)
        assert plan.failure is not None
        assert plan.failure.stage == "place: approach"
        assert plan.failure.ik is not None
        assert not plan.failure.ik.is_valid
        assert "(1.500, 0.000, 0.550) m in base is proven out of reach" in plan.failure.reason
        assert plan.failure.is_certain
        assert labels(plan) == []

    def test_a_place_inside_the_table_fails_with_how_deep(
        self, manipulator: Manipulator, scene: Scene
    ) -> None:
        plan = planned(PickAndPlace("block", PICK, overhead(0.75, 0.0, -0.149)), manipulator, scene)
        assert plan.failure is not None
        assert plan.failure.stage == "place: descend"
        assert re.fullmatch(
            r"all \d+ IK solutions collide: block with table, at best 20.0 mm deep \(\d+\); "
            r"torso with left_upper_elbow, at best [\d.]+ mm deep \(\d+\)",
            plan.failure.reason,
        )
        assert plan.failure.is_certain

    def test_a_pick_that_drives_the_fingers_into_the_table_fails(
        self, manipulator: Manipulator, table: Body
    ) -> None:
        flat = box("tile", (0.05, 0.05, 0.01), 0.70, 0.15, -0.150)
        tile = Body(flat.name, flat.parts, flat.T_base_body, is_movable=True)
        task = PickAndPlace("tile", overhead(0.70, 0.15, -0.155), PLACE)
        plan = planned(task, manipulator, Scene.of([table, tile]))
        assert plan.failure is not None
        assert plan.failure.stage == "pick: descend"
        assert "finger_tip with table, at best 3.9 mm deep" in plan.failure.reason

    @pytest.mark.parametrize(("dx", "dy"), [(0.055, 0.0), (0.0, 0.12), (-0.055, 0.0)])
    def test_a_block_beside_the_pads_is_not_grasped(
        self, manipulator: Manipulator, table: Body, block: Body, dx: float, dy: float
    ) -> None:
        beside = block.at(at(0.6725 + dx, 0.1265 + dy, -0.155))
        plan = planned(TASK, manipulator, Scene.of([table, beside]))
        assert plan.failure is not None
        assert plan.failure.stage == "pick: close"
        number = re.search(r"block is (\d+) mm beside the tip", plan.failure.reason)
        assert number is not None
        across = 1e3 * np.hypot(dx - 0.0025, dy + 0.0015)
        assert float(number[1]) == pytest.approx(across, abs=1.0)  # the hand is tilted by 1 degree
        assert labels(plan) == []

    def test_a_block_that_the_fingers_would_land_on_is_a_collision(
        self, manipulator: Manipulator, table: Body, block: Body
    ) -> None:
        shifted = block.at(at(0.6725, 0.1265 + 0.03, -0.155))
        plan = planned(TASK, manipulator, Scene.of([table, shifted]))
        assert plan.failure is not None
        assert plan.failure.stage == "pick: descend"
        assert "finger_tip with block, at best" in plan.failure.reason

    def test_an_obstacle_under_the_hand_is_a_collision_that_names_it(
        self, manipulator: Manipulator, scene: Scene
    ) -> None:
        post = box("post", (0.03, 0.03, 0.3), 0.75, 0.05, 0.0)
        plan = planned(TASK, manipulator, scene.with_body(post))
        assert plan.failure is not None
        assert plan.failure.stage == "place: descend"
        assert "with post, at best" in plan.failure.reason

    def test_what_the_held_block_would_graze_on_the_shortest_way_is_gone_around(
        self, plan: Plan, manipulator: Manipulator, scene: Scene
    ) -> None:
        post = post_below_the_carried_block(plan, manipulator, scene, gap_m=-0.007)
        cluttered = planned(TASK, manipulator, scene.with_body(post))
        assert cluttered.is_valid, str(cluttered.failure)
        assert cluttered.motion_time_s > 0.99 * plan.motion_time_s
        assert verify(cluttered).is_valid

    def test_what_the_hand_meets_on_its_line_is_found_once_for_all_solutions(
        self, manipulator: Manipulator, scene: Scene
    ) -> None:
        """A bead that the shoulders of the hand meet on the way up, whatever the arm does."""
        bead = box("bead", (0.004, 0.004, 0.004), 0.70, 0.19, 0.020)
        plan = planned(TASK, manipulator, scene.with_body(bead))
        failure = plan.failure
        assert failure is not None
        assert failure.stage == "pick: descend"
        assert failure.is_certain
        assert failure.reason.startswith("for every IK solution, l_gripper_l_finger")
        assert failure.contact is not None
        assert failure.contact.nearest.second == "bead"
        assert labels(plan) == []

    def test_the_clearance_of_a_held_block_counts(
        self, plan: Plan, manipulator: Manipulator, scene: Scene
    ) -> None:
        post = post_below_the_carried_block(plan, manipulator, scene, gap_m=0.003)
        close = planned(TASK, manipulator, scene.with_body(post))
        assert close.is_valid, str(close.failure)
        assert close.clearance is not None
        assert (close.clearance.first, close.clearance.second) == ("block", "post")
        assert 0.0025 <= close.clearance.distance_m <= 0.01  # 3 mm below where it is lowest nearby

    def test_a_second_block_at_the_place_is_a_collision(
        self, manipulator: Manipulator, scene: Scene
    ) -> None:
        other = load_object("block", at(0.7225, -0.0235, -0.155), name="other", is_movable=True)
        plan = planned(TASK, manipulator, scene.with_body(other))
        assert plan.failure is not None
        assert plan.failure.stage == "place: descend"
        assert "with other, at best" in plan.failure.reason
        (tally,) = plan.failure.tallies
        assert tally.colliding == tally.solutions

    def test_a_block_may_be_put_on_another(self, manipulator: Manipulator, scene: Scene) -> None:
        other = load_object("block", at(0.7225, -0.0235, -0.155), name="other", is_movable=True)
        task = PickAndPlace("block", PICK, overhead(0.75, 0.0, -0.079))
        plan = planned(task, manipulator, scene.with_body(other))
        assert plan.is_valid, str(plan.failure)

    def test_a_place_that_the_body_would_tip_off_is_refused_with_how_far(
        self, manipulator: Manipulator, scene: Scene
    ) -> None:
        """The table begins at x = 0.5435 m; the block's middle comes to lie 3.4 mm outside."""
        task = PickAndPlace("block", PICK, overhead(0.5425, 0.15, -0.129))
        plan = planned(task, manipulator, scene)
        assert plan.failure is not None
        assert plan.failure.stage == "place: open"
        assert "block would tip: its centre is 3.4 mm beside table" in plan.failure.reason
        assert plan.failure.is_certain

    def test_a_body_wider_than_the_hand_fails_with_both_widths(
        self, manipulator: Manipulator, table: Body
    ) -> None:
        wide = Body(
            "crate", (Part(Box((0.06, 0.06, 0.05)), ORIGIN),), at(0.7, 0.15, -0.13), is_movable=True
        )
        plan = planned(PickAndPlace("crate", PICK, PLACE), manipulator, Scene.of([table, wide]))
        assert plan.failure is not None
        assert plan.failure.stage == "pick: open"
        assert "crate measures 50.0 mm" in plan.failure.reason or "60.0" in plan.failure.reason
        assert "the left hand opens only 57.0 mm" in plan.failure.reason
        assert labels(plan) == []

    def test_a_narrower_hand_refuses_the_block_with_both_widths(self, scene: Scene) -> None:
        robot = Baxter.load(hands={"right": ElectricGripper(tips="half_round")})
        right = Manipulator.of(robot, "right")
        task = PickAndPlace("block", overhead(0.7, -0.15, -0.129), overhead(0.75, 0.0, -0.129))
        plan = planned(task, right, scene)
        assert plan.failure is not None
        assert "block measures 50.0 mm" in plan.failure.reason
        assert "the right hand opens only 52.7 mm" in plan.failure.reason

    def test_a_start_inside_something_fails_at_the_first_move(
        self, manipulator: Manipulator, scene: Scene
    ) -> None:
        tip = manipulator.arm.T_base_tip(manipulator.arm.start).translation
        crate = box("crate", (0.2, 0.2, 0.2), *tip)
        plan = planned(TASK, manipulator, scene.with_body(crate))
        assert plan.failure is not None
        assert plan.failure.stage == "pick: approach"
        assert re.fullmatch(
            r"the arm is blocked where it stands: \w+ is [\d.]+ mm inside crate",
            plan.failure.reason,
        )
        assert plan.failure.is_certain


class TestObstacles:
    """Sideways motions go around what is in the way, and stop at nothing."""

    @pytest.fixture(params=[0.2, 0.26])
    def walled(self, request: pytest.FixtureRequest, scene: Scene) -> Scene:
        height: float = request.param
        return scene.with_body(box("wall", (0.3, 0.02, height), 0.72, 0.075, -0.155 + height / 2))

    def test_over_a_wall(self, plan: Plan, manipulator: Manipulator, walled: Scene) -> None:
        over = planned(TASK, manipulator, walled)
        assert over.is_valid, str(over.failure)
        assert labels(over) == STAGES
        assert over.motion_time_s < plan.motion_time_s + 1.0
        speeds = [float(np.abs(move.trajectory.v[-1]).max()) for move in over.moves]
        assert [speed > 0.1 for speed in speeds] == [True, False, True, True, False, False]

    def test_lines_up_to_the_clear_height_stay_straight(
        self, manipulator: Manipulator, walled: Scene
    ) -> None:
        over = planned(TASK, manipulator, walled)
        for stage, T in (("pick: approach", PICK), ("place: approach", PLACE)):
            move = next(move for move in over.moves if move.label == stage)
            T_end = manipulator.arm.T_base_tip(move.trajectory.q_goal)
            above = raised(T, TASK.clear_m)
            np.testing.assert_allclose(T_end.translation, above.translation, atol=REACHED_M)

    def test_a_wall_before_the_pick_is_passed_too(
        self, manipulator: Manipulator, scene: Scene
    ) -> None:
        q_start = manipulator.ik.solve(overhead(0.72, -0.2, -0.05)).q
        wall = box("wall", (0.3, 0.02, 0.2), 0.72, 0.03, -0.055)
        task = PickAndPlace("block", PICK, overhead(0.70, 0.25, -0.129))
        plan = plan_pick_and_place(task, manipulator, scene.with_body(wall), q_start)
        assert plan.is_valid, str(plan.failure)
        assert verify(plan).is_valid

    def test_the_same_obstacle_gives_the_same_plan(
        self, manipulator: Manipulator, walled: Scene
    ) -> None:
        first, again = (planned(TASK, manipulator, walled) for _ in range(2))
        for one, other in zip(first.moves, again.moves, strict=True):
            assert one.trajectory.q.tolist() == other.trajectory.q.tolist()

    def test_a_wall_that_the_forearm_goes_into_was_believed_to_be_passed(
        self, robot: Baxter, manipulator: Manipulator, scene: Scene
    ) -> None:
        """30 cm high; of shapes smaller than the meshes, `verify` says that they are too small."""
        wall = box("wall", (0.3, 0.02, 0.3), 0.72, 0.075, -0.005)
        body = RobotBody.load()
        lacking = {name: link for name, link in body.links.items() if "forearm" not in name}
        thin = Manipulator.of(robot, "left", body=replace(body, links=lacking))
        believed = planned(TASK, thin, scene.with_body(wall))
        assert believed.is_valid
        found = verify(believed)
        assert not found.is_valid
        assert found["clearance"].value < -0.001
        assert "left_lower_forearm with wall" in found["clearance"].where
        refused = planned(TASK, manipulator, scene.with_body(wall))
        assert "left_lower_forearm with wall, at best" in str(refused.failure)

    def test_where_no_way_is_found_the_search_says_so(
        self, manipulator: Manipulator, walled: Scene, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """The program is not led, and the search around has no time."""
        monkeypatch.setattr("planner.motion.avoidance.ROUNDS", 0)
        monkeypatch.setattr("planner.pick_place.cycle.TIMEOUT_S", 1e-9)
        failure = planned(TASK, manipulator, walled).failure
        assert failure is not None
        assert failure.stage == "place: approach"
        assert "no way around was found in 1e-09 s" in str(failure.tried[-1])
        assert "wall" in str(failure)

    def test_the_start_move_goes_around_a_wall(
        self, manipulator: Manipulator, scene: Scene
    ) -> None:
        wall = box("wall", (0.3, 0.02, 0.2), 0.72, 0.0, -0.055)
        one, other = (manipulator.ik.solve(overhead(0.7, y, -0.08)).q for y in (-0.15, 0.15))
        plan = plan_start_move(manipulator, scene.with_body(wall), one, other)
        assert plan.is_valid, str(plan.failure)
        assert verify(plan).is_valid


class TestMargin:
    """A distance that is proven to be kept."""

    @pytest.mark.parametrize("margin_m", [0.005, 0.018])
    def test_every_move_is_proven_to_keep_it(
        self, manipulator: Manipulator, scene: Scene, margin_m: float
    ) -> None:
        start = manipulator.arm.start
        plan = plan_pick_and_place(TASK, manipulator, scene, start, margin_m=margin_m)
        assert plan.is_valid, str(plan.failure)
        assert plan.proven_clearance_m is not None
        assert plan.proven_clearance_m >= margin_m

    def test_more_than_the_pick_leaves_is_refused_with_what_it_leaves(
        self, manipulator: Manipulator, scene: Scene
    ) -> None:
        start = manipulator.arm.start
        plan = plan_pick_and_place(TASK, manipulator, scene, start, margin_m=0.025)
        assert plan.failure is not None
        assert plan.failure.stage == "pick: descend"
        assert "finger_tip with table, at best 22.1 mm apart" in plan.failure.reason

    def test_a_start_nearer_than_that_is_refused(
        self, manipulator: Manipulator, scene: Scene
    ) -> None:
        q = manipulator.ik.solve(overhead(0.6, 0.3, -0.129)).q
        plan = plan_pick_and_place(TASK, manipulator, scene, q, margin_m=0.025)
        assert plan.failure is not None
        assert "mm from table, and 25.0 mm are asked for" in plan.failure.reason

    @pytest.mark.parametrize("bad", [-0.001, np.nan, np.inf, None, "1 cm", True])
    def test_one_that_is_none_raises(
        self, manipulator: Manipulator, scene: Scene, bad: Any
    ) -> None:
        start = manipulator.arm.start
        with pytest.raises(MotionError, match="margin"):
            plan_pick_and_place(TASK, manipulator, scene, start, margin_m=bad)
        with pytest.raises(MotionError, match="margin"):
            plan_start_move(manipulator, scene, start, start, margin_m=bad)


class TestLineTolerance:
    """How far the tip may be off its lines is the user's to say."""

    def test_a_wider_one_makes_a_faster_cycle_that_is_judged_by_it(
        self, plan: Plan, manipulator: Manipulator, scene: Scene, tmp_path: Path
    ) -> None:
        wide = LineTolerance(0.001, math.radians(0.5))
        start = manipulator.arm.start
        loose = plan_pick_and_place(TASK, manipulator, scene, start, line_tolerance=wide)
        assert loose.motion_time_s < 0.98 * plan.motion_time_s
        save_plan(loose, tmp_path / "plan.json")
        found = verify(load_plan(tmp_path / "plan.json"))
        assert found.is_valid
        assert 1e-4 < found["distance from line"].value <= wide.position_m
        assert found["distance from line"].bound == wide.position_m
        assert found["turn from line"].bound == wide.rotation_rad

    def test_a_plan_that_states_less_than_it_keeps_is_rejected(
        self, manipulator: Manipulator, scene: Scene
    ) -> None:
        wide, start = LineTolerance(0.001, math.radians(0.5)), manipulator.arm.start
        loose = plan_pick_and_place(TASK, manipulator, scene, start, line_tolerance=wide)
        found = verify(replace(loose, line_tolerance=LineTolerance()))
        assert not found["distance from line"].is_passed

    def test_a_tight_one_is_kept_and_proven(
        self, plan: Plan, manipulator: Manipulator, scene: Scene
    ) -> None:
        tight, start = LineTolerance(5e-6, 5e-5), manipulator.arm.start
        found = plan_pick_and_place(TASK, manipulator, scene, start, line_tolerance=tight)
        assert found.motion_time_s < 1.02 * plan.motion_time_s
        assert verify(found).is_valid

    def test_a_retreat_states_it_too(self, manipulator: Manipulator, scene: Scene) -> None:
        wide, q = LineTolerance(0.002, 0.01), manipulator.ik.solve(overhead(0.6, 0.3, 0.0)).q
        plan = plan_retract(manipulator, scene, q, 0.1, line_tolerance=wide)
        assert plan.line_tolerance == wide
        assert verify(plan).is_valid

    @pytest.mark.parametrize("bad", [1e-3, (1e-3, 1e-3), "strict"])
    def test_one_that_is_none_raises(
        self, manipulator: Manipulator, scene: Scene, bad: Any
    ) -> None:
        with pytest.raises(MotionError, match="line_tolerance"):
            plan_pick_and_place(TASK, manipulator, scene, manipulator.arm.start, line_tolerance=bad)

    @pytest.mark.parametrize("bad", [0.0, 1e-9, -1.0, math.nan, math.inf, 1e3, "1 mm", None, True])
    def test_numbers_that_are_none_raise(self, bad: Any) -> None:
        with pytest.raises(MotionError, match="line tolerance position_m"):
            LineTolerance(bad)
        with pytest.raises(MotionError, match="line tolerance rotation_rad"):
            LineTolerance(1e-3, bad)


class TestContradictions:
    """What makes no sense raises."""

    def test_a_missing_block_raises_naming_what_is_there(
        self, manipulator: Manipulator, table: Body
    ) -> None:
        with pytest.raises(SceneError, match="no body 'block' in the scene; it has: table"):
            planned(TASK, manipulator, Scene.of([table]))

    def test_an_immovable_body_raises(self, manipulator: Manipulator, scene: Scene) -> None:
        with pytest.raises(TaskError, match="'table' is not movable"):
            planned(PickAndPlace("table", PICK, PLACE), manipulator, scene)

    @pytest.mark.parametrize("q", [None, "q", [], [0.0] * 6, [np.nan] * 7, [9.0] * 7])
    def test_a_start_that_is_none_raises(
        self, manipulator: Manipulator, scene: Scene, q: Any
    ) -> None:
        with pytest.raises(ConfigurationError, match="q_start"):
            plan_pick_and_place(TASK, manipulator, scene, q)

    @pytest.mark.parametrize(
        "hover", [0.0, -0.1, np.nan, np.inf, None, "high", [0.1], True, 10**400]
    )
    def test_a_hover_distance_that_is_none_raises(self, hover: Any) -> None:
        with pytest.raises(TaskError, match="hover distance"):
            PickAndPlace("block", PICK, PLACE, hover)

    @pytest.mark.parametrize("pose", [None, "here", np.eye(3), np.full((4, 4), np.nan)])
    def test_a_pose_that_is_none_raises(self, pose: Any) -> None:
        for poses in ((pose, PLACE), (PICK, pose)):
            with pytest.raises(PoseError):
                PickAndPlace("block", *poses)

    @pytest.mark.parametrize("body", [None, 5, ["block"]])
    def test_a_body_without_name_raises(self, body: Any) -> None:
        with pytest.raises(TaskError, match="name of the body"):
            PickAndPlace(body, PICK, PLACE)

    @pytest.mark.parametrize("position", [0, 1, 2])
    @pytest.mark.parametrize("bad", [None, "x", 5, {}])
    def test_planning_with_something_else_raises(
        self, manipulator: Manipulator, scene: Scene, position: int, bad: Any
    ) -> None:
        parts: list[Any] = [TASK, manipulator, scene]
        parts[position] = bad
        task, manipulator_or_bad, scene_or_bad = parts
        with pytest.raises((TaskError, SceneError), match="must be of class"):
            plan_pick_and_place(task, manipulator_or_bad, scene_or_bad, manipulator.arm.start)

    @pytest.mark.parametrize("limb", ["middle", "", None, 5])
    def test_an_unknown_limb_raises(self, robot: Baxter, limb: Any) -> None:
        with pytest.raises(UnknownNameError, match="use one of: left, right"):
            Manipulator.of(robot, limb)

    @pytest.mark.parametrize("ratio", [0.0, -0.5, 1.5, np.nan, np.inf, None, "fast"])
    def test_a_speed_ratio_out_of_range_raises(self, robot: Baxter, ratio: Any) -> None:
        with pytest.raises(LimitsError, match="speed ratio"):
            Manipulator.of(robot, "left", speed_ratio=ratio)

    @pytest.mark.parametrize("q", ["q", [], [0.0] * 7, [np.nan] * 19])
    def test_other_joints_that_are_none_raise(self, robot: Baxter, q: Any) -> None:
        with pytest.raises(ConfigurationError, match="q_others"):
            Manipulator.of(robot, "left", q_others=q)

    @pytest.mark.parametrize("robot", [None, "baxter", 5])
    def test_a_manipulator_of_no_robot_raises(self, robot: Any) -> None:
        with pytest.raises(TaskError, match="robot"):
            Manipulator.of(robot, "left")


class TestConfigurations:
    """Full configurations of the robot for those of one arm."""

    def test_arm_and_fingers_are_set_and_all_others_stay(self, manipulator: Manipulator) -> None:
        names = manipulator.robot.joint_names
        (q,) = manipulator.configurations(manipulator.arm.start[None], 0.01)
        joints = dict(zip(names, q.tolist(), strict=True))
        before = dict(zip(names, manipulator.q_others.tolist(), strict=True))
        changed = manipulator.arm.joints(manipulator.arm.start) | {
            "l_gripper_l_finger_joint": 0.01,
            "l_gripper_r_finger_joint": -0.01,
        }
        assert joints == before | changed

    def test_each_is_an_array_of_its_own(self, manipulator: Manipulator) -> None:
        qs = np.stack([manipulator.arm.neutral, manipulator.arm.start])
        first, second = manipulator.configurations(qs, 0.0)
        assert first.tolist() != second.tolist()

    @pytest.mark.parametrize("qs", [None, "q", [0.0] * 7, [[0.0] * 6], [[np.nan] * 7], 5])
    def test_malformed_ones_are_refused(self, manipulator: Manipulator, qs: Any) -> None:
        with pytest.raises(ConfigurationError, match="qs"):
            list(manipulator.configurations(qs, 0.0))


class TestStartMove:
    """The way to where a task starts."""

    def test_it_ends_where_asked_with_the_gripper_open(
        self, manipulator: Manipulator, scene: Scene
    ) -> None:
        arm = manipulator.arm
        plan = plan_start_move(manipulator, scene, arm.neutral, arm.start)
        assert labels(plan) == ["move to start", "open"]
        assert plan.moves[0].trajectory.q_goal.tolist() == arm.start.tolist()
        assert isinstance(plan.steps[0], Move)

    def test_a_goal_inside_the_table_is_refused(
        self, manipulator: Manipulator, scene: Scene
    ) -> None:
        arm = manipulator.arm
        below = manipulator.ik.solve(overhead(0.65, 0.2, -0.25), current=arm.start)
        plan = plan_start_move(manipulator, scene, arm.start, below.q)
        assert plan.failure is not None
        assert plan.failure.stage == "move to start"
        assert "the arm is blocked where it shall go" in plan.failure.reason
        assert "inside table" in plan.failure.reason

    def test_without_angles_every_joint_goes_to_zero(
        self, manipulator: Manipulator, scene: Scene
    ) -> None:
        plan = plan_start_move(manipulator, scene, manipulator.arm.neutral)
        assert plan.moves[0].trajectory.q_goal.tolist() == [0.0] * 7

    def test_from_where_the_arm_is_it_takes_no_time(
        self, manipulator: Manipulator, scene: Scene
    ) -> None:
        start: NDArray[np.float64] = manipulator.arm.start
        assert plan_start_move(manipulator, scene, start, start).motion_time_s == 0.0

    @pytest.mark.parametrize("q", ["q", [], [0.0] * 6, [np.nan] * 7, [9.0] * 7])
    def test_malformed_ends_raise(self, manipulator: Manipulator, scene: Scene, q: Any) -> None:
        neutral = manipulator.arm.neutral
        for ends in ((q, neutral), (neutral, q)):
            with pytest.raises(ConfigurationError):
                plan_start_move(manipulator, scene, *ends)

    @pytest.mark.parametrize("bad", [None, "left"])
    def test_a_manipulator_that_is_none_raises(self, bad: Any) -> None:
        with pytest.raises(TaskError, match="manipulator"):
            plan_start_move(bad, Scene.of(), np.zeros(7))


@pytest.mark.parametrize("height_m", [1e308, 1001.0, np.nan, 0.0, "high", None], ids=str)
def test_a_height_beyond_what_is_measured_is_refused(
    manipulator: Manipulator, height_m: Any
) -> None:
    q, T = manipulator.arm.neutral, pin.SE3.Identity()
    with pytest.raises(TaskError, match="height_m must be"):
        plan_retract(manipulator, Scene.of(), q, height_m)
    with pytest.raises(TaskError, match="hover distance must be"):
        PickAndPlace("block", T, T, hover_m=height_m)
    with pytest.raises(TaskError, match="clear height must be"):
        PickAndPlace("block", T, T, clear_m=height_m)


@pytest.mark.parametrize(("clear_m", "hover_m"), [(1e-17, 0.15), (1e-12, 0.15), (0.05, 1e-17)])
def test_lines_of_no_length_to_speak_of_raise_nothing(
    manipulator: Manipulator, scene: Scene, clear_m: float, hover_m: float
) -> None:
    task = PickAndPlace("block", PICK, PLACE, clear_m=clear_m, hover_m=hover_m)
    plan = planned(task, manipulator, scene)
    assert plan.is_valid or plan.failure is not None


def test_a_pick_in_millimetres_is_told_to_be_out_of_reach(
    manipulator: Manipulator, scene: Scene
) -> None:
    far = PickAndPlace("block", overhead(2000.0, 0.0, -0.129), PLACE)
    failure = planned(far, manipulator, scene).failure
    assert failure is not None
    assert "millimetres" in failure.reason


def test_a_sheet_in_the_way_is_gone_around(manipulator: Manipulator, scene: Scene) -> None:
    corners = np.array([(-0.15, 0.0, -0.1), (0.15, 0.0, -0.1), (0.15, 0.0, 0.1), (-0.15, 0.0, 0.1)])
    sheet = Part(Mesh(corners, np.array([(0, 1, 2), (0, 2, 3)])), at(0.0, 0.0, 0.0))
    plan = planned(
        TASK, manipulator, scene.with_body(Body("sheet", (sheet,), at(0.72, 0.075, -0.055)))
    )
    assert plan.is_valid, str(plan.failure)
    assert verify(plan).is_valid


@pytest.mark.parametrize("off_m", [0.0032, 0.0036, 0.0038, 0.0042])
def test_a_body_that_a_finger_begins_inside_is_planned_for_or_refused(
    manipulator: Manipulator, scene: Scene, off_m: float
) -> None:
    """Beside its middle by about as much as the open hand has room."""
    x, y, _ = scene["block"].centre_base
    task = PickAndPlace("block", overhead(x, y + off_m, -0.129), PLACE)
    plan = plan_pick_and_place(task, manipulator, scene, manipulator.arm.start)
    assert plan.failure is not None or verify(plan).is_valid
