"""The share of a self-motion that is free of self-collision, by samples."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin import Baxter
from baxter_kin.ik import SelfMotion
from baxter_kin.ik.self_motion.curve_cubics import cubics
from baxter_kin.validation import FloatArray
from planner.collision.checker import ClearanceChecker
from planner.collision.context import CollisionContext
from planner.collision.robot.robot_shapes import RobotShapes
from planner.scene.bodies import Scene

SAMPLE_RAD = 0.1
"""Greatest distance of samples on a piece; a shorter collision, or a gap in one, may be missed."""

MIN_SAMPLES = 9
"""Number of samples of each piece, however short."""

HALVINGS = 5
"""Bisections between two samples of which one is free: the change is located to 0.003 rad."""


class SelfCollision:
    """One arm among the rest of the robot, and nothing else.

    Checked is what `planner.collision.checker.ClearanceChecker` checks: the arm's links, hand and
    fingers against each other and against the other links, the other arm included where it stands.
    """

    def __init__(self, robot: Baxter, side: str, q_others: ArrayLike | None = None) -> None:
        """Make the shapes.

        Args:
            robot: the robot.
            side: of the arm that moves.
            q_others: a full configuration, shape (19,), that says where all other joints stand;
                the other arm in neutral and all hands closed when not given.
        """
        others = robot.configuration() if q_others is None else q_others
        checker = ClearanceChecker(RobotShapes(robot), robot.arm(side), Scene({}))
        self._context = CollisionContext(checker, others)

    @property
    def q_others(self) -> FloatArray:
        """Where all other joints stand, shape (19,)."""
        return self._context.q_others

    def free_share(self, curves: Sequence[SelfMotion]) -> float:
        """Of the length of one or more pieces of self-motion, the share that touches nothing.

        Of pieces without length, the share of the pieces.
        """
        lengths = np.array([curve.length_rad for curve in curves])
        if lengths.sum() > 0.0:
            return float(sum(map(self._free_rad, curves)) / lengths.sum())
        return float(np.mean([self._context.is_free(curve.q[0]) for curve in curves]))

    def _free_rad(self, curve: SelfMotion) -> float:
        """The free length of a piece, by its samples."""
        if curve.length_rad == 0.0:
            return 0.0
        intervals = max(math.ceil(curve.length_rad / SAMPLE_RAD), MIN_SAMPLES - 1)
        s = np.linspace(0.0, curve.length_rad, intervals + 1)
        is_free = [self._context.is_free(q) for q in on_curve(curve, s)]
        free_rad = 0.0
        for i in range(intervals):
            if is_free[i] and is_free[i + 1]:
                free_rad += s[i + 1] - s[i]
            elif is_free[i]:
                free_rad += self._until_contact(curve, s[i], s[i + 1])
            elif is_free[i + 1]:
                free_rad += self._until_contact(curve, s[i + 1], s[i])
        return free_rad

    def _until_contact(self, curve: SelfMotion, free: float, touching: float) -> float:
        """The free length from one sample of a piece towards another, in contact."""
        begin = free
        for _ in range(HALVINGS):
            middle = 0.5 * (free + touching)
            if self._context.is_free(on_curve(curve, np.array([middle]))[0]):
                free = middle
            else:
                touching = middle
        return abs(0.5 * (free + touching) - begin)


def on_curve(curve: SelfMotion, s: FloatArray) -> FloatArray:
    """Configurations at lengths along a piece that has some, by cubics, shape (k, 7), rad."""
    segment = np.searchsorted(curve.s, s, side="right").clip(1, len(curve.s) - 1) - 1
    u = (s - curve.s[segment]) / (curve.s[segment + 1] - curve.s[segment])
    return cubics(curve.q, curve.tangent, segment, u)[0]
