"""What a certificate is made of: exact extrema, straight lines, closing fingers, its own text."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from baxter_kin import Baxter
from baxter_kin.description import RobotDescription
from baxter_kin.errors import UnknownNameError
from planner import (
    Body,
    Box,
    Certificate,
    Cylinder,
    Held,
    Manipulator,
    Part,
    Scene,
    Situation,
    Trajectory,
    plan_joint_move,
)
from planner.errors import SceneError, TaskError
from planner.trajectory import CONTINUITY_TOLERANCE
from planner.verification import Check, Tolerances
from planner.verification.body.robot_body import robot_body
from planner.verification.certificate import Relation
from planner.verification.fingers import LEAD_M, Fingers, drop_m
from planner.verification.motion.cubics import Cubics
from planner.verification.motion.sampled_path import sampled_path
from planner.verification.motion.tip_checks import _off_line, line_deviation
from planner.verification.urdf_robot import UrdfRobot
from tests.conftest import at

COAL_M = 2e-6
"""Coal's accuracy, from both sides of a comparison."""


@pytest.fixture(scope="module")
def urdf() -> UrdfRobot:
    return UrdfRobot(RobotDescription.installed(), "left")


@pytest.fixture(scope="module")
def fingers(urdf: UrdfRobot) -> Fingers:
    return Fingers(urdf, robot_body(RobotDescription.installed()).solids)


def configurations() -> st.SearchStrategy[Any]:
    return hnp.arrays(np.float64, 7, elements=st.floats(-0.9, 0.9))


def inside(manipulator: Manipulator, share: Any) -> Any:
    """A configuration by its share of the range of each joint, -1..1."""
    low, high = manipulator.limits.q_min, manipulator.limits.q_max
    return (low + high) / 2 + share * (high - low) / 2


@given(first=configurations(), second=configurations(), rate=configurations())
@settings(max_examples=20)
def test_critical_states_hold_every_extreme(
    manipulator: Manipulator, first: Any, second: Any, rate: Any
) -> None:
    start, goal = inside(manipulator, 0.8 * first), inside(manipulator, 0.8 * second)
    way = plan_joint_move(start, goal, manipulator.limits, v_start=0.1 * rate)
    states = Cubics(way).critical_states()
    for sampled, critical in zip(
        way.sample(np.linspace(0.0, way.duration, 2000)),
        (states.q, states.v, states.a),
        strict=True,
    ):
        assert (critical.max(axis=0) >= sampled.max(axis=0) - CONTINUITY_TOLERANCE).all()
        assert (critical.min(axis=0) <= sampled.min(axis=0) + CONTINUITY_TOLERANCE).all()


@given(first=configurations(), second=configurations(), rate=configurations())
@settings(max_examples=20)
def test_extrema_by_bisection_are_those_by_formula(
    manipulator: Manipulator, first: Any, second: Any, rate: Any
) -> None:
    start, goal = inside(manipulator, 0.8 * first), inside(manipulator, 0.8 * second)
    way = plan_joint_move(start, goal, manipulator.limits, v_start=0.1 * rate)
    states = Cubics(way).critical_states()
    lowest, highest = way.position_extrema()
    # a joint that turns at its goal does so just before or after it, by rounding
    assert states.q.min(axis=0) == pytest.approx(lowest, abs=CONTINUITY_TOLERANCE)
    assert states.q.max(axis=0) == pytest.approx(highest, abs=CONTINUITY_TOLERANCE)
    fastest = (np.abs(states.v) / manipulator.limits.v_max).max(initial=0.0)
    assert fastest == pytest.approx(way.peak_ratios().velocity, abs=CONTINUITY_TOLERANCE)


def test_a_turn_between_knots_is_found(manipulator: Manipulator) -> None:
    # q = t - t^2 + t^3 / 5 over 2 s turns at 5/3 -+ sqrt(10)/3: one of both lies inside
    def state(t: float) -> list[float]:
        return [t - t**2 + t**3 / 5, 1 - 2 * t + 0.6 * t**2, -2 + 1.2 * t]

    q, v, a = (np.outer(x, np.ones(7)) for x in np.array([state(0.0), state(2.0)]).T)
    way = Trajectory(manipulator.limits, np.array([0.0, 2.0]), q, v, a, np.full((1, 7), 1.2))
    turn = 5 / 3 - math.sqrt(10) / 3
    states = Cubics(way).critical_states()
    assert states.q.max() == pytest.approx(state(turn)[0], abs=1e-15)
    assert np.isclose(Cubics(way).turning_times(), turn, atol=1e-12).any()
    assert states.v.min() == pytest.approx(state(5 / 3)[1], abs=1e-15)


