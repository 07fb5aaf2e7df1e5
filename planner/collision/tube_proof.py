"""Proof over a tube: the distance that shapes keep wherever in a tube the joints of arms are.

A `JointTube` bounds every joint at every time. Rows over boxes of joint angles prove the distance;
`planner.certificate.boxes` states the lemma. The tube between two of its instants is a box. A pair
of clusters is separated in it by a direction, or one of the clusters is split, or the box: in time
where the motion makes it large, across a joint where the tube itself is wide. A kernel in C finds
the rows; without a C compiler NumPy does, and proves less.

The smallest distance measured at configurations in the tube is an upper bound on the provable
distance; the search proves 0.98 of it, or less where that fails. Where shapes of triangles are not
touched anywhere in the tube, nothing gets inside one, as the tube is connected; whether something
is inside is checked in its first instant.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from baxter_kin.display import count, seconds
from baxter_kin.fields import array, frozen
from baxter_kin.validation import FloatArray, Indices
from planner.certificate.boxes import Tube
from planner.clearance import Clearance
from planner.collision.checker import ClearanceChecker
from planner.collision.proof import (
    Arrangement,
    is_any_inside,
    worst_at,
)
from planner.errors import MotionError
from planner.prover.kernel import Trees, rows_kernel
from planner.prover.numpy_boxes import search_tube, unproven_cells
from planner.prover.numpy_search import laid_out
from planner.prover.problem import SHARES, BoxesFound, Outcome

MIN_CELLS = 4
"""Number of cells of a tube below which time is not split to find when contacts may happen."""


@frozen(error=MotionError)
class JointTube:
    """Bounds on n joints at m + 1 instants, each monotone between neighbouring instants.

    So the hull of the bounds at two neighbouring instants contains the tube between them.

    Attributes:
        times_s: of the instants, shape (m + 1,), increasing.
        lowest: shape (m + 1, n), rad.
        highest: shape (m + 1, n), rad, nowhere below `lowest`.
    """

    times_s: FloatArray = array(None)
    lowest: FloatArray = array(None, None)
    highest: FloatArray = array(None, None)

    @property
    def cells(self) -> int:
        """Number of intervals between neighbouring instants, m."""
        return len(self.times_s) - 1

    @property
    def widths(self) -> FloatArray:
        """Distance of the bounds of each joint at each instant, shape (m + 1, n), rad."""
        return self.highest - self.lowest

    def hull(self, first: int, last: int) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds between two instants, by their numbers, each of shape (n,)."""
        some = slice(first, last + 1)
        lowest: FloatArray = self.lowest[some].min(axis=0)
        highest: FloatArray = self.highest[some].max(axis=0)
        return lowest, highest

    def between(self, start_s: float, end_s: float) -> JointTube:
        """The tube of the cells that overlap the time from `start_s` to `end_s`; at least one."""
        first = int(np.searchsorted(self.times_s, start_s, side="right")) - 1
        last = int(np.searchsorted(self.times_s, end_s, side="left"))
        first = min(max(first, 0), self.cells - 1)
        some = slice(first, min(max(last, first + 1), self.cells) + 1)
        return JointTube(self.times_s[some], self.lowest[some], self.highest[some])

    def widened(self, by_rad: FloatArray) -> JointTube:
        """The tube widened in both directions, for each joint by `by_rad`, shape (n,), rad."""
        return JointTube(self.times_s, self.lowest - by_rad, self.highest + by_rad)

    def _facts(self) -> tuple[str, ...]:
        width = float(self.widths.max(initial=0.0))
        length_s = float(self.times_s[-1] - self.times_s[0])
        return count(self.cells, "cell"), seconds(length_s), f"up to {width:.3g} rad wide"


@dataclass(frozen=True, slots=True)
class TubeClearance:
    """The result of a proof over a tube.

    Attributes:
        proven_m: minimum distance of all pairs anywhere in the tube.
        nearest: the smallest distance that was measured in the tube; its time is the tube's.
        margin_m: the required distance.
        boxes: number of pairs of clusters and boxes that were examined.
    """

    proven_m: float
    nearest: Clearance
    margin_m: float
    boxes: int

    @property
    def is_clear(self) -> bool:
        """Whether all pairs keep more than the margin."""
        return self.proven_m > self.margin_m


