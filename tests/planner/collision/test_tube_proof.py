"""Proofs over tubes, compared with configurations in them."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from baxter_kin.validation import FloatArray, Indices
from planner import Body, Box, Manipulator, Part, Scene
from planner.collision.context import CollisionContext
from planner.collision.tube_proof import JointTube, TubeProofs
from tests.conftest import at, overhead

PLACES = 100
ACCURACY_M = 2e-3
"""Difference of coal's distances, as its shapes contain the meshes that proofs use."""


@pytest.fixture(scope="module")
def context(manipulator: Manipulator, table: Body) -> CollisionContext:
    return manipulator.context(Scene.of([table]))


def free(context: CollisionContext) -> Indices:
    return np.flatnonzero(~context.checker.may_touch)


def swinging(manipulator: Manipulator, widths: FloatArray | float) -> JointTube:
    """A tube of 1 s from the demo's start to the side, with constant widths."""
    times, q = np.linspace(0.0, 1.0, 101), manipulator.arm.start
    way = np.array([0.5, 0.1, -0.2, 0.1, 0.0, 0.1, 0.4])
    middle = q + times[:, None] * way
    return JointTube(times, middle - np.asarray(widths) / 2, middle + np.asarray(widths) / 2)


@pytest.mark.slow
@pytest.mark.parametrize("wide_rad", [0.0, 0.08])
def test_no_configuration_in_the_tube_is_nearer_than_proven(
    context: CollisionContext, manipulator: Manipulator, wide_rad: float
) -> None:
    rng, checker = np.random.default_rng(6), context.checker
    tube = swinging(manipulator, wide_rad * np.array([1.0, 0.5, 1.0, 0.7, 0.3, 1.0, 1.0]))
    proof = TubeProofs(checker, context.q_others).prove(tube, pairs=free(context))
    assert proof.is_clear
    full, least = context.q_others, np.inf
    for _ in range(PLACES):
        cell = int(rng.integers(0, tube.cells))
        low, high = tube.hull(cell, cell + 1)
        share = np.where(rng.random(7) < 0.6, rng.integers(0, 2, 7), rng.random(7))
        full[checker.motion_bounds.q_index] = low + share * (high - low)
        least = min(least, *checker.distances_m(full, free(context).tolist(), least))
    assert least >= proof.proven_m - ACCURACY_M
    assert proof.proven_m <= proof.nearest.distance_m
    assert proof.proven_m >= 0.97 * proof.nearest.distance_m


def test_the_smallest_distance_is_measured_inside_the_tube(
    context: CollisionContext, manipulator: Manipulator
) -> None:
    tube = swinging(manipulator, 0.1)
    proof = TubeProofs(context.checker, context.q_others).prove(tube, pairs=free(context))
    rng, least = np.random.default_rng(8), np.inf
    instant = int(np.abs(tube.times_s - (proof.nearest.time_s or 0.0)).argmin())
    full = context.q_others
    for _ in range(PLACES):
        corner = rng.integers(0, 2, 7)
        q = np.where(corner, tube.lowest[instant], tube.highest[instant])
        full[context.checker.motion_bounds.q_index] = q
        least = min(least, *context.checker.distances_m(full, free(context).tolist(), least))
    assert least <= proof.nearest.distance_m + 0.02


def wall(manipulator: Manipulator, gap_m: float) -> Body:
    """A block under the hand, at some distance below its start."""
    tip = manipulator.arm.T_base_tip(manipulator.arm.start).translation
    size = (0.4, 0.4, 0.02)
    centre = at(float(tip[0]), float(tip[1]), float(tip[2]) - 0.01 - gap_m)
    return Body("wall", (Part(Box(size), at(0.0, 0.0, 0.0)),), centre)


def test_a_body_hit_by_the_edge_of_a_tube_only_is_found(manipulator: Manipulator) -> None:
    """The path itself passes at 2 cm or more; lifted shoulders bring the hand down on the wall."""
    context = manipulator.context(Scene.of([wall(manipulator, 0.04)]))
    proofs, pairs = TubeProofs(context.checker, context.q_others), free(context)
    narrow = proofs.prove(swinging(manipulator, 0.001), pairs=pairs)
    assert narrow.is_clear
    wide = proofs.prove(swinging(manipulator, 0.2), pairs=pairs)
    assert not wide.is_clear
    assert wide.nearest.distance_m <= 0.0
    assert "wall" in {wide.nearest.first, wide.nearest.second}


