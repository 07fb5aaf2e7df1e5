"""Every interval contains the exact value: against rationals, and against Pinocchio."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from planner.certificate.intervals import (
    MAX_ANGLE,
    Interval,
    Pose,
    axis_angle,
    cos_sin,
    norm_bound,
    product,
    rotation,
    turns_about,
)

NUMBERS = st.floats(-1e3, 1e3)
WIDEST = 2e-14
"""Sines and cosines are enclosed so tightly: some units of the last place of 4."""


def contains(interval: Interval, exact: Fraction) -> bool:
    return Fraction(float(interval.low)) <= exact <= Fraction(float(interval.high))


@given(NUMBERS, NUMBERS)
def test_operations_contain_the_exact_result(x: float, y: float) -> None:
    a, b, p, q = Interval(x), Interval(y), Fraction(x), Fraction(y)
    assert contains(a + b, p + q)
    assert contains(a - b, p - q)
    assert contains(a * b, p * q)
    assert contains(-a, -p)
    assert contains(a.over(3.0), p / 3)


@given(st.tuples(NUMBERS, NUMBERS), st.tuples(NUMBERS, NUMBERS), st.floats(0, 1), st.floats(0, 1))
def test_a_product_contains_all_products(
    xs: tuple[float, float], ys: tuple[float, float], s: float, t: float
) -> None:
    a, b = Interval(min(xs), max(xs)), Interval(min(ys), max(ys))
    x, y = (np.clip(c[0] + u * (c[1] - c[0]), min(c), max(c)) for c, u in ((xs, s), (ys, t)))
    assert contains(a * b, Fraction(float(x)) * Fraction(float(y)))


def exact_cos_sin(x: Fraction) -> tuple[Fraction, Fraction]:
    """Sums of the series up to terms below 1e-40."""
    term, found = Fraction(1), [Fraction(0), Fraction(0)]
    for n in range(60):
        found[n % 2] += term * (-1) ** (n // 2)
        term = term * x / (n + 1)
    return found[0], found[1]


@given(st.floats(-MAX_ANGLE, MAX_ANGLE))
def test_sines_and_cosines_contain_the_exact_value_and_are_tight(angle: float) -> None:
    for enclosed, exact in zip(
        cos_sin(Interval(angle)), exact_cos_sin(Fraction(angle)), strict=True
    ):
        assert contains(enclosed, exact)
        assert float(enclosed.high - enclosed.low) < WIDEST


def test_larger_angles_are_refused() -> None:
    for angle in (4.1, -5.0, np.nan):
        with pytest.raises(ValueError, match="beyond 4 rad"):
            cos_sin(Interval(angle))


@given(st.lists(st.floats(-np.pi, np.pi), min_size=3, max_size=3))
def test_an_origin_of_a_urdf_is_that_of_pinocchio(rpy: list[float]) -> None:
    T = Pose.of_urdf([0.1, -0.2, 0.3], rpy)
    middle, radius = T.R.centred()
    np.testing.assert_allclose(middle, pin.rpy.rpyToMatrix(*rpy), atol=WIDEST)
    assert radius < WIDEST


def test_a_pose_times_its_inverse_contains_the_identity() -> None:
    T = Pose.of_urdf([0.1, -0.2, 0.3], [0.4, 0.5, -0.6])
    still = T * T.inverse()
    assert (still.R.low <= np.eye(3)).all()
    assert (still.R.high >= np.eye(3)).all()
    assert (still.p.low <= 0.0).all()
    assert (still.p.high >= 0.0).all()


def test_rotations_of_an_array_equal_single_ones() -> None:
    angles = np.linspace(-3.0, 3.0, 7)
    many = rotation(2, Interval(angles))
    for i, angle in enumerate(angles):
        one = rotation(2, Interval(float(angle)))
        assert (many[i].low == one.low).all()
    assert product(many, many).low.shape == (7, 3, 3)


@given(st.lists(NUMBERS, min_size=3, max_size=3))
def test_a_bound_on_a_length_is_not_less(vector: list[float]) -> None:
    bound = Fraction(float(norm_bound(np.array(vector))))
    assert bound * bound >= sum(Fraction(x) ** 2 for x in vector)


def test_axis_and_angle_give_the_rotation_back() -> None:
    rng = np.random.default_rng(7)
    for angle in (0.0, 1e-9, 1e-3, 1.0, 3.0, np.pi - 1e-9, np.pi):
        for _ in range(20):
            axis = rng.normal(size=3)
            R = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()
            found, turned = axis_angle(R)
            again, error = turns_about(found, Interval([turned])).centred()
            np.testing.assert_allclose(again[0], R, atol=1e-12)
            assert error < 1e-13
