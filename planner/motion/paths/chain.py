"""A chain of configurations along a path of the tip, as an initial guess.

Inverse kinematics gives many configurations at the start of each piece and at the end of the last.
Dynamic programming chooses the chain with the least sum of squared durations of motions from rest
to rest. Whether the arm
can follow a piece from one configuration to the next is tried only for those that are chosen; where
it cannot, that step is struck out and the chain is chosen anew.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from baxter_kin import IKService, JointLimits
from baxter_kin.ik import sample_solutions
from baxter_kin.validation import FloatArray
from planner.motion.joint_move import rest_to_rest_s
from planner.motion.paths.pieces import Piece
from planner.motion.paths.straight_line import LineTolerance, Turn

TURNS, SPINS = 48, 12
"""Number of angles of s0 at which solutions are sampled; and of rotations about a free axis."""

LOOKS, MAX_JUMP_RAD, MAX_JUMP_RATIO = 6, 0.35, 3.0
"""Number of steps along a piece; and the maximum change of a joint in one of them, in rad, or as a
multiple of its average change where that is more."""

MAX_STEP_RAD, MAX_REFUSED = 1.2, 400
"""Maximum change of a joint along a piece, and maximum number of steps of the chain that the arm
cannot follow before the search gives up."""

ROOM_COST, ROOM = 0.05, 0.02
"""Cost of a configuration at a limit, in s^2, and the share of a joint's range in which it falls by
a factor e."""

NEWTON_STEPS, ACCURACY, MIN_SINGULAR_RATIO = 10, 1e-8, 1e-4
"""Newton's method: maximum number of steps, error at convergence, in m and rad, and the minimum
ratio of a singular value of the Jacobian to the largest."""


class NoChain(NamedTuple):
    """Why there is no chain.

    Attributes:
        waypoint: number of the end of a piece that has no configuration, or to which none leads
            from the ones before; 0 is the start of the path.
        reason: why; empty where it has no configuration at all.
    """

    waypoint: int
    reason: str = ""


class Chain:
    """Configurations along a path.

    Attributes:
        qs: at the start of each piece and at the end of the last, shape (n + 1, 7), rad.
    """

    def __init__(self, pieces: Sequence[Piece], qs: FloatArray, follower: Follower) -> None:
        self.qs = qs
        self._pieces, self._follower = pieces, follower

    def along(self, number: int, q_start: FloatArray, fractions: FloatArray) -> FloatArray:
        """Configurations on a piece from a start to the chain's end of it, shape (m, 7).

        Where Newton's method does not converge, those in between in joint space.

        Args:
            number: of the piece.
            q_start: configuration at its start, shape (7,), rad.
            fractions: from 0 to 1, shape (m,).
        """
        qs = q_start + fractions[:, None] * (self.qs[number + 1] - q_start)
        for k, s in enumerate(fractions.tolist()[1:-1], 1):
            q = self._follower.on_piece(qs[k], self._pieces[number], s)
            qs[k] = qs[k] if q is None else q
        found: FloatArray = qs
        return found


class Follower:
    """Leads configurations onto pieces by Newton's method with least-norm steps."""

    def __init__(self, ik: IKService, limits: JointLimits, tolerance: LineTolerance) -> None:
        self._arm, self._limits, self._tolerance = ik.arm, limits, tolerance

    def on_piece(self, q: FloatArray, piece: Piece, s: float) -> FloatArray | None:
        """The configuration near another one whose tip is on a piece; None where none is found."""
        limits, wanted = self._limits, piece.at(s)
        for _ in range(NEWTON_STEPS):
            error, jacobian = self._error(q, wanted)
            if np.linalg.norm(error) < ACCURACY:
                return q
            step = np.linalg.lstsq(jacobian, error, rcond=MIN_SINGULAR_RATIO)[0]
            q = (q + step).clip(limits.q_min, limits.q_max)
        return None

    def follows(self, q_start: FloatArray, q_end: FloatArray, piece: Piece) -> list[FloatArray]:
        """Configurations along a piece, both ends included; empty where the arm would jump."""
        qs = [q_start]
        for s in np.linspace(0.0, 1.0, LOOKS + 1)[1:-1].tolist():
            q = self.on_piece(q_start + s * (q_end - q_start), piece, s)
            if q is None:
                return []
            qs.append(q)
        qs.append(q_end)
        most = max(MAX_JUMP_RAD, MAX_JUMP_RATIO * float(np.abs(q_end - q_start).max()) / LOOKS)
        return qs if np.abs(np.diff(qs, axis=0)).max() < most else []

    def _error(self, q: FloatArray, wanted: pin.SE3) -> tuple[FloatArray, FloatArray]:
        """What is missing to a pose, along the axes that are not free; and its Jacobian."""
        T, J, turn = self._arm.T_base_tip(q), self._arm.jacobian(q), self._tolerance.turn
        away = wanted.translation - T.translation
        if turn is Turn.FREE:
            return away, J[:3]
        R = T.rotation
        if turn is Turn.FIXED:
            return np.concatenate([away, R @ pin.log3(R.T @ wanted.rotation)]), J
        k = "xyz".index(self._tolerance.free_about)
        others = [i for i in range(3) if i != k]
        lean = np.cross(np.eye(3)[k], R.T @ wanted.rotation[:, k])  # a log would mix in the rest
        return np.concatenate([away, lean[others]]), np.vstack([J[:3], (R.T @ J[3:])[others]])


