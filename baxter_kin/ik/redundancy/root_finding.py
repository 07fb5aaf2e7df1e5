"""Roots and minima of functions of one variable."""

from __future__ import annotations

import math
from collections.abc import Callable

_ROOT_ITERATIONS = 100
_ROOT_VALUE = 1e-12
_ROOT_WIDTH = 1e-14

_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0


def root(function: Callable[[float], float], lower: float, upper: float) -> float | None:
    """Where `function` changes from negative or zero to positive.

    False position with the Illinois rule (Dowell and Jarratt, 1971): the value of an end that was
    kept twice counts half.

    Returns:
        None when the ends do not differ in sign this way.
    """
    low, high = function(lower), function(upper)
    if low > 0.0 or high <= 0.0:
        return None
    kept = 0.0
    for _ in range(_ROOT_ITERATIONS):
        guess = upper - high * (upper - lower) / (high - low)
        value = function(guess)
        if abs(value) <= _ROOT_VALUE or upper - lower <= _ROOT_WIDTH:
            return guess
        if value > 0.0:
            upper, high, low = guess, value, 0.5 * low if kept < 0.0 else low
            kept = -1.0
        else:
            lower, low, high = guess, value, 0.5 * high if kept > 0.0 else high
            kept = 1.0
    return lower


def least(
    function: Callable[[float], float], lower: float, upper: float, width: float
) -> tuple[float, float]:
    """The least value between two ends with one minimum between them, and where it is.

    By golden section (Kiefer, 1953), until the minimum is known to lie within `width`.
    """
    inner = [upper - _GOLDEN * (upper - lower), lower + _GOLDEN * (upper - lower)]
    values = [function(inner[0]), function(inner[1])]
    while upper - lower > width:
        if values[0] <= values[1]:
            upper = inner[1]
            inner = [upper - _GOLDEN * (upper - lower), inner[0]]
            values = [function(inner[0]), values[0]]
        else:
            lower = inner[0]
            inner = [inner[1], lower + _GOLDEN * (upper - lower)]
            values = [values[1], function(inner[1])]
    return min(zip(values, inner, strict=True))
