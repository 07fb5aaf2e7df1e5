"""What planes between hulls leave in a box of joint angles, against hulls placed in it."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import coal
import numpy as np
import pinocchio as pin
import pytest

from baxter_kin.validation import FloatArray
from planner import Body, Box, Cylinder, Manipulator, Part, Scene, Sphere
from planner.collision.checker import ClearanceChecker
from planner.collision.continuous.hull_gaps import ROUNDING_M, ArmPose, Corners, HullGaps
from planner.scene.contact import hull
from tests.conftest import at

PLACES = 40
NEAR_M = 0.25


@pytest.fixture(scope="module")
def checker(manipulator: Manipulator, table: Body) -> ClearanceChecker:
    """A table, and round things that a hull needs more corners for than it has."""
    ball = Body("ball", (Part(Sphere(0.04), at(0.0, 0.0, 0.0)),), at(0.7, 0.1, 0.0))
    post = Body("post", (Part(Cylinder(0.03, 0.3), at(0.0, 0.0, 0.0)),), at(0.6, 0.4, 0.1))
    context = manipulator.context(Scene.of([table, ball, post]))
    return context.checker


def hulls_apart(checker: ClearanceChecker, pair: tuple[int, int], poses: FloatArray) -> float:
    shapes = [checker.geometry.geometryObjects[i].geometry for i in pair]
    hulls = [hull(shape) for shape in shapes]
    at_ = [coal.Transform3s(poses[i][:3, :3], poses[i][:3, 3]) for i in pair]
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    return float(coal.distance(hulls[0], at_[0], hulls[1], at_[1], request, result))


def boxes(
    checker: ClearanceChecker, manipulator: Manipulator, wide_rad: float
) -> Iterator[tuple[FloatArray, FloatArray]]:
    rng = np.random.default_rng(9)
    for _ in range(3):
        yield manipulator.arm.start + rng.uniform(-0.3, 0.3, 7), rng.uniform(0.0, wide_rad, 7)


@pytest.mark.parametrize("wide_rad", [0.01, 0.06, 0.2])
def test_no_place_in_a_box_is_nearer(
    checker: ClearanceChecker, manipulator: Manipulator, wide_rad: float
) -> None:
    rng, gaps, bounds = np.random.default_rng(1), HullGaps(checker), checker.motion_bounds
    full = manipulator.q_others
    looked = 0
    for middle, w in boxes(checker, manipulator, wide_rad):
        placed = bounds.place(full, middle[None])
        arm = ArmPose(bounds.axes(placed)[0], placed.joints[0, :, :3, 3])
        corners = rng.choice([-1.0, 1.0], (PLACES, 7)) * rng.uniform(0.7, 1.0, (PLACES, 1))
        elsewhere = bounds.place(full, middle + w * corners).shapes
        for pair, both in enumerate(checker.pairs.tolist()):
            found = gaps.of(pair, placed.shapes[0], arm, w)
            if not 0.0 < found.least_m + checker.checked.padding_m[pair] < NEAR_M:
                continue
            looked += 1
            least = min(hulls_apart(checker, tuple(both), poses) for poses in elsewhere[::8])
            assert least - checker.checked.padding_m[pair] >= found.least_m, both
    assert looked > 20


def test_slopes_lead_to_where_it_is_nearest(
    checker: ClearanceChecker, manipulator: Manipulator
) -> None:
    """Along them the hulls come nearer by what was subtracted, to first order."""
    gaps, bounds = HullGaps(checker), checker.motion_bounds
    w = np.full(7, 1e-3)
    for middle, _ in boxes(checker, manipulator, 0.01):
        placed = bounds.place(manipulator.q_others, middle[None])
        arm = ArmPose(bounds.axes(placed)[0], placed.joints[0, :, :3, 3])
        for pair, both in enumerate(checker.pairs.tolist()):
            found = gaps.of(pair, placed.shapes[0], arm, w)
            if not 0.01 < found.least_m < 0.1 or max(both) < len(checker.shapes.links):
                continue
            nearer = bounds.place(manipulator.q_others, (middle - w * np.sign(found.slopes))[None])
            there = hulls_apart(checker, tuple(both), nearer.shapes[0])
            assert there - checker.checked.padding_m[pair] == pytest.approx(found.least_m, abs=2e-3)


@pytest.mark.parametrize("joints", [(0,), (1,), (0, 1), (0, 3), (1, 3), (0, 1, 3, 5)])
def test_turns_curve_towards_what_is_nearer_to_their_axes(
    manipulator: Manipulator, joints: tuple[int, ...]
) -> None:
    """A plate across the way to the shoulder: to first order a turn leads along it."""
    q = manipulator.arm.neutral
    checker = manipulator.context(Scene.of([plate_behind_the_hand(manipulator)])).checker
    links, bounds = checker.shapes.links, checker.motion_bounds
    hand, gaps = links.index("left_hand_link"), HullGaps(checker)
    with_plate = (checker.pairs >= len(links)).any(axis=1)
    pair = int(np.flatnonzero(with_plate & (checker.pairs == hand).any(axis=1))[0])
    w = np.zeros(7)
    w[list(joints)] = 0.15
    placed = bounds.place(manipulator.q_others, q[None])
    arm = ArmPose(bounds.axes(placed)[0], placed.joints[0, :, :3, 3])
    found = gaps.of(pair, placed.shapes[0], arm, w).least_m
    signs = np.array(list(product((-1.0, 0.0, 1.0), repeat=len(joints))))
    turns = np.zeros((len(signs), 7))
    turns[:, list(joints)] = 0.15 * signs
    there = bounds.place(manipulator.q_others, q + turns).shapes
    both = checker.pairs[pair].tolist()
    least = min(hulls_apart(checker, (both[0], both[1]), poses) for poses in there)
    assert found <= least
    assert found >= least - 0.08


def plate_behind_the_hand(manipulator: Manipulator) -> Body:
    """Some 0.1 m from it towards the shoulder, across the line between both."""
    arm = manipulator.arm
    tip = arm.T_base_tip(arm.neutral).translation
    shoulder = arm.chain.poses(arm.neutral[None])[0, 0, :3, 3]
    out = tip - shoulder
    out /= np.linalg.norm(out)
    across = np.cross(out, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    R = np.column_stack([out, across, np.cross(out, across)])
    part = Part(Box((0.01, 2.0, 2.0)), pin.SE3.Identity())
    return Body("plate", (part,), pin.SE3(R, tip - 0.35 * out))


@pytest.mark.parametrize(
    "shape", [coal.Sphere(0.1), coal.Cylinder(0.1, 0.4), coal.Box(0.1, 0.2, 0.3)]
)
def test_corners_contain_the_shape(shape: coal.ShapeBase) -> None:
    """In every direction they reach as far as the shape, and not much farther."""
    rng, corners = np.random.default_rng(0), Corners.of(shape)
    for normal in rng.normal(size=(200, 3)):
        n = normal / np.linalg.norm(normal)
        reach = float((corners.points @ n).max()) + corners.radius_m
        exact = _reach(shape, n)
        assert exact <= reach + ROUNDING_M
        assert reach <= 1.03 * exact + ROUNDING_M


def _reach(shape: coal.ShapeBase, n: FloatArray) -> float:
    """How far a shape goes in a direction, by hand."""
    if isinstance(shape, coal.Sphere):
        return float(shape.radius)
    if isinstance(shape, coal.Cylinder):
        return float(shape.radius * np.hypot(*n[:2]) + shape.halfLength * abs(n[2]))
    return float(np.abs(n) @ np.array(shape.halfSide))
