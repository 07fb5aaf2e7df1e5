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
    LineTolerance,
    Manipulator,
    Move,
    Plan,
    Polyline,
    State,
    complete,
    plan_free_move,
    plan_path_move,
)
from planner.motion.paths.path import TipPath, pieces_of
from planner.motion.paths.pieces import Piece
from sim.errors import SimulationError
from sim.workbench.lettering import strokes

Drawing: TypeAlias = str | TipPath | FloatArray | Sequence[TipPath] | Sequence[ArrayLike]
"""Text, a path or several, a stroke as an array of x and y in base, m, or several strokes."""

PEN_M, LIFT_M = 0.05, 0.01
"""Default height of the tip above the table while it draws, and by how much it rises between
strokes."""

TOLERANCE = LineTolerance(1e-3, math.radians(0.5))
"""Default tolerance, with which a pen rounds corners as a person does."""

DOWN = (0.0, 1.0, 0.0, 0.0)
"""Orientation of a hand that points down, x, y, z, w."""

SAME_M = 1e-6
"""Points at a smaller distance are the same."""


def path_of(drawing: Drawing, z_m: float) -> tuple[TipPath, ...]:
    """The whole path of the tip, from above the first stroke to above the last.

    Args:
        drawing: what to draw; of a path, x and y count.
        z_m: height of the tip in base while it draws.

    Raises:
        SimulationError: when the drawing is malformed.
        MotionError: when a path has no length.
    """
    found: list[TipPath] = []
    end: pin.SE3 | None = None
    for part in _level_parts(drawing, z_m):
        pieces = pieces_of(part)
        start = pieces[0].T_base_start
        if end is None:
            found.append(Polyline([_lifted(start), start]))
        elif np.abs(end.translation - start.translation).max() > SAME_M:
            found.append(Polyline([end, _lifted(end), _lifted(start), start]))
        found.append(part)
        end = pieces[-1].T_base_goal
    if end is None:
        raise SimulationError("there is nothing to draw")
    return *found, Polyline([end, _lifted(end)])


class PlannedDrawing(NamedTuple):
    """A plan that draws.

    Attributes:
        plan: a move to the start of the path, and the one that draws.
        times_s: when the tip draws: from when to when, shape (k, 2), s from the plan's start.
    """

    plan: Plan
    times_s: FloatArray


def plan_drawing(
    arm: Manipulator, state: State, path: Sequence[TipPath], tolerance: LineTolerance, z_m: float
) -> PlannedDrawing:
    """Plan how an arm draws, clear of everything.

    Args:
        arm: the arm.
        state: robot and bodies now.
        path: of the tip, as of `path_of`.
        tolerance: maximum deviation of the tip.
        z_m: height of the tip in base while it draws.

    Raises:
        MotionError: when no motion is found.
    """
    here = arm.at(state)
    move = plan_path_move(arm, None, path, tolerance=tolerance, context=here)
    q_now, q_start = state.q(arm.arm.joint_names), move.trajectory.q_start
    approach = plan_free_move(q_now, q_start, arm.limits, here)
    moves = Move("draw: approach", approach), Move("draw: strokes", move.trajectory)
    plan = complete(Plan(state, moves, robot=arm.identity), manipulator=arm)
    return PlannedDrawing(plan, approach.duration + _drawn_s(move.pieces, move.ends_s, z_m))


def _drawn_s(pieces: Sequence[Piece], ends_s: FloatArray, z_m: float) -> FloatArray:
    """When the tip is at a height: from when to when, shape (k, 2), s from the start of a path."""
    shares = np.linspace(0.0, 1.0, 4)  # which determine a cubic
    heights = np.array([piece.positions(shares)[:, 2] for piece in pieces])
    is_drawn = (np.abs(heights - z_m) <= SAME_M).all(axis=1)
    edges = np.flatnonzero(np.diff(is_drawn, prepend=False, append=False))
    found: FloatArray = np.concatenate([[0.0], ends_s])[edges].reshape(-1, 2)
    return found


def points_of(path: Sequence[TipPath]) -> FloatArray:
    """Positions at the ends of the pieces of a path, shape (n, 3), m."""
    pieces = pieces_of(path)
    return np.array([T.translation for each in pieces for T in (each.T_base_start, each.T_base_goal)])


def _lifted(T: pin.SE3) -> pin.SE3:
    return pin.SE3(T.rotation, T.translation + [0.0, 0.0, LIFT_M])


def _level_parts(drawing: object, z_m: float) -> Iterator[TipPath]:
    """The strokes at their height, with the hand pointing down."""
    given = strokes(drawing) if isinstance(drawing, str) else drawing
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
