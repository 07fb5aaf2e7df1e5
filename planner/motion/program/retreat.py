"""Retreats: ways of an arm out of a confined configuration, before a path is searched.

A search by samples hardly ever finds its way into a hand's pose around a body, between two boards.
A retreat leaves such a pose step by step: the tip moves along a straight line, or the arm away from
what is nearest. Each step is the change of the joints nearest to the wanted one that keeps the
linearised distances and the limits. The hand may turn on the way, and the elbow may move aside.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from baxter_kin import Arm, JointLimits
from baxter_kin.validation import FloatArray
from planner.collision.context import SCREENING_STEP_RAD, IsFree
from planner.collision.obstacles import Obstacles

LENGTH_M, MIN_LENGTH_M = 0.3, 0.05
"""Length of a line on which a confined end is left, and of the shortest one that helps."""

LINES = 3
"""Maximum number of lines after one another."""

TOOL_AXES = np.array([[0, 0, -1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]], dtype=float)
"""Directions of these lines, seen from the tip: out of the grasp, and across."""

UP_AND_BACK = np.array([[0, 0, 1], [-1, 0, 0]], dtype=float)
"""Other directions, in base: up, and back towards the robot."""

STRIDE_M, MAX_STEPS, MAX_SLOW, SLOW = 0.02, 40, 3, 0.1
"""Travel of the tip in a step; maximum number of steps; and number of successive ones with a
smaller share of that travel after which a line ends."""

TURNS_M, DAMPING = (0.15, 0.02), 0.03
"""Lengths that a turn of the hand by a radian counts as, on lines where it hardly turns and on
others, and the damping of the joints, m/rad."""

AWAY_RAD, AWAY_STEPS, AWAY_M = 0.06, 25, 0.1
"""Change of the joints in a step away from obstacles, number of steps, and the distance of
obstacles that count, each by the inverse of its own."""

MAX_TURN_RAD, PAIRS, NEAR_M, KEPT = 0.12, 10, 0.08, 0.3
"""Maximum change of a joint in a step, number of pairs and their maximum distance that are
considered, and the share of their excess that a step keeps."""

MIN_EXCESS_M, SOFTENED_M = 1e-3, 3e-3
"""Minimum excess of a distance, and what is added to it, before its inverse is a weight."""

HALVINGS, SWEEPS = 3, 200
"""How often a step is halved that is not free; and iterations of a projection."""


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """An arm among obstacles.

    Attributes:
        arm: whose tip moves.
        limits: of its joints.
        obstacles: linearised distances.
        is_free: whether a configuration is free.
    """

    arm: Arm
    limits: JointLimits
    obstacles: Obstacles
    is_free: IsFree

    def retreat(self, q: FloatArray) -> list[FloatArray]:
        """Corners of a way out of a confined configuration, which is the first of them.

        It is the only one where no way out is found.
        """
        way = self._longest_line(q)
        if self._travel_m(way) < LENGTH_M:
            way = self._away(q)
            for _ in range(LINES):
                line = self._longest_line(way[-1])
                if self._travel_m(line) < MIN_LENGTH_M:
                    break
                way += line[1:]
                if self._travel_m(line) >= LENGTH_M:
                    break
        return self._shortened(way)

    def _travel_m(self, way: Sequence[FloatArray]) -> float:
        first, last = self.arm.T_base_tips(np.array([way[0], way[-1]]))[:, :3, 3]
        return float(np.linalg.norm(last - first))

    def _longest_line(self, q: FloatArray) -> list[FloatArray]:
        """The longest of the ways along all lines; the first one that has the whole length."""
        longest = [q]
        R = self.arm.T_base_tip(q).rotation
        for turn_m, direction in product(TURNS_M, (*(TOOL_AXES @ R.T), *UP_AND_BACK)):
            longest = max(longest, self._line(q, direction, turn_m), key=self._travel_m)
            if self._travel_m(longest) >= LENGTH_M:
                break
        return longest

    def _line(self, q: FloatArray, direction: FloatArray, turn_m: float) -> list[FloatArray]:
        """A way along a line, on which a turn by a radian counts as a length."""
        way, slow, start = [q], 0, self.arm.T_base_tip(q).translation
        weights = np.array([1.0, 1.0, 1.0, turn_m, turn_m, turn_m])
        wanted = np.concatenate([STRIDE_M * direction, np.zeros(3)])
        done_m = 0.0
        while len(way) <= MAX_STEPS and slow <= MAX_SLOW and done_m < LENGTH_M:
            J = weights[:, None] * self.arm.jacobian(way[-1])
            damped = J.T @ J + DAMPING**2 * np.eye(len(q))
            there = self._step(way[-1], np.linalg.solve(damped, J.T @ wanted), NEAR_M)
            if there is None:
                break
            before_m, done_m = done_m, (self.arm.T_base_tip(there).translation - start) @ direction
            slow = slow + 1 if done_m - before_m < SLOW * STRIDE_M else 0
            way.append(there)
        return way

    def _away(self, q: FloatArray) -> list[FloatArray]:
        """A way on which all distances grow, the smallest ones most."""
        way = [q]
        for _ in range(AWAY_STEPS):
            near = self.obstacles.nearest(way[-1][None], PAIRS, AWAY_M)
            weights = 1.0 / (near.excess_m.clip(min=MIN_EXCESS_M) + SOFTENED_M)
            slope = weights @ near.slopes
            if not slope.any():
                break
            there = self._step(way[-1], AWAY_RAD * slope / np.linalg.norm(slope), AWAY_M)
            if there is None:
                break
            way.append(there)
        return way

    def _step(self, q: FloatArray, wanted: FloatArray, within_m: float) -> FloatArray | None:
        """The free configuration after the nearest allowed step to the wanted one, or None."""
        near = self.obstacles.nearest(q[None], PAIRS, within_m)
        low = np.maximum(self.limits.q_min - q, -MAX_TURN_RAD)
        high = np.minimum(self.limits.q_max - q, MAX_TURN_RAD)
        identity = np.eye(len(q))
        slopes = np.concatenate([near.slopes, identity, -identity])
        least = np.concatenate([(KEPT - 1.0) * near.excess_m, low, -high])
        step = projected(wanted, slopes, least)
        for halvings in range(HALVINGS + 1):
            there: FloatArray = q + step / 2**halvings
            if self.is_free(there):
                return there
        return None

    def _shortened(self, way: Sequence[FloatArray]) -> list[FloatArray]:
        """The way by fewer corners, where straight lines between these look free."""
        corners, at = [way[0]], 0
        while at < len(way) - 1:
            last = len(way) - 1
            while last > at + 1 and not self._looks_free(way[at], way[last]):
                last = (at + last + 1) // 2
            corners.append(way[last])
            at = last
        return corners

    def _looks_free(self, q: FloatArray, other: FloatArray) -> bool:
        count = math.ceil(float(np.abs(other - q).max()) / SCREENING_STEP_RAD)
        return all(map(self.is_free, np.linspace(q, other, count + 1)[1:]))


def projected(wanted: FloatArray, slopes: FloatArray, least: FloatArray) -> FloatArray:
    """The point x nearest to a wanted one with `slopes @ x >= least`, to a few digits.

    By the method of Hildreth ("A quadratic programming procedure", Naval Research Logistics
    Quarterly 4, 1957); where no point satisfies all rows, the result is arbitrary.

    Args:
        wanted: shape (J,).
        slopes: shape (n, J).
        least: shape (n,).
    """
    x, squares = wanted.copy(), np.einsum("ij,ij->i", slopes, slopes)
    multipliers = np.zeros(len(least))
    for _ in range(SWEEPS):
        before = x.copy()
        for i in np.flatnonzero(squares).tolist():
            multiplier = max(0.0, multipliers[i] + (least[i] - slopes[i] @ x) / squares[i])
            x += (multiplier - multipliers[i]) * slopes[i]
            multipliers[i] = multiplier
        if np.abs(x - before).max() < 1e-6:
            break
    return x
