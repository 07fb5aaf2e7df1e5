"""Proof over a tube: how far apart shapes stay wherever in a tube the joints of an arm are.

The tube is cut into boxes of joint angles: what the joints may reach in some of its cells, or a
part of that. In each every pair has a bound (`planner.collision.continuous.box_bounds`). The box
with the least of them is split next: in time where it is the motion that makes it large,
across a joint where the tube itself is wide (branch and bound: Land and Doig, "An automatic method
of solving discrete programming problems", Econometrica 28(3), 1960). The least distance at places
where the arm may really be bounds what can be proven from above, and a pair that keeps more in a
box than that is done there. Splitting ends when enough is proven, when a contact is found, or after
`MOST_BOXES`: an instant of a wide tube does not become smaller by halving time.

Where shapes of triangles are nowhere touched in the tube, nothing gets inside of one, as the tube
is connected; whether something is inside is looked at in its first instant.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count, pairwise
from typing import NamedTuple

import numpy as np

from baxter_kin.validation import FloatArray, Indices
from planner.clearance import Clearance
from planner.collision.continuous.box_bounds import BoxBounds, BoxView, JointBox, PairBound
from planner.collision.continuous.joint_tube import JointTube
from planner.collision.distances import UNKNOWN_DEPTH_M

TIGHTNESS, SLACK_M = 0.7, 1e-3
"""How much of the least distance found shall be proven, or how much less, if that is more."""

FIRST_BOXES, LOOKS = 8, 5
"""How many boxes a tube is cut into at first, and at how many instants it is looked at."""

BATCH = 16
"""Boxes that are split at once."""

MOST_BOXES, MOST_TIGHT = 3000, 200
"""Boxes after which a proof is given up; and after which what is proven is tight enough."""

MOTION_SHARE = 0.7
"""Time is halved where the motion of all joints counts for more than so much of the widest one."""

LEAST_SLOPE_M = 0.1
"""What any joint that moves a pair counts for when a box is split, m/rad."""


@dataclass(frozen=True, slots=True)
class TubeClearance:
    """What is known of a tube.

    Attributes:
        proven_m: nowhere in it does a pair come nearer than this.
        nearest: the least distance that was found where the arm may be; when, in the tube's time.
        margin_m: what was asked for.
        boxes: that were looked at.
    """

    proven_m: float
    nearest: Clearance
    margin_m: float
    boxes: int

    @property
    def is_clear(self) -> bool:
        """Whether all pairs keep more than the margin."""
        return self.proven_m > self.margin_m


def prove_tube(
    bounds: BoxBounds,
    tube: JointTube,
    *,
    pairs: Indices,
    margin_m: float = 0.0,
    most_boxes: int = MOST_BOXES,
    is_tight: bool = True,
) -> TubeClearance:
    """How far apart pairs of shapes stay in a tube.

    Args:
        bounds: of the situation.
        tube: of the joints of its arm.
        pairs: their numbers.
        margin_m: what shall be proven, if it can be.
        most_boxes: after so many boxes it is given up.
        is_tight: whether more than the margin shall be proven, as much as `TIGHTNESS` says.
    """
    return _TubeSearch(bounds, tube, margin_m, most_boxes, is_tight).run(pairs)


class _TubeBox(NamedTuple):
    """A box in the cells between two instants by their numbers."""

    first: int
    last: int
    box: JointBox


class _OpenBox(NamedTuple):
    """A part in which something is not proven yet; the least proven comes first.

    Attributes:
        bound_m: the least bound of its pairs.
        number: which tells parts of the same bound apart.
        part: with the pairs that are not proven yet.
        bounds_m: of each of these.
        worst: the pair of the least bound.
        slopes: of that pair.
    """

    bound_m: float
    number: int
    part: _TubeBox
    bounds_m: FloatArray
    worst: int
    slopes: FloatArray


class _TubeSearch:
    """The proof while it is being made."""

    def __init__(
        self, bounds: BoxBounds, tube: JointTube, margin_m: float, most_boxes: int, is_tight: bool
    ) -> None:
        self._bounds, self._checked, self._tube = bounds, bounds.checked, tube
        self._most_tight = MOST_TIGHT if is_tight else 0
        self._margin_m, self._most_boxes = margin_m, most_boxes
        self._nearest = Clearance(np.inf, "", "")
        self._closed_m, self._boxes = np.inf, 0
        self._numbers, self._heap = count(), list[_OpenBox]()

    def run(self, pairs: Indices) -> TubeClearance:
        """Look at some instants; then split the box with the least bound until that will do."""
        self._look(pairs)
        cuts = np.unique(np.linspace(0, self._tube.cells, FIRST_BOXES + 1).astype(np.intp))
        ends = pairwise(cuts.tolist())
        self._open([_TubeBox(a, b, JointBox(*self._tube.hull(a, b), pairs)) for a, b in ends])
        while self._heap and not self._is_enough():
            worst = [heapq.heappop(self._heap) for _ in range(min(BATCH, len(self._heap)))]
            self._try_corner(worst[0])
            self._open([part for each in worst for part in self._halves(each)])
        left_m = self._heap[0].bound_m if self._heap else np.inf
        proven_m = min(self._closed_m, left_m, self._nearest.distance_m)
        return TubeClearance(proven_m, self._nearest, self._margin_m, self._boxes)

    def _is_enough(self) -> bool:
        """Whether a contact is found, or enough is proven, or it shall be given up."""
        nearest_m, bound_m = self._nearest.distance_m, self._heap[0].bound_m
        if nearest_m <= self._margin_m or self._boxes > self._most_boxes:
            return True
        is_tight = bound_m >= min(TIGHTNESS * nearest_m, nearest_m - SLACK_M)
        return bound_m > self._margin_m and (is_tight or self._boxes > self._most_tight)

    def _look(self, pairs: Indices) -> None:
        """Measure in the middle of the tube at some instants."""
        instants = np.unique(np.linspace(0, self._tube.cells, LOOKS).astype(np.intp))
        poses = self._bounds.place((self._tube.lowest[instants] + self._tube.highest[instants]) / 2)
        for number, instant in enumerate(instants.tolist()):
            gaps_m = self._checked.gaps_m(poses, np.full(len(pairs), number), pairs)
            self._checked.distances.place(poses[number])
            for k in np.argsort(gaps_m).tolist():
                if gaps_m[k] >= max(self._nearest.distance_m, 0.0):
                    break
                self._measure(int(pairs[k]), instant, is_first=instant == 0)

    def _measure(self, pair: int, instant: int, *, is_first: bool = False) -> None:
        """Measure a pair where the arm may be at an instant."""
        distances = self._checked.distances
        distance_m = distances.measure(pair, max(self._nearest.distance_m, 0.0))
        if is_first and distance_m > 0.0 and distances.is_within(pair):
            distance_m = UNKNOWN_DEPTH_M
        self._found(pair, distance_m, instant)

    def _found(self, pair: int, distance_m: float, instant: int) -> None:
        """Take over a distance where the arm may be, if it is the nearest so far."""
        if distance_m < self._nearest.distance_m:
            time_s = float(self._tube.times_s[instant])
            self._nearest = self._checked.between(pair, distance_m, time_s)

    def _try_corner(self, worst: _OpenBox) -> None:
        """Measure the worst pair of a box where its slopes lead, at the instant in its middle."""
        part, instant = worst.part, (worst.part.first + worst.part.last) // 2
        low = np.maximum(part.box.low, self._tube.lowest[instant])
        high = np.minimum(part.box.high, self._tube.highest[instant])
        if (low <= high).all():
            q = np.where(worst.slopes > 0.0, low, high)
            self._checked.distances.place(self._bounds.place(q[None])[0])
            self._measure(worst.worst, instant)

    def _open(self, parts: Sequence[_TubeBox]) -> None:
        """Look at boxes; keep those in which some pair may be nearer than the nearest found."""
        self._boxes += len(parts)
        views = self._bounds.views([part.box for part in parts])
        for part, view in zip(parts, views, strict=True):
            self._keep(part, view)

    def _keep(self, part: _TubeBox, view: BoxView) -> None:
        """Bound every pair of a box, and put what is left of it on the heap."""
        instant = self._tube.instant_at(part.first, part.last, view.q)
        kept: dict[int, PairBound] = {}
        is_far = view.rough_m >= self._nearest.distance_m
        self._closed_m = min(self._closed_m, float(view.rough_m[is_far].min(initial=np.inf)))
        near = np.flatnonzero(~is_far)
        for k in near[np.argsort(view.gaps_m[near])].tolist():
            bound = view.bound(k, self._nearest.distance_m)
            if instant is not None:
                self._found(int(view.pairs[k]), bound.at_middle_m, instant)
            if bound.least_m < self._nearest.distance_m:
                kept[int(view.pairs[k])] = bound
            else:
                self._closed_m = min(self._closed_m, bound.least_m)
        if kept:
            worst = min(kept, key=lambda pair: kept[pair].least_m)
            left = part._replace(box=part.box._replace(pairs=np.array(list(kept))))
            bounds_m = np.array([bound.least_m for bound in kept.values()])
            order = kept[worst].least_m, next(self._numbers)
            heapq.heappush(self._heap, _OpenBox(*order, left, bounds_m, worst, kept[worst].slopes))

    def _halves(self, worst: _OpenBox) -> Iterator[_TubeBox]:
        """Of a box, in time or across a joint, with the pairs that still count."""
        counts = worst.bounds_m < self._nearest.distance_m
        self._closed_m = min(self._closed_m, float(worst.bounds_m[~counts].min(initial=np.inf)))
        part = worst.part
        if not counts.any():
            return
        box = part.box._replace(pairs=part.box.pairs[counts])
        weights = self._bounds.moving_joints(worst.worst) * (np.abs(worst.slopes) + LEAST_SLOPE_M)
        reach = weights * (box.high - box.low)
        joint = int(reach.argmax())
        is_long = part.last - part.first > 1
        if is_long and float((weights * self._motion(part)).sum()) >= MOTION_SHARE * reach[joint]:
            yield from self._halves_in_time(part._replace(box=box))
        else:
            yield from (part._replace(box=half) for half in _halves_across(box, joint))

    def _motion(self, part: _TubeBox) -> FloatArray:
        """How much of the width of a box is motion: the rest is so wide at one instant, (n,)."""
        some = slice(part.first, part.last + 1)
        low = np.maximum(self._tube.lowest[some], part.box.low)
        at_once = (np.minimum(self._tube.highest[some], part.box.high) - low).max(axis=0)
        widths = part.box.high - part.box.low
        motion: FloatArray = widths - np.clip(at_once, 0.0, widths)
        return motion

    def _halves_in_time(self, part: _TubeBox) -> Iterator[_TubeBox]:
        middle = (part.first + part.last) // 2
        for first, last in ((part.first, middle), (middle, part.last)):
            low, high = self._tube.hull(first, last)
            low, high = np.maximum(low, part.box.low), np.minimum(high, part.box.high)
            if (low <= high).all():
                yield _TubeBox(first, last, JointBox(low, high, part.box.pairs))


def _halves_across(box: JointBox, joint: int) -> Iterator[JointBox]:
    low, high = np.array(box.low), np.array(box.high)
    low[joint] = high[joint] = (box.low[joint] + box.high[joint]) / 2
    yield box._replace(high=high)
    yield box._replace(low=low)
