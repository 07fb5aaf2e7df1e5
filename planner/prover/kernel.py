"""Rows by a kernel in C, which `rows.c` describes; compiled once where a C compiler is found."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from baxter_kin.compilation.machine_code import built, key_of
from planner.certificate.clusters import Clusters, Shape
from planner.certificate.errors import NotCertifiedError
from planner.certificate.intervals import Array
from planner.certificate.robot import Robot
from planner.certificate.rows import Step, Trace

LANES = 8
"""Points of each node are padded to a multiple of this by repeating the last one."""

MOST_LETTERS = 1 << 19
"""Of one step."""

SPARE_M = 1e-7
"""By how much more than needed a row must conclude, so that the checker's rounding agrees."""

SINGLE = 1.2e-7
"""The same as a share of the size of what is placed: points are in single precision here."""

_VERSION = 1


@dataclass(frozen=True, eq=False)
class Rows:
    """What leads the checker through one step.

    Attributes:
        trace: letters of all levels, and directions.
        proven_m: what counted pairs keep at every instant, as the checker will find too; inf where
            none counts.
    """

    trace: Trace
    proven_m: float


class NotShownError(NotCertifiedError):
    """Rows do not show that all pairs keep what they must."""


def not_shown(step: Step, pair: int, distance_m: float, time_s: float) -> NotShownError:
    """The error that says which pair comes too near."""
    first, second = step.pairs[pair].first.name, step.pairs[pair].second.name
    return NotShownError(
        f"{step.label}: {first} and {second} come as near as {1e3 * distance_m:.3f} mm at "
        f"{time_s:.4f} s"
    )


class _Tree(ctypes.Structure):
    _fields_ = [
        (name, ctypes.c_void_p)
        for name in ("x", "y", "z", "first", "count", "children", "low", "high", "reach")
    ]


