from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from baxter_kin.ik.redundancy.curve_points import CurvePoint, CurvePoints, whole_turns_off
from baxter_kin.validation import FloatArray

finite = st.floats(-100.0, 100.0)
rows = hnp.arrays(np.float64, st.tuples(st.integers(0, 6), st.just(17)), elements=finite)


@given(rows)
def test_points_are_what_they_are_made_of(rows: FloatArray) -> None:
    points = CurvePoints(rows)
    assert len(points) == len(rows)
    np.testing.assert_array_equal(
        CurvePoints.of(map(points.__getitem__, range(len(rows)))).rows, rows
    )


def test_each_measure_is_in_its_place() -> None:
    point = CurvePoint(np.arange(7.0), 10.0 + np.arange(7.0), 20.0, 21.0, 22.0)
    points = CurvePoints.of([point])
    np.testing.assert_array_equal(points.q, [point.q])
    np.testing.assert_array_equal(points.tangent, [point.tangent])
    found = points.determinant[0], points.residual[0], points.clearance_rad[0]
    assert found == point.measures == (20.0, 21.0, 22.0)


@given(rows)
def test_twice_the_other_way_is_the_same_way(rows: FloatArray) -> None:
    points = CurvePoints(rows)
    np.testing.assert_array_equal(points.reversed().reversed().rows, rows)
    for i in range(len(points)):
        one, other = points[i].reversed(), points.reversed()[len(points) - 1 - i]
        np.testing.assert_array_equal(CurvePoints.of([one]).rows, CurvePoints.of([other]).rows)


def test_the_other_way_turns_the_tangent_and_its_determinant_alone() -> None:
    point = CurvePoint(np.arange(7.0), np.eye(7)[2], 0.5, 1e-13, -0.1)
    other = point.reversed()
    np.testing.assert_array_equal(other.q, point.q)
    np.testing.assert_array_equal(other.tangent, -point.tangent)
    assert other.measures == (-0.5, 1e-13, -0.1)


@given(rows, rows)
def test_what_was_joined_is_cut_again(one: FloatArray, other: FloatArray) -> None:
    joined = CurvePoints(one).then(CurvePoints(other))
    np.testing.assert_array_equal(joined.part(slice(len(one))).rows, one)
    np.testing.assert_array_equal(joined.part(slice(len(one), None)).rows, other)


@given(hnp.arrays(np.float64, 7, elements=finite))
def test_whole_turns_off_are_whole_and_leave_half_a_turn_at_most(angles: FloatArray) -> None:
    rest = whole_turns_off(angles)
    turns = (angles - rest) / (2.0 * math.pi)
    rounding = 1e-12
    assert np.abs(rest).max() <= math.pi + rounding
    assert np.abs(turns - np.round(turns)).max() < rounding


def test_whole_turns_between_neighbours_do_not_lengthen_a_chord() -> None:
    q = np.zeros((3, 17))
    q[1, 2], q[2, 2] = 0.3, 0.5 + 2.0 * math.pi
    assert CurvePoints(q).chords_rad == pytest.approx([0.3, 0.2])