@given(first=configurations(), second=configurations(), rate=configurations())
@settings(max_examples=20)
def test_samples_stand_a_step_of_travel_apart(
    manipulator: Manipulator, first: Any, second: Any, rate: Any
) -> None:
    start, goal = inside(manipulator, 0.8 * first), inside(manipulator, 0.8 * second)
    way = plan_joint_move(start, goal, manipulator.limits, v_start=0.1 * rate)
    reach, step = np.linspace(1.0, 0.1, 7), 0.01
    path = sampled_path(Cubics(way), reach, step, 10_000)
    dense = way.sample(np.linspace(0.0, way.duration, 20_000)).q
    travelled = float((np.abs(np.diff(dense, axis=0)) @ reach).sum())
    assert float((path.turned @ reach).max()) <= step + 1e-9
    assert (path.turned @ reach).sum() == pytest.approx(travelled, rel=1e-4, abs=1e-7)
    assert len(path.times_s) <= 3 + travelled / step
    assert path.q[[0, -1]] == pytest.approx(
        np.array([way.q_start, way.q_goal]), abs=CONTINUITY_TOLERANCE
    )


@given(first=configurations(), second=configurations())
@settings(max_examples=10)
def test_between_looks_the_tip_stays_as_near_its_line_as_is_said(
    urdf: UrdfRobot, manipulator: Manipulator, first: Any, second: Any
) -> None:
    start = inside(manipulator, 0.8 * first)
    goal = start + 0.1 * second * np.linspace(0.5, 1.0, 7)  # turned by small angles
    way = plan_joint_move(start, goal, manipulator.limits)
    standing = np.array(manipulator.robot.configuration())
    found = line_deviation(way, urdf, standing, Tolerances())
    ends = [urdf.T_base_tip(standing, q) for q in (way.q_start, way.q_goal)]
    off = np.array(
        [
            _off_line(urdf.T_base_tip(standing, q), *ends)
            for q in way.sample(np.linspace(0.0, way.duration, 3001)).q
        ]
    )
    assert off[:, 0].max() <= found.position_m + found.between_m
    assert off[:, 1].max() <= found.orientation_rad + found.between_rad
    assert found.between_m < 1e-5
    assert found.between_rad < 1e-4


@given(share=configurations())
@settings(max_examples=20)
def test_the_tip_by_the_full_urdf_is_the_arms(
    urdf: UrdfRobot, manipulator: Manipulator, share: Any
) -> None:
    q = inside(manipulator, share)
    standing = np.array(manipulator.robot.configuration())
    theirs = manipulator.arm.T_base_tip(q).homogeneous
    assert np.abs(urdf.T_base_tip(standing, q).homogeneous - theirs).max() < 1e-12


def test_the_urdfs_limits_are_the_arms(urdf: UrdfRobot, manipulator: Manipulator) -> None:
    low, high = urdf.q_range
    assert urdf.arm_names == manipulator.arm.joint_names
    assert np.array_equal(low, manipulator.limits.q_min)
    assert np.array_equal(high, manipulator.limits.q_max)
    assert np.array_equal(urdf.v_max, manipulator.limits.v_max)


def test_a_turn_of_the_shoulder_leaves_the_line_by_the_sagitta(
    urdf: UrdfRobot, manipulator: Manipulator
) -> None:
    start = manipulator.arm.neutral
    goal = start + np.array([0.6, 0, 0, 0, 0, 0, 0])
    way = plan_joint_move(start, goal, manipulator.limits)
    standing = np.array(manipulator.robot.configuration())
    axis = manipulator.robot.model.jointPlacements[1 + 1].translation  # left_s0, after head_pan
    assert manipulator.robot.model.names[2] == "left_s0"
    arm = manipulator.arm.T_base_tip(start).translation - axis
    sagitta = float(np.hypot(arm[0], arm[1])) * (1 - math.cos(0.3))
    found = line_deviation(way, urdf, standing, Tolerances())
    assert found.position_m == pytest.approx(sagitta, abs=1e-6)
    assert found.position_time_s == pytest.approx(way.duration / 2, abs=2e-3)