def test_a_wide_instant_is_split_across_joints(manipulator: Manipulator) -> None:
    """An arm at any configuration of a box over a wall."""
    context = manipulator.context(Scene.of([wall(manipulator, 0.06)]))
    checker, q = context.checker, manipulator.arm.start
    w = np.array([0.05, 0.04, 0.05, 0.04, 0.06, 0.05, 0.1])
    tube = JointTube(np.array([0.0, 1.0]), np.array([q - w] * 2), np.array([q + w] * 2))
    proofs = TubeProofs(checker, context.q_others)
    least = _least_at_corners(context, q, w)
    proof = proofs.prove(tube, pairs=free(context), margin_m=0.9 * least)
    assert 0.9 * least < proof.proven_m <= least + ACCURACY_M


def _least_at_corners(context: CollisionContext, q: FloatArray, w: FloatArray) -> float:
    full, least = context.q_others, np.inf
    for corner in product((-1.0, 1.0), repeat=7):
        full[context.checker.motion_bounds.q_index] = q + w * corner
        least = min(least, *context.checker.distances_m(full, free(context).tolist(), least))
    return float(least)


def test_a_margin_that_is_not_kept_names_the_nearer_body(manipulator: Manipulator) -> None:
    context = manipulator.context(Scene.of([wall(manipulator, 0.04)]))
    proofs = TubeProofs(context.checker, context.q_others)
    found = proofs.prove(swinging(manipulator, 0.03), pairs=free(context), margin_m=0.03)
    assert not found.is_clear
    assert 0.0 < found.nearest.distance_m <= 0.03
    assert "wall" in {found.nearest.first, found.nearest.second}


@pytest.mark.parametrize("wide_rad", [0.0, 0.03])
def test_numpy_proves_less_without_a_compiler(
    context: CollisionContext,
    manipulator: Manipulator,
    wide_rad: float,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    proofs, tube = TubeProofs(context.checker, context.q_others), swinging(manipulator, wide_rad)
    kernels = proofs.prove(tube, pairs=free(context))
    monkeypatch.setattr("planner.collision.tube_proof.rows_kernel", lambda: None)
    found = proofs.prove(tube, pairs=free(context))
    assert 0.0 < found.proven_m <= kernels.nearest.distance_m


def test_cells_are_unproven_only_where_contacts_may_happen(
    manipulator: Manipulator, scene: Scene
) -> None:
    """The hand sinks onto the block: cells are unproven near it, and proven before."""
    context = manipulator.context(scene, touchable="block")
    times, q = np.linspace(0.0, 1.0, 101), manipulator.arm.start
    block = scene["block"].centre_base
    goal = manipulator.ik.solve(overhead(*block.tolist()), current=q).q
    middle = q + times[:, None] * (goal - q)
    tube = JointTube(times, middle - 0.005, middle + 0.005)
    touching = np.flatnonzero(context.checker.may_touch)
    proofs = TubeProofs(context.checker, context.q_others)
    cells = proofs.unproven_cells(tube, touching)
    assert cells.shape == (tube.cells,)
    assert cells[-1]
    assert not cells[:40].any()
    assert not proofs.unproven_cells(tube, np.zeros(0, dtype=np.intp)).any()
    full = context.q_others
    for cell in np.flatnonzero(~cells).tolist()[::5]:
        full[context.checker.motion_bounds.q_index] = tube.highest[cell]
        assert min(context.checker.distances_m(full, touching.tolist(), 0.05)) > 0.0


@pytest.fixture
def tube() -> JointTube:
    """Two joints, 0.1 rad wide: one rises, the other rests."""
    times = np.linspace(0.0, 1.0, 11)
    middle = np.column_stack([times, np.zeros(11)])
    return JointTube(times, middle - 0.05, middle + 0.05)


def test_a_hull_contains_both_ends_of_its_cells(tube: JointTube) -> None:
    low, high = tube.hull(2, 4)
    np.testing.assert_allclose(low, [0.15, -0.05])
    np.testing.assert_allclose(high, [0.45, 0.05])


def test_a_part_contains_all_cells_that_overlap_its_time(tube: JointTube) -> None:
    part = tube.between(0.25, 0.51)
    np.testing.assert_allclose(part.times_s[[0, -1]], [0.2, 0.6])
    assert part.cells == 4
    assert tube.between(0.95, np.inf).times_s[-1] == 1.0
    assert tube.between(5.0, 6.0).cells == 1
    assert tube.between(0.3, 0.3).cells == 1


def test_a_tube_can_be_widened(tube: JointTube) -> None:
    wide = tube.widened(np.array([0.01, 0.02]))
    np.testing.assert_allclose(wide.widths[0], [0.12, 0.14])
