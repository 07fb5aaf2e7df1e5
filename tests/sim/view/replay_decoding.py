"""What a replay's page decodes, decoded by other code."""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np
import umsgpack
from numpy.typing import NDArray

_TYPES = {0x11: "i1", 0x12: "u1", 0x13: "<i2", 0x14: "<u2", 0x15: "<i4", 0x16: "<u4", 0x17: "<f4"}
_DTYPES = {
    "Int8Array": "int8",
    "Uint8Array": "uint8",
    "Int16Array": "int16",
    "Uint16Array": "uint16",
    "Int32Array": "int32",
    "Uint32Array": "uint32",
    "Float32Array": "float32",
}


def decoded(text: str) -> dict[str, Any]:
    """The content as a page reads it."""
    handlers = {
        code: (lambda ext, kind=kind: np.frombuffer(ext.data, kind))
        for code, kind in _TYPES.items()
    }
    packed = zlib.decompress(base64.b64decode(text))
    return dict(added_up(umsgpack.unpackb(packed, ext_handlers=handlers)))


def added_up(tree: Any) -> Any:
    """The same with whole arrays in place of differences."""
    if isinstance(tree, dict):
        if "differences" in tree:
            return _array(**tree)
        return {key: added_up(value) for key, value in tree.items()}
    return [added_up(value) for value in tree] if isinstance(tree, list) else tree


def _array(
    differences: NDArray[np.uint8], array: str, count: int, width: int, step: float
) -> NDArray[Any]:
    planes = differences.reshape(-1, count).astype(np.int64)
    codes = sum(plane << (8 * number) for number, plane in enumerate(planes))
    steps = np.where(codes & 1, -(codes + 1) // 2, codes // 2)
    columns = steps.reshape(width, -1).cumsum(axis=1)
    return (columns.T.reshape(-1) * step).astype(_DTYPES[array])
