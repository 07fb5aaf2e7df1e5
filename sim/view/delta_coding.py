"""Arrays as differences: half as large once they are compressed, and the same again in the page.

What is next to each other in an array is mostly alike: corners of a surface, samples of a motion.
So each number is kept as its difference to the one of the row before, without sign (zigzag: 0, -1,
1, -2 become 0, 1, 2, 3), column by column; of all of them the lowest bytes come first, then the
second ones, and so on. `pages/scripts/unpack.js` adds them up again.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.view.meshcat_commands import array_name

SHORTEST = 32
"""Arrays of fewer numbers stay as they are."""

_WIDTHS = (1, 2, 3, 4, 6, 7)
"""How many columns an array may have: scalars, pairs, points, quaternions, segments, joints."""

_FINEST = 24
"""Numbers with point are multiples of a power of 1/2, at most this one, or stay as they are."""

_MOST = 2**30
"""Numbers kept are less than this, so that differences without sign have 32 bits."""


def delta_coded(tree: Any) -> Any:
    """A tree of values with every array in it as differences, where these are exact.

    Such an array becomes a mapping: `differences`, the bytes; `array`, what JavaScript calls its
    type; `count`, how many numbers there are; `width`, how many columns; and `step`, by which the
    sums are multiplied.

    Args:
        tree: mappings, sequences and arrays, as `sim.view.meshcat_commands.packed` takes them.
    """
    if isinstance(tree, np.ndarray):
        return _coded(tree)
    if isinstance(tree, Mapping):
        return {key: delta_coded(value) for key, value in tree.items()}
    if isinstance(tree, list | tuple):
        return [delta_coded(value) for value in tree]
    return tree


def _coded(values: NDArray[Any]) -> Any:
    exponent = _exponent(values)
    if values.size < SHORTEST or exponent is None:
        return values
    whole = np.ldexp(values.astype(np.float64), exponent).astype(np.int64)
    widths = [width for width in _WIDTHS if values.size % width == 0]
    codes = min((_differences(whole, width) for width in widths), key=_bits)
    return {
        "differences": _planes(codes),
        "array": array_name(values),
        "count": values.size,
        "width": codes.shape[0],
        "step": 2.0**-exponent,
    }


def _exponent(values: NDArray[Any]) -> int | None:
    """The least power of 2 that makes all of them whole; None where none does, or one is -0.0."""
    if (np.signbit(values) & (values == 0)).any():
        return None
    for exponent in range(_FINEST + 1):
        scaled = np.ldexp(values.astype(np.float64), exponent)
        if not np.abs(scaled).max(initial=0.0) < _MOST:
            return None
        if (scaled == np.rint(scaled)).all():
            return exponent
    return None


def _differences(whole: NDArray[np.int64], width: int) -> NDArray[np.int64]:
    """Between rows, without sign, shape (width, rows)."""
    steps = np.diff(whole.reshape(-1, width).T, axis=1, prepend=0)
    return np.where(steps < 0, -2 * steps - 1, 2 * steps)


def _bits(codes: NDArray[np.int64]) -> float:
    """About how many bits they need."""
    return float(np.log2(1.0 + codes).sum())


def _planes(codes: NDArray[np.int64]) -> NDArray[np.uint8]:
    """The bytes of numbers below 2^32, the lowest of all numbers first, as many as are needed."""
    size = max(1, -(-int(codes.max()).bit_length() // 8))
    bytes_of = codes.reshape(-1).astype("<u4").view(np.uint8).reshape(-1, 4)
    return np.ascontiguousarray(bytes_of[:, :size].T).reshape(-1)
