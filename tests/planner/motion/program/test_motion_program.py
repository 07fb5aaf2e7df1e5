"""The nonlinear program of a motion: its derivatives, and what it finds."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Arm, Baxter, IKService
from baxter_kin.frames import raised
from baxter_kin.validation import FloatArray
from planner import StraightLine, Trajectory, plan_joint_move
from planner.motion.program import tip_rows
from planner.motion.program.guess import guess_along
from planner.motion.program.motion_program import (
    MARGIN_TOLERANCE_M,
    MAX_FAILURES,
    MAX_ROUNDS,
    MAX_ROUNDS_TO_CLEAR,
    TRUST_DECAY,
    TRUST_RAD,
    MotionProgram,
    Motions,
    Track,
    led_around,
)
from planner.motion.program.rows import Clearances, Rows, spline_rows
from planner.motion.program.tip_rows import height_rows, path_rows, speed_rows, tilt_rows
from planner.motion.program.unknowns import MotionTask, Numbers, Phase, Unknowns
from planner.splines import Sketch
from tests.conftest import overhead
from tests.planner.toy_world import (
    ARM_LEFT,
    ARM_LIMITS,
    ARM_RIGHT,
    AROUND_DISC,
    Disc,
    ToyObstacles,
    ToySpace,
    least_distance,
)

PHASES = (Phase(4), Phase(5, 0, (1.0, 0.0), rests=True), Phase(4, 0), Phase(6, 1, rests=True))
"""Phases and hand-overs of a pick and place, on few intervals."""

AT_SPEED = (Phase(5, 0, enters=True), Phase(4, 1, leaves=True))
TO_GOAL = (Phase(4), Phase(5, rests=True, at_goal=True))
UPRIGHT = (Phase(4), Phase(5, rests=True, at_goal=True, keeps_upright=True))

POSITION_M, ROTATION_RAD = TOLERANCE = (2e-5, 5e-5)


@pytest.fixture
def differentiable(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """CasADi does not look into machine code."""
    monkeypatch.setattr(tip_rows, "compiled", lambda _: None)
    caches = tip_rows._at_knots, tip_rows.leaning
    for each in caches:
        each.cache_clear()
    yield
    for each in caches:
        each.cache_clear()


@pytest.mark.usefixtures("differentiable")
@pytest.mark.parametrize(
    ("make", "phases"),
    [
        *((make, PHASES) for make in (spline_rows, path_rows, height_rows)),
        *((make, AT_SPEED) for make in (spline_rows, path_rows, speed_rows)),
        *((make, TO_GOAL) for make in (spline_rows, height_rows)),
        (tilt_rows, UPRIGHT),
    ],
)
def test_derivatives_are_those_that_casadi_finds_by_itself(
    make: Callable[..., Rows], phases: tuple[Phase, ...]
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
    guess = guess_along(arm, limits, q, line, intervals, ends_at_rest=True)
    assert isinstance(guess, Sketch)
    program = MotionProgram([Phase(intervals, 0, rests=True)], 7)
    found = program.solve([guess], MotionTask(q, (line,), TOLERANCE), arm, limits)
    assert found is not None
    return found[0]


def test_no_tip_within_its_tolerance_passes_an_end_at_rest(left: Arm, q_grasp: FloatArray) -> None:
    """An arm that has time may be anywhere within; beyond the end, it puts a body down twice."""
    rise, limits = straight(left, q_grasp, 0.15, 20), left.limits
    line, guess = StraightLine(*left.T_base_tips(rise.q[[0, -1]])), Sketch.of(rise, 20)
    phases = [Phase(20, 0, (1.0, 0.0), rests=True), Phase(20, 0, leaves=True)]
    program = MotionProgram(phases, 7)
    track = Track(program, MotionTask(rise.q_goal, (line,), TOLERANCE), left, limits)
    part = program.part([guess._replace(q=guess.q[::-1]), guess], track, 1.0)
    down, up = (
        np.array([part.inputs[name][fractions[1:-1]] for name in ("lbx", "ubx")])
        for fractions in program.unknowns.fractions
        if fractions is not None
    )
    for kept in (down[0], 1.0 - down[1], up[0]):
        assert np.min(0.15 * kept) >= POSITION_M * (1.0 - 1e-9)
    assert np.max(up[1]) == 1.0  # it leaves at speed


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


def test_a_rise_is_on_its_line_at_all_knots_and_keeps_and_reaches_limits(
    left: Arm, q_grasp: FloatArray
) -> None:
    found = straight(left, q_grasp, 0.15, 20)
    assert 0.99 < max(found.peak_ratios()) <= 1.0 + 1e-12
    low, high = found.position_extrema()
    assert (low >= left.limits.q_min).all()
    assert (high <= left.limits.q_max).all()
    T_start, T_goal = left.T_base_tip(q_grasp), left.T_base_tip(found.q_goal)
    np.testing.assert_allclose(T_goal.translation - T_start.translation, [0, 0, 0.15], atol=1e-8)
    for q in found.q:
        T = left.T_base_tip(q)
        off = np.abs((T.translation - T_start.translation)[:2]).max()
        assert off <= POSITION_M * (1.0 + 1e-6)
        turned = np.abs(pin.log3(T_start.rotation.T @ T.rotation)).max()
        assert turned <= ROTATION_RAD * (1.0 + 1e-6)


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


INTERVALS = 20

TASK = MotionTask(ARM_LEFT, q_goal=ARM_RIGHT)

MARGIN_M = 0.05
BESIDE = ToySpace((Disc(0.0, 1.8, 0.5),))
"""A disc that the straight way does not meet."""

STRAIGHT = plan_joint_move(ARM_LEFT, ARM_RIGHT, ARM_LIMITS)
SKETCH = Sketch.of(STRAIGHT, INTERVALS)
BENT = Sketch(
    SKETCH.q + 0.6 * np.outer(np.sin(np.linspace(0.0, np.pi, INTERVALS + 1)) ** 2, np.eye(7)[1]),
    SKETCH.v_ends,
    SKETCH.duration_s,
)
"""Into the disc as well, but beside its middle."""


@pytest.fixture(scope="module")
def program() -> MotionProgram:
    return MotionProgram([Phase(INTERVALS, rests=True, at_goal=True)], 7)


def around(
    program: MotionProgram, space: ToySpace = AROUND_DISC, enough_s: float = 0.0
) -> list[Trajectory]:
    def solve(sketches: Sequence[Sketch], near: Clearances) -> Motions | None:
        return program.solve(sketches, TASK, None, ARM_LIMITS, near)

    obstacles = ToyObstacles(space.with_margin(MARGIN_M, ARM_LEFT, ARM_RIGHT))
    return [motion for (motion,) in led_around(solve, [obstacles], [BENT], enough_s=enough_s)]


class Script:
    """Answers a solver gives, the last one again and again; what it was asked."""

    def __init__(self, *answers: Trajectory | None) -> None:
        self.answers, self.trusts_rad = answers, list[float]()

    def __call__(self, _: Sequence[Sketch], near: Clearances) -> Motions | None:
        number = min(len(self.trusts_rad), len(self.answers) - 1)
        self.trusts_rad.append(near.trust_rad)
        answer = self.answers[number]
        return None if answer is None else (answer,)

    def found(self, space: ToySpace) -> list[Motions]:
        return led_around(self, [ToyObstacles(space)], [SKETCH])


def test_what_is_found_keeps_nearly_all_of_the_margin_where_it_is_bounded(
    program: MotionProgram,
) -> None:
    found = around(program)
    assert least_distance(AROUND_DISC, BENT.q) < 0.0
    assert len(found) > 1
    durations = [motion.duration for motion in found]
    assert durations[0] == pytest.approx(min(durations), rel=0.01)
    for motion in found:
        np.testing.assert_allclose(
            [motion.q_start, motion.q_goal], [ARM_LEFT, ARM_RIGHT], atol=1e-9
        )
        assert max(motion.peak_ratios()) <= 1.0 + 1e-9
        middles_s = (np.arange(INTERVALS) + 0.5) / INTERVALS * motion.duration
        qs = motion.sample(middles_s).q
        assert least_distance(AROUND_DISC, qs) > MARGIN_M - MARGIN_TOLERANCE_M - 1e-9


def test_motions_that_are_fast_enough_end_the_search(program: MotionProgram) -> None:
    (first,) = around(program, enough_s=np.inf)
    assert first.q.tolist() == around(program)[-1].q.tolist()


def test_a_clear_way_is_left_as_it_is_and_asked_for_twice() -> None:
    script = Script(STRAIGHT)
    assert script.found(BESIDE) == [(STRAIGHT,)] * 2
    assert len(script.trusts_rad) == 2


def test_a_program_without_solution_is_trusted_less_and_given_up() -> None:
    script = Script(None)
    assert not script.found(AROUND_DISC)
    assert len(script.trusts_rad) == MAX_FAILURES + 1
    assert script.trusts_rad[:2] == [TRUST_RAD, TRUST_DECAY * TRUST_RAD]


def test_motions_that_stay_in_collision_are_given_up() -> None:
    script = Script(STRAIGHT)
    assert not script.found(AROUND_DISC)
    assert len(script.trusts_rad) == MAX_ROUNDS_TO_CLEAR


def test_from_half_of_the_rounds_on_bounds_are_trusted_less_and_less() -> None:
    """Durations that keep changing end after all rounds."""
    slower = [
        plan_joint_move(ARM_LEFT, ARM_RIGHT, ARM_LIMITS.scaled(share))
        for share in np.linspace(0.2, 1.0, MAX_ROUNDS)
    ]
    script = Script(*slower)
    assert len(script.found(BESIDE)) == MAX_ROUNDS
    assert script.trusts_rad[: MAX_ROUNDS // 2] == [TRUST_RAD] * (MAX_ROUNDS // 2)
    later = script.trusts_rad[MAX_ROUNDS // 2 + 1 :]
    assert all(after < before for before, after in pairwise(later))
