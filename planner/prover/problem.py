"""The problem of finding rows, and what a search returns; the same for the kernel and for NumPy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np

from planner.certificate.boxes import BoxTrace
from planner.certificate.clusters import Shape
from planner.certificate.errors import NotCertifiedError
from planner.certificate.intervals import Array, Interval, Pose
from planner.certificate.rows import Joints, Step, Trace

SHARES = (0.98, 0.9, 0.5, 0.0)
"""Shares of the smallest distance found that are to be proven; the next where one cannot be."""

SPARE_M = 1e-7
"""By how much the conclusion of a row must exceed what is needed, for the checker's rounding."""


class Chain(NamedTuple):
    """A serial chain of n joints, each of which turns about the z axis of its frame.

    Attributes:
        R, p: poses of each joint at position 0 seen from the one before, the first from base,
            shapes (n, 3, 3) and (n, 3).
        offsets: lengths of p, shape (n,), m.
        base: number of joints before base: 0, or those of an arm that is passed backwards.
    """

    R: Array
    p: Array
    offsets: Array
    base: int = 0

    @property
    def joints(self) -> int:
        """Number of joints, n."""
        return len(self.offsets)

    @classmethod
    def of(cls, robot: Joints) -> Chain:
        """The chain of a robot's arm that moves, or of both arms."""
        R, p = ([getattr(span, x).centred()[0] for span in robot.spans] for x in ("R", "p"))
        return cls(np.array(R), np.array(p), robot.offsets, robot.base)

    @property
    def spans(self) -> Sequence[Pose]:
        """The same poses, in the form of the checker's code."""
        return [Pose(Interval(R), Interval(p)) for R, p in zip(self.R, self.p, strict=True)]

    @classmethod
    def of_poses(cls, T: Array) -> Chain:
        """From the pose of each joint at position 0 seen from the one before, (n, 4, 4)."""
        R, p = T[:, :3, :3], T[:, :3, 3]
        return cls(R, p, np.linalg.norm(p, axis=1))


class PlacedShapes(NamedTuple):
    """Shapes and their poses.

    Attributes:
        shapes: n shapes.
        R, p: their poses in the frames that carry them, shapes (n, 3, 3) and (n, 3).
        thicker_m: by how much each is widened, shape (n,), m.
    """

    shapes: Sequence[Shape]
    R: Array
    p: Array
    thicker_m: Array


PAIR = np.dtype(
    [
        *((name, np.int32) for name in ("first", "second", "k", "m", "is_counted")),
        *((name, np.float64) for name in ("least", "begin", "end")),
        ("slides", np.float64, 4),
    ],
    align=True,
)


class Outcome(IntEnum):
    """Outcome of a search, numbered as in `rows.c`."""

    PROVEN = 0
    TOO_NEAR = 1
    NOT_SHOWN = 2
    TOO_MUCH = 3


class Near(NamedTuple):
    """The distance of a pair at an instant.

    Attributes:
        pair: its number; -1 for none.
        distance_m: the distance; infinite for none.
        time_s: the instant.
    """

    pair: int
    distance_m: float
    time_s: float


class Found(NamedTuple):
    """The result of a search.

    Attributes:
        outcome: how it ended.
        proven_m: if `PROVEN`, the clearance of counted pairs at every instant; inf where none
            counts.
        nearest: the smallest distance of a counted pair that was found.
        stopped: the pair that is too near, or is not shown to be apart.
        letters, directions, fine: as in `planner.certificate.rows.Trace`.
    """

    outcome: Outcome
    proven_m: float
    nearest: Near
    stopped: Near
    letters: np.ndarray[Any, Any]
    directions: np.ndarray[Any, Any]
    fine: np.ndarray[Any, Any]


class BoxesFound(NamedTuple):
    """The result of a search over a tube.

    Attributes:
        outcome: how it ended.
        proven_m: if `PROVEN`, the clearance of all pairs at all positions that the joints may have;
            inf where there are no pairs.
        nearest: the smallest distance of a pair that was found; its time is the number of an
            instant.
        stopped: the pair that is too near, or is not shown to be apart, likewise.
        q: position of the joints at `nearest`, shape (joints,), rad.
        trace: letters and directions for `planner.certificate.boxes`.
    """

    outcome: Outcome
    proven_m: float
    nearest: Near
    stopped: Near
    q: Array
    trace: BoxTrace


@dataclass(frozen=True, eq=False)
class Rows:
    """The rows of one step.

    Attributes:
        trace: letters of all levels, and directions.
        proven_m: clearance of counted pairs at every instant, at most what the checker concludes;
            inf where none counts.
    """

    trace: Trace
    proven_m: float


class NotShownError(NotCertifiedError):
    """No rows were found that keep all pairs apart.

    Attributes:
        near: the pair that comes too near, by its number in the step; None where too many rows are
            needed.
        step: the step; None likewise.
    """

    near: Near | None = None
    step: Step | None = None

    @classmethod
    def of(cls, step: Step, near: Near) -> NotShownError:
        """The error that names the pair that comes too near."""
        first, second = step.pairs[near.pair].first.name, step.pairs[near.pair].second.name
        distance_mm = round(1e3 * near.distance_m, 3) + 0.0
        error = cls(
            f"{step.label}: {first} and {second} come as near as {distance_mm:.3f} mm "
            f"at {near.time_s:.4f} s"
        )
        error.near, error.step = near, step
        return error
