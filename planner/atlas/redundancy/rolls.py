"""The self-motion of poses that differ by a roll about the tool's axis, found once for all of them.

The tool's z axis is the last joint's, so that w2 alone tells such poses apart: their loops are the
same but for it, and so is what the limits of the first six joints leave of them. That is found at
roll zero, and then cut by the limits of w2 for each roll. What comes out is what
`baxter_kin.ik.solutions` finds pose by pose, in a third of its time where directions have twelve
rolls each.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from baxter_kin import IKService
from baxter_kin.ik import SelfMotion
from baxter_kin.ik.self_motion.continuation import Loop, loops_near
from baxter_kin.ik.self_motion.pieces import (
    AT_LIMITS_RAD,
    STARTS,
    Piece,
    as_curve,
    filled_pieces,
    off_curves,
    pieces_inside,
    sort_key,
    swept,
    traced,
    without_duplicates,
)
from baxter_kin.ik.self_motion.solution_curve import CurvePoints, SolutionCurve
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray
from planner.atlas.rotations import about_z

STEP_RAD = 0.05
"""Longest step along the pieces: cubics between their points are good to 1e-6 rad."""

W2 = 6


def pieces_of_rolls(
    ik: IKService, T_base_tip: pin.SE3, rolls: FloatArray, known: FloatArray
) -> list[tuple[SelfMotion, ...]]:
    """The pieces of self-motion at each roll, ordered as `baxter_kin.ik.solutions` does.

    Args:
        ik: the service of the arm.
        T_base_tip: the pose at roll zero; its z axis is that of w2, unless the only roll is zero.
        rolls: angles about it, shape (k,), rad.
        known: configurations that reach it, w2 inside its limits or not, shape (n, 7), rad.
    """
    solution_curve = SolutionCurve(ik.arm, T_base_tip)
    shared = _without_w2(ik, solution_curve, known)
    poses = turned(T_base_tip, rolls)
    return [_at_roll(ik.arm, T, roll, shared) for T, roll in zip(poses, rolls, strict=True)]


def turned(T_base_tip: pin.SE3, rolls: FloatArray) -> list[pin.SE3]:
    """A pose, turned about its own z axis by each of the rolls, shape (k,), rad."""
    return [T_base_tip * pin.SE3(R, np.zeros(3)) for R in about_z(rolls)]


def with_witness(
    curves: tuple[SelfMotion, ...], arm: Arm, T_base_tip: pin.SE3, q: FloatArray
) -> tuple[SelfMotion, ...]:
    """The same pieces, and the one through a configuration where it is so short that it was missed.

    Args:
        curves: of the pose.
        arm: whose.
        T_base_tip: the pose.
        q: a configuration that reaches it inside the limits, shape (7,), rad.
    """
    margin = np.minimum(q - arm.limits.q_min, arm.limits.q_max - q).min()
    if curves and (margin > AT_LIMITS_RAD or not off_curves(list(curves), q[None])[0]):
        return curves
    return tuple(sorted([*curves, traced(arm, q, T_base_tip, STEP_RAD)], key=sort_key))


def _without_w2(ik: IKService, solution_curve: SolutionCurve, known: FloatArray) -> Sequence[Piece]:
    """What the limits of the first six joints leave of the loops at roll zero."""
    arm, pose = ik.arm, solution_curve.T_base_tip
    seeds = np.random.default_rng(0).uniform(arm.limits.q_min, arm.limits.q_max, (STARTS, 7))
    found = ik.search.search(seeds, np.repeat(pose.homogeneous[None], STARTS, axis=0))
    starts = np.concatenate([known, found.q[found.is_valid], swept(arm, pose)])
    limited = solution_curve.limited_by(range(W2))
    pieces = list(pieces_inside(limited, loops_near(limited, starts)))
    return filled_pieces(limited, pieces, STEP_RAD)


def _at_roll(
    arm: Arm, T_base_tip: pin.SE3, roll: float, shared: Sequence[Piece]
) -> tuple[SelfMotion, ...]:
    """What the limits of w2 leave of pieces that are turned by a roll."""
    solution_curve = SolutionCurve(arm, T_base_tip)
    limited = solution_curve.limited_by([W2])
    loops = [
        Loop(limited.into_range(_with_roll(piece.points, roll)), piece.ends) for piece in shared
    ]
    pieces = pieces_inside(limited, loops)
    curves = [as_curve(solution_curve, _measured(solution_curve, piece)) for piece in pieces]
    return tuple(without_duplicates(sorted(curves, key=sort_key)))


def _with_roll(points: CurvePoints, roll: float) -> CurvePoints:
    rows = np.array(points.rows)
    rows[:, W2] += roll
    return CurvePoints(rows)


def _measured(solution_curve: SolutionCurve, piece: Piece) -> Piece:
    """The piece with its distances to the limits of all joints; rounding may have led beyond."""
    rows = np.array(piece.points.rows)
    rows[:, :7] = rows[:, :7].clip(solution_curve.q_min, solution_curve.q_max)
    rows[:, -1] = solution_curve.clearance_rad(rows[:, :7])
    return Piece(CurvePoints(rows), piece.ends)
