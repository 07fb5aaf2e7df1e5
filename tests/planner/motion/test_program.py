"""The nonlinear program of a motion: its derivatives, and what it finds."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Arm, Baxter, IKService
from baxter_kin.arrays import Vector
from planner import StraightLine, Trajectory, plan_straight_move
from planner.lines import raised
from planner.motion.clearance_rows import clearance_rows
from planner.motion.phases import LineTolerance, MotionTask, Phase
from planner.motion.program import MotionProgram
from planner.motion.sparse import Rows
from planner.motion.spline_rows import spline_rows
from planner.motion.splines import Sketch
from planner.motion.tip_rows import height_rows, line_rows
from planner.motion.unknowns import Numbers, Unknowns, numbers_of
from tests.conftest import overhead

PHASES = (Phase(4), Phase(5, 0, (1.0, 0.0), rests=True), Phase(4, 0), Phase(6, 1, rests=True))
"""Every kind of phase and of hand-over, on few intervals."""

TOLERANCE = LineTolerance(2e-5, 5e-5)
LINE_M, TILT_RAD = 0.1, 0.3


def task_of(arm: Arm, q: Vector) -> MotionTask:
    T = arm.T_base_tip(q)
    tilted = pin.SE3(pin.exp3(np.array([TILT_RAD, 0.0, 0.0])) @ T.rotation, T.translation + LINE_M)
    lines = StraightLine(T, raised(T, LINE_M)), StraightLine(T, tilted)
    return MotionTask(q, lines, TOLERANCE, (0.1,))


@pytest.mark.parametrize("make", [spline_rows, line_rows, height_rows, clearance_rows])
def test_derivatives_are_those_that_casadi_finds_by_itself(
    arm: Arm, make: Callable[..., Rows]
) -> None:
    rng = np.random.default_rng(1)
    unknowns = Unknowns.of(PHASES, keeps_clear=True)
    numbers = Numbers(PHASES, len(unknowns.shortfalls))
    x = ca.MX.sym("x", unknowns.count)
    rows = make(PHASES, unknowns, x, numbers)
    multipliers = ca.MX.sym("multipliers", rows.g.shape[0])
    weighted, _ = ca.hessian(ca.dot(multipliers, rows.g), x)
    inputs = [x, numbers.all, multipliers]
    ours = ca.Function("ours", inputs, [rows.jacobian, rows.hessian(multipliers)])
    theirs = ca.Function("theirs", inputs, [ca.jacobian(rows.g, x), ca.triu(weighted)])
    at = rng.uniform(0.3, 0.9, unknowns.count)
    given = numbers_of(task_of(arm, arm.neutral), arm, arm.limits)
    values = np.concatenate([given, rng.normal(size=numbers.all.shape[0] - len(given))])
    weights = rng.normal(size=multipliers.shape[0])
    assert rows.jacobian.nnz() > rows.g.shape[0]
    for mine, expected in zip(
        ours.call([at, values, weights]), theirs.call([at, values, weights]), strict=True
    ):
        dense = np.array(ca.DM(expected).full())
        np.testing.assert_allclose(mine.full(), dense, rtol=1e-9, atol=1e-9 * np.abs(dense).max())


@pytest.fixture(scope="module")
def q_grasp(robot: Baxter) -> Vector:
    found = IKService(robot.arm("left")).solve(overhead(0.70, 0.15, -0.129))
    assert found.is_valid
    return found.q


def straight(arm: Arm, q: Vector, height_m: float, intervals: int) -> tuple[Trajectory, Trajectory]:
    """A rise as one program, and as the path timed by other means that it begins from."""
    T = arm.T_base_tip(q)
    line = StraightLine(T, raised(T, height_m))
    planned = plan_straight_move(arm, q, line.T_base_goal, arm.limits)
    program = MotionProgram([Phase(intervals, 0, rests=True)])
    task = MotionTask(q, (line,), TOLERANCE, ())
    found = program.solve([Sketch.of(planned, intervals)], task, arm, arm.limits)
    assert found is not None
    return found[0], planned


def test_a_line_takes_no_longer_than_its_fastest_path(left: Arm, q_grasp: Vector) -> None:
    """It is as fast but for the intervals, and faster where self-motion helps."""
    found, planned = straight(left, q_grasp, 0.15, 40)
    assert found.duration <= 1.005 * planned.duration


def test_the_tip_is_on_the_line_at_all_knots(left: Arm, q_grasp: Vector) -> None:
    found, _ = straight(left, q_grasp, 0.15, 20)
    T_start, T_goal = left.T_base_tip(q_grasp), left.T_base_tip(found.q_goal)
    np.testing.assert_allclose(T_goal.translation - T_start.translation, [0, 0, 0.15], atol=1e-8)
    for q in found.q:
        T = left.T_base_tip(q)
        off = np.abs((T.translation - T_start.translation)[:2]).max()
        assert off <= TOLERANCE.position_m * (1.0 + 1e-6)
        turned = np.abs(pin.log3(T_start.rotation.T @ T.rotation)).max()
        assert turned <= TOLERANCE.rotation_rad * (1.0 + 1e-6)


def test_limits_are_kept_and_reached(left: Arm, q_grasp: Vector) -> None:
    found, _ = straight(left, q_grasp, 0.15, 20)
    assert 0.99 < max(found.peak_ratios()) <= 1.0 + 1e-12
    low, high = found.position_extrema()
    assert (low >= left.limits.q_min).all()
    assert (high <= left.limits.q_max).all()


def test_the_same_task_has_the_same_motion(left: Arm, q_grasp: Vector) -> None:
    first, second = (straight(left, q_grasp, 0.05, 10)[0] for _ in range(2))
    np.testing.assert_array_equal(first.q, second.q)
    np.testing.assert_array_equal(first.knots_s, second.knots_s)


def test_what_cannot_be_done_is_told_by_none(left: Arm, q_grasp: Vector) -> None:
    T = left.T_base_tip(q_grasp)
    line = StraightLine(T, raised(T, 2.0))
    sketch = Sketch(np.tile(q_grasp, (11, 1)), np.zeros((2, 7)), 1.0)
    task = MotionTask(q_grasp, (line,), TOLERANCE, ())
    program = MotionProgram([Phase(10, 0, rests=True)])
    assert program.solve([sketch], task, left, left.limits) is None
