"""Pick and place: the demo's cycle, what is asked of it, and what makes no sense."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from baxter_kin import Baxter
from baxter_kin.errors import ConfigurationError
from baxter_kin.fields import evolve
from baxter_kin.frames import raised
from planner import (
    Body,
    Box,
    Cylinder,
    Grip,
    GripperAction,
    LineTolerance,
    Manipulator,
    Move,
    Part,
    PickAndPlace,
    Plan,
    Scene,
    load_plan,
    overhead_grasp,
    plan_joint_move,
    plan_pick_and_place,
    plan_retract,
    plan_start_move,
    save_plan,
    verify,
)
from planner.collision import ClearanceChecker
from planner.errors import MotionError, SceneError, TaskError
from planner.scene.bodies import Attachment
from planner.scene.contact import touching
from planner.trajectory import CONTINUITY_TOLERANCE
from tests.bodies import grasp_of
from tests.conftest import at, overhead
from tests.planner.pick_place.conftest import PICK, PLACE, STAGES, TASK, labels, planned

REACHED_M = 1e-6
"""What a valid IK result promises, in m and rad."""

RATIO_TOLERANCE = 1e-9

SAMPLING_M = 1e-3
"""What checks 25 ms apart may miss: at 1 m/s the tip covers 25 mm between them, but the least
clearance of these moves is at their ends, where the arm stands still."""

HELD = Attachment("block", "left_gripper", at(0.0, 0.0, 0.0))

SIDEWAYS = ("pick: approach", "place: approach")


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
        told = f"{label}, optimised by {moved_rad:.2f} rad" if moved_rad > 0.005 else label
        assert move.seed_label == told


def test_a_move_in_joint_angles_has_no_seed(plan: Plan) -> None:
    move = evolve(plan.moves[0], T_base_tip=None, ik=None)
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


def test_every_move_keeps_every_limit(plan: Plan) -> None:
    for move in plan.moves:
        assert max(move.trajectory.peak_ratios()) <= 1.0 + RATIO_TOLERANCE


def test_every_move_is_clear_of_everything(plan: Plan) -> None:
    for move in plan.moves:
        assert move.clearance is not None
        assert move.clearance.distance_m > 0.0


def test_the_least_clearance_is_that_of_the_fingers_above_the_table(plan: Plan) -> None:
    assert plan.clearance is not None
    assert plan.clearance.distance_m == pytest.approx(22.2e-3, abs=0.05e-3)
    assert plan.clearance.second == "table"
    assert "finger" in plan.clearance.first


def test_clearances_agree_with_a_check_ten_times_as_dense(
    plan: Plan, manipulator: Manipulator, scene: Scene
) -> None:
    hand, block = manipulator.hand, scene["block"]
    grasp = grasp_of(hand, PICK, block, hand.stroke_m)
    assert grasp is not None
    placed = scene.moved("block", PLACE * grasp.T_tip_body)
    held, stood = Attachment("block", "left_gripper", grasp.T_tip_body), touching(block, scene)
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
        assert "mm from table, and 25.0 mm are required" in plan.failure.reason

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
        found = verify(evolve(loose, line_tolerance=LineTolerance()))
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


NONSENSE: list[Any] = [None, "x", 5, {}]

WRONG_ARGUMENTS: list[tuple[dict[str, Any], type[Exception], str]] = [
    *(({"task": bad}, TaskError, "task") for bad in NONSENSE),
    *(({"manipulator": bad}, TaskError, "manipulator") for bad in NONSENSE),
    *(({"scene": bad}, SceneError, "scene") for bad in NONSENSE),
    *(
        ({"q_start": bad}, ConfigurationError, "q_start")
        for bad in (None, "q", [], [0.0] * 6, [np.nan] * 7)
    ),
    ({"q_start": [0.0, 0.0, 0.0, 9.0, 0.0, 0.0, 0.0]}, ConfigurationError, "left_e1"),
    ({"line_tolerance": 1e-3}, MotionError, "line_tolerance"),
    ({"line_tolerance": (1e-3, 1e-3)}, MotionError, "line_tolerance"),
    ({"held": ["block"]}, TaskError, "what the hands hold"),
    ({"held": np.zeros(2)}, TaskError, "what the hands hold"),
    ({"held": [HELD]}, TaskError, "the left hand holds 'block'"),
    ({"margin_m": -0.001}, MotionError, r"margin .*negative, got -0\.001 m"),
]


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

    @pytest.mark.parametrize(
        ("given", "error", "named"),
        WRONG_ARGUMENTS,
    )
    def test_a_wrong_argument_raises_by_its_name(
        self,
        manipulator: Manipulator,
        scene: Scene,
        given: dict[str, Any],
        error: type[Exception],
        named: str,
    ) -> None:
        asked: dict[str, Any] = {
            "task": TASK,
            "manipulator": manipulator,
            "scene": scene,
            "q_start": manipulator.arm.start,
        }
        with pytest.raises(error, match=named):
            plan_pick_and_place(**asked | given)


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
        assert "the arm is blocked at its goal" in plan.failure.reason
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
            with pytest.raises(ConfigurationError, match="q_now" if ends[0] is q else "q_start"):
                plan_start_move(manipulator, scene, *ends)

    @pytest.mark.parametrize("bad", [None, "left"])
    def test_a_manipulator_that_is_none_raises(self, bad: Any) -> None:
        with pytest.raises(TaskError, match="manipulator"):
            plan_start_move(bad, Scene.of(), np.zeros(7))


@pytest.mark.parametrize(("clear_m", "hover_m"), [(1e-17, 0.15), (1e-12, 0.15), (0.05, 1e-17)])
def test_lines_of_no_length_to_speak_of_raise_nothing(
    manipulator: Manipulator, scene: Scene, clear_m: float, hover_m: float
) -> None:
    task = PickAndPlace("block", PICK, PLACE, clear_m=clear_m, hover_m=hover_m)
    plan = planned(task, manipulator, scene)
    assert plan.is_valid or plan.failure is not None


def tee(gap_m: float, side: float) -> tuple[Part, ...]:
    """A post with a block beside it whose underside is a gap above that of the post."""
    arm = Box((0.02, 0.02, 0.09 - gap_m))
    return (
        Part(Box((0.04, 0.04, 0.09)), at(0.0, 0.0, 0.0)),
        Part(arm, at(side * 0.03, 0.0, gap_m / 2)),
    )


def mug(gap_m: float, side: float) -> tuple[Part, ...]:
    """A cylinder with a handle, a gap above its underside."""
    handle = Part(Box((0.02, 0.008, 0.03)), at(side * 0.034, 0.0, gap_m - 0.03))
    return Part(Cylinder(0.025, 0.09), at(0.0, 0.0, 0.0)), handle


@pytest.mark.parametrize(
    ("parts", "push_m"),
    [
        (tee(0.005, 1.0), 0.0),
        (tee(0.015, -1.0), 0.0),
        (mug(0.005, 1.0), 0.0),
        (tee(0.005, 1), 4e-3),
    ],
)
def test_what_is_proven_of_a_body_in_several_parts_holds_for_each_of_them(
    manipulator: Manipulator, table: Body, parts: tuple[Part, ...], push_m: float
) -> None:
    """One part stands on the table, and the other passes it at a distance that counts."""
    body = Body("tee", parts, at(0.65, 0.25, -0.11), is_movable=True)
    grasp = overhead_grasp(manipulator.hand, body) * at(0.0, push_m, 0.0)
    task = PickAndPlace("tee", grasp, at(0.0, -0.2, 0.0) * grasp)
    plan = planned(task, manipulator, Scene.of([table, body]))
    assert plan.is_valid, str(plan.failure)
    certificate = verify(plan)
    assert certificate.is_valid, certificate.verdict
    near = {step.label: step.proof.nearest for step in plan if step.proof is not None}
    for label in ("pick: retract", "place: descend", *["pick: close"] * (push_m > 0.0)):
        assert {near[label].first, near[label].second} == {"tee", "table"}


def test_a_body_in_two_parts_is_stacked_on_another(manipulator: Manipulator, table: Body) -> None:
    """The lower one carries by its higher part; its lower one is passed at 15 mm."""
    body = Body("tee", tee(0.005, 1.0), at(0.65, 0.25, -0.11), is_movable=True)
    shoulder = Part(Box((0.05, 0.05, 0.035)), at(0.05, 0.0, -0.0075))
    step = Body(
        "step", (Part(Box((0.05, 0.05, 0.05)), at(0, 0, 0)), shoulder), at(0.65, 0.05, -0.13)
    )
    grasp = overhead_grasp(manipulator.hand, body)
    task = PickAndPlace("tee", grasp, at(0.0, -0.2, 0.05) * grasp)
    plan = planned(task, manipulator, Scene.of([table, step, body]))
    assert plan.is_valid, str(plan.failure)
    certificate = verify(plan)
    assert certificate.is_valid, certificate.verdict


def test_a_body_in_the_other_hand_is_refused_by_the_name_of_the_hand(
    manipulator: Manipulator, scene: Scene
) -> None:
    held = Attachment("block", "right_gripper", at(0.0, 0.0, 0.0))
    plan = plan_pick_and_place(TASK, manipulator, scene, manipulator.arm.start, held=[held])
    assert plan.failure is not None
    assert plan.failure.reason == "block is in the right hand"
    assert labels(plan) == []
