"""How numbers enter: checked once, copied, read-only."""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from baxter_kin.errors import BaxterError, quoted

Vector: TypeAlias = NDArray[np.float64]
Indices: TypeAlias = NDArray[np.intp]

MOST_NUMBERS = 10**8
"""What an array made of a range may have; of other values they are in memory already."""


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
    return _frozen(array, what, error)


def finite_rows(values: ArrayLike, width: int, what: str, error: type[BaxterError]) -> Vector:
    """The same of shape (n, `width`), for any n.

    Raises:
        BaxterError: of class `error`, as `finite_array`.
    """
    array = float_array(values, what, error)
    if array.ndim != 2 or array.shape[1] != width:
        raise error(f"{what} has shape {array.shape}; it must have shape (n, {width})")
    return _frozen(array, what, error)


def finite_scalar(value: object, what: str, error: type[BaxterError]) -> float:
    """One finite number.

    Raises:
        BaxterError: of class `error`, when it is not one.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise error(f"{what} must be a number, got {quoted(value)}")
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
        BaxterError: of class `error`, when it is not one.
    """
    number = finite_scalar(value, what, error)
    if number <= 0.0:
        raise error(f"{what} must be above zero, got {number}")
    return number


def whole_scalar(
    value: object, what: str, error: type[BaxterError], *, least: int, most: int
) -> int:
    """One whole number between two others, both allowed.

    Raises:
        BaxterError: of class `error`, when it is not one.
    """
    if isinstance(value, (int, np.integer)) and not isinstance(value, bool):
        number = int(value)
        if least <= number <= most:
            return number
    raise error(f"{what} must be a whole number from {least} to {most}, got {quoted(value)}")


def float_array(values: ArrayLike, what: str, error: type[BaxterError]) -> Vector:
    """A float copy of `values`, of any shape, finite or not.

    Real numbers alone: text, truth values, complex numbers, times and masked entries are refused.

    Raises:
        BaxterError: of class `error`, when the values are not real numbers.
    """
    if isinstance(values, np.ma.MaskedArray) and np.ma.is_masked(values):
        raise error(f"{what} has masked entries; give every number, or NaN where that is allowed")
    if isinstance(values, range) and len(values) > MOST_NUMBERS:
        raise error(f"{what} has {len(values)} numbers; up to {MOST_NUMBERS} are taken")
    try:
        given = np.asarray(values)
        if given.dtype.kind not in "iuf" and not _holds_numbers(given):
            raise TypeError
        return np.array(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError, MemoryError) as cause:
        raise error(f"{what} must be real numbers, got {quoted(values)}") from cause


def _frozen(array: Vector, what: str, error: type[BaxterError]) -> Vector:
    if not np.isfinite(array).all():
        raise error(f"{what} must be finite numbers, got {quoted(array.tolist())}")
    array.setflags(write=False)
    return array


def _holds_numbers(given: NDArray[Any]) -> bool:
    """Whether an array of objects holds numbers that NumPy has no type for, as large integers."""
    kinds = (int, float, np.integer, np.floating)
    is_number = (isinstance(x, kinds) and not isinstance(x, bool) for x in given.flat)
    return given.dtype.kind == "O" and all(is_number)
