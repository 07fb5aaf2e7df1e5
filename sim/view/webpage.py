"""The pages that show the robot, put together from `sim/view/pages` and Meshcat's viewer.

The content of a page is stored in few bytes: arrays as differences, msgpack, zlib and base64.
Neighbours in an array are mostly similar: corners of a surface, samples of a motion. So each number
is stored as its difference from the one in the previous row, zigzag-coded (0, -1, 1, -2 become
0, 1, 2, 3) and column by column; the lowest bytes of all numbers come first, then the second ones,
and so on. This halves the compressed size, and `pages/scripts/unpack.js` restores equal numbers.

Compressed here, a page is no larger than a gzipped one of plain msgpack, whose bytes base64
misaligns. Decoding needs a browser of 2023 or later (`DecompressionStream`).
"""

from __future__ import annotations

import base64
import html
import re
import zlib
from collections.abc import Mapping
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from baxter_kin.distribution.extras import run_to_install
from sim.errors import ViewerError
from sim.view.meshcat_commands import array_name, packed

_BUNDLE = Path("viewer", "dist", "main.min.js")
_SLOT = re.compile(r"\{\{([\w./]+)\}\}")

MIN_CODED = 32
"""Minimum length of arrays that are stored as differences."""

_WIDTHS = (1, 2, 3, 4, 6, 7)
"""Numbers of columns that are tried: scalars, pairs, points, quaternions, segments, joints."""

_MAX_EXPONENT = 24
"""Floats are coded if they are multiples of a power of 1/2, at most this one."""

_MAX_NUMBER = 2**30
"""Coded numbers are below this, so that zigzag-coded differences have 32 bits."""


def viewer_bundle() -> str:
    """Meshcat's viewer: one JavaScript file that draws commands. Meshcat itself is not imported."""
    spec = find_spec("meshcat")
    folders = spec.submodule_search_locations if spec is not None else None
    for folder in folders or ():
        path = Path(folder) / _BUNDLE
        if path.is_file():
            return path.read_text(encoding="utf-8")
    raise ViewerError(f"meshcat's viewer is not installed; {run_to_install('meshcat')}")


def live_page(title: str) -> str:
    """The page of a live view, which loads Meshcat's viewer from its server."""
    return _filled("live.html", {"title": html.escape(title)})


def page(template: str, *, title: object, notice: str, data: str) -> str:
    """A self-contained page.

    Args:
        template: a file of `sim/view/pages`. A slot with a dot, such as `{{help.html}}`, takes that
            file, whose slots are filled, too; the others are `title`, `notice`, `bundle`, `data`.
        title: shown on the page, and its name in the browser.
        notice: the licence of the robot's meshes.
        data: what the page decodes.
    """
    texts = {"title": html.escape(str(title)), "notice": html.escape(notice), "data": data}
    return _filled(template, {**texts, "bundle": inside_script(viewer_bundle())})


def inside_script(code: str) -> str:
    """The same code, with nothing in its texts that would end a `<script>` element."""
    return re.sub(r"</(script)", r"<\\/\1", code, flags=re.IGNORECASE)


def _filled(name: str, texts: dict[str, str]) -> str:
    def insert(slot: re.Match[str]) -> str:
        return _filled(slot[1], texts) if "." in slot[1] else texts[slot[1]]

    return _SLOT.sub(insert, (files("sim.view") / "pages" / name).read_text(encoding="utf-8"))


def encoded(content: Mapping[str, Any]) -> str:
    """A page's content as ASCII."""
    compressed = zlib.compress(packed(delta_coded(content)), level=9)
    return base64.b64encode(compressed).decode("ascii")


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
