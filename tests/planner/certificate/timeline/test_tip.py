"""Straight lines of the tip, on which the hand may turn."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter
from planner import (
    Manipulator,
    Move,
    Plan,
    Scene,
    complete,
    plan_joint_move,
    plan_straight_move,
)
from planner.certificate.checking import check
from planner.certificate.errors import NotCertifiedError
from planner.errors import TaskError
from planner.plan_file import plan_document
from planner.state import State
from planner.trajectory import Trajectory
from planner.verification import certificate_of
from tests.conftest import overhead

START = overhead(0.70, 0.20, 0.0)


@pytest.fixture(scope="module")
def q_start(manipulator: Manipulator) -> Any:
    return manipulator.ik.solve(START).q


def straight(manipulator: Manipulator, trajectory: Trajectory) -> Plan:
    """A plan of one move that says of itself that it is straight."""
    start = State.of(manipulator, Scene.of(), q=trajectory.q[0])
    move = Move("line", trajectory, is_straight=True)
    return complete(Plan(start, (move,)), manipulator=manipulator)


@pytest.mark.slow
@pytest.mark.parametrize(
    "way",
    [
        pin.SE3(pin.utils.rotate("z", 0.8), np.array([0.05, 0.1, 0.02])),
        pin.SE3(pin.utils.rotate("z", 0.5), np.zeros(3)),
    ],
)
def test_lines_that_turn_evenly_are_certified(
    robot: Baxter, manipulator: Manipulator, q_start: Any, way: pin.SE3
) -> None:
    goal = START * way
    trajectory = plan_straight_move(manipulator.arm, q_start, goal, manipulator.limits)
    plan = straight(manipulator, trajectory)
    document: dict[str, Any] = {**plan_document(plan), "certificate": certificate_of(plan)}
    assert check(document, robot.description.text).clearance_m > 0.01
    document["plan"]["line_tolerance"] = {"position_m": 1e-4, "rotation_rad": 1e-9}
    with pytest.raises(NotCertifiedError, match="off its way"):
        check(document, robot.description.text)


@pytest.mark.slow
@pytest.mark.parametrize("goal_m", [(0.05, 0.1, 0.02), (0.0, -0.15, 0.05)])
def test_a_tip_is_certified_to_within_a_share_of_its_tolerance(
    robot: Baxter, manipulator: Manipulator, q_start: Any, goal_m: tuple[float, ...]
) -> None:
    goal = pin.SE3(START.rotation, START.translation + np.array(goal_m))
    trajectory = plan_straight_move(manipulator.arm, q_start, goal, manipulator.limits)
    plan = straight(manipulator, trajectory)
    document: dict[str, Any] = {**plan_document(plan), "certificate": certificate_of(plan)}
    times_s = np.linspace(0.0, trajectory.duration, 4_001)
    qs = trajectory.sample(times_s).q
    p = np.array([manipulator.arm.T_base_tip(q).translation for q in qs])
    way = (p[-1] - p[0]) / np.linalg.norm(p[-1] - p[0])
    off_m = np.linalg.norm(p - p[0] - np.outer((p - p[0]) @ way, way), axis=1).max()
    document["plan"]["line_tolerance"] = {"position_m": 1.002 * off_m, "rotation_rad": 1e-2}
    assert check(document, robot.description.text).rows > 0
    document["plan"]["line_tolerance"] = {"position_m": 0.999 * off_m, "rotation_rad": 1e-2}
    with pytest.raises(NotCertifiedError, match="off its way"):
        check(document, robot.description.text)


def test_a_line_that_turns_unevenly_is_refused(
    robot: Baxter, manipulator: Manipulator, q_start: Any
) -> None:
    """The last joint turns the hand about the tip; where another one moves too, it is off."""
    q_goal = q_start + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.4])
    q_between = q_start + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.02, 0.2])
    evenly = straight(manipulator, plan_joint_move(q_start, q_goal, manipulator.limits))
    document = {**plan_document(evenly), "certificate": certificate_of(evenly)}
    assert check(document, robot.description.text).rows > 0
    astray = plan_joint_move(q_start, q_between, manipulator.limits)
    back = plan_joint_move(q_between, q_goal, manipulator.limits)
    knots_s = np.append(astray.knots_s, astray.duration + back.knots_s[1:])
    q, v, a = (np.vstack([getattr(astray, x), getattr(back, x)[1:]]) for x in "qva")
    joined = Trajectory(manipulator.limits, knots_s, q, v, a, np.vstack([astray.j, back.j]))
    with pytest.raises(TaskError, match="off its way"):
        certificate_of(straight(manipulator, joined))
