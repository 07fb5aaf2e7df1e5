"""BoxBounds: what pairs of shapes keep while the joints of an arm are anywhere in a box.

The greatest of three distances:

- that of simple shapes around them, at the middle of the box, less what lever arms and turns move
  them (`planner.collision.continuous.motion_bounds`),
- what a plane between their hulls leaves (`planner.collision.continuous.hull_gaps`),
- that of the shapes themselves at the middle, less that motion and `ACCURACY_M`.

Each is asked for only where those before it are not enough.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from baxter_kin.validation import FloatArray, Indices
from planner.collision.checker import ClearanceChecker
from planner.collision.continuous.hull_gaps import ArmPose, HullGaps
from planner.collision.distances import ACCURACY_M
from planner.collision.shape_pairs import CheckedPairs


class JointBox(NamedTuple):
    """Joint angles between two corners, shape (n,), rad; and the pairs that count in there."""

    low: FloatArray
    high: FloatArray
    pairs: Indices


class PairBound(NamedTuple):
    """What one pair keeps in a box.

    Attributes:
        least_m: the bound.
        slopes: how the distance changes with each joint where it is least, shape (n,), m/rad; zero
            where it is not known, as it did not matter.
        at_middle_m: the distance in the middle of the box, where it was measured and is less than
            what was enough; else infinite.
    """

    least_m: float
    slopes: FloatArray
    at_middle_m: float = np.inf


class BoxView:
    """The arm in the middle of one box.

    Attributes:
        q: that middle, shape (n,), rad.
        pairs: those of the box.
        gaps_m: what simple shapes around them keep there, shape (pairs,).
        rough_m: what these keep throughout the box, as `bound` has it at least, shape (pairs,).
    """

    def __init__(
        self,
        checked: CheckedPairs,
        hulls: HullGaps,
        box: JointBox,
        placed: tuple[FloatArray, ArmPose],
        distances: tuple[FloatArray, FloatArray],
    ) -> None:
        self.pairs, self.q = box.pairs, (box.low + box.high) / 2
        self._turns = (box.high - box.low) / 2
        self._checked, self._hulls = checked, hulls
        self._poses, self._arm = placed
        self.gaps_m, self._motions_m = distances
        self.rough_m: FloatArray = self.gaps_m - self._motions_m
        checked.distances.place(self._poses)

    def bound(self, k: int, enough_m: float) -> PairBound:
        """Of the k-th pair; more than `enough_m` is not looked for."""
        pair, motion_m = int(self.pairs[k]), float(self._motions_m[k])
        least_m = float(self.rough_m[k])
        if least_m >= enough_m:
            return PairBound(least_m, np.zeros_like(self.q))
        hulls = self._hulls.of(pair, self._poses, self._arm, self._turns)
        least_m = max(least_m, hulls.least_m)
        if least_m >= enough_m:
            return PairBound(least_m, hulls.slopes)
        asked_m = max(enough_m, 0.0) + motion_m + 2.0 * ACCURACY_M * max(1.0, enough_m)
        found_m = self._checked.distances.measure(pair, asked_m)
        kept_m = found_m - ACCURACY_M * max(1.0, found_m) - motion_m
        at_middle_m = found_m if found_m < enough_m else np.inf
        return PairBound(max(least_m, kept_m), hulls.slopes, at_middle_m)


class BoxBounds:
    """Those of one situation.

    Attributes:
        checked: its pairs.
    """

    def __init__(self, checker: ClearanceChecker, full: FloatArray) -> None:
        """For a full configuration, shape (19,), that says where all other joints stand."""
        self.checked, self._full = checker.checked, full
        self._bounds, self._hulls = checker.motion_bounds, HullGaps(checker)

    def moving_joints(self, pair: int) -> NDArray[np.bool_]:
        """Which joints move one shape of a pair against the other, shape (n,)."""
        first, second = self._bounds.moves[self.checked.numbers[pair]]
        moving: NDArray[np.bool_] = first ^ second
        return moving

    def place(self, qs: FloatArray) -> FloatArray:
        """Poses of all shapes at configurations, shape (m, n): (m, shapes, 4, 4)."""
        return self._bounds.place(self._full, qs).shapes

    def views(self, boxes: Sequence[JointBox]) -> Iterator[BoxView]:
        """Of each box in turn; one is of use until the next is asked for."""
        if not boxes:
            return
        lows, highs = (np.array([box[corner] for box in boxes]) for corner in (0, 1))
        placed = self._bounds.place(self._full, (lows + highs) / 2)
        axes, turns = self._bounds.axes(placed), (highs - lows) / 2
        number = np.repeat(np.arange(len(boxes)), [len(box.pairs) for box in boxes])
        pairs = np.concatenate([box.pairs for box in boxes])
        moved_m = self._bounds.motions_m(placed, turns, number, self.checked.numbers[pairs])
        gaps_m = self.checked.gaps_m(placed.shapes, number, pairs)
        for k, box in enumerate(boxes):
            at = placed.shapes[k], ArmPose(axes[k], placed.joints[k, :, :3, 3])
            known = gaps_m[number == k], moved_m[number == k]
            yield BoxView(self.checked, self._hulls, box, at, known)