def test_a_turn_of_the_hand_about_its_axis_is_straight(
    urdf: UrdfRobot, manipulator: Manipulator
) -> None:
    start = manipulator.arm.neutral
    way = plan_joint_move(start, start + np.eye(7)[6], manipulator.limits)
    found = line_deviation(way, urdf, np.array(manipulator.robot.configuration()), Tolerances())
    assert found.position_m < 1e-12
    assert found.orientation_rad < 1e-8  # of an angle near zero: half the digits


BODIES = st.one_of(
    st.builds(Box, st.tuples(*[st.floats(0.02, 0.04)] * 3)),
    st.builds(Cylinder, st.floats(0.01, 0.02), st.floats(0.02, 0.04)),
)


@given(
    shape=BODIES,
    offset=st.tuples(*[st.floats(-0.008, 0.008)] * 3),
    turn=st.tuples(*[st.floats(-0.4, 0.4)] * 3),
)
@settings(max_examples=15)
def test_closing_fingers_end_where_both_touch_and_touch_nothing_before(
    fingers: Fingers, manipulator: Manipulator, shape: Any, offset: Any, turn: Any
) -> None:
    T_tip_body = pin.SE3(pin.exp3(np.array(turn)), np.array(offset))
    body = Body("thing", (Part(shape, at(0, 0, 0)),), T_tip_body, is_movable=True)
    stroke = manipulator.hand.stroke_m
    ours = fingers.closing(body, T_tip_body, stroke)
    has_room = min(fingers.gaps_m(body, T_tip_body, stroke)) > -LEAD_M
    if not (ours.is_hold and has_room):
        return
    assert max(map(abs, fingers.gaps_m(body, ours.T_tip_body, ours.finger_m))) < 1e-5
    for share in (0.1, 0.5, 0.9):
        open_m = ours.touch_m + share * (stroke - ours.touch_m)
        assert min(fingers.gaps_m(body, T_tip_body, open_m)) > -LEAD_M
    pushed = ours.T_tip_body.translation - T_tip_body.translation
    assert pushed == pytest.approx([0.0, ours.push_m, 0.0], abs=1e-15)
    assert abs(ours.push_m) == pytest.approx(ours.touch_m - ours.finger_m, abs=2 * COAL_M)


def test_closed_fingers_are_on_the_body(fingers: Fingers) -> None:
    block = Body("block", (Part(Box((0.05, 0.05, 0.05)), at(0, 0, 0)),), at(0, 0.003, 0))
    closing = fingers.closing(block, block.T_base_body, 0.020833)
    # 50 mm less 16 mm, halved, and the meshes' pads stand 0.35 mm further in
    assert closing.finger_m == pytest.approx(0.01735, abs=1e-5)
    assert np.abs(closing.T_tip_body.translation).max() < COAL_M  # pushed to the middle
    assert max(map(abs, fingers.gaps_m(block, closing.T_tip_body, closing.finger_m))) < COAL_M


def test_fingers_that_meet_nothing_close_fully(fingers: Fingers) -> None:
    block = Body("block", (Part(Box((0.05, 0.05, 0.05)), at(0, 0, 0)),), at(0, 0, 0.3))
    closing = fingers.closing(block, block.T_base_body, 0.02)
    assert not closing.is_hold
    assert closing.finger_m == 0.0


@pytest.mark.parametrize(("height_m", "drop"), [(0.025, 0.0), (0.032, 0.007), (0.5, math.inf)])
def test_a_drop_is_measured_down_to_the_support(height_m: float, drop: float) -> None:
    block = Body("block", (Part(Box((0.05, 0.05, 0.05)), at(0, 0, 0)),), at(0, 0, height_m))
    floor = Body("floor", (Part(Box((1.0, 1.0, 0.1)), at(0, 0, -0.05)),), at(0, 0, 0))
    assert drop_m(block, floor, 0.02) == pytest.approx(drop, abs=COAL_M)


