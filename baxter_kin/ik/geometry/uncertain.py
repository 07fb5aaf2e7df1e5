"""Angles, and vectors in a plane, that are known up to a slack.

What the sweeps over cells of joint angles reckon with (`shoulder_sweep`, `pose_sweep`): a value at
the middle of a cell, and how far off it may be anywhere in the cell.
"""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from baxter_kin.validation import FloatArray

Flags: TypeAlias = NDArray[np.bool_]

_LEAST = 1e-9


class UncertainAngle(NamedTuple):
    """An angle, and how far it may be off, rad; by more than half a turn, it may be any."""

    middle: FloatArray
    slack: FloatArray

    def part(self, which: Flags) -> UncertainAngle:
        """Some of several."""
        return UncertainAngle(self.middle[which], self.slack[which])

    def less(self, other: UncertainAngle) -> UncertainAngle:
        """The difference of two."""
        return UncertainAngle(self.middle - other.middle, self.slack + other.slack)

    def is_within(self, middle: float, half: float) -> Flags:
        """Where it may be so close to an angle, whole turns apart."""
        off = np.abs(np.remainder(self.middle - (middle - math.pi), 2.0 * math.pi) - math.pi)
        return np.asarray(off <= half + self.slack)


class UncertainVector(NamedTuple):
    """A vector in a plane by its components, and how far its end may be off."""

    x: FloatArray
    y: FloatArray
    slack: FloatArray

    @property
    def length(self) -> FloatArray:
        """At the middle."""
        return np.asarray(np.hypot(self.x, self.y))

    @property
    def angle(self) -> UncertainAngle:
        """From x towards y."""
        length, slack = self.length, self.slack
        turn = np.where(
            slack < length,
            np.arcsin(slack / np.maximum(np.maximum(length, slack), _LEAST)),
            math.pi,
        )
        return UncertainAngle(np.arctan2(self.y, self.x), turn)

    def arc_cosine(self, least: FloatArray, most: FloatArray) -> tuple[UncertainAngle, Flags]:
        """The angle to a direction along which the vector has a component in a range.

        And where there is one.
        """
        length = self.length
        short, long = np.maximum(length - self.slack, _LEAST), length + self.slack
        low = least / np.where(least > 0.0, long, short)
        high = most / np.where(most > 0.0, short, long)
        far = np.arccos(np.minimum(np.maximum(low, -1.0), 1.0))
        near = np.arccos(np.minimum(np.maximum(high, -1.0), 1.0))
        is_possible: Flags = (low <= 1.0) & (high >= -1.0)
        return UncertainAngle(0.5 * (far + near), 0.5 * (far - near)), is_possible
