"""Distance of two solids along samples, every sample accounted for.

Between two samples no point of the one moves farther, seen from the other, than the corners of the
box around it do: how far a point moves between two poses is the length of an affine function of the
point, which is greatest at a corner. So after a distance `d` all samples are passed over until a
corner has moved by what `d` exceeds the needed distance (conservative advancement, Mirtich 1996).
What is far away is not measured at all: boxes around pieces of both solids bound their distance.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import fcl
import numpy as np
from numpy.typing import NDArray

from referee.solids import Solid, box_corners

Array = NDArray[np.float64]

STRIDE = 16
"""Samples between those at which boxes are compared."""

TOUCHING_M = 1e-9
"""FCL's distance of what intersects is zero; this much is rounding."""

AFTER_A_HIT = 5
"""Samples passed over after one at which the two are too close: it is reported anyhow."""

MOST_HITS = 200


@dataclass(eq=False)
class Track:
    """A solid and where it is, seen from base, at every sample: shape (n, 4, 4), or (4, 4)."""

    solid: Solid
    T: Array

    @property
    def moves(self) -> bool:
        """Whether it has a pose for every sample."""
        return self.T.ndim == 3

    @property
    def count(self) -> int:
        """How many samples; 1 when it stands still."""
        return len(self.T) if self.moves else 1

    @cached_property
    def way(self) -> Array:
        """A bound on how far any of its points has moved by each sample, shape (n,), m."""
        corners = _placed(self.T, self.solid.corners)
        steps = np.linalg.norm(np.diff(corners, axis=0), axis=2).max(axis=1, initial=0.0)
        return np.append(0.0, np.cumsum(steps))

    @cached_property
    def swept(self) -> Array:
        """The box in base around the box around it at all samples, shape (2, 3)."""
        corners = _placed(self.T if self.moves else self.T[None], self.solid.corners)
        return np.array([corners.min(axis=(0, 1)), corners.max(axis=(0, 1))])

    def at(self, sample: int) -> Array:
        """Its pose at a sample, shape (4, 4)."""
        T: Array = self.T[sample] if self.moves else self.T
        return T

    def with_solid(self, solid: Solid) -> Track:
        """Another solid that goes the same way; one inside the first."""
        other = Track(solid, self.T)
        if self.moves:
            other.way = self.way
        other.swept = self.swept
        return other

    def part(self, first: int, last: int) -> Track:
        """The same from one sample up to another, that one left out."""
        if not self.moves or (first == 0 and last == self.count):
            return self
        return Track(self.solid, self.T[first:last])


@dataclass(frozen=True)
class Approach:
    """How close two solids come.

    Attributes:
        least_m: no sample has less, but for those in `hits`.
        hits: samples at which they are too close, and their distance; not all of a long contact.
        is_near_at_first: whether boxes around them leave open that they meet at the first sample.
    """

    least_m: float
    hits: tuple[tuple[int, float], ...]
    is_near_at_first: bool


def distance_m(first: Solid, second: Solid, T_second_first: Array) -> float:
    """Distance of surfaces; 0 where they intersect."""
    one, other = first.fcl_object, second.fcl_other
    one.setTransform(fcl.Transform(T_second_first[:3, :3], T_second_first[:3, 3]))
    found = fcl.distance(one, other, fcl.DistanceRequest(), fcl.DistanceResult())
    if found > TOUCHING_M:
        return float(found)
    return 0.0


