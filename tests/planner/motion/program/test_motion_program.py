"""The nonlinear program of a motion: its derivatives, and what it finds."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Arm, Baxter, IKService
from baxter_kin.frames import raised
from baxter_kin.validation import FloatArray
from planner import StraightLine, Trajectory
from planner.motion.guess import Way, along
from planner.motion.program import nodes
from planner.motion.program.motion_program import MotionProgram
from planner.motion.program.phases import MotionTask, Phase
from planner.motion.program.sparse import Rows
from planner.motion.program.spline_rows import spline_rows
from planner.motion.program.tip_rows import height_rows, line_rows, speed_rows
from planner.motion.program.unknowns import Numbers, Unknowns
from planner.splines import Sketch
from tests.conftest import overhead

PHASES = (Phase(4), Phase(5, 0, (1.0, 0.0), rests=True), Phase(4, 0), Phase(6, 1, rests=True))
"""Phases and hand-overs of a pick and place, on few intervals."""

AT_SPEED = (Phase(5, 0, enters=True), Phase(4, 1, leaves=True))
TO_GOAL = (Phase(4), Phase(5, rests=True, at_goal=True))

POSITION_M, ROTATION_RAD = TOLERANCE = (2e-5, 5e-5)
LINE_M, TILT_RAD = 0.1, 0.3


def task_of(arm: Arm, q: FloatArray) -> MotionTask:
    T = arm.T_base_tip(q)
    tilted = pin.SE3(pin.exp3(np.array([TILT_RAD, 0.0, 0.0])) @ T.rotation, T.translation + LINE_M)
    lines = StraightLine(T, raised(T, LINE_M)), StraightLine(T, tilted)
    return MotionTask(q, lines, TOLERANCE, (0.1,))


@pytest.fixture
def differentiable(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """CasADi does not look into machine code."""
    monkeypatch.setattr(nodes, "compiled", lambda _: None)
    nodes._at_knots.cache_clear()
    yield
    nodes._at_knots.cache_clear()


@pytest.mark.usefixtures("differentiable")
@pytest.mark.parametrize(
    ("make", "phases"),
    [
        *((make, PHASES) for make in (spline_rows, line_rows, height_rows)),
        *((make, AT_SPEED) for make in (spline_rows, line_rows, speed_rows)),
        *((make, TO_GOAL) for make in (spline_rows, height_rows)),
    ],
)
def test_derivatives_are_those_that_casadi_finds_by_itself(
    arm: Arm, make: Callable[..., Rows], phases: tuple[Phase, ...]
) -> None:
    rng = np.random.default_rng(1)
    unknowns, numbers = Unknowns.of(phases, 7), Numbers(phases, 7)
    x = ca.MX.sym("x", unknowns.count)
    rows = make(phases, unknowns, x, numbers)
    multipliers = ca.MX.sym("multipliers", rows.g.shape[0])
    weighted, _ = ca.hessian(ca.dot(multipliers, rows.g), x)
    inputs = [x, numbers.all, multipliers]
    ours = ca.Function("ours", inputs, [rows.jacobian, rows.hessian(multipliers)])
    theirs = ca.Function("theirs", inputs, [ca.jacobian(rows.g, x), ca.triu(weighted)])
    at = rng.uniform(0.3, 0.9, unknowns.count)
    values = rng.uniform(0.3, 0.9, numbers.all.shape[0])
    weights = rng.normal(size=multipliers.shape[0])
    assert rows.jacobian.nnz() > rows.g.shape[0]
    for mine, expected in zip(
        ours.call([at, values, weights]), theirs.call([at, values, weights]), strict=True
    ):
        dense = np.array(ca.DM(expected).full())
        np.testing.assert_allclose(mine.full(), dense, rtol=1e-9, atol=1e-9 * np.abs(dense).max())


@pytest.fixture(scope="module")
def q_grasp(robot: Baxter) -> FloatArray:
    found = IKService(robot.arm("left")).solve(overhead(0.70, 0.15, -0.129))
    assert found.is_valid
    return found.q


def straight(
    arm: Arm, q: FloatArray, height_m: float, intervals: int, speed: float = 1.0
) -> Trajectory:
    """A rise, with limits as for that share of all speeds."""
    T, limits = arm.T_base_tip(q), arm.limits.scaled(speed)
    line = StraightLine(T, raised(T, height_m))
    guess = along(arm, limits, q, Way(line, intervals, ends_at_rest=True))
    assert isinstance(guess, Sketch)
    program = MotionProgram([Phase(intervals, 0, rests=True)], 7)
    found = program.solve([guess], MotionTask(q, (line,), TOLERANCE), arm, limits)
    assert found is not None
    return found[0]


@pytest.mark.parametrize("speed", [1e-6, 0.1])
def test_a_slower_arm_makes_the_same_motion_more_slowly(
    left: Arm, q_grasp: FloatArray, speed: float
) -> None:
    """As velocity scales with the speed, acceleration with its square, and jerk with its cube."""
    usual, slow = (straight(left, q_grasp, 0.15, 20, share) for share in (1.0, speed))
    same = left.limits.scaled(speed)
    ratio = np.array([same.v_max, same.a_max**0.5, same.j_max ** (1 / 3)]) / np.array(
        [left.limits.v_max, left.limits.a_max**0.5, left.limits.j_max ** (1 / 3)]
    )
    assert usual.duration / ratio.max() <= 1.01 * slow.duration
    assert slow.duration <= 1.01 * usual.duration / ratio.min()


def test_the_tip_is_on_the_line_at_all_knots(left: Arm, q_grasp: FloatArray) -> None:
    found = straight(left, q_grasp, 0.15, 20)
    T_start, T_goal = left.T_base_tip(q_grasp), left.T_base_tip(found.q_goal)
    np.testing.assert_allclose(T_goal.translation - T_start.translation, [0, 0, 0.15], atol=1e-8)
    for q in found.q:
        T = left.T_base_tip(q)
        off = np.abs((T.translation - T_start.translation)[:2]).max()
        assert off <= POSITION_M * (1.0 + 1e-6)
        turned = np.abs(pin.log3(T_start.rotation.T @ T.rotation)).max()
        assert turned <= ROTATION_RAD * (1.0 + 1e-6)


def test_limits_are_kept_and_reached(left: Arm, q_grasp: FloatArray) -> None:
    found = straight(left, q_grasp, 0.15, 20)
    assert 0.99 < max(found.peak_ratios()) <= 1.0 + 1e-12
    low, high = found.position_extrema()
    assert (low >= left.limits.q_min).all()
    assert (high <= left.limits.q_max).all()


def test_the_same_task_has_the_same_motion(left: Arm, q_grasp: FloatArray) -> None:
    first, second = (straight(left, q_grasp, 0.05, 10) for _ in range(2))
    np.testing.assert_array_equal(first.q, second.q)
    np.testing.assert_array_equal(first.knots_s, second.knots_s)


def test_what_cannot_be_done_is_told_by_none(left: Arm, q_grasp: FloatArray) -> None:
    T = left.T_base_tip(q_grasp)
    line = StraightLine(T, raised(T, 2.0))
    sketch = Sketch(np.tile(q_grasp, (11, 1)), np.zeros((2, 7)), 1.0)
    task = MotionTask(q_grasp, (line,), TOLERANCE, ())
    program = MotionProgram([Phase(10, 0, rests=True)], 7)
    assert program.solve([sketch], task, left, left.limits) is None
