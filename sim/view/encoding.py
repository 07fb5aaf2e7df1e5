"""Encodes the content of pages in few bytes: arrays as differences, msgpack, zlib and base64.

Neighbours in an array are mostly similar: corners of a surface, samples of a motion. So each number
is stored as its difference from the one in the previous row, zigzag-coded (0, -1, 1, -2 become
0, 1, 2, 3) and column by column; the lowest bytes of all numbers come first, then the second ones,
and so on. This halves the compressed size, and `pages/scripts/unpack.js` restores equal numbers.

Compressed here, a page is no larger than a gzipped one of plain msgpack, whose bytes base64
misaligns. Decoding needs a browser of 2023 or later (`DecompressionStream`).
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Iterable, Mapping
from typing import Any, TypeAlias

import numpy as np
import umsgpack
from numpy.typing import NDArray

Command: TypeAlias = dict[str, Any]
"""One command of Meshcat: its `type`, the `path` of a node, and what the type needs."""

_EXTENSIONS = {
    "int8": 0x11,
    "uint8": 0x12,
    "int16": 0x13,
    "uint16": 0x14,
    "int32": 0x15,
    "uint32": 0x16,
    "float32": 0x17,
}
"""Codes of msgpack-lite, Meshcat's decoder, for arrays of a NumPy type."""

MIN_CODED = 32
"""Minimum length of arrays that are stored as differences."""

_WIDTHS = (1, 2, 3, 4, 6, 7)
"""Numbers of columns that are tried: scalars, pairs, points, quaternions, segments, joints."""

_MAX_EXPONENT = 24
"""Floats are coded if they are multiples of a power of 1/2, at most this one."""

_MAX_NUMBER = 2**30
"""Coded numbers are below this, so that zigzag-coded differences have 32 bits."""


def encoded(content: Mapping[str, Any]) -> str:
    """A page's content as ASCII."""
    compressed = zlib.compress(packed(delta_coded(content)), level=9)
    return base64.b64encode(compressed).decode("ascii")


def packed(command: object) -> bytes:
    """A command, or any tree of values with NumPy arrays in it, as Meshcat decodes it."""
    return bytes(umsgpack.packb(command, ext_handlers={np.ndarray: _extension}))


def shared_geometries(
    commands: Iterable[Command],
) -> tuple[dict[str, Command], list[Command]]:
    """The geometries by name, each once, and the commands with only the names of theirs."""
    shared: dict[str, Command] = {}
    named: list[Command] = []
    for command in commands:
        if command["type"] == "set_object":
            drawn = command["object"]
            shared.update((geometry["uuid"], geometry) for geometry in drawn["geometries"])
            names = [{"uuid": geometry["uuid"]} for geometry in drawn["geometries"]]
            command = command | {"object": drawn | {"geometries": names}}  # noqa: PLW2901
        named.append(command)
    return shared, named


def array_name(values: NDArray[Any]) -> str:
    """JavaScript's name of the array type, such as "Int16Array" for int16."""
    return f"{values.dtype.name.capitalize()}Array"


def delta_coded(tree: Any) -> Any:
    """A tree of values whose arrays are stored as differences, where these are exact.

    Such an array becomes a mapping: `differences`, the bytes; `array`, JavaScript's name of the
    type; `count`, the number of values; `width`, the number of columns; and `step`, by which the
    sums are multiplied.

    Args:
        tree: mappings, sequences and arrays.
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
    if values.size < MIN_CODED or exponent is None:
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
    """The smallest power of 2 that makes all values integers; None without one, or for -0.0."""
    if (np.signbit(values) & (values == 0)).any():
        return None
    for exponent in range(_MAX_EXPONENT + 1):
        scaled = np.ldexp(values.astype(np.float64), exponent)
        if not np.abs(scaled).max(initial=0.0) < _MAX_NUMBER:
            return None
        if (scaled == np.rint(scaled)).all():
            return exponent
    return None


def _differences(whole: NDArray[np.int64], width: int) -> NDArray[np.int64]:
    """Zigzag-coded differences between rows, shape (width, rows)."""
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


def _extension(values: NDArray[Any]) -> Any:
    if values.dtype.name not in _EXTENSIONS:
        raise TypeError(f"pages have no arrays of {values.dtype}; use {', '.join(_EXTENSIONS)}")
    little_endian = values.astype(values.dtype.newbyteorder("<"), copy=False)
    return umsgpack.Ext(_EXTENSIONS[values.dtype.name], little_endian.tobytes())
