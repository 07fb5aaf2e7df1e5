"""Bounds over all joint positions in a tube: smallest distances, and positions of the tip."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from baxter_kin.validation import FloatArray
from planner.certificate.boxes import Tube, box_gaps_m, box_rows
from planner.certificate.clusters import Clusters
from planner.certificate.intervals import norm_bound
from planner.certificate.robot import ARM_JOINTS, Robot
from planner.certificate.rows import Joints, Pair, Step
from planner.prover.kernel import Trees, rows_kernel
from planner.prover.numpy_boxes import search_tube
from planner.prover.problem import SHARES, BoxesFound, Chain, Near, Outcome
from planner.trajectory import Trajectory
from planner.verification.lag.response_tube import positions

PATH_S = 2e-3
"""Plan time between two points of a path."""


class TubeDistances:
    """The smallest distances of pairs in tubes, proven by rows that the checker concludes."""

    def __init__(self, robot: Joints, clusters: Clusters) -> None:
        """Lay out all trees; none may be added later."""
        self._robot, self._clusters, self._chain = robot, clusters, Chain.of(robot)
        kernel = rows_kernel()
        self._trees = None if kernel is None else Trees.of(kernel, clusters)

    def least(self, pairs: Sequence[Pair], tube: Tube) -> Near | None:
        """The smallest distance of some pairs in a tube; None where too many rows are needed.

        The time is the number of an instant; a distance that could not be proven positive is
        reported as not positive.
        """
        found = self._sought(pairs, tube)
        if found.outcome == Outcome.TOO_MUCH:
            return None
        if found.outcome != Outcome.PROVEN:
            return found.stopped._replace(distance_m=min(found.stopped.distance_m, 0.0))
        rows, n = box_rows(self._clusters, pairs, tube, found.trace)
        gaps_m = box_gaps_m(self._robot, self._clusters, pairs, rows, n)
        least = int(gaps_m.argmin())
        middle = 0.5 * float(rows.start[least] + rows.end[least])
        return Near(int(rows.pair[least]), float(gaps_m[least]), middle)

    def _sought(self, pairs: Sequence[Pair], tube: Tube) -> BoxesFound:
        kernel = rows_kernel()
        if kernel is None or self._trees is None:
            return search_tube(self._robot, self._clusters, pairs, tube)
        step = Step("", pairs, None, np.zeros(self._chain.joints))
        there = self._trees, self._trees.pairs(step), tube
        for share in SHARES:
            found = kernel.search_tube(self._chain, *there, share=share)
            if found.outcome in (Outcome.PROVEN, Outcome.TOO_NEAR):
                break
        return found


def path_of(robot: Robot, motion: Trajectory) -> FloatArray:
    """Positions of the tip along a motion, closely spaced, shape (k, 3), m."""
    end_s = float(motion.knots_s[-1])
    times_s = np.linspace(0.0, end_s, 2 + int(end_s / PATH_S))
    return tips_at(robot, positions(motion, times_s)[0][:, None])[:, 0]


def tips_off(robot: Robot, boxes: FloatArray, path: FloatArray) -> FloatArray:
    """Maximum distance of the tip from the nearest point of a path, in each box, shape (m,), m.

    Along any unit vector the tip's position is c + A cos q + B sin q as a function of any one joint
    q, so its distance is at most the greatest at the corners plus the sag of the lemma.

    Args:
        robot: the robot.
        boxes: lowest and highest angles of the joints, shape (m, 2, 7), rad.
        path: points, shape (k, 3), m.
    """
    tips = tips_at(robot, boxes)
    middles = tips.mean(axis=1)
    nearest = np.array([path[np.linalg.norm(path - x, axis=1).argmin()] for x in middles])
    off_m: FloatArray = np.linalg.norm(tips - nearest[:, None], axis=2).max(axis=1)
    return off_m + tip_sags(robot, boxes)


def tip_sags(robot: Robot, boxes: FloatArray, points: FloatArray | None = None) -> FloatArray:
    """How far the tip may be beyond its places at the corners of boxes, in any direction, (m,).

    Args:
        robot: the robot.
        boxes: lowest and highest angles of the joints, shape (m, 2, 7), rad.
        points: instead of the tip, as of `tips_at`.
    """
    reach_m: float | FloatArray = float(norm_bound(robot.tip.p.magnitude))
    if points is not None:
        reach_m = np.linalg.norm(points, axis=1)[:, None]
    rho = reach_m + np.append(np.cumsum(robot.offsets[:0:-1])[::-1], 0)
    sags: FloatArray = (np.ptp(boxes, axis=1) ** 2 * rho).sum(axis=1) / 8.0
    return sags


def tips_at(robot: Robot, choices: FloatArray, points: FloatArray | None = None) -> FloatArray:
    """Positions of the tip for all combinations of c angles of each joint.

    Args:
        robot: the robot.
        choices: the angles, shape (m, c, 7), rad.
        points: instead of the tip, points seen from the last joint, shape (m, 3), m.

    Returns:
        Shape (m, c^7, 3), m.
    """
    points = robot.tip.p.centred()[0] if points is None else points[:, None]
    points = np.broadcast_to(points, (len(choices), 1, 3))
    for joint in range(ARM_JOINTS - 1, -1, -1):
        span, q = robot.spans[joint], choices[:, :, joint, None]
        x, y, z = (points[:, None, :, i] for i in range(3))
        c, s = np.cos(q), np.sin(q)
        turned = np.stack(
            [c * x - s * y, s * x + c * y, np.broadcast_to(z, (c * x).shape)], axis=-1
        )
        points = turned.reshape(len(choices), -1, 3) @ span.R.centred()[0].T + span.p.centred()[0]
    return points


def wrists_at(robot: Robot, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Frames of the last joint at angles of shape (m, 7): rotations (m, 3, 3), and (m, 3), m."""
    at = [
        tips_at(robot, q[:, None], np.broadcast_to(point, (len(q), 3)))[:, 0]
        for point in (np.zeros(3), *np.eye(3))
    ]
    return np.stack([each - at[0] for each in at[1:]], axis=2), at[0]
