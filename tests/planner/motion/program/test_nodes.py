"""What is asked of the tip, against Pinocchio on the whole robot."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Arm, Baxter
from planner import StraightLine
from planner.motion.program.nodes import above, geometry_numbers, line_numbers, on_line
from tests.calibrated import calibrated_arm

ROUNDING = 1e-9


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
    numbers = line_numbers(line, placed), geometry_numbers(placed)
    found = np.array(on_line().value([*q, s], *numbers)).ravel()
    reached, wanted = placed.T_base_tip(q), line.at(s)
    distance_m = np.linalg.norm(reached.translation - wanted.translation)
    assert np.linalg.norm(found[:3]) == pytest.approx(distance_m, abs=ROUNDING)
    angle = np.linalg.norm(pin.log3(wanted.rotation.T @ reached.rotation))
    assert np.linalg.norm(found[3:]) == pytest.approx(abs(np.sin(angle)), abs=ROUNDING)


@given(seed=st.integers(0, 2**32 - 1))
def test_the_height_is_that_in_base(placed: Arm, seed: int) -> None:
    rng = np.random.default_rng(seed)
    q, height_m = placed.random_configuration(rng), float(rng.normal())
    found = float(above().value(q, height_m, geometry_numbers(placed)))
    z_m = placed.T_base_tip(q).translation[2]
    assert found == pytest.approx(z_m - height_m, abs=ROUNDING)


def test_nothing_is_left_of_the_error_on_the_line(placed: Arm) -> None:
    q = placed.neutral
    T = placed.T_base_tip(q)
    line = StraightLine(pin.SE3(T.rotation, T.translation - [0.0, 0.0, 0.1]), T)
    e = np.array(on_line().value([*q, 1.0], line_numbers(line, placed), geometry_numbers(placed)))
    np.testing.assert_allclose(e, 0.0, atol=ROUNDING)
