"""Polylines, arcs and curves: how near their pieces are, and what is refused."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any, cast

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin.errors import PoseError
from planner import Arc, Curve, Polyline
from planner.errors import MotionError
from planner.motion.paths.path import corners_of, graded, pieces_of
from planner.motion.paths.pieces import Piece

CENTRE, RADIUS_M, Z = np.array([0.7, 0.1, 0.0]), 0.06, np.array([0.0, 0.0, 1.0])


def at(*position: float, turn: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> pin.SE3:
    return pin.SE3(pin.exp3(np.array(turn)), np.array(position))


START = at(0.76, 0.1, 0.0)
CIRCLE = Arc(START, CENTRE, Z, 2.0 * math.pi)
TRIANGLE = Polyline([at(0.0, 0, 0), at(0.1, 0, 0), at(0.1, 0.1, 0), at(0.0, 0, 0)])


def samples(pieces: tuple[Piece, ...]) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.concatenate([piece.positions(np.linspace(0.0, 1.0, 50)) for piece in pieces])


@pytest.mark.parametrize("angle_rad", [0.3, -2.0, 2.0 * math.pi, 6.0 * math.pi])
@pytest.mark.parametrize("turns_hand", [False, True])
def test_pieces_of_an_arc_are_on_it(angle_rad: float, turns_hand: bool) -> None:
    pieces = pieces_of(Arc(START, CENTRE, 3.0 * Z, angle_rad, turns_hand))
    spokes = samples(pieces) - CENTRE
    assert np.abs(np.linalg.norm(spokes, axis=1) - RADIUS_M).max() < 4.3e-6 * RADIUS_M
    assert np.abs(spokes[:, 2]).max() < 1e-12
    total = sum(piece.length_m for piece in pieces)
    assert total == pytest.approx(RADIUS_M * abs(angle_rad), rel=1e-5)
    goal = pieces[-1].T_base_goal
    turn = pin.exp3(angle_rad * Z)
    np.testing.assert_allclose(
        goal.translation, CENTRE + turn @ (START.translation - CENTRE), atol=1e-9
    )
    np.testing.assert_allclose(goal.rotation, turn if turns_hand else np.eye(3), atol=1e-12)


def test_pieces_of_a_polyline_lead_through_its_poses_and_are_short() -> None:
    poses = [at(0.0, 0, 0), at(0.5, 0, 0, turn=(1.2, 0, 0)), at(0.5, 0.05, 0)]
    pieces = pieces_of(Polyline(poses))
    assert all(piece.length_m <= 0.15 + 1e-9 and piece.angle_rad <= 0.5 for piece in pieces)
    assert all(one.T_base_goal.isApprox(other.T_base_start) for one, other in pairwise(pieces))
    ends = [piece.T_base_goal for piece in pieces]
    assert all(any(end.isApprox(pose, 1e-9) for end in ends) for pose in poses[1:])


def test_pieces_of_a_curve_are_near_it() -> None:
    def helix(length: float) -> pin.SE3:
        angle = length / 0.1
        turn = pin.exp3(np.array([0.2 * math.sin(angle), 0.0, 0.3 * angle]))
        return pin.SE3(
            turn, np.array([0.08 * math.cos(angle), 0.08 * math.sin(angle), 0.6 * length])
        )

    pieces, ends = pieces_of(Curve(helix, 0.6)), [0.0]
    for piece in pieces:  # the path is longer than the parameter, everywhere by the same factor
        ends.append(ends[-1] + piece.length_m)
    scale = 0.6 / ends[-1]
    for piece, begin, end in zip(pieces, ends[:-1], ends[1:], strict=True):
        for s in (0.1, 0.3, 0.62, 0.9):
            wanted = helix(scale * (begin + s * (end - begin)))
            nearest = piece.at(piece.nearest_fraction(wanted))
            assert np.linalg.norm(nearest.translation - wanted.translation) < 5e-6
            assert np.linalg.norm(pin.log3(nearest.rotation.T @ wanted.rotation)) < 1e-4
    assert pieces[-1].T_base_goal.isApprox(helix(0.6), 1e-9)


@pytest.mark.parametrize(
    "wave_m",
    [*(pytest.param(each, marks=pytest.mark.slow) for each in (0.0125, 0.0375)), 0.025, 0.05],
)
@pytest.mark.parametrize("length_m", [0.1, 0.15, 0.3])
def test_no_wave_of_a_curve_is_lost(wave_m: float, length_m: float) -> None:
    def weave(s: float) -> pin.SE3:
        return at(s, 0.01 * (1.0 - math.cos(2.0 * math.pi * s / wave_m)), 0.0)

    positions = samples(pieces_of(Curve(weave, length_m)))
    assert positions[:, 1].max() == pytest.approx(0.02, abs=1e-5)


def test_an_arc_may_have_a_short_normal_and_a_centre_beside_its_plane() -> None:
    usual = pieces_of(Arc(START, CENTRE, Z, 1.0))
    other = pieces_of(Arc(START, CENTRE + 0.7 * Z, 1e-9 * Z, 1.0))
    assert usual[-1].T_base_goal.isApprox(other[-1].T_base_goal, 1e-12)
    assert len(usual) == len(other)


def test_corners_are_where_the_direction_changes() -> None:
    assert corners_of(pieces_of(TRIANGLE)) == [True, True, True, True]
    assert corners_of(pieces_of([CIRCLE, CIRCLE])) == [True, *[False] * 15, True]


def test_graded_pieces_are_the_same_path_with_short_pieces_at_corners() -> None:
    pieces = pieces_of(TRIANGLE)
    fine = graded(pieces, 0.01)
    lengths = [round(piece.length_m, 6) for piece in fine]
    assert lengths == [0.01, 0.08, 0.01, 0.01, 0.08, 0.01, 0.01, 0.121421, 0.01]
    assert all(one.T_base_goal.isApprox(other.T_base_start) for one, other in pairwise(fine))
    assert graded(pieces, 0.06) == pieces


@pytest.mark.parametrize(
    ("make", "error"),
    [
        (lambda: Polyline([START]), MotionError),
        (lambda: Polyline([START, "a"]), PoseError),
        (lambda: pieces_of(Polyline([START, START])), MotionError),
        (
            lambda: pieces_of(Polyline([at(0, 0, 0), at(1, 0, 0, turn=(math.pi, 0, 0))])),
            MotionError,
        ),
        (lambda: Arc(START, CENTRE, np.zeros(3), 1.0), MotionError),
        (lambda: Arc(START, CENTRE, Z, 0.0), MotionError),
        (lambda: Arc(START, START.translation + Z, Z, 1.0), MotionError),
        (lambda: Arc(START, 1e6 * CENTRE, Z, 1.0), MotionError),
        (lambda: Arc(START, CENTRE, Z, 1e7), MotionError),
        (lambda: Curve(lambda _: START, 1e9), MotionError),
        (lambda: Polyline(cast("list[pin.SE3]", 5)), MotionError),
        (lambda: Curve(lambda _: START, 0.0), MotionError),
        (lambda: pieces_of(Curve(lambda s: at(abs(s - 0.031), 0, 0), 0.1)), MotionError),
        (lambda: pieces_of([CIRCLE, TRIANGLE]), MotionError),
        (lambda: pieces_of([CIRCLE, Polyline([at(9, 0, 0)] * 2)]), MotionError),
        (lambda: pieces_of([]), MotionError),
        (lambda: pieces_of([START]), MotionError),
        (lambda: pieces_of(START), MotionError),
        (lambda: pieces_of(cast("Polyline", 7)), MotionError),
    ],
)
def test_what_is_no_path_is_refused(make: Any, error: type[Exception]) -> None:
    with pytest.raises(error):
        make()
