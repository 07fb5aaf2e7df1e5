"""Proof over a tube: how far apart shapes stay wherever in a tube the joints of an arm are.

Rows over boxes of joint angles prove it; `planner.certificate.boxes` states the lemma. What the
tube allows between two of its instants is a box; a pair of clusters is separated in it by a
direction, or one of the clusters is cut, or the box: in time where it is the motion that makes it
large, across a joint where the tube itself is wide. A kernel in C finds the rows; without a C
compiler NumPy does, and proves less.

The least distance at places where the arm may be bounds what can be proven from above; 0.98 of it
is proven, less where that cannot be shown. Where shapes of triangles are nowhere touched in the
tube, nothing gets inside of one, as the tube is connected; whether something is inside is checked
in its first instant.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from baxter_kin.validation import FloatArray, Indices
from planner.certificate.boxes import Tube
from planner.clearance import Clearance
from planner.collision.checker import ClearanceChecker
from planner.collision.continuous.joint_tube import JointTube
from planner.collision.continuous.proof import (
    Arrangement,
    is_any_inside,
    worst_at,
)
from planner.prover.kernel import Trees, rows_kernel
from planner.prover.numpy_boxes import search_tube, unproven_cells
from planner.prover.numpy_search import laid_out
from planner.prover.problem import SHARES, BoxesFound, Outcome

MIN_CELLS = 4
"""Time is not cut finer than so many cells of a tube to find out when contacts may happen."""


@dataclass(frozen=True, slots=True)
class TubeClearance:
    """What is known of a tube.

    Attributes:
        proven_m: nowhere in it does a pair come nearer than this.
        nearest: the least distance that was found where the arm may be; when, in the tube's time.
        margin_m: what was asked for.
        boxes: how many pairs of clusters and boxes were looked at.
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
    """Proofs in one situation."""

    def __init__(self, checker: ClearanceChecker, full: FloatArray) -> None:
        """For a full configuration, shape (19,), that says where all other joints stand."""
        self._checker, self._full = checker, full
        self._arrangement = Arrangement.of_mover(checker, full)

    def prove(
        self,
        tube: JointTube,
        *,
        pairs: Indices,
        margin_m: float = 0.0,
        is_tight: bool = True,
    ) -> TubeClearance:
        """How far apart pairs of shapes stay in a tube.

        Args:
            tube: of the joints of the arm.
            pairs: their numbers.
            margin_m: what shall be proven, if it can be.
            is_tight: whether more than the margin shall be proven, as much as can be.
        """
        checked = self._checker.checked
        numbers = np.unique(checked.alike[pairs])
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
            return self._contact(self._poses(found.q), numbers, at_s, margin_m, size)
        near = Clearance(np.inf, "", "")
        if pair >= 0:
            near = checked.between(int(numbers[pair]), distance_m, float(tube.times_s[int(at)]))
        proven_m = found.proven_m if found.outcome == Outcome.PROVEN else 0.0
        return TubeClearance(min(proven_m, distance_m), near, margin_m, size)

    def unproven_cells(self, tube: JointTube, pairs: Indices) -> NDArray[np.bool_]:
        """In which cells of a tube some pairs are not proven to be apart, shape (cells,)."""
        numbers = np.unique(self._checker.checked.alike[pairs])
        if not len(numbers):
            return np.zeros(tube.cells, dtype=np.bool_)
        kernel, arranged = rows_kernel(), self._arrangement
        there, rows = arranged.placed(numbers)
        allowed = Tube(tube.lowest, tube.highest)
        if kernel is None:
            clusters, of = laid_out(there, rows)
            return unproven_cells(arranged.chain, clusters, of, allowed, MIN_CELLS)
        trees = Trees(kernel, there)
        return kernel.unproven_cells(arranged.chain, trees, rows, allowed, MIN_CELLS)

    def _found(
        self, tube: JointTube, numbers: Indices, margin_m: float, shares: Sequence[float]
    ) -> BoxesFound:
        """Search for rows that keep the first share of the least distance that can be shown."""
        kernel, arranged = rows_kernel(), self._arrangement
        there, rows = arranged.placed(numbers)
        allowed = Tube(tube.lowest, tube.highest)
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
        """What coal measures of the pair that comes nearest at some poses."""
        checked = self._checker.checked
        number, distance_m = worst_at(checked, poses, numbers, checked.needed_m(margin_m))
        near = checked.between(number, distance_m, time_s)
        return TubeClearance(min(distance_m, margin_m), near, margin_m, size)

    def _poses(self, q: FloatArray) -> FloatArray:
        bounds = self._checker.motion_bounds
        found: FloatArray = bounds.place(self._full, q[None]).shapes[0]
        return found