def find_chain(
    ik: IKService,
    limits: JointLimits,
    pieces: Sequence[Piece],
    tolerance: LineTolerance,
    *,
    q_start: FloatArray | None = None,
    is_free: Callable[[FloatArray], bool] | None = None,
) -> Chain | NoChain:
    """The chain along pieces with the least cost, or where there is none.

    Args:
        ik: inverse kinematics of the arm.
        limits: of its joints.
        pieces: in order.
        tolerance: says which rotations are free.
        q_start: configuration at the start; any when not given.
        is_free: whether a configuration is clear of obstacles.
    """
    first = _solutions(ik, pieces[0].T_base_start, tolerance) if q_start is None else q_start[None]
    layers = [first, *(_solutions(ik, piece.T_base_goal, tolerance) for piece in pieces)]
    for number, layer in enumerate(layers):
        if not len(layer):
            return NoChain(number)
        if is_free is not None:
            layers[number] = layer[[is_free(q) for q in layer]]
            if not len(layers[number]):
                return NoChain(
                    number, "every configuration that was found there is too near to something"
                )
    costs = [_costs(*pair, limits) for pair in itertools.pairwise(layers)]
    follower, known = Follower(ik, limits, tolerance), set()
    refused, farthest = 0, 0
    while refused < MAX_REFUSED:
        way = _quickest(costs)
        if isinstance(way, int):
            return NoChain(way, "no configuration there can be reached along the path")
        is_chain = True
        for k, (i, j) in enumerate(itertools.pairwise(way)):
            if (k, i, j) in known:
                continue
            between = follower.follows(layers[k][i], layers[k + 1][j], pieces[k])
            if between and (is_free is None or all(map(is_free, between))):
                known.add((k, i, j))
            else:
                costs[k][i, j], is_chain = np.inf, False
                refused, farthest = refused + 1, max(farthest, k + 1)
        if is_chain:
            qs = np.array([layer[i] for layer, i in zip(layers, way, strict=True)])
            return Chain(pieces, qs, follower)
    return NoChain(farthest, f"no way on was found in {MAX_REFUSED} attempts")


def _solutions(ik: IKService, T_base_tip: pin.SE3, tolerance: LineTolerance) -> FloatArray:
    """Configurations at a pose, with several rotations about a free axis, shape (n, 7)."""
    if tolerance.turn is Turn.FIXED:
        return sample_solutions(ik, T_base_tip, turns=TURNS)
    axes = np.eye(3)[["xyz".index(axis) for axis in tolerance.free_about]]
    angles = np.linspace(0.0, 2.0 * np.pi, SPINS, endpoint=False)
    turns = [pin.exp3(angle * axis) for axis in axes for angle in angles]
    spun = (pin.SE3(T_base_tip.rotation @ R, T_base_tip.translation) for R in turns)
    return np.concatenate([sample_solutions(ik, T, turns=TURNS // 4) for T in spun])


def _costs(first: FloatArray, second: FloatArray, limits: JointLimits) -> FloatArray:
    """Costs of steps between two layers, shape (m, n): squares of durations, and room at limits."""
    ways = second[None] - first[:, None]
    room = np.minimum(second - limits.q_min, limits.q_max - second)
    share = (room / (limits.q_max - limits.q_min)).min(axis=1)
    costs = rest_to_rest_s(ways, limits) ** 2 + ROOM_COST * np.exp(-share / ROOM)
    found: FloatArray = np.where(np.abs(ways).max(axis=2) > MAX_STEP_RAD, np.inf, costs)
    return found


def _quickest(costs: Sequence[FloatArray]) -> list[int] | int:
    """Numbers of the configurations with the least sum of costs; or the layer out of reach."""
    best, back = np.zeros(len(costs[0])), []
    for number, cost in enumerate(costs, 1):
        totals = best[:, None] + cost
        back.append(totals.argmin(axis=0))
        best = totals.min(axis=0)
        if not np.isfinite(best).any():
            return number
    way = [int(best.argmin())]
    for before in reversed(back):
        way.append(int(before[way[-1]]))
    return way[::-1]
