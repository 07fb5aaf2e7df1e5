"""Contacts and travels compared with arithmetic."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from planner import Body, Box, Cylinder, Part, Scene, Sphere
from planner.errors import SceneError
from planner.scene.bodies import Shape
from planner.scene.coal_shapes import coal_shape
from planner.scene.contact import Contact, PartContact, part_contacts, touching, travel_to_contact
from tests.bodies import CORNERS, SIDES
from tests.conftest import at
from tests.planner.conftest import distance, hull, mesh_of

CONTACT_TOLERANCE_M = 1e-6
"""Distances to rounded shapes are accurate to 1e-8, magnified at grazing angles."""

X, Y, Z = np.eye(3)
ORIGIN = at(0.0, 0.0, 0.0)
CUBE = Box((0.05, 0.05, 0.05))
FloatArray = NDArray[np.float64]

seeds = st.integers(0, 2**32 - 1)
metres = st.floats(0.01, 0.1)


@pytest.mark.parametrize(
    ("gap", "names"), [(0.0, {"slab"}), (4e-4, {"slab"}), (-0.01, {"slab"}), (6e-4, set())]
)
def test_bodies_touch_within_the_pressing_tolerance(gap: float, names: set[str]) -> None:
    cube = Body("cube", (Part(CUBE, ORIGIN),), at(0.0, 0.0, 0.025 + gap))
    slab = Body("slab", (Part(Box((0.2, 0.2, 0.04)), ORIGIN),), at(0.0, 0.0, -0.02))
    scene = Scene.of([cube, slab, Body("far", (Part(Sphere(0.02), ORIGIN),), at(1.0, 1.0, 1.0))])
    assert touching(cube, scene) == names


def placed(shape: Any, x: float, y: float = 0.0, z: float = 0.0) -> Part:
    return Part(shape, at(x, y, z))


@given(metres, metres, st.floats(0.001, 1.0), st.floats(-0.95, 0.95))
def test_a_box_travels_to_a_box_by_the_gap_between_them(
    first: float, second: float, gap: float, offset: float
) -> None:
    reach = (first + second) / 2
    still = placed(Box((second, second, second)), reach + gap, offset * reach)
    travel = travel_to_contact(placed(Box((first, first, first)), 0.0), X, still, 2.0)
    assert travel == pytest.approx(gap, abs=CONTACT_TOLERANCE_M)


@given(metres, metres, st.floats(0.3, 1.0), st.floats(-0.98, 0.98))
def test_a_ball_travels_to_a_ball_as_circles_do(
    first: float, second: float, ahead: float, offset: float
) -> None:
    reach = first + second
    still = placed(Sphere(second), ahead, offset * reach)
    travel = travel_to_contact(placed(Sphere(first), 0.0), X, still, 2.0)
    expected = ahead - reach * math.sqrt(1.0 - offset**2)
    assert travel == pytest.approx(expected, abs=CONTACT_TOLERANCE_M)


@given(metres, metres, st.floats(0.3, 1.0))
def test_a_cylinder_travels_sideways_by_its_radius_and_lengthwise_by_half_its_length(
    radius: float, length: float, ahead: float
) -> None:
    cylinder = placed(Cylinder(radius, length), 0.0)
    beside, below = placed(CUBE, ahead), placed(CUBE, 0.0, 0.0, -ahead)
    sideways = travel_to_contact(cylinder, X, beside, 2.0)
    down = travel_to_contact(cylinder, -Z, below, 2.0)
    assert sideways == pytest.approx(ahead - radius - 0.025, abs=CONTACT_TOLERANCE_M)
    assert down == pytest.approx(ahead - length / 2 - 0.025, abs=CONTACT_TOLERANCE_M)


@given(metres, st.floats(0.3, 1.0), st.floats(-0.95, 0.95))
def test_a_cylinder_travels_to_a_cylinder_as_circles_do(
    radius: float, ahead: float, offset: float
) -> None:
    still = placed(Cylinder(radius, 0.1), ahead, offset * 2 * radius, 0.03)
    travel = travel_to_contact(placed(Cylinder(radius, 0.1), 0.0), X, still, 2.0)
    expected = ahead - 2 * radius * math.sqrt(1.0 - offset**2)
    assert travel == pytest.approx(expected, abs=CONTACT_TOLERANCE_M)


@given(seeds)
def test_shapes_touch_at_the_end_of_their_travel_and_not_before(seed: int) -> None:
    rng = np.random.default_rng(seed)
    moving, still = random_part(rng, 0.0), random_part(rng, 0.3)
    way = still.T_body_part.translation - moving.T_body_part.translation
    direction = way / np.linalg.norm(way)
    travel = travel_to_contact(moving, direction, still, 1.0)
    assert travel is not None  # it aims at the centre
    gaps = [gap_after(moving, direction, still, share * travel) for share in (0.0, 0.5, 0.9, 0.99)]
    assert min(gaps) >= -CONTACT_TOLERANCE_M
    assert gap_after(moving, direction, still, travel) == pytest.approx(0.0, abs=5e-6)


def random_part(rng: np.random.Generator, x: float) -> Part:
    a, b, c = rng.uniform(0.01, 0.05, 3)
    shapes: list[Shape] = [Box((a, b, c)), Cylinder(a, b), Sphere(a)]
    shape = shapes[rng.integers(3)]
    quat = rng.normal(size=4)
    R = pin.Quaternion(*(quat / np.linalg.norm(quat))).toRotationMatrix()
    return Part(shape, pin.SE3(R, np.array([x, 0.0, 0.0]) + rng.uniform(-0.02, 0.02, 3)))


def gap_after(moving: Part, direction: FloatArray, still: Part, travel_m: float) -> float:
    T = moving.T_body_part
    moved = pin.SE3(T.rotation, T.translation + travel_m * direction)
    return distance(coal_shape(moving.shape), moved, coal_shape(still.shape), still.T_body_part)


@pytest.mark.parametrize("gap", [1e-5, 1e-4, 1e-3, 0.01])
def test_a_shape_that_slides_past_another_never_touches_it(gap: float) -> None:
    beside = placed(CUBE, 0.0, 0.05 + gap)
    assert travel_to_contact(placed(CUBE, 0.0), X, beside, 3.0) is None
    ahead = placed(CUBE, 0.2, 0.05 + gap)
    assert travel_to_contact(placed(CUBE, 0.0), X, ahead, 3.0) is None
    ball = placed(Sphere(0.03), 0.2, 0.06 + gap)
    assert travel_to_contact(placed(Sphere(0.03), 0.0), X, ball, 3.0) is None
    assert travel_to_contact(placed(CUBE, 0.0), -X, placed(CUBE, 0.2), 3.0) is None


@pytest.mark.parametrize("x", [0.03, 0.0499, 0.05])
def test_shapes_in_contact_touch_at_once_or_not_again(x: float) -> None:
    assert travel_to_contact(placed(CUBE, 0.0), X, placed(CUBE, x), 1.0) == 0.0
    for direction in (-X, Y, -Y, Z):
        assert travel_to_contact(placed(CUBE, 0.0), direction, placed(CUBE, x), 1.0) is None


def test_a_contact_at_the_maximum_distance_counts() -> None:
    travel = travel_to_contact(placed(CUBE, 0.0), X, placed(CUBE, 0.2), 0.15)
    assert travel == pytest.approx(0.15, abs=CONTACT_TOLERANCE_M)
    assert travel_to_contact(placed(CUBE, 0.0), X, placed(CUBE, 0.2), 0.1) is None


SOLID = mesh_of(CORNERS / 10, SIDES)
OPEN = mesh_of(CORNERS / 10, SIDES[:-1])
"""A box of 20 cm, whole and without one triangle of its sides."""


@pytest.mark.parametrize("still", [SOLID, OPEN])
@pytest.mark.parametrize("moving", [CUBE, hull(CORNERS / 40), mesh_of(CORNERS / 40, SIDES[1:])])
def test_a_shape_travels_to_a_mesh_by_the_gap_between_them(moving: Any, still: Any) -> None:
    travel = travel_to_contact(placed(moving, 0.01, 0.02, 0.4), -Z, placed(still, 0.0), 1.0)
    assert travel == pytest.approx(0.4 - 0.1 - 0.025, abs=CONTACT_TOLERANCE_M)


def test_only_the_parts_that_touch_are_contacts() -> None:
    """A body of two parts on a body of two: one pair of parts touches, three do not."""
    tee = Body(
        "tee",
        (placed(Box((0.04, 0.04, 0.09)), 0.0), placed(Box((0.02, 0.02, 0.085)), 0.03, z=0.0025)),
        at(0.0, 0.0, 0.045),
    )
    step = Body(
        "step",
        (placed(Box((0.04, 0.2, 0.02)), 0.0), placed(Box((0.2, 0.2, 0.01)), 0.0, z=-0.0075)),
        at(0.0, 0.0, -0.01),
    )
    scene = Scene.of([tee, step])
    assert part_contacts(tee, scene) == {PartContact(0, "step", 0)}
    assert touching(tee, scene) == {"step"}


@pytest.mark.parametrize("supports", [None, 5, "table", [None], [[1, 2]]])
def test_intended_contacts_refuse_invalid_supports(supports: Any) -> None:
    with pytest.raises(SceneError):
        Contact.of_supports("block", supports)


@pytest.mark.parametrize("may_press", [None, 5, "table"])
def test_intended_contacts_of_a_hand_refuse_what_is_no_flag(may_press: Any) -> None:
    with pytest.raises(SceneError):
        Contact.of_hand("left", "block", may_press=may_press)
