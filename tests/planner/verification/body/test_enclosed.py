"""Things wholly inside a link, where no surface is near."""

from __future__ import annotations

import coal
import numpy as np
import pytest

from baxter_kin.description import RobotDescription
from planner.verification.body.enclosed import is_enclosed
from planner.verification.body.robot_body import RobotBody, robot_body
from planner.verification.body.solid import Solid
from tests.conftest import at

FILES = RobotDescription.installed()


@pytest.fixture(scope="module")
def body() -> RobotBody:
    return robot_body(FILES)


def test_a_thing_inside_a_link_is_found_though_no_surface_is_near(body: RobotBody) -> None:
    wrist = next(solid for solid in body.solids if solid.name == "left_wrist")
    marble = Solid.of("marble", 0, at(0, 0, 0), coal.Sphere(0.001))
    corners = np.array(wrist.shape.vertices())
    x, y, z = wrist.T_joint_shape.act((corners.min(axis=0) + corners.max(axis=0)) / 2)
    assert is_enclosed(marble, at(x, y, z), wrist, wrist.T_joint_shape)
    for beside in (at(x + 0.06, y, z), at(x, y, z + 0.08), at(x + 1.0, y, z)):
        assert not is_enclosed(marble, beside, wrist, wrist.T_joint_shape)
