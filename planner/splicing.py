"""Trajectories taken apart and put together, exactly: no piece is sampled or fitted anew."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from baxter_kin.arrays import Vector, finite_scalar
from baxter_kin.errors import expect
from planner.errors import TrajectoryError, expect_all
from planner.trajectory import Trajectory

NEAREST_KNOT_S = 1e-6
"""A cut nearer to a knot than this is made at the knot, so that no sliver is left over."""


def nearest_cut(trajectory: Trajectory, t: float) -> float:
    """Where to cut near a time: at the nearest knot if that is within `NEAREST_KNOT_S`, else there.

    Raises:
        TrajectoryError: when the time is not a number inside the motion.
    """
    _check_time(trajectory, t)
    knot = float(trajectory.knots_s[np.abs(trajectory.knots_s - t).argmin()])
    return knot if abs(knot - t) < NEAREST_KNOT_S else t


def section(trajectory: Trajectory, start_s: float, end_s: float) -> Trajectory:
    """The part of a motion between two times, its own time starting at 0.

    Raises:
        TrajectoryError: when a time is not a number inside the motion, or the end comes first.
    """
    for t in (start_s, end_s):
        _check_time(trajectory, t)
    if end_s < start_s:
        raise TrajectoryError(f"a section cannot end at {end_s:g} s before it starts: {start_s:g}")
    knots = trajectory.knots_s
    inner = (knots > start_s) & (knots < end_s)
    times = np.unique(np.concatenate([[start_s], knots[inner], [end_s]]))
    q, v, a = trajectory.sample(times)
    return Trajectory(trajectory.limits, times - start_s, q, v, a, _jerks(trajectory, times))


def joined(trajectories: Iterable[Trajectory]) -> Trajectory:
    """One motion of several, each starting in the state where the one before ends.

    Args:
        trajectories: at least one; those of no duration leave no trace.

    Raises:
        TrajectoryError: when there is none, or q, v or a jump from one to the next.
    """
    given = expect_all(trajectories, Trajectory, "the motions to join", TrajectoryError)
    if not given:
        raise TrajectoryError("nothing to join; give at least one motion")
    parts = [part for part in given if part.duration > 0.0] or list(given[:1])
    starts = np.cumsum([0.0, *(part.duration for part in parts)])
    knots = [part.knots_s[:-1] + start for part, start in zip(parts, starts[:-1], strict=True)]
    q, v, a = (
        np.concatenate(
            [*(getattr(part, name)[:-1] for part in parts), getattr(parts[-1], name)[-1:]]
        )
        for name in "qva"
    )
    j = np.concatenate([part.j for part in parts])
    return Trajectory(parts[0].limits, np.concatenate([*knots, starts[-1:]]), q, v, a, j)


def _check_time(trajectory: Trajectory, t: float) -> None:
    duration = expect(trajectory, Trajectory, "trajectory", TrajectoryError).duration
    if not 0.0 <= finite_scalar(t, "time", TrajectoryError) <= duration:
        raise TrajectoryError(f"{t:g} s is outside the motion, which lasts {duration:g} s")


def _jerks(trajectory: Trajectory, times: Vector) -> Vector:
    """The jerk between every two neighbouring times, shape (m - 1, n)."""
    middles = (times[:-1] + times[1:]) / 2
    jerks: Vector = trajectory.j[np.searchsorted(trajectory.knots_s, middles, side="right") - 1]
    return jerks