def check(value: float, relation: Relation, bound: float) -> Check:
    return Check("velocity limit", value, relation, bound, "rad/s", "pick: approach")


@pytest.mark.parametrize(
    ("value", "relation", "bound", "passes"),
    [
        (1.0, Relation.AT_MOST, 1.0, True),
        (1.1, Relation.AT_MOST, 1.0, False),
        (1.0, Relation.AT_LEAST, 1.0, True),
        (0.9, Relation.AT_LEAST, 1.0, False),
        (1.0, Relation.ABOVE, 1.0, False),
        (math.inf, Relation.AT_MOST, 1.0, False),
        (math.nan, Relation.AT_MOST, 1.0, False),
        (math.nan, Relation.ABOVE, 1.0, False),
    ],
)
def test_a_check_is_passed_when_its_value_keeps_the_bound(
    value: float, relation: Relation, bound: float, passes: bool
) -> None:
    assert check(value, relation, bound).is_passed is passes


def test_a_certificate_names_what_fails() -> None:
    checks = (check(0.5, Relation.AT_MOST, 1.0), check(math.inf, Relation.AT_MOST, 1.0))
    certificate = Certificate("left", 2.0, 10, checks)
    assert not certificate.is_valid
    assert certificate.failures == checks[1:]
    assert "1 of 2 checks fail: velocity limit inf rad/s" in certificate.verdict
    assert "FAILS" in str(certificate)


def test_a_value_without_a_number_is_null_in_json() -> None:
    certificate = Certificate("left", 2.0, 10, (check(math.inf, Relation.AT_MOST, 1.0),))
    data = json.loads(json.dumps(certificate.as_dict(), allow_nan=False))
    assert data["checks"][0]["value"] is None
    assert data["checks"][0]["relation"] == "<="


def test_there_is_no_check_of_another_name() -> None:
    with pytest.raises(UnknownNameError):
        _ = Certificate("left", 2.0, 10, ())["velocity limit"]


@pytest.mark.parametrize("value", [-1.0, math.nan, "1"])
def test_a_tolerance_is_a_number_not_below_zero(value: Any) -> None:
    with pytest.raises(TaskError, match="tip_m"):
        Tolerances(tip_m=value)


def test_a_situation_has_the_fingers_of_both_hands_open_as_a_new_world_has(
    manipulator: Manipulator, scene: Scene
) -> None:
    joints = Situation.of(manipulator, scene).joints
    assert joints["l_gripper_l_finger_joint"] == manipulator.hand.stroke_m
    assert joints["r_gripper_l_finger_joint"] == manipulator.hand.stroke_m
    assert list(joints) == list(manipulator.robot.joint_names)


def test_a_situation_cannot_be_changed(manipulator: Manipulator, scene: Scene) -> None:
    joints = {"head_pan": 0.0}
    situation = Situation(scene, joints)
    joints["head_pan"] = 1.0
    assert situation.joints["head_pan"] == 0.0


def test_a_situation_needs_a_scene_and_numbers(scene: Scene) -> None:
    with pytest.raises(SceneError, match="scene must be of class Scene"):
        Situation("table", {})  # type: ignore[arg-type]
    with pytest.raises(TaskError, match="joint head_pan must be a finite number"):
        Situation(scene, {"head_pan": math.nan})


def test_a_situation_says_what_the_hands_hold(scene: Scene) -> None:
    right = Held("right", "block", pin.SE3.Identity())
    assert [each.body for each in Situation(scene, {}, (right,)).held] == ["block"]
    with pytest.raises(SceneError, match="no body 'cup'"):
        Situation(scene, {}, (replace(right, body="cup"),))
    with pytest.raises(TaskError, match="held by one hand, got: block, block"):
        Situation(scene, {}, (right, replace(right, side="left")))
    with pytest.raises(UnknownNameError, match="limb"):
        replace(right, side="middle")


def test_the_robot_is_read_from_the_files_that_are_given(robot: Baxter) -> None:
    assert UrdfRobot(robot.description, "right").arm_names == robot.arm("right").joint_names
