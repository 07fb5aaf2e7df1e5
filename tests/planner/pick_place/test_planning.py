"""Pick and place: the demo's cycle, what is asked of it, and what makes no sense."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

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
from tests.bodies import grasp_of
from tests.conftest import at, overhead
from tests.planner.pick_place.conftest import PICK, PLACE, STAGES, TASK, labels, planned

SAMPLING_M = 1e-3
"""What checks 25 ms apart may miss: at 1 m/s the tip covers 25 mm between them, but the least
clearance of these moves is at their ends, where the arm stands still."""

HELD = Attachment("block", "left_gripper", at(0.0, 0.0, 0.0))

SIDEWAYS = ("pick: approach", "place: approach")


def test_the_stages_are_those_of_the_original_in_order(plan: Plan) -> None:
    assert plan.is_valid, str(plan.failure)
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
    by_angles = evolve(plan.moves[0], T_base_tip=None, ik=None)
    assert (by_angles.seed_label, by_angles.moved_rad) == ("(joint angles)", 0.0)


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
        times = np.linspace(0.0, move.trajectory.duration, int(50 * move.trajectory.duration))
        qs = manipulator.configurations(
            move.trajectory.sample(times).q, grasp.finger_m if carries else full
        )
        dense = min(checker.clearance(q).distance_m for q in qs)
        assert move.clearance is not None
        assert move.proof is not None
        assert 0.0 < move.proof.proven_m <= dense
        assert move.clearance.distance_m == pytest.approx(dense, abs=SAMPLING_M)


def test_what_is_proven_of_the_plan_is_the_least_of_its_steps(plan: Plan) -> None:
    proofs = [step.proof for step in plan]
    assert plan.proven_clearance_m == min(proof.proven_m for proof in proofs if proof is not None)
    assert None not in proofs


def test_the_same_task_gives_the_same_plan(
    plan: Plan, manipulator: Manipulator, scene: Scene
) -> None:
    before = {body.name: body.T_base_body.homogeneous.tolist() for body in scene}
    again = planned(TASK, manipulator, scene)
    assert {body.name: body.T_base_body.homogeneous.tolist() for body in scene} == before
    for first, second in zip(plan.moves, again.moves, strict=True):
        assert first.trajectory.q.tolist() == second.trajectory.q.tolist()
        assert first.trajectory.knots_s.tolist() == second.trajectory.knots_s.tolist()


@pytest.mark.slow
@settings(max_examples=4)
@given(st.floats(0.62, 0.80), st.floats(-0.05, 0.25), st.floats(0.05, 0.20))
def test_neighbouring_tasks_have_plans_too(
    manipulator: Manipulator, scene: Scene, x: float, y: float, hover: float
) -> None:
    shifted = scene.moved("block", at(x - 0.0275, y - 0.0235, -0.155))
    task = PickAndPlace("block", overhead(x, y, -0.129), PLACE, hover)
    plan = planned(task, manipulator, shifted)
    assert plan.is_valid, str(plan.failure)
    assert labels(plan) == STAGES


@pytest.mark.campaign  # its search takes 20 s; tasks beside each other are planned above
def test_picking_and_placing_at_one_pose_is_allowed(manipulator: Manipulator, scene: Scene) -> None:
    plan = planned(PickAndPlace("block", PICK, PICK), manipulator, scene)
    assert plan.is_valid, str(plan.failure)
    assert plan.moves[3].label == "place: approach"


@pytest.mark.parametrize(("hover_m", "clear_m", "above_m"), [(0.03, 0.05, 0.03), (0.2, 0.2, 0.2)])
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


class TestLineTolerance:
    """How far the tip may be off its lines is the user's to say."""

    @pytest.mark.slow
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
        strict = verify(evolve(loose, line_tolerance=LineTolerance()))
        assert not strict["distance from line"].is_passed

    @pytest.mark.slow
    def test_a_tight_one_is_kept_and_proven(
        self, plan: Plan, manipulator: Manipulator, scene: Scene
    ) -> None:
        tight, start = LineTolerance(5e-6, 5e-5), manipulator.arm.start
        found = plan_pick_and_place(TASK, manipulator, scene, start, line_tolerance=tight)
        assert found.motion_time_s < 1.02 * plan.motion_time_s
        assert verify(found).is_valid


