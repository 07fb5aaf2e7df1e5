"""Drawings as paths of the tip: level strokes at one height, with lifts between them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin import pose_from_quaternion
from baxter_kin.display import quoted
from baxter_kin.fields import evolve
from baxter_kin.validation import FloatArray, finite_array
from planner import (
    Arc,
    Curve,
    FollowedPath,
    LineTolerance,
    Manipulator,
    Move,
    PathMove,
    Plan,
    Polyline,
    State,
    complete,
    plan_free_move,
    plan_path_move,
)
from planner.collision.context import CollisionContext
from planner.errors import PathMoveError
from planner.motion.paths.path import TipPath, pieces_of
from sim.errors import SimulationError
from sim.workbench import lettering

Drawing: TypeAlias = str | TipPath | FloatArray | Sequence[TipPath] | Sequence[ArrayLike]
"""Text, a path or several, a stroke as an array of x and y in base, m, or several strokes."""

PEN_M, LIFT_M = 0.05, 0.005
"""Default height of the tip above the table while it draws, and by how much it rises between
strokes."""

TOLERANCE = LineTolerance(1e-3, math.radians(0.5))
"""Default tolerance, with which a pen rounds corners as a person does."""

DOWN = (0.0, 1.0, 0.0, 0.0)
"""Orientation of a hand that points down, x, y, z, w."""

SAME_M = 1e-6
"""Points at a smaller distance are the same."""


Stroke: TypeAlias = tuple[TipPath, ...]
"""Paths that follow one another."""


def strokes_of(drawing: Drawing, z_m: float) -> tuple[Stroke, ...]:
    """The strokes of a drawing, with the hand pointing down.

    Args:
        drawing: what to draw; of a path, x and y count.
        z_m: height of the tip in base.

    Raises:
        SimulationError: when the drawing is malformed.
        MotionError: when a path is invalid or has no length.
    """
    found: list[list[TipPath]] = []
    for part in _level_parts(drawing, z_m):
        is_next = found and _gap_m(_end(found[-1][-1]), _start(part)) <= SAME_M
        if is_next:
            found[-1].append(part)
        else:
            found.append([part])
    if not found:
        raise SimulationError("there is nothing to draw")
    return tuple(map(tuple, found))


def points_of(strokes: Sequence[Stroke]) -> FloatArray:
    """Positions at the ends of the pieces of strokes, shape (n, 3), m."""
    pieces = [piece for stroke in strokes for piece in pieces_of(stroke)]
    ends = [T.translation for each in pieces for T in (each.T_base_start, each.T_base_goal)]
    return np.array(ends)


class PlannedDrawing(NamedTuple):
    """A plan that draws.

    Attributes:
        plan: free moves, each followed by a move along a path that draws strokes.
        times_s: when the tip draws: from when to when, shape (k, 2), s from the plan's start.
    """

    plan: Plan
    times_s: FloatArray


def plan_drawing(
    arm: Manipulator, state: State, strokes: Sequence[Stroke], tolerance: LineTolerance
) -> PlannedDrawing:
    """Plan how an arm draws, clear of everything.

    All strokes are one motion if one is found. Otherwise the arm rests above the end of the last
    stroke to which one leads, and moves freely to the start of the next.

    Args:
        arm: the arm.
        state: robot and bodies now.
        strokes: as of `strokes_of`.
        tolerance: maximum deviation of the tip.

    Raises:
        MotionError: when no motion is found.
    """
    here, q, time_s = arm.at(state), state.q(arm.arm.joint_names), 0.0
    moves, drawn_s, left = list[Move](), list[FloatArray](), list(strokes)
    while left:
        found, count = _along_most(arm, left, tolerance, here)
        approach = plan_free_move(q, found.trajectory.q_start, arm.limits, here)
        moves += [
            Move(f"draw: approach{_number(moves)}", approach),
            Move(f"draw: strokes{_number(moves)}", found.trajectory, path=found.path),
        ]
        time_s += approach.duration
        drawn_s.append(time_s + _drawn_s(found.path, float(points_of(left)[0, 2])))
        q, time_s = found.trajectory.q_goal, time_s + found.trajectory.duration
        del left[:count]
    plan = complete(Plan(state, tuple(moves), robot=arm.identity), manipulator=arm)
    return PlannedDrawing(plan, np.concatenate(drawn_s))


def _number(moves: Sequence[Move]) -> str:
    return f" {len(moves) // 2 + 1}" if moves else ""


def _along_most(
    arm: Manipulator, strokes: Sequence[Stroke], tolerance: LineTolerance, here: CollisionContext
) -> tuple[PathMove, int]:
    """A motion along the first strokes, as many as one is found for, and their number."""
    count = len(strokes)
    while True:
        path = list(_with_lifts(strokes[:count]))
        try:
            return plan_path_move(arm, None, path, tolerance=tolerance, context=here), count
        except PathMoveError as failure:
            ends_m = [_length_m(list(_with_lifts(strokes[: k + 1]))) for k in range(count - 1)]
            count = int(np.searchsorted(ends_m, failure.length_m + SAME_M))
            if not count:
                raise


def _with_lifts(strokes: Sequence[Stroke]) -> Iterator[TipPath]:
    """The path of the tip, from above the first stroke to above the last."""
    end: pin.SE3 | None = None
    for stroke in strokes:
        start = _start(stroke[0])
        if end is None:
            yield Polyline([_lifted(start), start])
        else:
            yield Polyline([end, _lifted(end), _lifted(start), start])
        yield from stroke
        end = _end(stroke[-1])
    if end is not None:
        yield Polyline([end, _lifted(end)])


def _length_m(path: Sequence[TipPath]) -> float:
    return sum(piece.length_m for piece in pieces_of(path))


def _start(part: TipPath) -> pin.SE3:
    return pieces_of(part)[0].T_base_start


def _end(part: TipPath) -> pin.SE3:
    return pieces_of(part)[-1].T_base_goal


def _gap_m(one: pin.SE3, other: pin.SE3) -> float:
    return float(np.abs(one.translation - other.translation).max())


def _drawn_s(path: FollowedPath, z_m: float) -> FloatArray:
    """When the tip is at a height: from when to when, shape (k, 2), s from the start of a path."""
    shares = np.linspace(0.0, 1.0, 4)  # which determine a cubic
    heights = np.array([piece.positions(shares)[:, 2] for piece in path.pieces])
    is_drawn = (np.abs(heights - z_m) <= SAME_M).all(axis=1)
    edges = np.flatnonzero(np.diff(is_drawn, prepend=False, append=False))
    found: FloatArray = np.concatenate([[0.0], path.ends_s])[edges].reshape(-1, 2)
    return found


def _lifted(T: pin.SE3) -> pin.SE3:
    return pin.SE3(T.rotation, T.translation + np.array([0.0, 0.0, LIFT_M]))


def _level_parts(drawing: object, z_m: float) -> Iterator[TipPath]:
    """The strokes at their height, with the hand pointing down."""
    given = lettering.text_strokes(drawing) if isinstance(drawing, str) else drawing
    is_one = isinstance(given, np.ndarray) and given.ndim == 2
    if is_one or isinstance(given, (Polyline, Arc, Curve)):
        given = [given]
    if not isinstance(given, (Sequence, np.ndarray)):
        raise SimulationError(
            "a drawing is text, a path, or strokes, each an array of x and y in base, m; got "
            f"{quoted(given)}"
        )
    for number, part in enumerate(given, 1):
        if isinstance(part, (Polyline, Arc, Curve)):
            yield _level(part, z_m)
            continue
        points = finite_array(part, (None, 2), f"stroke {number}", SimulationError)
        if len(points) < 2:
            raise SimulationError(f"stroke {number} has {len(points)} points; it needs two")
        yield Polyline([_at(point, z_m) for point in points])


def _at(point: FloatArray, z_m: float) -> pin.SE3:
    return pose_from_quaternion((float(point[0]), float(point[1]), z_m), DOWN)


def _level(part: TipPath, z_m: float) -> TipPath:
    """A path at a height, with the hand pointing down all along."""
    if isinstance(part, Polyline):
        return Polyline([_at(T.translation, z_m) for T in part.poses])
    if isinstance(part, Curve):
        pose_at = part.pose_at
        return Curve(lambda length_m: _at(pose_at(length_m).translation, z_m), part.length_m)
    if np.abs(part.normal[:2]).max() > SAME_M * np.abs(part.normal).max():
        raise SimulationError(f"an arc on the table has a vertical normal, got {part.normal}")
    centre = np.array([*part.centre[:2], z_m])
    start = _at(part.T_base_start.translation, z_m)
    return evolve(part, T_base_start=start, centre=centre, turns_hand=False)
