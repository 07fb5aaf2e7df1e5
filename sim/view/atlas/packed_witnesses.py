"""Witnesses of a map, small enough for a page.

Cells that differ by a roll about the last joint's axis mostly share their witness but for w2, so
each is kept once, with w2 at roll zero. Of it, the first joint is rounded to `FIRST_BITS` of its
range and the others to `OTHER_BITS`: the page finds the configuration again by a few steps of
`polishing`. Here it is tried for all of them. Where what comes out misses its pose, lies outside
the limits or is another configuration, the witness is kept as it is in the map.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from baxter_kin.ik.result import ORIENTATION_TOLERANCE_RAD, POSITION_TOLERANCE_M
from baxter_kin.validation import FloatArray, Indices
from planner.atlas.reach_map import ReachMap
from planner.atlas.reach_search import RAD_PER_STEP
from sim.view.atlas.polishing import TipChain
from sim.view.atlas.shown_map import ShownMap

FIRST_BITS, OTHER_BITS = 16, 8

SAME_RAD = 0.02
"""How far a joint may end from the map's own witness; margins of a page are in steps of 0.01."""

TOLERANCE = min(POSITION_TOLERANCE_M, ORIENTATION_TOLERANCE_RAD) / 2.0
"""Metres and rad that a polished witness may be off: half of what a witness may be."""


@dataclass(frozen=True, slots=True, eq=False)
class PackedWitnesses:
    """Witnesses as the page reads them.

    Of each arm, position and direction with a reachable roll, in their order, one after the other.

    Attributes:
        of_roll: which of those of its pair each reachable cell has, shape (m,), from 0 on.
        first: s0 in steps of its range, shape (n,).
        others: the other joints, shape (6, n).
        kept: which are kept as they are, shape (k,), in ascending order.
        q_kept: these, w2 at roll zero, shape (k, 7), rad.
    """

    of_roll: NDArray[np.uint8]
    first: NDArray[np.uint16]
    others: NDArray[np.uint8]
    kept: NDArray[np.uint32]
    q_kept: FloatArray


def pack(found: ReachMap, shown: ShownMap) -> PackedWitnesses:
    """Pack the witnesses of a map's shown part."""
    cells, rolls = shown.cells, found.rotations.rolls
    at_zero = shown.q.copy()
    at_zero[:, 6] = wrapped(at_zero[:, 6] - rolls[cells[4] % len(rolls)])
    pairs = np.ravel_multi_index(tuple(cells), shown.codes.shape) // len(rolls)
    example, which = _different(pairs, at_zero)
    ends = np.array([_ends(found, arm) for arm in range(len(found.arms))]).reshape(-1, 2, 7)
    ends = ends[cells[0, example]]
    steps = _steps(at_zero[example], ends)
    fails = _fail(found, shown, which, unpacked(steps, ends))
    first_of_pair = np.unique(pairs[example], return_index=True)
    begun = first_of_pair[1][np.searchsorted(first_of_pair[0], pairs)]
    return PackedWitnesses(
        (which - begun).astype(np.uint8),
        steps[:, 0].astype(np.uint16),
        steps[:, 1:].T.astype(np.uint8),
        np.flatnonzero(fails).astype(np.uint32),
        at_zero[example[fails]],
    )


def unpacked(steps: FloatArray, ends: FloatArray) -> FloatArray:
    """Configurations, shape (n, 7), from steps between the ends of their joints, (n, 2, 7)."""
    q: FloatArray = ends[:, 0] + steps * (ends[:, 1] - ends[:, 0]) / _most()
    return q


def wrapped(angles: FloatArray) -> FloatArray:
    """Between -pi and pi."""
    turned: FloatArray = (angles + np.pi) % (2.0 * np.pi) - np.pi
    return turned


def _most() -> FloatArray:
    return 2.0 ** np.array([FIRST_BITS] + 6 * [OTHER_BITS]) - 1.0


def _ends(found: ReachMap, arm: int) -> tuple[FloatArray, FloatArray]:
    """Between which joints are rounded; w2 at roll zero may lie anywhere in a turn."""
    limits = found.robot.arm(found.arms[arm]).limits
    turn = np.array([0.0] * 6 + [np.pi])
    return np.minimum(limits.q_min, -turn), np.maximum(limits.q_max, turn)


def _steps(q: FloatArray, ends: FloatArray) -> FloatArray:
    steps: FloatArray = np.rint((q - ends[:, 0]) / (ends[:, 1] - ends[:, 0]) * _most())
    return steps


def _different(pairs: Indices, q: FloatArray) -> tuple[Indices, Indices]:
    """A cell of each different witness, by pairs in their order; and which one each cell has."""
    rounded = np.rint(q / RAD_PER_STEP).astype(np.int64)
    rounded[:, 6] = np.rint(q[:, 6] / 1e-6)  # w2 less its roll is a multiple of no step
    columns = np.column_stack([pairs, rounded])
    _, example, which = np.unique(columns, axis=0, return_index=True, return_inverse=True)
    return example, which.reshape(-1)


def _fail(
    found: ReachMap, shown: ShownMap, which: Indices, q_near: FloatArray
) -> NDArray[np.bool_]:
    """Of which witnesses a cell does not get its configuration back."""
    cells, rotations = shown.cells, found.rotations
    fails = np.zeros(len(q_near), bool)
    for arm, side in enumerate(found.arms):
        own = np.flatnonzero(cells[0] == arm)
        if not own.size:
            continue
        chain, limits = TipChain.of(found.robot.arm(side)), found.robot.arm(side).limits
        example, users = np.unique(which[own], return_inverse=True)
        leader = own[np.unique(users, return_index=True)[1]]
        rolls = rotations.rolls[cells[4] % len(rotations.rolls)]
        Ts = np.tile(np.eye(4), (len(leader), 1, 1))
        Ts[:, :3, 3] = shown.points(cells[:, leader])
        Ts[:, :3, :3] = rotations.matrices[cells[4, leader]]
        q = q_near[example]
        q[:, 6] = wrapped(q[:, 6] + rolls[leader])
        q, left = chain.polished(q, Ts)
        q[:, 6] -= rolls[leader]
        q_all = q[users]
        q_all[:, 6] = wrapped(q_all[:, 6] + rolls[own])
        is_off = (q_all < limits.q_min).any(axis=1) | (q_all > limits.q_max).any(axis=1)
        is_off |= np.abs(q_all - shown.q[own]).max(axis=1) > SAME_RAD
        fails[example[left > TOLERANCE]] = True
        fails[which[own[is_off]]] = True
    return fails
