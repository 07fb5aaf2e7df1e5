"""Tips beside their waypoints, and moves that are not as straight as they shall be."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings

from planner import Certificate, Manipulator, Move, Plan, Trajectory, plan_joint_move, verify
from planner.verification import Tolerances
from planner.verification.motion.tip_checks import _off_line, line_deviation
from planner.verification.urdf_robot import UrdfRobot
from tests.planner.verification.conftest import configurations, failed, inside, move_of

LINES = {"distance from line", "turn from line"}
"""What fails when a move that shall be straight is not."""


def said_to_be_straight(plan: Plan, label: str) -> Plan:
    """The plan with one move marked as straight."""
    steps = [
        replace(step, is_straight=True) if isinstance(step, Move) and step.label == label else step
        for step in plan
    ]
    return replace(plan, steps=tuple(steps))


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
