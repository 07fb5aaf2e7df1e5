"""Rows over boxes of joint angles: clusters keep apart at all angles that lagging arms may have.

A row is a box of joint angles, two clusters and a direction n, fixed in the frame that carries the
second. For a pair of points, the gap n . (a - b) is c + A cos q + B sin q as a function of any one
joint q, with an amplitude of at most |n| rho, where rho bounds the distance of a from that joint.
By the lemma of `motion`, on an interval of width w it is at least the smaller of its end values
minus |n| rho w^2 / 8. Applied to one joint after another: the gap anywhere in a box is at least the
smallest value at its corners minus |n| times the sum of rho_i w_i^2 / 8. Only the joints between
both frames count, so there are at most 2^7 corners. As in `rows`, any direction is sound.

Between two arms, on a chain of 14 joints that passes base in between (`Joints.base`), n is fixed in
base. Then n . a depends on the joints of one arm alone, and n . b on those of the other, and the
lemma holds for each of them: there are at most 2^7 corners for each cluster, not 2^14 for both.

A tube bounds the angles of each joint at some instants. Letters lead through the pairs and the
tube, level by level: each open task (a pair of clusters and a box) is separated, or replaced by
both halves of a cluster, of the span of time, or of the interval of one joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from planner.certificate.clusters import LEAF, Clusters, Nodes
from planner.certificate.errors import require
from planner.certificate.intervals import Array, norm_bound
from planner.certificate.rows import Joints, Pair

SEPARATED, CUT_FIRST, CUT_SECOND, CUT_TIME, CUT_JOINT = range(5)
"""Letters; `CUT_JOINT` plus the number of a joint, from 0, halves its interval."""

ROUNDING_M = 1e-9
"""Subtracted from every gap, times |n|_1: directions are rotated by seven joints in doubles. These
are sums of products of numbers of order one, each with an error below 1e-14."""

CHUNK = 64
"""Number of rows whose corners are computed at once; clusters have up to some thousand points."""


@dataclass(frozen=True, eq=False)
class Tube:
    """Bounds on joint angles at instants; between two instants, the hull of their bounds.

    Attributes:
        low: lower bounds at n + 1 instants, shape (n + 1, joints), rad.
        high: upper bounds, likewise.
    """

    low: Array
    high: Array

    def hull(self, first: int, last: int) -> tuple[Array, Array]:
        """Bounds between two instants, by their numbers; two arrays of shape (joints,), rad."""
        some = slice(first, last + 1)
        return self.low[some].min(axis=0), self.high[some].max(axis=0)


@dataclass(frozen=True, eq=False)
class Boxes:
    """Pairs of clusters and boxes, as columns of one length.

    Attributes:
        pair: numbers of the pairs.
        first, second: nodes.
        start, end: numbers of the instants between which the joints are in the box.
        low, high: bounds of the joints, shape (n, joints), rad.
    """

    pair: Nodes
    first: Nodes
    second: Nodes
    start: Nodes
    end: Nodes
    low: Array
    high: Array

    @classmethod
    def of(cls, pairs: Sequence[Pair], tube: Tube) -> Boxes:
        """Both roots of every pair in the whole tube."""
        count = len(pairs)
        first, second = (
            np.array([getattr(pair, side).root for pair in pairs], np.intp)
            for side in ("first", "second")
        )
        last = len(tube.low) - 1
        low, high = (np.tile(bound, (count, 1)) for bound in tube.hull(0, last))
        start = np.zeros(count, np.intp)
        return cls(np.arange(count), first, second, start, np.full(count, last), low, high)

    def only(self, rows: Any) -> Boxes:
        """The tasks of some rows."""
        return Boxes(*(getattr(self, column)[rows] for column in self.__dataclass_fields__))

    @classmethod
    def joined(cls, parts: Sequence[Boxes]) -> Boxes:
        """The tasks of several, at least one."""
        columns = cls.__dataclass_fields__
        return cls(*(np.concatenate([getattr(part, c) for part in parts]) for c in columns))

    def __len__(self) -> int:
        return len(self.pair)

    def halves(self, letters: Nodes, clusters: Clusters, tube: Tube) -> Boxes:
        """Both halves of each task, cut as its letter says; empty boxes are left out.

        Raises:
            NotCertifiedError: when a leaf is cut, or a box that cannot be cut.
        """
        count = np.arange(len(self))
        twice, side = np.repeat(count, 2), np.tile([0, 1], len(self))
        after, letter = self.only(twice), letters[twice]
        first, second = after.first.copy(), after.second.copy()
        for nodes, cut in ((first, CUT_FIRST), (second, CUT_SECOND)):
            at = np.flatnonzero(letter == cut)
            children = clusters.children(nodes[at])
            require(children != LEAF, "a cluster that cannot be cut")
            nodes[at] = children[np.arange(len(at)), side[at]]
        start, end = after.start.copy(), after.end.copy()
        low, high = after.low.copy(), after.high.copy()
        at = np.flatnonzero(letter >= CUT_JOINT)
        joint = letter[at] - CUT_JOINT
        middle = 0.5 * (low[at, joint] + high[at, joint])
        is_inside = (low[at, joint] < middle) & (middle < high[at, joint])
        require(is_inside, "a box that cannot be cut")
        low[at, joint] = np.where(side[at] == 1, middle, low[at, joint])
        high[at, joint] = np.where(side[at] == 0, middle, high[at, joint])
        at = np.flatnonzero(letter == CUT_TIME)
        require(end[at] - start[at] > 1, "a span of time that cannot be cut")
        middles = (start[at] + end[at]) // 2
        start[at] = np.where(side[at] == 1, middles, start[at])
        end[at] = np.where(side[at] == 0, middles, end[at])
        hulls = [tube.hull(a, b) for a, b in zip(start[at].tolist(), end[at].tolist(), strict=True)]
        for i, (lowest, highest) in zip(at.tolist(), hulls, strict=True):
            low[i], high[i] = np.maximum(low[i], lowest), np.minimum(high[i], highest)
        made = replace(after, first=first, second=second, start=start, end=end, low=low, high=high)
        return made.only(np.flatnonzero((low <= high).all(axis=1)))


@dataclass(frozen=True, eq=False)
class BoxTrace:
    """Letters and directions that lead through the boxes of a tube.

    Attributes:
        letters: in order, shape (n,).
        directions: for each letter `SEPARATED`, shape (k, 3), of any length.
    """

    letters: Nodes
    directions: Array


def box_rows(
    clusters: Clusters, pairs: Sequence[Pair], tube: Tube, trace: BoxTrace
) -> tuple[Boxes, Array]:
    """The rows that a trace asks for, and their directions; no geometry is computed.

    Raises:
        NotCertifiedError: when the trace is malformed.
    """
    boxes, parts, read = Boxes.of(pairs, tube), [], 0
    letters = CUT_JOINT + tube.low.shape[1]
    require((trace.letters >= 0) & (trace.letters < letters), "an unknown letter")
    while len(boxes):
        own = trace.letters[read : read + len(boxes)]
        require(len(own) == len(boxes), "the trace ends too soon")
        read += len(boxes)
        is_apart = own == SEPARATED
        parts.append(boxes.only(np.flatnonzero(is_apart)))
        at = np.flatnonzero(~is_apart)
        boxes = boxes.only(at).halves(own[at], clusters, tube)
    rows = Boxes.joined(parts) if parts else boxes
    require(read == len(trace.letters), "the trace goes on after the tube")
    require(len(rows) == len(trace.directions), "directions do not fit the letters")
    return rows, trace.directions


def box_gaps_m(
    robot: Joints, clusters: Clusters, pairs: Sequence[Pair], boxes: Boxes, n: Array
) -> Array:
    """The conclusions of rows: lower bounds on the distance in each box, shape (k,), m.

    Args:
        robot: the arm that moves, or both.
        clusters: all trees.
        pairs: the pairs that the rows refer to; the first mover of each is on the later joint.
        boxes: the rows.
        n: a direction for each, shape (k, 3), of any non-zero length.

    Raises:
        NotCertifiedError: when a direction, or a pair, is malformed.
    """
    length = norm_bound(n)
    require((length > 1e-6) & np.isfinite(length), "a direction is zero or not finite")
    level = np.array([[pair.second.level, pair.first.level] for pair in pairs], np.intp)
    level = level.reshape(-1, 2)
    slides = np.array([[pair.first.slide_m, pair.second.slide_m] for pair in pairs])
    slides = slides.reshape(-1, 2, 2)
    require(slides[..., 0] == slides[..., 1], "a mover slides while joints move")
    slide = slides[..., 0]
    require(level[:, 0] <= level[:, 1], "a pair in the wrong order")
    gaps = np.empty(len(boxes))
    for m, k in np.unique(level[boxes.pair], axis=0).tolist():
        own = np.flatnonzero((level[boxes.pair] == (m, k)).all(axis=1))
        own = own[np.argsort(boxes.first[own], kind="stable")]  # supports of one node at once
        for rows in np.split(own, range(CHUNK, len(own), CHUNK)):
            some, base = boxes.only(rows), min(max(robot.base, m), k)
            onward = _at_corners(robot, some, n[rows], range(base, k))
            back = _at_corners(robot, some, -n[rows], range(base - 1, m - 1, -1))
            gaps[rows] = sum(
                _lowest(clusters, nodes, corners, slide[some.pair, side])
                for side, (nodes, corners) in enumerate(((some.first, onward), (some.second, back)))
            )
    sag = _sags_m(robot, clusters, boxes, level[boxes.pair], slide[boxes.pair])
    error = np.abs(n).sum(axis=1) * (ROUNDING_M + 4.0 * clusters.rounding_m)
    found = gaps - error - sag * length
    shorter = length * (1.0 - 1e-12)  # a gap below zero is divided by less
    least: Array = np.where(found > 0.0, found / length, found / shorter)
    return least


def _at_corners(robot: Joints, boxes: Boxes, n: Array, joints: range) -> tuple[Array, Array]:
    """Directions at all corners of boxes, and their products with an origin.

    Args:
        robot: the arm that moves, or both.
        boxes: the rows.
        n: directions in the frame from which the joints lead, shape (rows, 3).
        joints: that are passed, onwards or, with a step of -1, backwards.

    Returns:
        Directions seen from the frame to which the joints lead, shape (rows, corners, 3), and
        n . (its origin), shape (rows, corners).
    """
    d, offsets = n[:, None], np.zeros((len(n), 1))
    for joint in joints:
        span = robot.spans[joint]
        R, p = span.R.centred()[0], span.p.centred()[0]
        if joints.step > 0:
            offsets, d = offsets + d @ p, d @ R
        ends = []
        for q in (boxes.low[:, joint, None], boxes.high[:, joint, None]):
            c, s = np.cos(q), joints.step * np.sin(q)
            x, y = d[..., 0], d[..., 1]
            ends.append(np.stack([c * x + s * y, c * y - s * x, d[..., 2]], axis=-1))
        d, offsets = np.concatenate(ends, axis=1), np.tile(offsets, (1, 2))
        if joints.step < 0:
            d = d @ R.T
            offsets = offsets - d @ p
    return d, offsets


def _lowest(
    clusters: Clusters, nodes: Nodes, corners: tuple[Array, Array], slide_m: Array
) -> Array:
    """The smallest product of a direction with a point of a cluster at any corner, (rows,)."""
    d, offsets = corners
    lowest = clusters.lowest(np.repeat(nodes, d.shape[1]), d.reshape(-1, 3))
    at = offsets + d[..., 1] * slide_m[:, None] + lowest.reshape(offsets.shape)
    least: Array = at.min(axis=1)
    return least


def _sags_m(robot: Joints, clusters: Clusters, boxes: Boxes, level: Nodes, slide: Array) -> Array:
    """The sum of rho_i w_i^2 / 8 over the joints between both frames, shape (k,).

    From base, or the frame that carries the second cluster, the first is on the joints that follow,
    and the second on those before, if there are any.
    """
    sag, eighths = np.zeros(len(boxes)), (boxes.high - boxes.low) ** 2 / 8.0
    base = np.clip(robot.base, level[:, 0], level[:, 1])
    rho = clusters.reaches_m(boxes.first) + np.abs(slide[:, 0])
    for joint in range(eighths.shape[1] - 1, -1, -1):
        counts = (base <= joint) & (joint < level[:, 1])
        sag = np.where(counts, sag + rho * eighths[:, joint], sag)
        rho = np.where(counts, rho + robot.offsets[joint], rho)
    rho = clusters.reaches_m(boxes.second) + np.abs(slide[:, 1])
    for joint in range(robot.base):
        counts = (level[:, 0] <= joint) & (joint < base)
        rho = np.where(counts, rho + robot.offsets[joint], rho)
        sag = np.where(counts, sag + rho * eighths[:, joint], sag)
    widened: Array = sag * (1.0 + 1e-9)
    return widened