class TubeProofs:
    """Proofs over tubes in one situation."""

    def __init__(self, checker: ClearanceChecker, full: FloatArray) -> None:
        """Take a full configuration, shape (19,), for all joints but those that move.

        With two arms, only pairs of one arm, and what it carries, with the other are proven.
        """
        self._checker, self._full = checker, full
        self._walk = checker.walk.from_hand
        self._arrangement = Arrangement.of_mover(checker, full, self._walk)

    def prove(
        self,
        tube: JointTube,
        *,
        pairs: Indices,
        margin_m: float = 0.0,
        is_tight: bool = True,
    ) -> TubeClearance:
        """Prove a distance that pairs of shapes keep in a tube.

        Args:
            tube: of the joints of the arm, or of both, the left arm's first.
            pairs: numbers of the pairs.
            margin_m: the required distance.
            is_tight: whether to prove as large a distance as possible, not the margin only.
        """
        checked = self._checker.checked
        numbers = np.unique(checked.representatives[pairs])
        if not len(numbers):
            return TubeClearance(np.inf, Clearance(np.inf, "", ""), margin_m, 0)
        first = self._poses((tube.lowest[0] + tube.highest[0]) / 2)
        if is_any_inside(checked, first, numbers):
            return self._contact(first, numbers, float(tube.times_s[0]), margin_m, 0)
        found = self._found(tube, numbers, margin_m, SHARES if is_tight else SHARES[-1:])
        size = len(found.trace.letters)
        pair, distance_m, at = found.nearest
        if found.outcome == Outcome.TOO_NEAR:
            at_s = float(tube.times_s[int(found.stopped.time_s)])
            poses = self._poses(self._walk.of_mover(found.q))
            return self._contact(poses, numbers, at_s, margin_m, size)
        near = Clearance(np.inf, "", "")
        if pair >= 0:
            near = checked.clearance_of(
                int(numbers[pair]), distance_m, float(tube.times_s[int(at)])
            )
        proven_m = found.proven_m if found.outcome == Outcome.PROVEN else 0.0
        return TubeClearance(min(proven_m, distance_m), near, margin_m, size)

    def unproven_cells(self, tube: JointTube, pairs: Indices) -> NDArray[np.bool_]:
        """Whether some pair is not proven to be apart in each cell of a tube, shape (cells,)."""
        numbers = np.unique(self._checker.checked.representatives[pairs])
        if not len(numbers):
            return np.zeros(tube.cells, dtype=np.bool_)
        kernel, arranged = rows_kernel(), self._arrangement
        there, rows = arranged.placed(numbers)
        allowed = Tube(*self._walk.bounds_along(tube.lowest, tube.highest))
        if kernel is None:
            clusters, of = laid_out(there, rows)
            return unproven_cells(arranged.chain, clusters, of, allowed, MIN_CELLS)
        trees = Trees(kernel, there)
        return kernel.unproven_cells(arranged.chain, trees, rows, allowed, MIN_CELLS)

    def _found(
        self, tube: JointTube, numbers: Indices, margin_m: float, shares: Sequence[float]
    ) -> BoxesFound:
        """Search for rows that prove the first possible share of the smallest distance."""
        kernel, arranged = rows_kernel(), self._arrangement
        there, rows = arranged.placed(numbers)
        allowed = Tube(*self._walk.bounds_along(tube.lowest, tube.highest))
        if kernel is None:
            return search_tube(arranged.chain, *laid_out(there, rows), allowed, margin_m)
        trees = Trees(kernel, there)
        for share in shares:
            asked = {"margin_m": margin_m, "share": share}
            found = kernel.search_tube(arranged.chain, trees, rows, allowed, **asked)
            if found.outcome in (Outcome.PROVEN, Outcome.TOO_NEAR):
                break
        return found

    def _contact(
        self, poses: FloatArray, numbers: Indices, time_s: float, margin_m: float, size: int
    ) -> TubeClearance:
        """The result for the pair that is nearest at some poses, as measured by coal."""
        checked = self._checker.checked
        number, distance_m = worst_at(checked, poses, numbers, checked.required_m(margin_m))
        near = checked.clearance_of(number, distance_m, time_s)
        return TubeClearance(min(distance_m, margin_m), near, margin_m, size)

    def _poses(self, q: FloatArray) -> FloatArray:
        bounds = self._checker.motion_bounds
        found: FloatArray = bounds.place(self._full, q[None]).shapes[0]
        return found
