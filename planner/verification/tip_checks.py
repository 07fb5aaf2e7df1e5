"""Checks of the tip: where it was asked to be, and on its line where it moves straight."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from baxter_kin.arrays import Vector
from baxter_kin.frames import angle_between
from planner.plan import Grip, Move, Plan
from planner.trajectory import Trajectory
from planner.verification.certificate import Check, Worst, greatest
from planner.verification.cubics import Cubics
from planner.verification.tolerances import Tolerances
from planner.verification.urdf_robot import UrdfRobot

LINE_STEP_S = 1e-3
"""Time between two looks at the tip of a straight move. In between it can leave the chord of both
by an eighth of its acceleration times this squared: 2e-6 m at 16 m/s^2."""

SHORTEST_LINE_M = 1e-6
"""Shorter lines are points, known no better than a tip pose."""


@dataclass(frozen=True, slots=True)
class LineDeviation:
    """How far a tip leaves its line.

    Attributes:
        position_m: greatest distance from the line.
        position_time_s: when that is.
        orientation_rad: greatest angle to the orientation that belongs there.
        orientation_time_s: when that is.
    """

    position_m: float
    position_time_s: float
    orientation_rad: float
    orientation_time_s: float


def tip_checks(
    plan: Plan, robot: UrdfRobot, q_standing: Vector, straight: Collection[str], allowed: Tolerances
) -> Iterator[Check]:
    """Waypoints, grasps and releases against what was asked; straight moves against their lines.

    Straight are the moves that say so and those whose label is given.
    """
    yield from _poses("", _waypoints(plan), robot, q_standing, allowed)
    yield from _poses(" at grips", _grips(plan), robot, q_standing, allowed)
    yield from _lines(plan, robot, q_standing, straight, allowed)


def line_deviation(trajectory: Trajectory, robot: UrdfRobot, q_standing: Vector) -> LineDeviation:
    """How far the tip leaves the straight line between its first and last pose.

    The orientation that belongs to a point of the line is the share of the shortest rotation that
    the point is of the way (slerp); where the line is but a point, the share that was turned.
    """
    cubics = Cubics(trajectory)
    count = 2 + int(cubics.duration_s / LINE_STEP_S)
    times = np.union1d(np.linspace(0.0, cubics.duration_s, count), cubics.knots_s)
    poses = [robot.T_base_tip(q_standing, q) for q in cubics.positions(times)]
    off, turned = np.array([_off_line(T, poses[0], poses[-1]) for T in poses]).T
    first, second = int(off.argmax()), int(turned.argmax())
    return LineDeviation(
        float(off[first]), float(times[first]), float(turned[second]), float(times[second])
    )


def _lines(
    plan: Plan, robot: UrdfRobot, q_standing: Vector, straight: Collection[str], allowed: Tolerances
) -> Iterator[Check]:
    off, turned = [], []
    for move in plan.moves:
        if move.is_straight or move.label in straight:
            found = line_deviation(move.trajectory, robot, q_standing)
            off.append(Worst(found.position_m, f"{move.label}, {found.position_time_s:.4f} s"))
            at_s = found.orientation_time_s
            turned.append(Worst(found.orientation_rad, f"{move.label}, {at_s:.4f} s"))
    none = "no move is said to be straight"
    yield greatest(off, none).at_most(allowed.line_m, "distance from line", "m")
    yield greatest(turned, none).at_most(allowed.line_rad, "turn from line", "rad")


def _off_line(T: pin.SE3, T_start: pin.SE3, T_goal: pin.SE3) -> tuple[float, float]:
    """Distance and angle of a pose to the nearest point of the line, and its orientation there."""
    way, offset = T_goal.translation - T_start.translation, T.translation - T_start.translation
    turn = pin.log3(T_start.rotation.T @ T_goal.rotation)
    length, angle = float(np.linalg.norm(way)), float(np.linalg.norm(turn))
    if length > SHORTEST_LINE_M:
        share = float(np.clip(way @ offset / length**2, 0.0, 1.0))
    else:
        turned = angle_between(T_start.rotation, T.rotation)
        share = min(1.0, turned / angle) if angle > 0.0 else 0.0
    R = T_start.rotation @ pin.exp3(share * turn)
    return float(np.linalg.norm(offset - share * way)), angle_between(R, T.rotation)


def _waypoints(plan: Plan) -> list[tuple[str, Move]]:
    return [(move.label, move) for move in plan.moves if move.T_base_tip is not None]


def _grips(plan: Plan) -> list[tuple[str, Move | None]]:
    """Each grip on a body, and the move right before it."""
    found: list[tuple[str, Move | None]] = []
    last: Move | None = None
    for step in plan.steps:
        if isinstance(step, Grip):
            if step.body is not None:
                found.append((step.label, last))
        else:
            last = step
    return found


def _poses(
    suffix: str,
    waypoints: list[tuple[str, Move]] | list[tuple[str, Move | None]],
    robot: UrdfRobot,
    q_standing: Vector,
    allowed: Tolerances,
) -> Iterator[Check]:
    """Worst residuals; infinite for a grip whose pose nobody asked for."""
    off, turned = [], []
    for label, move in waypoints:
        distance = angle = math.inf
        if move is not None and move.T_base_tip is not None:
            asked, reached = move.T_base_tip, robot.T_base_tip(q_standing, move.trajectory.q[-1])
            distance = float(np.linalg.norm(reached.translation - asked.translation))
            angle = angle_between(asked.rotation, reached.rotation)
        off.append(Worst(distance, label))
        turned.append(Worst(angle, label))
    nothing = f"no waypoints{suffix}"
    yield greatest(off, nothing).at_most(allowed.tip_m, f"tip position{suffix}", "m")
    yield greatest(turned, nothing).at_most(allowed.tip_rad, f"tip orientation{suffix}", "rad")
