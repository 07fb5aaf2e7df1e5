"""Deep equality of values, to the bit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import pinocchio as pin

from baxter_kin.fields import field_names


def differences(one: object, other: object, where: str = "") -> Iterator[str]:
    """Where two values differ: arrays by their bytes, objects by their fields."""
    names = field_names(one)
    if type(one) is not type(other):
        yield f"{where}: {type(one).__name__} and {type(other).__name__}"
    elif isinstance(one, pin.SE3) and isinstance(other, pin.SE3):
        yield from differences(one.homogeneous, other.homogeneous, where)
    elif isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        if one.shape != other.shape or one.tobytes() != other.tobytes():
            yield where
    elif names:
        for name in names:
            yield from differences(getattr(one, name), getattr(other, name), f"{where}.{name}")
    elif isinstance(one, Mapping) and isinstance(other, Mapping):
        yield from differences(list(one), list(other), f"{where} names")
        for name in one.keys() & other.keys():
            yield from differences(one[name], other[name], f"{where}[{name!r}]")
    elif isinstance(one, (list, tuple)) and isinstance(other, (list, tuple)):
        if len(one) != len(other):
            yield f"{where}: {len(one)} and {len(other)} items"
        for i, (first, second) in enumerate(zip(one, other, strict=False)):
            yield from differences(first, second, f"{where}[{i}]")
    elif repr(one) != repr(other):
        yield f"{where}: {one!r} and {other!r}"
