"""The paths of the tips, and the lines that viewers draw along them."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from baxter_kin import Baxter
from baxter_kin.validation import FloatArray
from sim.recording.recording import Recording
from sim.view.animation import frame_samples, key_samples
from sim.view.encoding import Command
from sim.view.gripper_status import GripperPhase
from sim.view.meshcat_commands import Rgb, delete
from sim.view.scenegraph import line_command

PATH_RADIUS_M = 4.5e-3
EMPTY_RGB: Rgb = (0.09, 0.42, 0.80)
HOLDING_RGB: Rgb = (0.93, 0.53, 0.02)
AHEAD_RGB: Rgb = (0.42, 0.47, 0.52)
"""The colours of a line, the last where the tip has yet to go. The pages' style sheet has the first
two for the grippers' states."""

SEGMENT_M = 0.015
"""Maximum length of the segments by which a line grows."""

MAX_STEP_M = 0.2
"""A tip that is farther away at the next sample was put there, and did not move there."""

_TOLERANCE_M = 1e-3
_MIN_MOVED_M = 5e-3
"""A tip that moves no farther than this gets no line."""

_MAX_SEGMENTS = 1000
"""Maximum number of segments for each tip; those of a longer path are longer."""


@dataclass(frozen=True, slots=True, eq=False)
class PathPiece:
    """A piece of a tip's path, with the hand either empty or holding something all along.

    Attributes:
        side: of the arm.
        times_s: recorded time at each point, shape (n,).
        points_base: shape (n, 3), metres.
        is_holding: whether the hand holds something.
    """

    side: str
    times_s: FloatArray
    points_base: FloatArray
    is_holding: bool

    def commands(self, path: str) -> tuple[Command, Command]:
        """The line twice, below a node: as drawn ahead of the tip, and behind it."""
        rgb, points = line_rgb(self.is_holding), self.points_base
        return (
            line_command(f"{path}/ahead", points, PATH_RADIUS_M, AHEAD_RGB, uuid=path),
            line_command(f"{path}/behind", points, PATH_RADIUS_M, rgb, uuid=path),
        )


def line_rgb(is_holding: bool) -> Rgb:
    """The colour of a line."""
    return HOLDING_RGB if is_holding else EMPTY_RGB


def recorded_paths(
    recording: Recording,
    robot: Baxter,
    phases: Mapping[str, Sequence[tuple[float, GripperPhase]]],
) -> Iterator[PathPiece]:
    """The paths of all tips that move.

    Args:
        recording: what happened.
        robot: the robot of the recording.
        phases: those of the grippers with their start times, by side.
    """
    frames = frame_samples(recording.times_s)
    times = recording.times_s[frames]
    for side, arm in robot.arms.items():
        joints = list(robot.indices(arm.joint_names))
        points = arm.T_base_tips(recording.q[frames][:, joints])[:, :3, 3]
        if np.ptp(points, axis=0).max() > _MIN_MOVED_M:
            starts_s = [-np.inf, *(start_s for start_s, _ in phases[side][1:])]
            is_holding = np.array([phase.is_holding for _, phase in phases[side]] or [False])
            now = is_holding[np.searchsorted(starts_s, times, side="right") - 1]
            yield from _pieces(side, times, points, now)


def _pieces(
    side: str, times: FloatArray, points: FloatArray, holding: NDArray[np.bool_]
) -> Iterator[PathPiece]:
    """The path cut where the hand grasps or releases, and where the tip jumps."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    jumps = steps > MAX_STEP_M
    segment_m = max(SEGMENT_M, float(steps[~jumps].sum()) / _MAX_SEGMENTS)
    cuts = np.flatnonzero(jumps | (np.diff(holding.astype(int)) != 0)) + 1
    for start, end in zip([0, *cuts], [*cuts, len(points)], strict=True):
        reaches_on = end < len(points) and not jumps[end - 1]
        rows = slice(start, end + int(reaches_on))
        chosen = _key_points(points[rows], segment_m)
        if len(chosen) > 1:
            at, where = times[rows][chosen], points[rows][chosen]
            yield PathPiece(side, at, where, bool(holding[start]))


def _key_points(points: FloatArray, segment_m: float) -> NDArray[np.intp]:
    """Indices of the points of a line, without rests and points straight between two others."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    moved = np.flatnonzero(np.concatenate([[True], steps > 0.0]))
    if len(moved) < 2:
        return moved
    travelled = np.concatenate([[0.0], np.cumsum(steps)])[moved]
    shape = key_samples(travelled, points[moved], _TOLERANCE_M)
    regular = np.flatnonzero(np.diff(np.floor(travelled / segment_m), prepend=-1.0) > 0)
    return moved[np.union1d(shape, regular)]


MAX_PIECE_POINTS = 32
"""Maximum number of points of a piece, which is sent again whenever it grows."""

MAX_PIECES = 24
"""Maximum number of pieces, of which the latest stay: some 10 m of line."""


class TipPath:
    """The line of one tip in a live view."""

    def __init__(self, side: str) -> None:
        """Begin without a line; its pieces are nodes under `/path/<side>`."""
        self._root = f"/path/{side}"
        self._points: list[FloatArray] = []
        self._is_holding = False
        self._number = 0
        self._kept: deque[str] = deque()

    def advance(self, point_base: FloatArray, *, is_holding: bool) -> list[Command]:
        """The commands after a motion of the tip, mostly none.

        Args:
            point_base: its new position, shape (3,), m.
            is_holding: whether the hand holds something, which sets the colour.
        """
        last = self._points[-1] if self._points else np.full(3, np.inf)
        step_m = float(np.linalg.norm(point_base - last))
        if step_m > MAX_STEP_M:
            self._begin([point_base], is_holding)
            return []
        if is_holding != self._is_holding or len(self._points) >= MAX_PIECE_POINTS:
            self._begin(self._points[-1:], is_holding)
        if step_m < SEGMENT_M:
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
            if len(self._kept) > MAX_PIECES:
                removed.append(delete(self._kept.popleft()))
        line = line_command(path, np.array(self._points), PATH_RADIUS_M, line_rgb(self._is_holding))
        return [*removed, line]