def test_a_margin_is_proven_to_be_kept_or_refused(manipulator: Manipulator, scene: Scene) -> None:
    start = manipulator.arm.start
    plan = plan_pick_and_place(TASK, manipulator, scene, start, margin_m=0.018)
    assert plan.is_valid, str(plan.failure)
    assert plan.proven_clearance_m is not None
    assert plan.proven_clearance_m >= 0.018
    beside = manipulator.ik.solve(overhead(0.6, 0.3, -0.129)).q
    for q, reason in (
        (start, "finger_tip with table, at best 22.1 mm apart"),
        (beside, "mm from table, and 25.0 mm are required"),
    ):
        refused = plan_pick_and_place(TASK, manipulator, scene, q, margin_m=0.025)
        assert refused.failure is not None
        assert reason in refused.failure.reason


def test_a_retreat_states_its_line_tolerance(manipulator: Manipulator, scene: Scene) -> None:
    wide, q = LineTolerance(0.002, 0.01), manipulator.ik.solve(overhead(0.6, 0.3, 0.0)).q
    plan = plan_retract(manipulator, scene, q, 0.1, line_tolerance=wide)
    assert plan.line_tolerance == wide
    assert verify(plan).is_valid


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        *(({"task": bad}, TaskError) for bad in list[Any]([None, "x", {}])),
        *(({"manipulator": bad}, TaskError) for bad in (None, "left", 5)),
        *(({"scene": bad}, SceneError) for bad in list[Any]([None, "x", {}])),
        *(
            ({"q_start": bad}, ConfigurationError)
            for bad in (None, "q", [], [0.0] * 6, [np.nan] * 7, [9.0] * 7)
        ),
        *(({"line_tolerance": bad}, MotionError) for bad in (1e-3, (1e-3, 1e-3))),
        *(({"margin_m": bad}, MotionError) for bad in (-0.001, np.nan, None, "1 cm", True)),
        *(({"held": bad}, TaskError) for bad in (["block"], np.zeros(2), [HELD])),
        ({"task": PickAndPlace("table", PICK, PLACE)}, TaskError),  # is not movable
        ({"task": PickAndPlace("brick", PICK, PLACE)}, SceneError),  # is not there
    ],
    ids=str,
)
def test_refuses_invalid_arguments(
    manipulator: Manipulator, scene: Scene, changes: dict[str, Any], error: type[Exception]
) -> None:
    start = manipulator.arm.start
    asked: dict[str, Any] = {"manipulator": manipulator, "scene": scene, "q_start": start}
    with pytest.raises(error):
        plan_pick_and_place(**{"task": TASK, **asked, **changes})
    if changes.keys() <= {"manipulator", "q_start", "margin_m"} and changes != {"q_start": None}:
        asked["q_now"] = start
        with pytest.raises(error):
            plan_start_move(**asked | changes)
        if "q_start" in changes:
            asked["q_now"] = changes["q_start"]
            with pytest.raises(error):
                plan_start_move(**asked)


def test_a_body_in_the_other_hand_is_refused_by_the_name_of_the_hand(
    manipulator: Manipulator, scene: Scene
) -> None:
    held = evolve(HELD, link="right_gripper")
    plan = plan_pick_and_place(TASK, manipulator, scene, manipulator.arm.start, held=[held])
    assert plan.failure is not None
    assert plan.failure.reason == "block is in the right hand"


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
        to_zero = plan_start_move(manipulator, scene, arm.neutral)
        assert to_zero.moves[0].trajectory.q_goal.tolist() == [0.0] * 7
        assert plan_start_move(manipulator, scene, arm.start, arm.start).motion_time_s == 0.0

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
        (tee(0.015, -1.0), 0.0),
        (mug(0.005, 1.0), 0.0),
        pytest.param(tee(0.005, 1.0), 4e-3, marks=pytest.mark.campaign),
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
