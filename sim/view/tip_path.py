"""Where the tips go: points in space, and the lines that viewers draw through them."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin import Baxter
from baxter_kin.validation import FloatArray
from sim.recording.recording import Recording
from sim.view.animation import frame_samples, telling_samples
from sim.view.gripper_status import GripperPhase
from sim.view.meshcat_commands import Command, Rgb, delete
from sim.view.scenegraph import line_command

PATH_RADIUS_M = 4.5e-3
EMPTY_RGB: Rgb = (0.09, 0.42, 0.80)
HOLDING_RGB: Rgb = (0.93, 0.53, 0.02)
AHEAD_RGB: Rgb = (0.42, 0.47, 0.52)
"""The colours of a line, the last where the tip has yet to go. The pages' style sheet has the first
two for the grippers' states."""

STRETCH_M = 0.015
"""A line grows by stretches of at most this length."""

LONGEST_JUMP_M = 0.2
"""A tip that is farther away at the next sample was put there, and did not move there."""

_TOLERANCE_M = 1e-3
_STILL_M = 5e-3
"""A tip that moves no farther than this gets no line."""

_MOST_STRETCHES = 1000
"""So many of `STRETCH_M` at most for each tip; a longer way grows by longer ones."""


@dataclass(frozen=True, slots=True, eq=False)
class PathPiece:
    """A piece of a tip's way, with the hand empty all along or holding something all along.

    Attributes:
        side: whose tip.
        times_s: when it is at each point, shape (n,), recorded time.
        points_base: shape (n, 3), metres.
        is_holding: whether the hand holds something.
    """

    side: str
    times_s: FloatArray
    points_base: FloatArray
    is_holding: bool


class TipTracker:
    """Where both tips are. Not for several threads at once."""

    def __init__(self, robot: Baxter) -> None:
        self._model = robot.model
        self._data = robot.model.createData()
        self._frames = {
            side: robot.model.getFrameId(arm.tip_frame) for side, arm in robot.arms.items()
        }

    def points(self, q: FloatArray) -> dict[str, FloatArray]:
        """By side, the tip's place in base, shape (3,), metres, at a configuration (19,)."""
        pin.forwardKinematics(self._model, self._data, q)
        return {
            side: pin.updateFramePlacement(self._model, self._data, frame).translation.copy()
            for side, frame in self._frames.items()
        }


def line_rgb(is_holding: bool) -> Rgb:
    """The colour of a line where the hand is empty, or holds something."""
    return HOLDING_RGB if is_holding else EMPTY_RGB


def recorded_paths(
    recording: Recording,
    robot: Baxter,
    phases: Mapping[str, Sequence[tuple[float, GripperPhase]]],
) -> Iterator[PathPiece]:
    """The ways of all tips that move.

    Args:
        recording: what happened.
        robot: the robot it happened to.
        phases: for each side when a phase begins, and which.
    """
    frames = frame_samples(recording.times_s)
    times = recording.times_s[frames]
    tracker = TipTracker(robot)
    rows = [tracker.points(q) for q in recording.q[frames]]
    for side in robot.arms:
        points = np.array([row[side] for row in rows])
        if np.ptp(points, axis=0).max() > _STILL_M:
            holding = _holding_at(times, phases[side])
            yield from _pieces(side, times, points, holding)


def _holding_at(
    times: FloatArray, phases: Sequence[tuple[float, GripperPhase]]
) -> NDArray[np.bool_]:
    """Whether the hand holds something at each time; a hand without phases never does."""
    if not phases:
        return np.zeros(len(times), dtype=np.bool_)
    starts = np.array([start for start, _ in phases])
    holding = np.array([phase.is_holding for _, phase in phases])
    return holding[np.maximum(np.searchsorted(starts, times, side="right") - 1, 0)]


def _pieces(
    side: str, times: FloatArray, points: FloatArray, holding: NDArray[np.bool_]
) -> Iterator[PathPiece]:
    """The way cut where the hand grasps or lets go, and where the tip jumps."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    jumps = steps > LONGEST_JUMP_M
    stretch = max(STRETCH_M, float(steps[~jumps].sum()) / _MOST_STRETCHES)
    cuts = np.flatnonzero(jumps | (np.diff(holding.astype(int)) != 0)) + 1
    for start, end in zip([0, *cuts], [*cuts, len(points)], strict=True):
        reaches_on = end < len(points) and not jumps[end - 1]
        rows = slice(start, end + int(reaches_on))
        chosen = _telling(points[rows], stretch)
        if len(chosen) > 1:
            at, where = times[rows][chosen], points[rows][chosen]
            yield PathPiece(side, at, where, bool(holding[start]))


def _telling(points: FloatArray, stretch_m: float) -> NDArray[np.intp]:
    """Indices of points that draw the line: rests left out, and what lies straight between two."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    moved = np.flatnonzero(np.concatenate([[True], steps > 0.0]))
    if len(moved) < 2:
        return moved
    travelled = np.concatenate([[0.0], np.cumsum(steps)])[moved]
    shape = telling_samples(travelled, points[moved], _TOLERANCE_M)
    regular = np.flatnonzero(np.diff(np.floor(travelled / stretch_m), prepend=-1.0) > 0)
    return moved[np.union1d(shape, regular)]


PIECE_POINTS = 32
"""A piece is sent again whenever it grows; a full one is followed by the next."""

PIECES_KEPT = 24
"""The oldest pieces vanish: some 10 m of line stay."""


class TipPath:
    """One tip's line."""

    def __init__(self, side: str) -> None:
        """Empty.

        Args:
            side: whose tip; the pieces are nodes under `/path/<side>`.
        """
        self._root = f"/path/{side}"
        self._points: list[FloatArray] = []
        self._is_holding = False
        self._number = 0
        self._kept: deque[str] = deque()

    def advance(self, point_base: FloatArray, *, is_holding: bool) -> list[Command]:
        """The tip is there now: what to draw and what to remove; mostly nothing.

        Args:
            point_base: shape (3,), metres.
            is_holding: whether the hand holds something, for the colour.
        """
        if not self._points:
            self._begin([point_base], is_holding)
            return []
        step = float(np.linalg.norm(point_base - self._points[-1]))
        if step > LONGEST_JUMP_M:
            self._begin([point_base], is_holding)
            return []
        if is_holding != self._is_holding or len(self._points) >= PIECE_POINTS:
            self._begin(self._points[-1:], is_holding)
        if step < STRETCH_M:
            return []
        self._points.append(point_base)
        return self._drawn()

    def _begin(self, points: list[FloatArray], is_holding: bool) -> None:
        self._points = points
        self._is_holding = is_holding
        self._number += 1

    def _drawn(self) -> list[Command]:
        path = f"{self._root}/{self._number}"
        removed = []
        if path not in self._kept:
            self._kept.append(path)
            if len(self._kept) > PIECES_KEPT:
                removed.append(delete(self._kept.popleft()))
        line = line_command(path, np.array(self._points), PATH_RADIUS_M, line_rgb(self._is_holding))
        return [*removed, line]
