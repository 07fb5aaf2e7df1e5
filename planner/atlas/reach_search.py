"""Which poses of one arm are within reach: a witness or a proof for each, for many at a time.

Poses come as pairs of a position and a direction of the tool, each with the same rolls about it.
The tool's z axis is the last joint's, so that a configuration that reaches one roll reaches all
others by w2 alone, as far as its limits allow. For all pairs that the spans of the arm do not rule
out:

1. closed forms (`ClosedForm`) at a few angles of s0, then more of them where nothing came of it: of
   the configurations inside the limits, each roll gets the one farthest from them. A search of the
   IK service makes it exact.
2. in between, proofs that a pair is out of reach in any roll (`ReachBound.are_proven`), each as
   long as the closed forms before it.
3. poses that are left: searches from the configurations that violate the limits least.
4. then sweeps of s0 and w0 (`PoseSweep`): of pairs with nothing found in any roll, then of poses.

What is left is undecided. A witness is stored in whole steps of `RAD_PER_STEP`, and counts if what
is stored is inside the limits and within the tolerances, by forward kinematics of the robot's
model. Every number depends on the arm, the pose and its block alone, not on who computes it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin import IKService
from baxter_kin.ik.reach.bound import ReachBound
from baxter_kin.ik.reach.closed_form import ClosedForm
from baxter_kin.ik.result import ORIENTATION_TOLERANCE_RAD, POSITION_TOLERANCE_M
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray, Indices
from planner.atlas.rotations import RotationGrid, about_z

Steps: TypeAlias = NDArray[np.int32]
Codes: TypeAlias = NDArray[np.int16]
Flags: TypeAlias = NDArray[np.bool_]

UNREACHABLE, UNDECIDED, NOT_COMPUTED = -1, -2, -3
"""Codes in the place of a margin."""

RAD_PER_STEP = 2.0**-29
"""Of stored witnesses: 1.9e-9 rad, so that 32 bits hold angles up to 4 rad."""

RAD_PER_MARGIN = 1e-4
"""Of stored margins, which are rounded down."""

TURNS, ROLLS, PROOF_LEVELS = (4, 10, 32, 96), (1, 1, 1, 2), (1, 2, 5, 5)
"""Stage by stage: angles of s0 and of w0 to begin from, and sizes of cells in the proofs after."""

PAIRS = 64
"""Worked on together."""

NEAREST, SEARCHES = 12, 240
"""From how many configurations a pose is searched for; and how many searches one call does."""

ENDS_RAD = 1e-8
"""How far inside the limits searches stay, so that rounding to steps stays inside, too."""

_COAXIAL = 1e-9  # how far (m, and of a unit vector) the tool's axis may be from the last joint's


class Cells(NamedTuple):
    """Results for n positions with r rotations each.

    Attributes:
        margins: of the witness to the nearest joint limit, in steps of `RAD_PER_MARGIN`, or
            `UNREACHABLE` or `UNDECIDED`; shape (n, r).
        witnesses: in steps of `RAD_PER_STEP`, zero where there is none; shape (n, 7, r).
    """

    margins: Codes
    witnesses: Steps


class ReachSearch:
    """The search for one arm and one set of rotations.

    Attributes:
        backend: where the IK service's searches run; their last bits depend on it.
    """

    def __init__(self, arm: Arm, rotations: RotationGrid) -> None:
        """Prepare it."""
        self._arm, self._bound, self._ik = arm, ReachBound(arm), IKService(arm)
        self.backend = str(self._ik.backend.value)
        is_shared = is_coaxial(self._bound.T_last_tip)
        self._rotations = rotations if is_shared else rotations.expanded()
        self._forms = [
            ClosedForm(arm, turns=turns, rolls=rolls)
            for turns, rolls in zip(TURNS, ROLLS, strict=True)
        ]
        limits = arm.limits
        self._q_min, self._q_max = limits.q_min + ENDS_RAD, limits.q_max - ENDS_RAD
        self._bounds = np.concatenate([self._q_min, self._q_max])

    def search(self, points: FloatArray) -> Cells:
        """What can be said of positions, shape (n, 3), m, in base."""
        Rs = self._rotations.R_base_tips
        Ts = np.zeros((len(points) * len(Rs), 4, 4))
        Ts[:, :3, :3], Ts[:, 3, 3] = np.tile(Rs, (len(points), 1, 1)), 1.0
        Ts[:, :3, 3] = np.repeat(points, len(Rs), axis=0)
        rolls = len(self._rotations.rolls)
        margins = np.full((len(Ts), rolls), UNREACHABLE, np.int16)
        witnesses = np.zeros((len(Ts), 7, rolls), np.int32)
        inside = np.flatnonzero(~self._bound.are_outside_shells(Ts))
        for at in range(0, len(inside), PAIRS):
            pairs = inside[at : at + PAIRS]
            found = _Pairs(Ts[pairs], self._rotations.rolls)
            self._decide(found)
            margins[pairs] = found.margins
            witnesses[pairs] = found.witnesses
        by_joint = witnesses.reshape(len(points), len(Rs), 7, rolls).swapaxes(1, 2)
        return Cells(margins.reshape(len(points), -1), by_joint.reshape(len(points), 7, -1))

    def _decide(self, found: _Pairs) -> None:
        bound = self._bound
        for form, levels in zip(self._forms, PROOF_LEVELS, strict=True):
            self._try_closed_forms(found, form)
            found.rule_out_pairs(partial(bound.are_proven, levels=levels))
        self._try_nearest(found)
        found.rule_out_pairs(partial(bound.are_beyond_limits, any_roll=True))
        found.rule_out_poses(bound.are_beyond_limits)

    def _try_closed_forms(self, found: _Pairs, form: ClosedForm) -> None:
        """For each open roll of each pair, the best configuration inside the limits."""
        pairs = found.open_pairs()
        if not pairs.size:
            return
        q, misfit = form.configurations(found.Ts[pairs])
        margins, best = self._best(q, misfit, found.rolls)
        at, roll = np.nonzero(found.is_open[pairs] & (margins > 0.0))
        chosen = at * q.shape[1] + best[at, roll]
        different, which = np.unique(chosen, return_inverse=True)
        rows, columns = np.divmod(different, q.shape[1])
        exact = self._searched(q[rows, columns], found.Ts[pairs[rows]])
        q_rolled = exact[which]
        q_rolled[:, 6] = _wrapped(q_rolled[:, 6] + found.rolls[roll])
        self._take(found, pairs[at], roll, q_rolled)

    def _best(
        self, q: FloatArray, misfit: FloatArray, rolls: FloatArray
    ) -> tuple[FloatArray, Indices]:
        """The greatest margin of configurations, (m, n, 7), for each roll, and whose it is."""
        lowest = np.minimum(q - self._q_min, self._q_max - q)[..., :6].min(axis=2) - misfit
        w2 = _wrapped(q[:, :, 6, None] + rolls)
        free = np.minimum(w2 - self._q_min[6], self._q_max[6] - w2)
        margins = np.minimum(lowest[:, :, None], free)
        best = margins.argmax(axis=1)
        return np.take_along_axis(margins, best[:, None], axis=1)[:, 0], best

    def _try_nearest(self, found: _Pairs) -> None:
        """Search for open poses from the configurations that violate the limits least."""
        for pair in found.open_pairs():
            q, misfit = (rows[0] for rows in self._forms[-1].configurations(found.Ts[pair, None]))
            for roll in np.flatnonzero(found.is_open[pair]):
                turned = q.copy()
                turned[:, 6] = _wrapped(turned[:, 6] + found.rolls[roll])
                excess = np.maximum(self._q_min - turned, turned - self._q_max).max(axis=1)
                nearest = np.argsort(excess + misfit, kind="stable")[:NEAREST]
                Ts = found.poses(np.repeat(pair, NEAREST), np.repeat(roll, NEAREST))
                q_found = self._searched(turned[nearest], Ts)
                margin = np.minimum(q_found - self._q_min, self._q_max - q_found).min(axis=1)
                is_met = np.flatnonzero(_are_met(self._arm, q_found, Ts))
                if is_met.size:
                    best = is_met[margin[is_met].argmax()]
                    self._take(found, np.array([pair]), np.array([roll]), q_found[best, None])

    def _searched(self, q_starts: FloatArray, Ts: FloatArray) -> FloatArray:
        """What searches of the IK service end at, found or not, shape (m, 7)."""
        parts = [slice(at, at + SEARCHES) for at in range(0, len(q_starts), SEARCHES)]
        starts = q_starts.clip(self._q_min, self._q_max)
        found = [self._ik.search.search(starts[p], Ts[p], self._bounds).q for p in parts]
        return np.concatenate([np.zeros((0, 7)), *found])

    def _take(self, found: _Pairs, pairs: Indices, rolls: Indices, q: FloatArray) -> None:
        """Keep configurations, shape (m, 7), that are witnesses as they are stored."""
        if not pairs.size:
            return
        steps, margins = as_stored(self._arm, q, found.poses(pairs, rolls))
        holds = margins >= 0
        kept = pairs[holds], rolls[holds]
        found.margins[kept] = margins[holds]
        found.witnesses[kept[0], :, kept[1]] = steps[holds]


class _Pairs:
    """Pairs of a position and a direction, and what is known of each of their rolls."""

    def __init__(self, Ts: FloatArray, rolls: FloatArray) -> None:
        self.Ts, self.rolls = Ts, rolls
        self._turns = np.zeros((len(rolls), 4, 4))
        self._turns[:, :3, :3], self._turns[:, 3, 3] = about_z(rolls), 1.0
        self.margins = np.full((len(Ts), len(rolls)), UNDECIDED, np.int16)
        self.witnesses = np.zeros((len(Ts), 7, len(rolls)), np.int32)

    @property
    def is_open(self) -> Flags:
        """Which poses are undecided, shape (pairs, rolls)."""
        return np.asarray(self.margins == UNDECIDED)

    def open_pairs(self) -> Indices:
        """Those with an open roll."""
        return np.flatnonzero(self.is_open.any(axis=1))

    def poses(self, pairs: Indices, rolls: Indices) -> FloatArray:
        """Poses of the tip seen from base, shape (m, 4, 4)."""
        turned: FloatArray = self.Ts[pairs] @ self._turns[rolls]
        return turned

    def rule_out_pairs(self, are_proven: Callable[[FloatArray], Flags]) -> None:
        """Try proofs for any roll of pairs of which no roll was reached."""
        pairs = np.flatnonzero(self.is_open.all(axis=1))
        if pairs.size:
            self.margins[pairs[are_proven(self.Ts[pairs])]] = UNREACHABLE

    def rule_out_poses(self, are_proven: Callable[[FloatArray], Flags]) -> None:
        """Try proofs for poses that are open."""
        pairs, rolls = np.nonzero(self.is_open)
        if pairs.size:
            proven = are_proven(self.poses(pairs, rolls))
            self.margins[pairs[proven], rolls[proven]] = UNREACHABLE


def as_stored(arm: Arm, q: FloatArray, Ts: FloatArray) -> tuple[FloatArray, Codes]:
    """Configurations in the steps of a map, and their margins in the steps of a map.

    The margin of one that is not a witness of its pose, as it is stored, is `UNDECIDED`.

    Args:
        arm: the arm.
        q: configurations, shape (m, 7), rad.
        Ts: poses of the tip seen from base, shape (m, 4, 4).

    Returns:
        Multiples of `RAD_PER_STEP`, shape (m, 7), and of `RAD_PER_MARGIN`, shape (m,).
    """
    steps: FloatArray = np.rint(q / RAD_PER_STEP)
    stored = steps * RAD_PER_STEP
    margins = np.minimum(stored - arm.limits.q_min, arm.limits.q_max - stored).min(axis=1)
    holds = (margins >= 0.0) & _are_met(arm, stored, Ts)
    return steps, np.where(holds, np.floor(margins / RAD_PER_MARGIN), UNDECIDED).astype(np.int16)


def _are_met(arm: Arm, q: FloatArray, Ts: FloatArray) -> Flags:
    """Whether configurations reach poses, by forward kinematics."""
    reached = arm.T_base_tips(q)
    offset = np.linalg.norm(reached[:, :3, 3] - Ts[:, :3, 3], axis=1)
    chord = np.linalg.norm(reached[:, :3, :3] - Ts[:, :3, :3], axis=(1, 2))
    is_turned = chord <= math.sqrt(2.0) * ORIENTATION_TOLERANCE_RAD
    return np.asarray((offset <= POSITION_TOLERANCE_M) & is_turned)


def is_coaxial(T_last_tip: pin.SE3) -> bool:
    """Whether the tool's z axis, seen from the last joint's frame, is that joint's axis."""
    p, z = T_last_tip.translation, T_last_tip.rotation[:, 2]
    return bool(np.hypot(*p[:2]) + np.hypot(*z[:2]) <= _COAXIAL)


def _wrapped(angles: FloatArray) -> FloatArray:
    """Between -pi and pi."""
    return (angles + math.pi) % (2.0 * math.pi) - math.pi
