"""Rows found by a kernel in C, which `rows.c` describes; compiled once where there is a compiler.

`Kernel.search` works on arrays: where trees of clusters are, and which pairs of them must keep
apart while an arm moves. The planner proves motions by it. `Kernel.rows` finds the rows of one step
of a certificate.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Sequence
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from baxter_kin.compilation.machine_code import built, key_of
from planner.certificate.boxes import BoxTrace, Tube
from planner.certificate.clusters import Clusters, Shape
from planner.certificate.intervals import Array
from planner.certificate.motion import Polynomials
from planner.certificate.robot import ARM_JOINTS
from planner.certificate.rows import Step, Trace
from planner.prover.problem import (
    PAIR,
    SPARE_M,
    BoxesFound,
    Chain,
    Found,
    Near,
    NotShownError,
    Outcome,
    PlacedShapes,
    Rows,
)

MAX_LETTERS = 1 << 19
"""Maximum number of letters of one step."""

MAX_BOXES = 40_000
"""Maximum number of letters of one tube; most take some hundreds."""

SINGLE = 1.2e-7
"""Rounding of points, which are in single precision here, relative to the size of all trees."""

_VERSION = 6

MANY, CELLS = 512, 6 * 4**3
"""Nodes of `MANY` points or more have lists of them for `CELLS` cells of directions (`rows.c`)."""


class _Tree(ctypes.Structure):
    _fields_ = [
        (name, ctypes.c_void_p)
        for name in (
            *("x", "y", "z", "first", "count", "children", "low", "high", "reach"),
            *("lists", "begins", "listed"),
        )
    ]


class _Step(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_int32) for name in ("joints", "pairs", "pieces", "orders", "kinks")),
        *((name, ctypes.c_double) for name in ("duration", "slack", "spare", "margin", "share")),
        *((name, ctypes.c_void_p) for name in ("t", "derivatives", "v_peak", "a_peak")),
        *((name, ctypes.c_void_p) for name in ("kinks_s", "jumps")),
        *((name, ctypes.c_void_p) for name in ("spans_R", "spans_p", "offsets")),
    ]


class _Tube(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_int32) for name in ("instants", "shortest", "base")),
        *((name, ctypes.c_void_p) for name in ("low", "high")),
    ]


class _Result(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_int64) for name in ("tasks", "directions", "fine")),
        *(
            (name, ctypes.c_double)
            for name in ("nearest", "nearest_s", "proven", "found", "found_s")
        ),
        *((name, ctypes.c_int32) for name in ("nearest_pair", "found_pair")),
    ]


class _LaidOut:
    """The arrays of one tree, in the layout of `rows.c`."""

    def __init__(self, shape: Shape, lay_out: Any) -> None:
        nodes = shape.size
        columns = (np.ascontiguousarray(column, np.float32) for column in shape.points.T)
        tree = (np.ascontiguousarray(x, np.int32) for x in (shape.counts, shape.children))
        boxes = np.empty((2, nodes, 3), np.float32)
        first, reach = np.empty(nodes, np.int32), np.empty(nodes, np.float32)
        many = shape.counts[shape.counts >= MANY]
        room = int(many.sum()) * CELLS // 8
        begins = np.empty(len(many) * CELLS + 1, np.int32)
        lists = np.empty(nodes, np.int32), begins, np.empty(room, np.uint16)
        self._arrays = (*columns, first, *tree, *boxes, reach, *lists)
        self.tree = _Tree(*(array.ctypes.data for array in self._arrays))
        lay_out(ctypes.c_int32(nodes), ctypes.byref(self.tree), ctypes.c_int32(room))


_PLACED = np.dtype(
    [
        ("tree", np.int32),
        ("has_apex", np.int32),
        ("joined", np.int32, 2),
        ("R", np.float64, (3, 3)),
        ("p", np.float64, 3),
        ("ball", np.float64),
        ("disc", np.float64),
        ("apex", np.float64, 3),
    ],
    align=True,
)

SOURCES = ("rows.c", "boxes.c")

_FAR_M = 1e8
"""Distances above this stand for none."""

_TRIAL = "import ctypes, sys; sys.exit(ctypes.CDLL(sys.argv[1]).rows_version() != int(sys.argv[2]))"


@cache
def rows_kernel() -> Kernel | None:
    """The compiled kernel; None without a C compiler or when compilation fails."""
    return built(_Source())


class _Source:
    """The C of the kernel."""

    instead = "NumPy"

    @property
    def source(self) -> str:
        folder = resources.files("planner.prover")
        return "".join(folder.joinpath(name).read_text("utf-8") for name in SOURCES)

    @property
    def key(self) -> str:
        return key_of(self.source)

    def load(self, library: Path) -> Kernel | None:
        try:
            return Kernel(str(library))
        except OSError:
            return None

    def trial(self, library: Path) -> Sequence[str]:
        return (sys.executable, "-c", _TRIAL, str(library), str(_VERSION))


class Kernel:
    """The loaded library."""

    def __init__(self, library: str) -> None:
        """Load a shared library.

        Raises:
            OSError: when it is no kernel, or of another version.
        """
        found = ctypes.CDLL(library)
        try:
            self._find, version = found.find_rows, found.rows_version()
            self._find_in_boxes = found.find_box_rows
        except AttributeError as cause:
            raise OSError(f"{library} has no rows") from cause
        if version != _VERSION:
            raise OSError(f"{library} has version {version} of rows")
        self._lay_out = found.lay_out
        self._trees: WeakKeyDictionary[Shape, _LaidOut] = WeakKeyDictionary()

    def tree(self, shape: Shape) -> _LaidOut:
        """The arrays of a shape, laid out once."""
        known = self._trees.get(shape)
        if known is None:
            known = self._trees[shape] = _LaidOut(shape, self._lay_out)
        return known

    def search(
        self,
        chain: Chain,
        trees: Trees,
        pairs: np.ndarray[Any, Any],
        motion: Polynomials | Array,
        *,
        margin_m: float = 0.0,
        share: float,
    ) -> Found:
        """Find rows that show that pairs of trees keep apart.

        Args:
            chain: the arm that moves.
            trees: all clusters.
            pairs: of type `PAIR`, shape (n,).
            motion: of its n joints; or their position, shape (n,), rad, while some trees slide.
            margin_m: clearance of counted pairs, where they need not keep more.
            share: of the smallest distance found, what is to be proven as well.
        """
        none = np.zeros(1)
        own: tuple[Any, ...] = (none, motion, none, none, none, none)
        sizes, duration_s, slack_m = (0, 0, 0), 1.0, 0.0
        if isinstance(motion, Polynomials):
            own = (motion.t, motion.derivatives, motion.v_peak, motion.a_peak)
            own = (*own, motion.kinks_s, motion.kinks)
            sizes = (*motion.derivatives.shape[:2], len(motion.kinks_s))
            slides_m = float(np.abs(pairs["slides"]).max(initial=0.0))
            reach_m = (trees.size_m + float(chain.offsets.sum()) + slides_m) * (1.0 + 1e-9)
            duration_s, slack_m = motion.duration_s, motion.slack_m(reach_m)
        held = [np.ascontiguousarray(x, np.float64) for x in (*own, *chain[:3])]
        spare_m = SPARE_M + SINGLE * trees.size_m
        request = _Step(
            len(chain.offsets),
            len(pairs),
            *sizes,
            duration_s,
            slack_m,
            spare_m,
            margin_m,
            share,
            *(array.ctypes.data for array in held),
        )
        letters = np.empty(MAX_LETTERS, np.uint8)
        directions = np.empty((MAX_LETTERS, 3), np.int8)
        fine = np.empty((MAX_LETTERS, 3), np.int16)
        result = _Result()
        outcome = self._find(
            trees.array,
            *(ctypes.c_void_p(array.ctypes.data) for array in (trees.placed, pairs)),
            ctypes.byref(request),
            *(ctypes.c_void_p(array.ctypes.data) for array in (letters, directions, fine)),
            ctypes.c_int64(MAX_LETTERS),
            ctypes.byref(result),
        )
        return Found(
            Outcome(outcome),
            *_ends(result, spare_m),
            letters[: result.tasks],
            directions[: result.directions],
            fine[: result.fine],
        )

    def search_tube(
        self,
        chain: Chain,
        trees: Trees,
        pairs: np.ndarray[Any, Any],
        tube: Tube,
        *,
        margin_m: float = 0.0,
        share: float,
    ) -> BoxesFound:
        """Find rows that show that pairs of trees keep apart at all positions in a tube.

        Args:
            chain: the arm that moves, or both, of which one is passed backwards to base.
            trees: all clusters.
            pairs: of type `PAIR`, shape (n,), all counted; their windows and gaps are not used.
            tube: bounds on its joints.
            margin_m: clearance of all pairs.
            share: of the smallest distance found, what is to be proven as well.
        """
        return self._in_tube(chain, trees, pairs, (tube, 0), (margin_m, share))[0]

    def unproven_cells(
        self, chain: Chain, trees: Trees, pairs: np.ndarray[Any, Any], tube: Tube, shortest: int
    ) -> NDArray[np.bool_]:
        """Whether some pair is not shown to be apart in each cell of a tube, shape (n,).

        Time is not cut into spans shorter than `shortest` cells. Other arguments as for
        `search_tube`.
        """
        found, is_open = self._in_tube(chain, trees, pairs, (tube, shortest), (0.0, 0.0))
        return is_open | (found.outcome != Outcome.PROVEN)

    def _in_tube(
        self,
        chain: Chain,
        trees: Trees,
        pairs: np.ndarray[Any, Any],
        bounds: tuple[Tube, int],
        asked: tuple[float, float],
    ) -> tuple[BoxesFound, NDArray[np.bool_]]:
        tube, shortest = bounds
        if max(chain.base, chain.joints - chain.base) > ARM_JOINTS:
            raise ValueError(f"a tube is of one arm or two; the chain has {chain.joints} joints")
        spare_m = SPARE_M + SINGLE * trees.size_m
        held = [np.ascontiguousarray(x, np.float64) for x in (*chain[:3], tube.low, tube.high)]
        at = [array.ctypes.data for array in held]
        request = _Step(
            joints=chain.joints,
            pairs=len(pairs),
            duration=1.0,
            spare=spare_m,
            margin=asked[0],
            share=asked[1],
            spans_R=at[0],
            spans_p=at[1],
            offsets=at[2],
        )
        allowed = _Tube(len(tube.low), shortest, chain.base, *at[3:])
        letters, directions = np.empty(MAX_BOXES, np.uint8), np.empty((MAX_BOXES, 3))
        is_open, q = np.zeros(len(tube.low) - 1, np.bool_), np.zeros(chain.joints)
        result = _Result()
        outcome = self._find_in_boxes(
            trees.array,
            *(ctypes.c_void_p(array.ctypes.data) for array in (trees.placed, pairs)),
            ctypes.byref(request),
            ctypes.byref(allowed),
            *(ctypes.c_void_p(array.ctypes.data) for array in (letters, directions)),
            ctypes.c_int64(MAX_BOXES),
            *(ctypes.c_void_p(array.ctypes.data) for array in (is_open, q)),
            ctypes.byref(result),
        )
        found = BoxesFound(
            Outcome(outcome),
            *_ends(result, spare_m),
            q,
            BoxTrace(letters[: result.tasks].astype(np.intp), directions[: result.directions]),
        )
        return found, is_open

    def rows(
        self, chain: Chain, trees: Trees, step: Step, *, margin_m: float = 0.0, share: float
    ) -> Rows:
        """Find the rows of one step.

        Args:
            chain: the arm that moves.
            trees: all clusters of the step.
            step: the step and its pairs.
            margin_m: clearance of counted pairs, where they need not keep more.
            share: of the smallest distance found, what is to be proven as well.

        Raises:
            NotShownError: when none are found.
        """
        motion = step.q if step.motion is None else step.motion
        pairs = trees.pairs(step)
        found = self.search(chain, trees, pairs, motion, margin_m=margin_m, share=share)
        if found.outcome == Outcome.TOO_MUCH:
            raise NotShownError(f"{step.label}: it needs more rows than are checked")
        if found.outcome != Outcome.PROVEN:
            raise NotShownError.of(step, found.stopped)
        letters = found.letters.astype(np.intp)
        stated = (x.astype(np.float64) for x in (found.directions, found.fine))
        return Rows(Trace(letters, *stated), found.proven_m)


def _ends(result: _Result, spare_m: float) -> tuple[float, Near, Near]:
    """What was proven, the nearest pair, and the pair at which the search stopped."""
    nearest_m = result.nearest if result.nearest < _FAR_M else np.inf
    return (
        result.proven - spare_m if result.proven < _FAR_M else np.inf,
        Near(result.nearest_pair, nearest_m, result.nearest_s),
        Near(result.found_pair, result.found, result.found_s),
    )


class Trees:
    """Trees of clusters and their poses, in the layout of the kernel.

    Attributes:
        array: of all shapes.
        placed: of all trees.
        size_m: maximum distance of any point from the frame that carries it.
    """

    def __init__(self, kernel: Kernel, there: PlacedShapes) -> None:
        """Lay out shapes that were not laid out before."""
        shapes, R, p, thicker_m = there
        number = {shape: i for i, shape in enumerate(dict.fromkeys(shapes))}
        self._held = [kernel.tree(shape) for shape in number]
        self.array = (_Tree * len(number))(*(tree.tree for tree in self._held))
        self.placed = np.zeros(len(shapes), _PLACED)
        self.placed["tree"] = [number[shape] for shape in shapes]
        self.placed["joined"] = -1
        self.placed["R"], self.placed["p"] = R, p
        self.placed["ball"] = np.array([shape.ball_m for shape in shapes]) + thicker_m
        self.placed["disc"] = [shape.disc_m for shape in shapes]
        self._place: dict[int, int] = {}
        reach = np.array([shape.reach_m for shape in shapes]) + thicker_m
        self.size_m = float((reach + np.linalg.norm(p, axis=1)).max(initial=0.0)) * (1.0 + 1e-9)

    @classmethod
    def of(cls, kernel: Kernel, clusters: Clusters) -> Trees:
        """All clusters of a problem so far."""
        placed = clusters.placed
        R = np.array([each.R for each in placed]).reshape(-1, 3, 3)
        p = np.array([each.p for each in placed]).reshape(-1, 3)
        shapes = [each.shape for each in placed]
        trees = cls(kernel, PlacedShapes(shapes, R, p, np.zeros(len(placed))))
        for row, each in zip(trees.placed, placed, strict=True):
            if each.joined is not None:
                row["joined"] = each.joined
            if each.apex is not None:
                row["has_apex"], row["apex"] = 1, each.apex
        trees._place = {each.root: i for i, each in enumerate(placed)}
        trees.size_m = clusters.reach_m
        return trees

    def pairs(self, step: Step) -> np.ndarray[Any, Any]:
        """The pairs of a step, of type `PAIR`."""
        found = np.zeros(len(step.pairs), PAIR)
        found[:] = [
            (
                self._place[pair.first.root],
                self._place[pair.second.root],
                pair.first.level,
                pair.second.level,
                pair.is_counted,
                pair.least_m,
                pair.begin_s,
                pair.end_s,
                (*pair.first.slide_m, *pair.second.slide_m),
            )
            for pair in step.pairs
        ]
        return found
