from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from baxter_kin import Arm
from baxter_kin.ik.self_motion.continuation import filled, walk
from baxter_kin.ik.self_motion.curve_cubics import Segment, arc_lengths, cubics, feet
from baxter_kin.ik.self_motion.solution_curve import (
    CurvePoints,
    SolutionCurve,
)
from baxter_kin.validation import FloatArray

ROUNDING = 1e-12


@pytest.fixture(scope="module")
def curve(arm: Arm) -> SolutionCurve:
    return SolutionCurve(arm, arm.T_base_tip(arm.start))


@pytest.fixture(scope="module")
def points(arm: Arm, curve: SolutionCurve) -> CurvePoints:
    """The points of the self-motion of the demo's start pose."""
    start = curve.start(arm.start)
    assert start is not None
    return walk(curve, start)[0]


@pytest.fixture(scope="module")
def segments(curve: SolutionCurve, points: CurvePoints) -> list[Segment]:
    return [Segment(curve, points[i], points[i + 1]) for i in range(len(points) - 1)]


def test_both_ends_are_the_points_and_their_tangents(segments: list[Segment]) -> None:
    for segment in segments:
        for u, point in ((0.0, segment.a), (1.0, segment.b)):
            np.testing.assert_array_equal(segment.exact(u), point.q)
            np.testing.assert_allclose(segment.estimate(u), point.q, atol=ROUNDING)
            np.testing.assert_allclose(segment.direction(u), point.tangent, atol=ROUNDING)


def test_directions_are_those_of_the_cubic(segments: list[Segment]) -> None:
    step, difference = 1e-5, 1e-8
    for segment in segments:
        for u in (0.2, 0.5, 0.9):
            slope = segment.estimate(u + step) - segment.estimate(u - step)
            slope /= np.linalg.norm(slope)
            np.testing.assert_allclose(segment.direction(u), slope, atol=difference)


def test_in_between_it_is_exactly_on_the_pose_and_the_cubic_nearly(
    arm: Arm, curve: SolutionCurve, segments: list[Segment]
) -> None:
    for segment in segments:
        for u in (0.1, 0.5, 0.7):
            exact = segment.exact(u)
            assert np.linalg.norm(curve.error(exact)) < ROUNDING
            assert np.linalg.norm(segment.estimate(u) - exact) < 1e-4  # steps of up to 0.2 rad


def test_the_cubic_is_off_by_the_fourth_power_of_the_length(
    arm: Arm, curve: SolutionCurve, points: CurvePoints
) -> None:
    off = []
    for step_rad in (0.2, 0.1):
        closer, _ = filled(curve, points, step_rad)
        all_segments = (Segment(curve, closer[i], closer[i + 1]) for i in range(len(closer) - 1))
        long = [each for each in all_segments if each.length_rad > 0.6 * step_rad]
        gaps = [np.linalg.norm(each.estimate(0.5) - each.exact(0.5)) for each in long]
        off.append(np.median(gaps))
    assert off[1] < off[0] / 4.0  # up to a sixteenth; the steps are not quite halved


def test_lengths_are_those_of_a_fine_polygon(segments: list[Segment]) -> None:
    for segment in segments:
        fine = np.array([segment.estimate(u) for u in np.linspace(0.0, 1.0, 201)])
        polygon = np.linalg.norm(np.diff(fine, axis=0), axis=1).sum()
        assert segment.length_rad == pytest.approx(polygon, rel=1e-5)


def test_coefficients_and_turning_points_are_those_of_the_cubic(
    segments: list[Segment],
) -> None:
    for segment in segments:
        for joint in range(7):
            c = segment.coefficients(joint)
            for u in (0.0, 0.3, 1.0):
                value = sum(factor * u**power for power, factor in enumerate(c))
                assert value == pytest.approx(segment.estimate(u)[joint], abs=ROUNDING)
            turns = segment.turns(joint)
            assert turns == sorted(turns)
            for u in turns[1:-1]:
                assert c[1] + u * (2.0 * c[2] + 3.0 * u * c[3]) == pytest.approx(0.0, abs=1e-9)
            for low, high in pairwise(turns):
                values = [segment.estimate(u)[joint] for u in np.linspace(low, high, 20)]
                steps = np.diff(values)
                assert (steps >= -ROUNDING).all() or (steps <= ROUNDING).all()


def shifted(points: CurvePoints) -> FloatArray:
    """The configurations of points, those in the middle with a whole turn of a joint."""
    q, third = points.q.copy(), len(points) // 3
    q[third : 2 * third, 4] += 2.0 * math.pi
    return q


def test_many_cubics_agree_with_single_ones(points: CurvePoints, segments: list[Segment]) -> None:
    which, u = np.arange(len(segments)), np.random.default_rng(1).random(len(segments))
    for q in (points.q, shifted(points)):
        found, _ = cubics(q, points.tangent, which, u)
        expected = [segment.estimate(share) for segment, share in zip(segments, u, strict=True)]
        turns = (found - np.array(expected)) / (2.0 * math.pi)
        np.testing.assert_allclose(turns, np.round(turns), atol=ROUNDING)


def test_feet_tell_how_far_away_a_configuration_is(
    curve: SolutionCurve, points: CurvePoints
) -> None:
    points, _ = filled(curve, points, 0.02)
    segments = [Segment(curve, points[i], points[i + 1]) for i in range(0, len(points) - 1, 20)]
    for q in (points.q, shifted(points)):
        for segment in segments:
            direction = segment.direction(0.4)
            across = np.linalg.svd(direction[None])[2][3]
            near = segment.estimate(0.4) + np.array([[0.0], [1e-3]]) * across
            distance, along = feet(q, points.tangent, near)
            np.testing.assert_allclose(distance, [0.0, 1e-3], atol=1e-6)
            np.testing.assert_allclose(along @ direction, 1.0, atol=1e-5)


def test_a_straight_line_is_as_long_as_its_chord() -> None:
    chord = np.array([0.0, 0.3, 0.0, 0.4, 0.0, 0.0, 0.0])
    assert arc_lengths(chord, chord / 0.5, chord / 0.5) == pytest.approx(0.5, rel=ROUNDING)
