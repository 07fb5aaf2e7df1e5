"""Pieces: their ends, parts, lengths and nearest points."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.errors import MotionError
from planner.motion.paths.pieces import Piece

seeds = st.integers(0, 2**32 - 1)

ROUNDING = 1e-9


def random_piece(seed: int) -> Piece:
    rng = np.random.default_rng(seed)
    start = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
    scales = np.array([0.1, 0.03, 0.02])[:, None]
    return Piece(start, scales * rng.normal(size=(3, 3)), rng.uniform(-0.5, 0.5, 3))


@given(seeds)
def test_it_goes_from_one_pose_to_the_other_with_the_given_slopes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    start, goal = (pin.SE3(pin.exp3(rng.normal(size=3) / 2), rng.normal(size=3)) for _ in range(2))
    slopes = rng.normal(size=(2, 3))
    piece = Piece.between(start, goal, slopes)
    assert piece.at(0.0).isApprox(start, ROUNDING)
    assert piece.T_base_goal.isApprox(goal, ROUNDING)
    ds = 1e-6
    for s, slope in zip((0.0, 1.0), slopes, strict=True):
        change = piece.at(s + ds).translation - piece.at(s - ds).translation
        np.testing.assert_allclose(change / (2.0 * ds), slope, atol=1e-6)


@given(seeds, st.floats(0.0, 1.0))
def test_many_fractions_give_what_each_gives(seed: int, s: float) -> None:
    piece = random_piece(seed)
    p, R = piece.positions(np.array([0.3, s]))[1], piece.rotations(np.array([0.3, s]))[1]
    assert pin.SE3(R, p).isApprox(piece.at(s), ROUNDING)
    assert np.linalg.norm(piece.error(s, piece.at(s))) < ROUNDING


@given(seeds, st.integers(1, 4), st.floats(0.0, 1.0))
def test_parts_are_the_same_path(seed: int, count: int, s: float) -> None:
    piece = random_piece(seed)
    parts = piece.parts(count)
    for k, part in enumerate(parts):
        assert part.at(s).isApprox(piece.at((k + s) / count), 1e-8)
    assert sum(part.length_m for part in parts) == pytest.approx(
        piece.length_m, rel=1e-2
    )  # cubics that turn sharply


@given(seeds)
def test_no_sample_is_nearer_than_the_nearest_fraction(seed: int) -> None:
    piece, rng = random_piece(seed), np.random.default_rng(seed)
    points = piece.positions(rng.uniform(size=5)) + rng.normal(scale=1e-3, size=(5, 3))
    found = np.linalg.norm(piece.positions(piece.nearest_positions(points)) - points, axis=1)
    samples = piece.positions(np.linspace(0.0, 1.0, 2001))
    nearest = np.linalg.norm(samples[None] - points[:, None], axis=2).min(axis=1)
    assert (found <= nearest + ROUNDING).all()


@given(seeds)
def test_the_length_is_nearly_that_of_many_chords(seed: int) -> None:
    piece = random_piece(seed)
    samples = piece.positions(np.linspace(0.0, 1.0, 2001))
    chords_m = np.linalg.norm(np.diff(samples, axis=0), axis=1).sum()
    assert piece.length_m == pytest.approx(chords_m, rel=1e-2)


def test_the_nearest_fraction_of_a_rotation_in_place_is_of_its_angle() -> None:
    piece = Piece(pin.SE3.Identity(), np.zeros((3, 3)), np.array([0.0, 0.0, 1.0]))
    assert piece.nearest_fraction(piece.at(0.3)) == pytest.approx(0.3)
    assert piece.nearest_fraction(piece.at(1.3)) == 1.0


@pytest.mark.parametrize("s", [np.nan, np.inf, 1e7, "a"])
def test_fractions_are_numbers(s: float) -> None:
    with pytest.raises(MotionError):
        random_piece(0).at(s)
