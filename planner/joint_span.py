"""JointSpan: how far the joints of a motion get from where they are at an instant, exactly.

Between two neighbouring ones of its knots and turning points a joint of a piecewise-cubic motion
only rises or only falls. So the positions at an interval's two ends, and at the knots and turning
points inside it, hold the lowest and the highest position of the interval.
"""

from __future__ import annotations

import numpy as np

from baxter_kin.arrays import Indices, Vector
from baxter_kin.errors import expect
from planner.errors import TrajectoryError
from planner.trajectory import CONTINUITY_TOLERANCE, Trajectory


class JointSpan:
    """The positions of a motion that bound all others."""

    def __init__(self, trajectory: Trajectory) -> None:
        """Collect knots and turning points.

        Raises:
            TrajectoryError: when it is no `Trajectory`.
        """
        self._trajectory = expect(trajectory, Trajectory, "trajectory", TrajectoryError)
        times = np.concatenate([trajectory.knots_s, trajectory.turning_times])
        self._times = np.unique(np.clip(times, 0.0, trajectory.duration))
        self._positions = trajectory.sample(self._times).q

    def around_middle(self, starts_s: Vector, ends_s: Vector) -> tuple[Vector, Vector]:
        """Where the joints are in the middle of intervals, and how far they get from there.

        Args:
            starts_s: shape (m,), seconds.
            ends_s: shape (m,), seconds, none before its start.

        Returns:
            Positions at the middles, shape (m, n), rad, and the greatest distance of each joint
            from them at any time of the interval, shape (m, n), rad, `CONTINUITY_TOLERANCE`
            included, by which positions may jump at a knot.
        """
        at = self._trajectory.sample
        middles = at((starts_s + ends_s) / 2).q
        ends = np.maximum(np.abs(at(starts_s).q - middles), np.abs(at(ends_s).q - middles))
        first = np.searchsorted(self._times, starts_s, side="left")
        last = np.searchsorted(self._times, ends_s, side="right")
        highest = np.maximum(self._over(np.maximum, first, last, middles) - middles, 0.0)
        lowest = np.maximum(middles - self._over(np.minimum, first, last, middles), 0.0)
        return middles, np.maximum(ends, np.maximum(highest, lowest)) + CONTINUITY_TOLERANCE

    def _over(self, extreme: np.ufunc, first: Indices, last: Indices, empty: Vector) -> Vector:
        """The extreme of the collected positions first .. last - 1; `empty` where there is none."""
        padded = np.concatenate([self._positions, self._positions[-1:]])
        bounds = np.column_stack([first, last]).reshape(-1)
        found: Vector = extreme.reduceat(padded, bounds, axis=0)[::2]
        return np.where((last > first)[:, None], found, empty)
