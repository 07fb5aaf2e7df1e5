"""Splines with fixed ends, against polynomials."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from planner.clamped_spline import ClampedSpline

ROUNDING = 1e-8

seeds = st.integers(0, 2**32 - 1)
some = settings(max_examples=25)


def random_knots(seed: int) -> NDArray[np.float64]:
    rng = np.random.default_rng(seed)
    steps = rng.uniform(0.2, 1.0, rng.integers(4, 30))
    knots: NDArray[np.float64] = np.concatenate([[0.0], np.cumsum(steps)])
    knots /= knots[-1]
    return knots


def ends(p: Polynomial) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    first, last = (np.array([p.deriv(k)(x) if k else p(x) for k in range(3)]) for x in (0.0, 1.0))
    return first, last


@some
@given(seeds)
def test_a_cubic_is_reproduced_with_its_derivatives(seed: int) -> None:
    knots, p = random_knots(seed), Polynomial(np.random.default_rng(seed).normal(size=4))
    spline = ClampedSpline.over(knots)
    c = spline.through(p(knots), *ends(p))
    for k, matrix in enumerate(spline.at_knots):
        wanted = p.deriv(k)(knots) if k else p(knots)
        np.testing.assert_allclose(matrix @ c, wanted, atol=ROUNDING)
    np.testing.assert_allclose(spline.third @ c, np.full(len(knots) - 1, p.deriv(3)(0)), atol=1e-6)


@some
@given(seeds)
def test_the_ends_are_met_whatever_is_between(seed: int) -> None:
    rng, knots = np.random.default_rng(seed), random_knots(seed)
    first, last = rng.normal(size=(2, 3))
    spline = ClampedSpline.over(knots)
    c = spline.through(rng.normal(size=len(knots)), first, last)
    for k, matrix in enumerate(spline.at_knots):
        np.testing.assert_allclose(matrix[0] @ c, first[k], atol=ROUNDING)
        np.testing.assert_allclose(matrix[-1] @ c, last[k], atol=ROUNDING)


@some
@given(seeds)
def test_the_inner_slopes_and_their_neighbours_bound_the_derivative(seed: int) -> None:
    rng, knots = np.random.default_rng(seed), random_knots(seed)
    spline = ClampedSpline.over(knots)
    c = rng.normal(size=len(knots) + 2)
    slopes, at_knots = spline.slopes @ c, spline.at_knots[1] @ c
    for k in range(1, spline.segments - 1):
        near = slopes[k - 1 : k + 2]
        for value in at_knots[k : k + 2]:
            assert near.min() - ROUNDING <= value <= near.max() + ROUNDING


@some
@given(seeds)
def test_third_derivatives_carry_the_second_from_knot_to_knot(seed: int) -> None:
    rng, knots = np.random.default_rng(seed), random_knots(seed)
    spline = ClampedSpline.over(knots)
    c = rng.normal(size=len(knots) + 2)
    change = np.diff(spline.at_knots[2] @ c)
    np.testing.assert_allclose(change, np.diff(knots) * (spline.third @ c), rtol=1e-9, atol=1e-6)


def test_several_splines_are_found_at_once() -> None:
    knots = np.linspace(0.0, 1.0, 9)
    spline = ClampedSpline.over(knots)
    values = np.stack([np.sin(knots), np.cos(knots)], axis=1)
    zeros = np.zeros((3, 2))
    together = spline.through(values, zeros, zeros)
    for i in range(2):
        alone = spline.through(values[:, i], zeros[:, i], zeros[:, i])
        np.testing.assert_allclose(together[:, i], alone, atol=1e-12)
