"""Rows of what is asked of the tip, against the arm at the knots of the spline."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Arm, Baxter
from baxter_kin.frames import raised
from baxter_kin.validation import FloatArray
from planner import StraightLine
from planner.motion.program.rows import Rows
from planner.motion.program.tip_rows import (
    above,
    height_rows,
    leaning,
    on_piece,
    path_rows,
    speed_rows,
    tilt_rows,
)
from planner.motion.program.unknowns import (
    MotionTask,
    Numbers,
    Phase,
    Unknowns,
    geometry_numbers,
    numbers_of,
    piece_numbers,
)
from planner.splines import AT_KNOT, trajectory_of
from tests.calibrated import calibrated_arm

ROUNDING = 1e-8

TOLERANCE = (2e-5, 5e-5)
HEIGHT_M, DURATION_S = 0.1, 2.0
RATES = (0.3, 0.2, 0.4, -0.1)

ON_LINE = (Phase(4, 0, rests=True),)
AT_SPEED = (Phase(5, 0, enters=True, leaves=True),)
FREE = (Phase(6, rests=True),)
UPRIGHT = (Phase(6, rests=True, keeps_upright=True),)

STEP_S, DIFFERENCES = 1e-4, 1e-5
"""What differences over such a step are good for, relative."""


class Drawn:
    """Rows of one phase at a random spline near a configuration."""

    def __init__(
        self, make: Callable[..., Rows | None], phases: tuple[Phase, ...], arm: Arm
    ) -> None:
        rng = np.random.default_rng(2)
        unknowns, numbers = Unknowns.of(phases, 7), Numbers(phases, 7)
        symbols, known = ca.MX.sym("x", unknowns.count), np.zeros(unknowns.count + 14)
        rows = make(phases, unknowns, symbols, numbers)
        assert rows is not None
        self.rows = rows
        (where,), (fractions,) = unknowns.controls, unknowns.fractions
        known[where] = arm.start + 0.1 * rng.normal(size=where.shape)
        known[unknowns.count :] = np.tile(arm.start, 2) + 0.1 * rng.normal(size=14)
        known[unknowns.durations] = DURATION_S
        self.controls: FloatArray = known[where]
        self.q = np.array([AT_KNOT[0] @ self.controls[i : i + 3] for i in range(len(where) - 2)])
        self.fractions = rng.uniform(size=len(where) - 2)
        if fractions is not None:
            known[fractions] = self.fractions
        T = arm.T_base_tip(arm.start)
        turned = pin.SE3(pin.exp3(np.array([0.2, 0.0, 0.1])) @ T.rotation, T.translation)
        self.line = StraightLine(T, raised(turned, 0.1))
        (phase,) = phases
        lines = () if phase.piece is None else (self.line,)
        heights_m = (HEIGHT_M,) if phase.keeps_height else ()
        task = MotionTask(known[-14:-7], lines, TOLERANCE, heights_m, rates=RATES)
        given = numbers_of(task, arm, arm.limits)
        value = ca.Function("value", [symbols, numbers.all], [rows.g])
        self.g = value(known[: unknowns.count], given).full().ravel()


def test_errors_on_a_line_are_those_of_the_tip_against_its_pose_at_the_fraction(arm: Arm) -> None:
    """In shares of the tolerance; the first knot is where the arm rested, so it is left out."""
    drawn = Drawn(path_rows, ON_LINE, arm)
    errors = drawn.g.reshape(-1, 2, 3)
    assert len(errors) == ON_LINE[0].intervals
    for i, error in enumerate(errors[:-1], 1):
        reached, wanted = arm.T_base_tip(drawn.q[i]), drawn.line.at(float(drawn.fractions[i]))
        off_m = np.linalg.norm(reached.translation - wanted.translation)
        off_rad = np.linalg.norm(pin.log3(wanted.rotation.T @ reached.rotation))
        assert np.linalg.norm(error[0]) * TOLERANCE[0] == pytest.approx(off_m, abs=ROUNDING)
        assert np.linalg.norm(error[1]) * TOLERANCE[1] == pytest.approx(
            np.sin(off_rad), abs=ROUNDING
        )


def test_the_end_of_a_line_is_exact_and_the_tip_is_near_in_between(arm: Arm) -> None:
    rows = Drawn(path_rows, ON_LINE, arm).rows
    assert rows.high.tolist() == [1.0] * 18 + [0.0] * 6
    np.testing.assert_array_equal(rows.low, -rows.high)


def test_heights_are_those_of_the_tip_above_the_least_height(arm: Arm) -> None:
    drawn = Drawn(height_rows, FREE, arm)
    heights_m = [arm.T_base_tip(q).translation[2] - HEIGHT_M for q in drawn.q[1:-1]]
    np.testing.assert_allclose(drawn.g, heights_m, atol=ROUNDING)
    assert not drawn.rows.low.any()
    assert np.isinf(drawn.rows.high).all()


def test_tilts_are_those_of_the_axis_against_the_vertical(arm: Arm) -> None:
    """As shares of the maximum, by 1 - cos: here of the z axis and a right angle."""
    drawn = Drawn(tilt_rows, UPRIGHT, arm)
    up = [arm.T_base_tip(q).rotation[2, 2] for q in drawn.q[1:-1]]
    np.testing.assert_allclose(drawn.g, 1.0 - np.array(up), atol=ROUNDING)
    assert (drawn.rows.high == 1.0).all()


@pytest.mark.parametrize("end", [0, 1], ids=["entered", "left"])
def test_speeds_are_those_of_the_tip_less_those_of_the_line(arm: Arm, end: int) -> None:
    """By differences of poses shortly before and after."""
    drawn = Drawn(speed_rows, AT_SPEED, arm)
    found = drawn.g.reshape(2, 4, 3)[end]
    assert not drawn.rows.low.any()
    assert not drawn.rows.high.any()
    q, v, a = (
        getattr(trajectory_of(drawn.controls, DURATION_S, arm.limits), name)[-end] for name in "qva"
    )
    T_before, T, T_after = (
        arm.T_base_tip(q + v * t_s + a * t_s**2 / 2) for t_s in (-STEP_S, 0.0, STEP_S)
    )
    speed, acceleration = RATES[2 * end : 2 * end + 2]
    way, turn = np.split(drawn.line.twist, 2)
    v_tip = (T_after.translation - T_before.translation) / (2.0 * STEP_S)
    a_tip = (T_after.translation - 2.0 * T.translation + T_before.translation) / STEP_S**2
    w_tip = T_before.rotation @ pin.log3(T_before.rotation.T @ T_after.rotation) / (2.0 * STEP_S)
    for row, lacking in (
        (found[0] / DURATION_S, v_tip - speed * way),
        (found[1] / DURATION_S, w_tip - speed * turn),
        (found[2] / DURATION_S**2, a_tip - acceleration * way),
    ):
        assert np.linalg.norm(row) == pytest.approx(np.linalg.norm(lacking), rel=DIFFERENCES)


@pytest.mark.parametrize(
    ("make", "phases"),
    [(path_rows, FREE), (height_rows, ON_LINE), (speed_rows, ON_LINE), (tilt_rows, FREE)],
)
def test_there_are_none_where_nothing_is_asked_for(
    make: Callable[..., Rows | None], phases: tuple[Phase, ...]
) -> None:
    unknowns = Unknowns.of(phases, 7)
    assert make(phases, unknowns, ca.MX.sym("x", unknowns.count), Numbers(phases, 7)) is None


NODE_ROUNDING = 1e-9


@pytest.fixture(scope="module", params=["left", "right", "calibrated"])
def placed(request: pytest.FixtureRequest, robot: Baxter) -> Arm:
    """Arms of several geometries."""
    if request.param == "calibrated":
        return calibrated_arm(robot, "left", np.random.default_rng(4))
    return robot.arm(request.param)


@given(seed=st.integers(0, 2**32 - 1))
def test_the_error_on_a_line_is_that_of_the_line(placed: Arm, seed: int) -> None:
    rng = np.random.default_rng(seed)
    q, s = placed.random_configuration(rng), float(rng.uniform())
    T = placed.T_base_tip(placed.random_configuration(rng))
    turn = pin.exp3(rng.uniform(0.0, 1.5) * rng.normal(size=3) / 2.0)
    line = StraightLine(T, pin.SE3(turn @ T.rotation, T.translation + rng.normal(size=3)))
    numbers = piece_numbers(line, placed), geometry_numbers(placed)
    found = np.array(on_piece().value([*q, s], *numbers)).ravel()
    reached, wanted = placed.T_base_tip(q), line.at(s)
    distance_m = np.linalg.norm(reached.translation - wanted.translation)
    assert np.linalg.norm(found[:3]) == pytest.approx(distance_m, abs=NODE_ROUNDING)
    angle = np.linalg.norm(pin.log3(wanted.rotation.T @ reached.rotation))
    assert np.linalg.norm(found[3:]) == pytest.approx(abs(np.sin(angle)), abs=NODE_ROUNDING)


@given(seed=st.integers(0, 2**32 - 1))
def test_the_height_is_that_in_base(placed: Arm, seed: int) -> None:
    rng = np.random.default_rng(seed)
    q, height_m = placed.random_configuration(rng), float(rng.normal())
    found = float(above().value(q, height_m, geometry_numbers(placed)))
    z_m = placed.T_base_tip(q).translation[2]
    assert found == pytest.approx(z_m - height_m, abs=NODE_ROUNDING)


@given(seed=st.integers(0, 2**32 - 1))
def test_the_tilt_is_that_of_the_axis_in_base(placed: Arm, seed: int) -> None:
    rng = np.random.default_rng(seed)
    q, axis, most = placed.random_configuration(rng), rng.normal(size=3), float(rng.uniform(0.1, 2))
    axis /= np.linalg.norm(axis)
    found = float(leaning().value(q, [*axis, most], geometry_numbers(placed)))
    up = float((placed.T_base_tip(q).rotation @ axis)[2])
    assert found * most == pytest.approx(1.0 - up, abs=NODE_ROUNDING)
