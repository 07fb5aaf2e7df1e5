"""Covers and balls contain their shapes."""

from __future__ import annotations

import numpy as np
import pytest

from baxter_kin.description import RobotDescription
from planner.verification.body.robot_body import RobotBody, robot_body

FILES = RobotDescription.installed()


@pytest.fixture(scope="module")
def body() -> RobotBody:
    return robot_body(FILES)


def test_covers_and_balls_contain_their_shapes(body: RobotBody) -> None:
    for solid in body.solids:
        if solid.is_surface:
            vertices = np.array(solid.shape.vertices())
            corners = np.array(solid.cover.points())
            sides = np.random.default_rng(1).normal(size=(200, 3))
            beyond = (vertices @ sides.T).max(axis=0) - (corners @ sides.T).max(axis=0)
            assert beyond.max() < 1e-12
            away = np.linalg.norm(vertices - solid.centre, axis=1)
            assert away.max() <= solid.radius_m + 1e-12
