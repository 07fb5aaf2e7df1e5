"""Checks of the tip: where it was asked to be, and on its line where it moves straight."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from baxter_kin.frames import angle_between
from baxter_kin.validation import FloatArray
from planner.plan import Grip, Move, Plan
from planner.trajectory import Trajectory
from planner.verification.certificate import Check, Worst, greatest
from planner.verification.motion.cubics import Cubics
from planner.verification.motion.sampled_path import SampledPath, path_at, sampled_path
from planner.verification.tolerances import Tolerances
from planner.verification.urdf_robot import UrdfRobot

LINE_STEP_M = 1e-3
"""Bound on the tip's travel between two looks at a straight move."""

MOST_LOOKS = 100_000
"""Steps of one straight move; where they do not suffice the bound in between grows."""

BETWEEN, LEAST, MOST_PARTS = 0.02, 1e-8, 64
"""With more than this share of what a line may leave left open between two looks, and more than so
much, m and rad, more looks are taken, but no more than so many times as many."""

SHORTEST_LINE_M = 1e-6
"""Shorter lines are points, known no better than a tip pose."""


@dataclass(frozen=True, slots=True)
class _LineDeviation:
    """How far a tip leaves its line.

    Attributes:
        position_m: greatest distance from the line, where it was looked at.
        position_time_s: when that is.
        orientation_rad: greatest angle to the orientation that belongs there, likewise.
        orientation_time_s: when that is.
        between_m: how much farther from the line it can be between two looks.
        between_rad: how much farther it can be turned.
    """

    position_m: float
    position_time_s: float
    orientation_rad: float
    orientation_time_s: float
    between_m: float
    between_rad: float


def tip_checks(
    plan: Plan,
    robot: UrdfRobot,
    q_standing: FloatArray,
    straight: Collection[str],
    allowed: Tolerances,
) -> Iterator[Check]:
    """Waypoints, grasps and releases against what was asked; straight moves against their lines.

    Straight are the moves that say so and those whose label is given.
    """
    yield from _poses("", _waypoints(plan), robot, q_standing, allowed)
    yield from _poses(" at grips", _grips(plan), robot, q_standing, allowed)
    yield from _lines(plan, robot, q_standing, straight, allowed)


def line_deviation(
    trajectory: Trajectory, robot: UrdfRobot, q_standing: FloatArray, allowed: Tolerances
) -> _LineDeviation:
    """How far the tip leaves the straight line between its first and last pose.

    The orientation that belongs to a point of the line is the share of the shortest rotation that
    the point is of the way (slerp); where the line is but a point, the share that was turned.
    """
    cubics, reach_m = Cubics(trajectory), robot.tip_reach_m
    looks = sampled_path(cubics, reach_m, LINE_STEP_M, MOST_LOOKS, with_knots=True)
    ends = [robot.T_base_tip(q_standing, q) for q in looks.q[[0, -1]]]
    turn_per_m = _line_turn(*ends)
    most = max(BETWEEN * allowed.line_m, LEAST), max(BETWEEN * allowed.line_rad, LEAST)
    looks = _refined(cubics, looks, reach_m, turn_per_m, most)
    between_m, between_rad = _between(cubics, looks, reach_m, turn_per_m)
    off, turned = np.array([_off_line(robot.T_base_tip(q_standing, q), *ends) for q in looks.q]).T
    first, second = int(off.argmax()), int(turned.argmax())
    return _LineDeviation(
        float(off[first]),
        float(looks.times_s[first]),
        float(turned[second]),
        float(looks.times_s[second]),
        float(between_m.max(initial=0.0)),
        float(between_rad.max(initial=0.0)),
    )


def _refined(
    cubics: Cubics,
    looks: SampledPath,
    reach_m: FloatArray,
    turn_per_m: float,
    most: tuple[float, float],
) -> SampledPath:
    """As many looks as leave no more open in between than so much, m and rad."""
    off_m, off_rad = _between(cubics, looks, reach_m, turn_per_m)
    parts = np.sqrt(np.maximum(off_m / most[0], off_rad / most[1]))
    counts = np.clip(np.ceil(parts), 1, MOST_PARTS).astype(np.intp)
    starts, lengths = np.repeat(looks.times_s[:-1], counts), np.diff(looks.times_s)
    number = np.arange(len(starts)) - np.repeat(np.cumsum(counts) - counts, counts)
    times = starts + np.repeat(lengths / counts, counts) * number
    return path_at(cubics, np.unique(np.append(times, looks.times_s[-1])))


def _between(
    cubics: Cubics, looks: SampledPath, reach_m: FloatArray, turn_per_m: float
) -> tuple[FloatArray, FloatArray]:
    """Bounds on how much farther from the line the tip is between two looks than at them.

    From knot to knot accelerations are linear in time, so a joint is no farther from going evenly
    than its greatest acceleration times an eighth of the time squared. Were all joints going
    evenly, the tip's second derivative would be at most the sum over pairs of joints of both turns
    times the lever arm of the outer one, and the turn's the square of all turns summed, that of
    the line among them; the deviation from a chord is an eighth of that. Distance to a line is
    convex, so on the chord it is no greater than at its ends; of the small angles between two
    rotations that holds up to the same square, taken four times for it.
    """
    dt, turns = np.diff(looks.times_s)[:, None], looks.turned[1:]
    uneven = cubics.fastest_change(looks.times_s) * dt**2 / 8
    number = np.arange(len(reach_m))
    arms = reach_m[np.maximum.outer(number, number)]
    curved_m = np.einsum("ki,ij,kj->k", turns, arms, turns) / 8
    off_m = uneven @ reach_m + curved_m
    all_turns = turns.sum(axis=1) + turn_per_m * (turns @ reach_m)
    off_rad = uneven.sum(axis=1) + turn_per_m * off_m + all_turns**2 / 2
    return off_m, off_rad


def _line_turn(T_start: pin.SE3, T_goal: pin.SE3) -> float:
    """How much the orientation that belongs to a line turns with each metre, rad/m."""
    length = float(np.linalg.norm(T_goal.translation - T_start.translation))
    angle = angle_between(T_start.rotation, T_goal.rotation)
    return angle / length if length > SHORTEST_LINE_M else 0.0


def _lines(
    plan: Plan,
    robot: UrdfRobot,
    q_standing: FloatArray,
    straight: Collection[str],
    allowed: Tolerances,
) -> Iterator[Check]:
    off, turned = [], []
    for move in plan.moves:
        if move.is_straight or move.label in straight:
            found = line_deviation(move.trajectory, robot, q_standing, allowed)
            where = f"{move.label}, {found.position_time_s:.4f} s"
            off.append(Worst(found.position_m + found.between_m, where))
            where = f"{move.label}, {found.orientation_time_s:.4f} s"
            turned.append(Worst(found.orientation_rad + found.between_rad, where))
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
    q_standing: FloatArray,
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