class _Step(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_int32) for name in ("pairs", "pieces")),
        *((name, ctypes.c_double) for name in ("duration", "slack", "spare", "margin", "share")),
        *((name, ctypes.c_void_p) for name in ("t", "q", "v", "a", "j", "v_peak", "a_peak")),
        *((name, ctypes.c_void_p) for name in ("spans_R", "spans_p", "offsets")),
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
    """The arrays of one tree."""

    def __init__(self, shape: Shape, lay_out: Any) -> None:
        points = np.ascontiguousarray(shape.points, np.float32)
        counts = np.ascontiguousarray(shape.counts, np.int32)
        nodes, room = len(counts), int((-(-counts // LANES) * LANES).sum())
        self._arrays = (
            *np.empty((3, room), np.float32),
            *np.empty((2, nodes), np.int32),
            np.ascontiguousarray(shape.children, np.int32),
            *np.empty((2, nodes, 3)),
            np.empty(nodes),
        )
        self.tree = _Tree(*(array.ctypes.data for array in self._arrays))
        given = (ctypes.c_void_p(array.ctypes.data) for array in (points, counts))
        lay_out(*given, ctypes.c_int32(nodes), ctypes.byref(self.tree))


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

_PAIR = np.dtype(
    [
        *((name, np.int32) for name in ("first", "second", "k", "m", "is_counted")),
        *((name, np.float64) for name in ("least", "begin", "end")),
        ("slides", np.float64, 4),
    ],
    align=True,
)

_FAR_M = 1e8
"""More than this stands for no distance at all."""

_PROVEN, _TOO_NEAR, _NOT_SHOWN = range(3)

_TRIAL = "import ctypes, sys; sys.exit(ctypes.CDLL(sys.argv[1]).rows_version() != int(sys.argv[2]))"


@cache
def rows_kernel() -> Kernel | None:
    """The kernel, compiled; None without a C compiler or when anything fails."""
    return built(_Source())


class _Source:
    """The C of the kernel."""

    instead = "NumPy"

    @property
    def source(self) -> str:
        return resources.files("planner.prover").joinpath("rows.c").read_text("utf-8")

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
    """The library, loaded."""

    def __init__(self, library: str) -> None:
        """Load it.

        Raises:
            OSError: when it cannot be loaded, or is another.
        """
        found = ctypes.CDLL(library)
        try:
            self._find, version = found.find_rows, found.rows_version()
        except AttributeError as cause:
            raise OSError(f"{library} has no rows") from cause
        if version != _VERSION:
            raise OSError(f"{library} has version {version} of rows")
        self._lay_out = found.lay_out
        self._trees: WeakKeyDictionary[Shape, _LaidOut] = WeakKeyDictionary()

    def tree(self, shape: Shape) -> _LaidOut:
        """A shape as the kernel reads it, laid out once."""
        known = self._trees.get(shape)
        if known is None:
            known = self._trees[shape] = _LaidOut(shape, self._lay_out)
        return known

    def rows(
        self, robot: Robot, trees: Trees, step: Step, *, margin_m: float = 0.0, share: float
    ) -> Rows:
        """Rows of one step.

        Args:
            robot: whose arm moves.
            trees: all clusters of the step.
            step: what must keep apart.
            margin_m: what counted pairs must keep, where they need not keep more.
            share: how much of the least distance that is met shall be proven.

        Raises:
            NotShownError: when a pair is not shown to keep what it must, or that takes too many.
        """
        pairs, held = trees.pairs(step), _motion(robot, step)
        cubics = step.cubics
        spare_m = SPARE_M + SINGLE * trees.size_m
        request = _Step(
            len(pairs),
            0 if cubics is None else len(cubics.j),
            step.duration_s,
            0.0 if cubics is None else cubics.slack_m(step.reach_m(robot, trees.size_m)),
            spare_m,
            margin_m,
            share,
            *(array.ctypes.data for array in held),
        )
        letters = np.empty(MOST_LETTERS, np.uint8)
        directions = np.empty((MOST_LETTERS, 3), np.int8)
        fine = np.empty((MOST_LETTERS, 3), np.int16)
        result = _Result()
        outcome = self._find(
            trees.array,
            *(ctypes.c_void_p(array.ctypes.data) for array in (trees.placed, pairs)),
            ctypes.byref(request),
            *(ctypes.c_void_p(array.ctypes.data) for array in (letters, directions, fine)),
            ctypes.c_int64(MOST_LETTERS),
            ctypes.byref(result),
        )
        if outcome in (_TOO_NEAR, _NOT_SHOWN):
            raise not_shown(step, result.found_pair, result.found, result.found_s)
        if outcome != _PROVEN:
            raise NotShownError(f"{step.label}: it takes more rows than are checked")
        return Rows(
            Trace(
                letters[: result.tasks].astype(np.intp),
                directions[: result.directions].astype(np.float64),
                fine[: result.fine].astype(np.float64),
            ),
            result.proven - spare_m if result.proven < _FAR_M else np.inf,
        )


class Trees:
    """All clusters of a problem as the kernel reads them."""

    def __init__(self, kernel: Kernel, clusters: Clusters) -> None:
        """Read those that are there; what is added later is not among them."""
        placed = clusters.placed
        kinds = dict.fromkeys(each.shape for each in placed)
        number = {shape: i for i, shape in enumerate(kinds)}
        self._held = [kernel.tree(shape) for shape in number]
        self.array = (_Tree * len(number))(*(tree.tree for tree in self._held))
        self.placed = np.zeros(len(placed), _PLACED)
        for row, each in zip(self.placed, placed, strict=True):
            shape = each.shape
            row["tree"], row["joined"] = number[shape], each.joined or (-1, -1)
            row["R"], row["p"], row["ball"], row["disc"] = (
                each.R,
                each.p,
                shape.ball_m,
                shape.disc_m,
            )
            if each.apex is not None:
                row["has_apex"], row["apex"] = 1, each.apex
        self._place = {each.root: i for i, each in enumerate(placed)}
        self.size_m = clusters.reach_m

    def pairs(self, step: Step) -> np.ndarray[Any, Any]:
        """The pairs of a step."""
        found = np.zeros(len(step.pairs), _PAIR)
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


def _motion(robot: Robot, step: Step) -> Sequence[Array]:
    """Arrays of a step and of the robot, in the kernel's order."""
    cubics, none = step.cubics, np.zeros(1)
    own: Sequence[Array] = (none, step.q, none, none, none, none, none)
    if cubics is not None:
        own = (cubics.t, cubics.q, cubics.v, cubics.a, cubics.j, cubics.v_peak, cubics.a_peak)
    R = np.array([span.R.centred()[0] for span in robot.spans])
    p = np.array([span.p.centred()[0] for span in robot.spans])
    return [np.ascontiguousarray(x, np.float64) for x in (*own, R, p, robot.offsets)]
