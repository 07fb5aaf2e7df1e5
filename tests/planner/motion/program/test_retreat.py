"""Retreats out of a confined configuration."""

from __future__ import annotations

import numpy as np
import pytest

from planner import Body, Box, Manipulator, Part, Scene
from planner.motion.program.retreat import LENGTH_M, Surroundings, projected
from tests.conftest import at

MARGIN_M = 0.005


@pytest.mark.parametrize("seed", range(5))
def test_no_allowed_point_is_nearer_than_the_projection(seed: int) -> None:
    rng = np.random.default_rng(seed)
    wanted, slopes = rng.normal(size=7), rng.normal(size=(10, 7))
    inside = rng.normal(size=7)
    least = slopes @ inside - rng.uniform(0.0, 0.5, 10)
    found = projected(wanted, slopes, least)
    assert (slopes @ found >= least - 1e-3).all()
    others = found + (inside - found) * rng.uniform(0.0, 1.0, (100, 1))
    assert np.linalg.norm(found - wanted) <= np.linalg.norm(others - wanted, axis=1).min() + 1e-3


def test_a_hand_between_two_boards_goes_out(manipulator: Manipulator) -> None:
    """They are 20 cm wide, with its fingers between them."""
    arm = manipulator.arm
    T = arm.T_base_tip(arm.start)
    boards = [
        Body(name, (Part(Box((0.02, 0.2, 0.2)), at(0.0, 0.0, 0.0)),), T * at(x, 0.0, 0.03))
        for name, x in (("one", -0.07), ("other", 0.07))
    ]
    context = manipulator.context(Scene.of(boards), finger_m=manipulator.finger_m)
    assert context.is_free(arm.start)
    obstacles = context.obstacles(MARGIN_M, arm.start[None])
    is_free = context.with_margin(MARGIN_M, arm.start).is_free
    way = Surroundings(arm, manipulator.limits, obstacles, is_free).retreat(arm.start)
    np.testing.assert_array_equal(way[0], arm.start)
    assert all(map(context.is_free, way))
    assert np.linalg.norm(arm.T_base_tip(way[-1]).translation - T.translation) > 0.9 * LENGTH_M
