"""Hostile values: what nobody should give, but somebody will."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pinocchio as pin

LONG = 100_000
"""Of the strings that no message should repeat."""

FILLER = "x"


class Stranger:
    """An object of a class that the toolkit does not know."""


def _turned(R: list[list[float]]) -> pin.SE3:
    return pin.SE3(np.array(R, dtype=np.float64), np.zeros(3))


def _nested(depth: int) -> list[Any]:
    inner: list[Any] = []
    for _ in range(depth):
        inner = [inner]
    return inner


def _far() -> pin.SE3:
    return pin.SE3(np.eye(3), np.array([1e308, 0.0, 0.0]))


HOSTILE: Mapping[str, Callable[[], Any]] = MappingProxyType(
    {
        "None": lambda: None,
        "5": lambda: 5,
        "-1": lambda: -1,
        "0": lambda: 0,
        "0.5": lambda: 0.5,
        "nan": lambda: float("nan"),
        "inf": lambda: float("inf"),
        "-inf": lambda: float("-inf"),
        "1e308": lambda: 1e308,
        "1e-308": lambda: 1e-308,
        "10**12": lambda: 10**12,
        "10**400": lambda: 10**400,
        "True": lambda: True,
        "1j": lambda: 1j,
        "''": lambda: "",
        "'x'": lambda: "x",
        "'0.1'": lambda: "0.1",
        "'\\ud800'": lambda: "\ud800",
        "'\\0'": lambda: "a\0b",
        "a long string": lambda: FILLER * LONG,
        "b'x'": lambda: b"x",
        "long bytes": lambda: FILLER.encode() * LONG,
        "()": lambda: (),
        "[]": list,
        "{}": dict,
        "set()": set,
        "{'a': 1}": lambda: {"a": 1},
        "{5: None}": lambda: {5: None},
        "[None]": lambda: [None],
        "['a', 'b']": lambda: ["a", "b"],
        "[[1, 2], [3]]": lambda: [[1, 2], [3]],
        "lists in lists": lambda: _nested(100),
        "[1.0] * 7": lambda: [1.0] * 7,
        "['1'] * 7": lambda: ["1"] * 7,
        "[10**400] * 7": lambda: [10**400] * 7,
        "a generator": lambda: (x for x in [1.0, 2.0]),
        "an endless generator": itertools.count,
        "an endless repetition": lambda: itertools.repeat(pin.SE3.Identity()),
        "range(10**12)": lambda: range(10**12),
        "zeros(0)": lambda: np.zeros(0),
        "zeros(3)": lambda: np.zeros(3),
        "zeros(7)": lambda: np.zeros(7),
        "zeros((2, 7))": lambda: np.zeros((2, 7)),
        "zeros((0, 7))": lambda: np.zeros((0, 7)),
        "zeros((3, 3))": lambda: np.zeros((3, 3)),
        "zeros((4, 4))": lambda: np.zeros((4, 4)),
        "zeros(100_000)": lambda: np.zeros(100_000),
        "full(7, nan)": lambda: np.full(7, np.nan),
        "full(7, inf)": lambda: np.full(7, np.inf),
        "full(7, 1e308)": lambda: np.full(7, 1e308),
        "masked": lambda: np.ma.array(np.zeros(7), mask=[True] + [False] * 6),
        "objects": lambda: np.array([None, "a", 1.0], dtype=object),
        "complex": lambda: np.zeros(7, dtype=np.complex128),
        "booleans": lambda: np.ones(7, dtype=np.bool_),
        "words": lambda: np.array(["a"] * 7),
        "dates": lambda: np.array(["2020-01-01"] * 7, dtype="datetime64[D]"),
        "integers": lambda: np.zeros(7, dtype=np.int8),
        "nan in SE3": lambda: pin.SE3(np.eye(3), np.array([np.nan, 0.0, 0.0])),
        "far SE3": _far,
        "mirrored SE3": lambda: _turned([[-1, 0, 0], [0, 1, 0], [0, 0, 1]]),
        "zero SE3": lambda: _turned([[0, 0, 0], [0, 0, 0], [0, 0, 0]]),
        "sheared SE3": lambda: _turned([[1, 1, 0], [0, 1, 0], [0, 0, 1]]),
        "a stranger": Stranger,
        "a class": lambda: Stranger,
        "a function": lambda: lambda *_: None,
        "a folder": Path,
    }
)
"""By the name under which a report shows it."""
