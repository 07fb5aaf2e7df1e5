"""Time-optimal motion of the tip along a path, without stops."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin.display import position, seconds
from baxter_kin.fields import evolve, frozen
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray, expect, finite_array, positive_scalar
from planner.collision.context import CollisionContext
from planner.errors import MotionError, PathMoveError
from planner.manipulator import Manipulator
from planner.motion.joint_move import checked_start
from planner.motion.paths.chain import NoChain, find_chain
from planner.motion.paths.deviation import Deviations, FollowedPath, deviations
from planner.motion.paths.path import TipPath, graded, pieces_of
from planner.motion.paths.pieces import Piece
from planner.motion.paths.straight_line import DEFAULT_TOLERANCE, LineTolerance
from planner.motion.paths.windows import PathTask, Windows
from planner.trajectory import Trajectory, joined

START = LineTolerance(2e-6, 1e-5)
"""Maximum distance of the tip from the start of the path."""

RAMP_M, SPEED_RAMP_M, RAMP_POWER = 0.008, 0.004, 0.4
"""Length of the pieces beside corners for the default tolerance, and where the speed is set; and
the power of the tolerance with which it grows, since a larger one makes rounder corners."""

SLOWER, SAMPLE_S = 0.985, 0.002
"""A tip below this share of a set speed counts as slower, which leaves something of 2 % for what
happens between samples; and the distance of the samples."""


@frozen(error=MotionError)
class PathMove:
    """A motion of the tip along a path.

    Attributes:
        trajectory: of the joints.
        path: the pieces of the path, when the tip passes them, and how closely.
    """

    trajectory: Trajectory
    path: FollowedPath

    def deviations(self, arm: Arm, times_s: ArrayLike) -> Deviations:
        """How far the tip is from the path at some times.

        Args:
            arm: the arm that moves.
            times_s: shape (m,), s, within the motion.
        """
        times = finite_array(times_s, (None,), "times_s", MotionError)
        tips = arm.T_base_tips(self.trajectory.sample(times).q)
        return self.path.deviations(tips, times)

    def _facts(self) -> tuple[str, ...]:
        return f"{self.path.length_m:.3g} m", seconds(self.trajectory.duration)


def plan_path_move(
    manipulator: Manipulator,
    q_start: ArrayLike | None,
    path: TipPath | Sequence[TipPath],
    *,
    tolerance: LineTolerance = DEFAULT_TOLERANCE,
    speed_m_s: float | None = None,
    stop_at_corners: bool = False,
    context: CollisionContext | None = None,
) -> PathMove:
    """A fast motion of the tip along a path, from rest to rest: a local optimum.

    At samples at most 2 ms apart there is a point of the path from which the tip is no farther than
    the tolerance, in position and in rotation. Corners are rounded within it. `verify` proves it
    for every instant, of a plan with a `Move` that states the path.

    Args:
        manipulator: the arm whose tip moves.
        q_start: configuration at the start of the path, shape (7,), rad; None for the one that a
            chain of quick motions from rest to rest through the path begins with.
        path: a polyline, an arc or a curve of the tip, or several that follow one another.
        tolerance: maximum deviation of the tip; it may leave the rotation about an axis free.
        speed_m_s: speed that the tip keeps where limits and corners allow it
            (`FollowedPath.slower_s`); as fast as possible when not given.
        stop_at_corners: whether the arm rests at corners instead of rounding them.
        context: the surroundings of the arm, of which the motion is proven to be clear.

    Raises:
        ConfigurationError: when `q_start` has another shape, is not finite or outside the limits.
        PoseError: when a pose is invalid.
        PathMoveError: when the arm cannot reach or follow the path, with the length up to there.
        MotionError: when the path is none, or does not begin where the tip is at `q_start`, or an
            argument has the wrong type.
    """
    expect(manipulator, Manipulator, "manipulator", MotionError)
    expect(tolerance, LineTolerance, "tolerance", MotionError)
    limits, arm = manipulator.limits, manipulator.arm
    if speed_m_s is not None:
        speed_m_s = positive_scalar(speed_m_s, "speed_m_s", MotionError)
    ramp_m = RAMP_M if speed_m_s is None else SPEED_RAMP_M
    ramp_m *= (tolerance.position_m / DEFAULT_TOLERANCE.position_m) ** RAMP_POWER
    pieces = graded(pieces_of(path), ramp_m)
    is_free = None
    if context is not None:
        is_free = expect(context, CollisionContext, "context", MotionError).is_free
    q = None if q_start is None else checked_start(q_start, limits)
    if q is not None:
        _refuse_other_start(arm, q, pieces[0], tolerance)
    chain = find_chain(manipulator.ik, limits, pieces, tolerance, q_start=q, is_free=is_free)
    if isinstance(chain, NoChain):
        raise _unreachable(manipulator, pieces, chain)
    task = PathTask(pieces, tolerance, stop_at_corners, speed_m_s, context)
    motions = Windows(arm, limits, task, chain).motions()
    if len(motions) < len(pieces):
        raise _at_waypoint(pieces, len(motions), "no motion onwards is found")
    trajectory = joined(motions)
    times = np.linspace(0.0, trajectory.duration, 2 + int(trajectory.duration / SAMPLE_S))
    tips = arm.T_base_tips(trajectory.sample(times).q)
    followed = FollowedPath(
        pieces,
        np.cumsum([motion.duration for motion in motions]),
        tolerance,
        speed_m_s,
        _slower_s(times, tips, speed_m_s or 0.0),
    )
    off = followed.deviations(tips, times)
    worst = int(off.share.argmax())
    if off.share[worst] > 1.0:
        number = int(np.searchsorted(followed.ends_s, times[worst]).clip(max=len(pieces) - 1))
        faster = "" if speed_m_s is None else " or another speed"
        raise _at_waypoint(
            pieces,
            number,
            f"the motion that is found there is {1e3 * off.off_m[worst]:.3g} mm and "
            f"{off.off_rad[worst]:.3g} rad off; a larger tolerance{faster} may help",
        )
    if context is not None:
        proof = context.prove(trajectory)
        if not proof.is_clear:
            raise MotionError(f"no motion along the path is proven clear: {proof}")
    return PathMove(trajectory, followed)


def _slower_s(times_s: FloatArray, T_base_tips: FloatArray, speed_m_s: float) -> FloatArray:
    """When the tip is below a speed by samples, shape (k, 2), s."""
    speeds = np.linalg.norm(np.gradient(T_base_tips[:, :3, 3], times_s, axis=0), axis=1)
    is_slow = np.concatenate([[False], speeds < SLOWER * speed_m_s, [False]])
    changes = np.flatnonzero(np.diff(is_slow.astype(np.int8)))
    first, last = (changes[::2] - 1).clip(min=0), changes[1::2].clip(max=len(times_s) - 1)
    return np.stack([times_s[first], times_s[last]], axis=1)


def _refuse_other_start(arm: Arm, q: FloatArray, piece: Piece, tolerance: LineTolerance) -> None:
    tip = arm.T_base_tip(q).homogeneous[None]
    start = Piece(piece.T_base_start, np.zeros((3, 3)), np.zeros(3))
    exact = evolve(START, free_about=tolerance.free_about)
    off = deviations([start], exact, tip, np.zeros(1, dtype=np.intp))
    if off.share[0] > 1.0:
        raise MotionError(
            f"at q_start the tip is {1e3 * off.off_m[0]:.4g} mm and {off.off_rad[0]:.4g} rad from "
            "the start of the path; move it there first, or let q_start be None"
        )


def _unreachable(manipulator: Manipulator, pieces: Sequence[Piece], at: NoChain) -> PathMoveError:
    """Why there is no chain of configurations."""
    if at.reason:
        return _at_waypoint(pieces, at.waypoint, at.reason)
    T = pieces[at.waypoint - 1].T_base_goal if at.waypoint else pieces[0].T_base_start
    found = manipulator.ik.solve(T)
    reason = "no configuration is found there" if found.is_valid else str(found.failure)
    return _at_waypoint(pieces, at.waypoint, reason)


def _at_waypoint(pieces: Sequence[Piece], number: int, reason: str) -> PathMoveError:
    T = pieces[number - 1].T_base_goal if number else pieces[0].T_base_start
    length_m = sum(piece.length_m for piece in pieces[:number])
    return PathMoveError(length_m, f"at {position(T)}, {reason}")
