"""A good plan passes every check; each way to spoil one fails at the checks it concerns."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pinocchio as pin
import pytest

from baxter_kin import Baxter, pose_from_quaternion
from planner import (
    Attachment,
    Body,
    Box,
    Certificate,
    Claim,
    Manipulator,
    Move,
    Part,
    PickAndPlace,
    Plan,
    PlanFailure,
    Scene,
    State,
    Trajectory,
    plan_file,
    plan_pick_and_place,
    verify,
)
from planner.errors import SceneError, TaskError
from tests.conftest import at
from tests.planner.verification.conftest import DOWN, PLACE, failed, with_moves


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
    found = verify(made, State.of(right, scene))
    assert found.is_valid, found.verdict


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


@pytest.mark.parametrize(("name", "count"), [("steps", 9), ("bodies", 1), ("parts", 3)])
def test_a_plan_too_large_is_refused(
    plan: Plan, monkeypatch: pytest.MonkeyPatch, name: str, count: int
) -> None:
    monkeypatch.setattr(plan_file, "MOST", {**plan_file.MOST, name: count - 1})
    with pytest.raises(TaskError, match=f"{name}; at most {count - 1} can be checked"):
        verify(plan)


def test_a_failed_plan_says_so(plan: Plan) -> None:
    found = verify(replace(plan, failure=PlanFailure("place: retract", "no way up")))
    assert failed(found) == {"failed steps"}
    assert found["failed steps"].where == "place: retract: no way up"


def test_a_claim_that_is_not_known_is_not_certified(plan: Plan) -> None:
    moves = {plan.moves[3].label: replace(plan.moves[3], claims=(Claim("upright"),))}
    claimed = replace(plan, steps=tuple(moves.get(step.label, step) for step in plan))
    found = verify(claimed)
    assert failed(found) == {"claims that are not known"}
    assert found["claims that are not known"].where == f"{plan.moves[3].label}: upright"


def test_a_plan_without_steps_is_valid(manipulator: Manipulator, world: Scene) -> None:
    plan = Plan(State.of(manipulator, world), (), limb="left")
    found = verify(plan)
    assert found.is_valid
    assert found.verdict.startswith("valid: left arm, a plan without steps, all ")


def test_a_move_that_stays_is_valid(manipulator: Manipulator, world: Scene) -> None:
    stay = Move("stay", Trajectory.stay(manipulator.arm.neutral, manipulator.limits))
    assert verify(Plan(State.of(manipulator, world), (stay,))).is_valid


def test_a_state_of_another_robot_is_refused(plan: Plan, world: Scene) -> None:
    with pytest.raises(TaskError, match="lacks joint 'head_pan'"):
        verify(plan, State(world, {}))


def test_an_unknown_straight_move_is_refused(plan: Plan) -> None:
    with pytest.raises(TaskError, match="no move 'pick: lift'"):
        verify(plan, straight=["pick: lift"])


def test_no_plan_is_refused() -> None:
    with pytest.raises(TaskError, match="plan must be of class Plan"):
        verify("plan")  # type: ignore[arg-type]


def test_the_plan_with_nothing_in_the_way_is_valid(cube_certificate: Certificate) -> None:
    assert cube_certificate.is_valid, cube_certificate.verdict


def test_without_the_meshes_no_clearance_is_measured_and_the_plan_is_not_valid(
    robot: Baxter, cube_plan: Plan, cube_certificate: Certificate, tmp_path: Path
) -> None:
    """The planner's own body would judge itself; what needs no shapes is checked as ever."""
    bare = replace(robot.description, stock=replace(robot.description.stock, package_dir=tmp_path))
    found = verify(cube_plan, description=bare)
    assert not found.is_valid
    assert [check.name for check in found.failures] == ["clearance"]
    assert "clearance not measured, must be > 0 m" in found.verdict
    assert "the package example-robot-data brings the meshes" in found.verdict
    assert str(tmp_path) in found.verdict
    assert "not measured" in found.table()
    assert not found.as_dict()["is_valid"]
    for check in found.checks:
        assert check.name == "clearance" or check == cube_certificate[check.name]


def test_a_state_has_the_fingers_of_both_hands_open_as_a_new_world_has(
    manipulator: Manipulator, scene: Scene
) -> None:
    joints = State.of(manipulator, scene).joints
    assert joints["l_gripper_l_finger_joint"] == manipulator.hand.stroke_m
    assert joints["r_gripper_l_finger_joint"] == manipulator.hand.stroke_m
    assert list(joints) == list(manipulator.robot.joint_names)


def test_a_state_cannot_be_changed(manipulator: Manipulator, scene: Scene) -> None:
    joints = {"head_pan": 0.0}
    state = State(scene, joints)
    joints["head_pan"] = 1.0
    assert state.joints["head_pan"] == 0.0


def test_a_state_needs_a_scene_and_numbers(scene: Scene) -> None:
    with pytest.raises(SceneError, match="scene must be of class Scene"):
        State("table", {})  # type: ignore[arg-type]
    with pytest.raises(TaskError, match="joint head_pan must be a finite number"):
        State(scene, {"head_pan": math.nan})


def test_a_state_says_what_the_hands_hold(scene: Scene) -> None:
    right = Attachment("block", "right_gripper", pin.SE3.Identity())
    assert [each.body for each in State(scene, {}, (right,)).attachments] == ["block"]
    with pytest.raises(SceneError, match="no body 'cup'"):
        State(scene, {}, (replace(right, body="cup"),))
    with pytest.raises(TaskError, match="a hand holds one body at most, got: block, table"):
        State(scene, {}, (right, replace(right, body="table")))
    with pytest.raises(SceneError, match="must be a link of an arm"):
        replace(right, link="middle_gripper")