def approach(first: Track, second: Track, needed_m: float) -> Approach:
    """The samples at which two solids are closer than needed; at 0, those at which they intersect.

    Samples are those of whichever moves, or one if none does.
    """
    if _gap_of_boxes(first.swept, second.swept) > needed_m:
        return Approach(np.inf, (), is_near_at_first=False)
    windows = _near(first, second, needed_m)
    if not windows.any():
        return Approach(np.inf, (), is_near_at_first=False)
    corners = _corners_seen(first, second)
    hits: list[tuple[int, float]] = []
    least, sample = np.inf, 0
    while sample < len(corners) and len(hits) < MOST_HITS:
        if not windows[sample // STRIDE]:
            ahead = np.flatnonzero(windows[sample // STRIDE :])
            if not len(ahead):
                break
            sample = (sample // STRIDE + int(ahead[0])) * STRIDE
        T_second_first = inverse(second.at(sample)) @ first.at(sample)
        found = distance_m(first.solid, second.solid, T_second_first)
        if found <= TOUCHING_M or found < needed_m:
            hits.append((sample, found))
            sample += AFTER_A_HIT
            continue
        least = min(least, found)
        sample = _next(corners, sample, max(found - needed_m, TOUCHING_M))
    return Approach(float(least), tuple(hits), bool(windows[0]))


def _gap_of_boxes(box: Array, other: Array) -> float:
    return float(np.linalg.norm(np.maximum(np.maximum(other[0] - box[1], box[0] - other[1]), 0.0)))


def _next(corners: Array, sample: int, room_m: float) -> int:
    """The first sample after one at which a corner has moved by so much, or the end."""
    begin, width = sample + 1, 16
    while begin < len(corners):
        moved = np.linalg.norm(corners[begin : begin + width] - corners[sample], axis=2).max(axis=1)
        over = np.flatnonzero(moved >= room_m)
        if len(over):
            return begin + int(over[0])
        begin, width = begin + width, 2 * width
    return begin


def _corners_seen(first: Track, second: Track) -> Array:
    """The corners of the box around the first, seen from the second, shape (n, 8, 3)."""
    T = inverse(second.T) @ first.T
    return _placed(T if T.ndim == 3 else T[None], first.solid.corners)


def _near(first: Track, second: Track, needed_m: float) -> NDArray[np.bool_]:
    """For each stride of samples, whether the two may be closer than needed in it."""
    count = max(first.count, second.count)
    chosen = np.append(np.arange(0, count, STRIDE), count - 1)
    T = inverse(second.T[chosen] if second.moves else second.T) @ (
        first.T[chosen] if first.moves else first.T
    )
    T = T if T.ndim == 3 else np.broadcast_to(T, (len(chosen), 4, 4))
    length = sum(np.diff(track.way[chosen]) for track in (first, second) if track.moves)
    near = np.ones(len(chosen) - 1, dtype=np.bool_)
    for box, others in ((first.solid.box[None], second.solid.box[None]), (None, None)):
        boxes = first.solid.boxes if box is None else box
        gaps = _box_gaps(T, boxes, second.solid.boxes if others is None else others)
        # inside a stride a point is not farther from both its ends than half the way along it
        near &= (gaps[:-1] + gaps[1:] - length) / 2 <= needed_m
        if not near.any():
            break
    return near


def _placed(T: Array, points: Array) -> Array:
    placed: Array = points @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3]
    return placed


def _box_gaps(T: Array, boxes: Array, others: Array) -> Array:
    """Lower bounds of the distance at relative poses, shape (n, 4, 4): the gap between boxes."""
    low, high = others[:, 0], others[:, 1]
    gaps = np.full(len(T), np.inf)
    for box in boxes:
        seen = _placed(T, box_corners(box))
        below = low[None] - seen.max(axis=1)[:, None]
        above = seen.min(axis=1)[:, None] - high[None]
        apart = np.linalg.norm(np.maximum(np.maximum(below, above), 0.0), axis=2)
        gaps = np.minimum(gaps, apart.min(axis=1))
    return gaps


def inverse(T: Array) -> Array:
    """The inverse of poses, shape (..., 4, 4)."""
    R = np.swapaxes(T[..., :3, :3], -1, -2)
    back = np.zeros(T.shape)
    back[..., :3, :3] = R
    back[..., :3, 3] = -(R @ T[..., :3, 3, None])[..., 0]
    back[..., 3, 3] = 1.0
    return back
