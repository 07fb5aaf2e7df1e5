"""How numbers enter: checked once, copied, read-only."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from baxter_kin.errors import BaxterError

Vector: TypeAlias = NDArray[np.float64]
Indices: TypeAlias = NDArray[np.intp]


def finite_array(
    values: ArrayLike, shape: tuple[int, ...], what: str, error: type[BaxterError]
) -> Vector:
    """A read-only float copy of `values`, which must be finite and of one shape.

    Args:
        values: anything NumPy makes an array of.
        shape: the required shape.
        what: the subject of the error message, such as "position_m".
        error: the class to raise.

    Raises:
        BaxterError: of class `error`, when the values are not numbers, of another shape, or not
            finite.
    """
    array = float_array(values, what, error)
    if array.shape != shape:
        raise error(f"{what} has shape {array.shape}; it must have shape {shape}")
    if not np.isfinite(array).all():
        raise error(f"{what} must be finite numbers, got {array.tolist()}")
    array.setflags(write=False)
    return array


def finite_scalar(value: object, what: str, error: type[BaxterError]) -> float:
    """One finite number.

    Raises:
        BaxterError: of class `error`, when it is none.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise error(f"{what} must be a number, got {value!r}")
    try:
        number = float(value)
    except OverflowError:
        raise error(f"{what} is too large a number") from None
    if not math.isfinite(number):
        raise error(f"{what} must be a finite number, got {number}")
    return number


def positive_scalar(value: object, what: str, error: type[BaxterError]) -> float:
    """One finite number above zero.

    Raises:
        BaxterError: of class `error`, when it is none.
    """
    number = finite_scalar(value, what, error)
    if number <= 0.0:
        raise error(f"{what} must be above zero, got {number}")
    return number


def float_array(values: ArrayLike, what: str, error: type[BaxterError]) -> Vector:
    """A float copy of `values`, of any shape, finite or not; text and complex numbers are refused.

    Raises:
        BaxterError: of class `error`, when the values are not real numbers.
    """
    try:
        if np.asarray(values).dtype.kind in "cSU":
            raise TypeError
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as cause:
        raise error(f"{what} must be real numbers, got {values!r}") from cause
