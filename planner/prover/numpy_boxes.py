"""Rows over boxes of joint angles found by NumPy, without a C compiler: slower and less tight.

Each task is separated by the direction between the nearest points of both clusters in the middle of
its box, found by the algorithm of Gilbert, Johnson and Keerthi. Otherwise a cluster or the box is
cut.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from planner.certificate.boxes import (
    CUT_FIRST,
    CUT_JOINT,
    CUT_SECOND,
    CUT_TIME,
    SEPARATED,
    Boxes,
    BoxTrace,
    Tube,
    box_gaps_m,
)
from planner.certificate.clusters import LEAF, Clusters, Nodes
from planner.certificate.intervals import Array
from planner.certificate.rows import Joints, Pair
from planner.prover.numpy_search import MAX_ITERATIONS, least_norm_weights
from planner.prover.problem import SPARE_M, BoxesFound, Near, Outcome

MAX_BOXES, MAX_BOXES_OF_TRIALS = 20_000, 4_000
"""Maximum number of tasks of one tube, and of an attempt at a margin of `MARGINS_M`."""

MARGINS_M = (0.01, 2e-3)
"""Margins that are tried first, as no distance is found here; at last the required one."""

MIN_APART_SHARE = 0.25
"""A box is cut where the distance in its middle exceeds this share of the loss due to its width."""

MIN_MOTION_SHARE = 0.7
"""Time is halved where motion is at least this share of the widest joint."""

MIN_WIDTH_RAD = 1e-7
"""Intervals of a joint below this width are not cut."""

_NONE = Near(-1, np.inf, 0.0)
_NO_TRACE = BoxTrace(np.zeros(0, np.intp), np.zeros((0, 3)))


def search_tube(
    robot: Joints, clusters: Clusters, pairs: Sequence[Pair], tube: Tube, margin_m: float = 0.0
) -> BoxesFound:
    """Like `planner.prover.kernel.Kernel.search_tube`; the nearest pair is not found."""
    for asked_m in (m for m in MARGINS_M if m > margin_m):
        found = _Search(robot, clusters, pairs, tube, asked_m).run(MAX_BOXES_OF_TRIALS)
        if found.outcome == Outcome.PROVEN:
            return found
    return _Search(robot, clusters, pairs, tube, margin_m).run(MAX_BOXES)


def unproven_cells(
    robot: Joints, clusters: Clusters, pairs: Sequence[Pair], tube: Tube, shortest: int
) -> NDArray[np.bool_]:
    """Like `planner.prover.kernel.Kernel.unproven_cells`."""
    search = _Search(robot, clusters, pairs, tube, 0.0, shortest=shortest)
    is_proven = search.run(MAX_BOXES).outcome == Outcome.PROVEN
    return search.is_open | (not is_proven)


class _Search:
    """A search for rows that keep a margin in a tube.

    Attributes:
        is_open: cells in which some pair is not shown to keep the margin, shape (n,); found where
            spans of few cells are not cut.
    """

    def __init__(
        self,
        robot: Joints,
        clusters: Clusters,
        pairs: Sequence[Pair],
        tube: Tube,
        margin_m: float,
        *,
        shortest: int = 0,
    ) -> None:
        """Prepare the search; spans of at most `shortest` cells are marked instead of cut."""
        self._robot, self._clusters, self._pairs, self._tube = robot, clusters, pairs, tube
        self._margin_m, self._shortest = margin_m, shortest
        self.is_open = np.zeros(len(tube.low) - 1, np.bool_)
        self._level = np.array([[p.second.level, p.first.level] for p in pairs], np.intp)
        slides = [[p.first.slide_m[0], p.second.slide_m[0]] for p in pairs]
        self._slide = np.array(slides).reshape(-1, 2)

    def run(self, most: int) -> BoxesFound:
        boxes, proven_m, traces, count = Boxes.of(self._pairs, self._tube), np.inf, [_NO_TRACE], 0
        while len(boxes):
            count += len(boxes)
            n, apart = self._directions(boxes)
            n = self._seen_from_base(boxes, n)
            gaps = box_gaps_m(self._robot, self._clusters, self._pairs, boxes, n)
            letters = self._letters(boxes, apart, gaps)
            is_apart = letters == SEPARATED
            is_marked = is_apart & (gaps <= self._margin_m + SPARE_M)
            for row in np.flatnonzero(is_marked).tolist():
                self.is_open[boxes.start[row] : boxes.end[row]] = True
            proven_m = min(proven_m, float(gaps[is_apart].min(initial=np.inf)))
            traces.append(BoxTrace(letters, n[is_apart]))
            is_hopeless = (letters >= CUT_JOINT) & (
                (boxes.high - boxes.low)[np.arange(len(boxes)), letters - CUT_JOINT] < MIN_WIDTH_RAD
            )
            if count > most or is_hopeless.any():
                worst = int(np.where(is_apart, np.inf, gaps).argmin())
                at = float(boxes.start[worst] + boxes.end[worst]) // 2
                near = Near(int(boxes.pair[worst]), float(apart[worst]), at)
                q = 0.5 * (boxes.low[worst] + boxes.high[worst])
                return BoxesFound(Outcome.NOT_SHOWN, 0.0, _NONE, near, q, _NO_TRACE)
            at_cut = np.flatnonzero(~is_apart)
            boxes = boxes.only(at_cut).halves(letters[at_cut], self._clusters, self._tube)
            spans = zip(boxes.start.tolist(), boxes.end.tolist(), strict=True)
            if self._shortest:
                boxes = boxes.only([not self.is_open[a:b].all() for a, b in spans])
        columns = ([getattr(trace, c) for trace in traces] for c in ("letters", "directions"))
        trace = BoxTrace(*(np.concatenate(column) for column in columns))
        q = np.zeros(self._tube.low.shape[1])
        return BoxesFound(Outcome.PROVEN, proven_m - SPARE_M, _NONE, _NONE, q, trace)

    def _letters(self, boxes: Boxes, apart: Array, gaps: Array) -> Nodes:
        need_m = self._margin_m + SPARE_M
        letters = np.full(len(boxes), SEPARATED, np.intp)
        at = np.flatnonzero(gaps <= need_m)
        open_ = boxes.only(at)
        first, second = (
            np.where(self._clusters.children(x)[:, 0] == LEAF, 0.0, self._clusters.extents_m(x))
            for x in (open_.first, open_.second)
        )
        loss = apart[at] - gaps[at]
        is_by_box = (first == 0.0) & (second == 0.0)
        is_by_box |= (apart[at] - need_m > MIN_APART_SHARE * loss) | (
            loss > np.maximum(first, second)
        )
        chosen = np.where(first >= second, CUT_FIRST, CUT_SECOND)
        chosen[is_by_box] = self._halved(open_)[is_by_box]
        is_marked = is_by_box & (open_.end - open_.start <= self._shortest)
        letters[at] = np.where(is_marked, SEPARATED, chosen)
        return letters

    def _halved(self, boxes: Boxes) -> Nodes:
        """Letters that cut time or the interval of a joint."""
        level, rho = self._level[boxes.pair], self._clusters.reaches_m(boxes.first)
        base = np.clip(self._robot.base, level[:, 0], level[:, 1])
        reach = np.zeros_like(boxes.low)
        for joint in range(reach.shape[1] - 1, -1, -1):
            counts = (base <= joint) & (joint < level[:, 1])
            reach[:, joint] = np.where(counts, rho, 0.0)
            rho = np.where(counts, rho + self._robot.offsets[joint], rho)
        rho = self._clusters.reaches_m(boxes.second)
        for joint in range(self._robot.base):
            counts = (level[:, 0] <= joint) & (joint < base)
            rho = np.where(counts, rho + self._robot.offsets[joint], rho)
            reach[:, joint] = np.where(counts, rho, reach[:, joint])
        middle = (boxes.start + boxes.end) // 2
        still = np.minimum(boxes.high, self._tube.high[middle])
        still = (still - np.maximum(boxes.low, self._tube.low[middle])).clip(0.0)
        widths = boxes.high - boxes.low
        motion = (reach * (widths - still).clip(0.0)).sum(axis=1)
        widest = (reach * widths).max(axis=1, initial=0.0)
        is_in_time = (motion >= MIN_MOTION_SHARE * widest) | (self._shortest > 0)
        is_in_time &= boxes.end - boxes.start > 1
        found: Nodes = np.where(is_in_time, CUT_TIME, CUT_JOINT + (reach * widths).argmax(axis=1))
        return found

    def _directions(self, boxes: Boxes) -> tuple[Array, Array]:
        """Unit directions with a large gap in the middles of boxes, and these gaps, m."""
        R, p = self._frames(boxes)
        middles = [self._clusters.middles(nodes) for nodes in (boxes.first, boxes.second)]
        v = np.einsum("kij,kj->ki", R, middles[0]) + p - middles[1]
        v[np.linalg.norm(v, axis=1) < 1e-9] = [0.0, 0.0, 1.0]
        count = len(boxes)
        best, apart = np.zeros((count, 3)), np.full(count, -np.inf)
        simplex, used = np.zeros((count, 4, 3)), np.zeros((count, 4), np.bool_)
        at = np.arange(count)
        for _ in range(MAX_ITERATIONS):
            length = np.linalg.norm(v[at], axis=1)
            d = v[at] / length[:, None]
            w = self._difference(boxes.only(at), d, R[at], p[at])
            kept = np.einsum("ki,ki->k", d, w)
            is_better = kept > apart[at]
            apart[at[is_better]], best[at[is_better]] = kept[is_better], d[is_better]
            is_done = used[at].any(axis=1) & (length - kept < 1e-3 * length)
            at, w = at[~is_done], w[~is_done]
            if not len(at):
                break
            free = (~used[at]).argmax(axis=1)
            simplex[at, free], used[at, free] = w, True
            shares = least_norm_weights(simplex[at], used[at])
            used[at] = shares > 1e-12
            v[at] = np.einsum("nk,nkj->nj", shares, simplex[at])
            is_open = ~used[at].all(axis=1) & (np.linalg.norm(v[at], axis=1) > 1e-9)
            at = at[is_open]
        return best, apart

    def _difference(self, boxes: Boxes, d: Array, R: Array, p: Array) -> Array:
        """Points of the difference of both clusters that are lowest along directions."""
        y, slide = np.eye(3)[1], self._slide[boxes.pair]
        own = np.einsum("kij,ki->kj", R, d)
        first = self._clusters.lowest_points(boxes.first, own) + slide[:, :1] * y
        second = self._clusters.lowest_points(boxes.second, -d) + slide[:, 1:] * y
        found: Array = np.einsum("kij,kj->ki", R, first) + p - second
        return found

    def _seen_from_base(self, boxes: Boxes, n: Array) -> Array:
        """Directions in base, where it is between both clusters' frames."""
        level = self._level[boxes.pair]
        ends = np.column_stack([level[:, 0], np.clip(self._robot.base, level[:, 0], level[:, 1])])
        found: Array = np.einsum("kij,ki->kj", self._frames(boxes, ends)[0], n)
        return found

    def _frames(self, boxes: Boxes, ends: Nodes | None = None) -> tuple[Array, Array]:
        """Poses of the first clusters' frames seen from the second's, in the middles of boxes.

        Or of frames that are given, shape (k, 2), each seen from the one before it.
        """
        q, level = 0.5 * (boxes.low + boxes.high), self._level[boxes.pair] if ends is None else ends
        R, p = np.tile(np.eye(3), (len(boxes), 1, 1)), np.zeros((len(boxes), 3))
        for joint, span in enumerate(self._robot.spans):
            counts = ((level[:, 0] <= joint) & (joint < level[:, 1]))[:, None]
            turn = np.tile(np.eye(3), (len(boxes), 1, 1))
            c, s = np.cos(q[:, joint]), np.sin(q[:, joint])
            turn[:, 0, 0], turn[:, 0, 1], turn[:, 1, 0], turn[:, 1, 1] = c, -s, s, c
            p = np.where(counts, p + R @ span.p.centred()[0], p)
            R = np.where(counts[..., None], R @ span.R.centred()[0] @ turn, R)
        return R, p
