"""Things wholly inside a link, where no surface is near."""

from __future__ import annotations

import coal
import numpy as np
import pytest

from baxter_kin.description import RobotDescription
from planner.scene.contact import surface
from planner.verification.body.enclosed import is_enclosed
from planner.verification.body.robot_body import SolidBody, robot_body
from planner.verification.body.solid import Solid
from tests.bodies import CORNERS, SIDES
from tests.conftest import at

FILES = RobotDescription.installed()


@pytest.fixture(scope="module")
def body() -> SolidBody:
    return robot_body(FILES)


def test_a_thing_inside_a_link_is_found_though_no_surface_is_near(body: SolidBody) -> None:
    wrist = next(solid for solid in body.solids if solid.name == "left_wrist")
    marble = Solid.of("marble", 0, at(0, 0, 0), coal.Sphere(0.001))
    corners = np.array(wrist.shape.vertices())
    x, y, z = wrist.T_joint_shape.act((corners.min(axis=0) + corners.max(axis=0)) / 2)
    assert is_enclosed(marble, at(x, y, z), wrist, wrist.T_joint_shape)
    for beside in (at(x + 0.06, y, z), at(x, y, z + 0.08), at(x + 1.0, y, z)):
        assert not is_enclosed(marble, beside, wrist, wrist.T_joint_shape)


def marble_at(x: float, y: float, z: float) -> Solid:
    return Solid.of("marble", 0, at(x, y, z), coal.Sphere(0.001))


def is_inside(marble: Solid, link: Solid) -> bool:
    return is_enclosed(marble, marble.T_joint_shape, link, link.T_joint_shape)


@pytest.mark.parametrize("lacking", [0, 2])
def test_a_shell_encloses_what_is_in_it_even_with_a_side_open(lacking: int) -> None:
    sides = np.array(SIDES[: len(SIDES) - lacking])
    shell = Solid.of("shell", 0, at(0.3, 0.2, 0.1), surface(0.1 * CORNERS, sides))
    assert is_inside(marble_at(0.3, 0.2, 0.1), shell)
    assert not is_inside(marble_at(0.3, 0.35, 0.1), shell)


def test_beside_a_plate_nothing_is_enclosed() -> None:
    plate = Solid.of("plate", 0, at(0, 0, 0), surface(CORNERS * [0, 1, 1], np.array(SIDES[:2])))
    for beside_m in (1e-3, 0.1):
        assert not is_inside(marble_at(beside_m, 0.0, 0.0), plate)


def test_convex_shapes_enclose_nothing_since_their_depth_is_known() -> None:
    box = Solid.of("box", 0, at(0, 0, 0), coal.Box(1.0, 1.0, 1.0))
    assert not is_inside(marble_at(0.0, 0.0, 0.0), box)
