"""Witnesses of a map in few bytes, and the iteration by which the page finds them again.

Cells that differ by a roll about the last joint's axis mostly share their witness except for w2, so
each is stored once, with w2 at roll zero. Its first joint is rounded to `FIRST_BITS` of its range,
and the others to `OTHER_BITS`. From there, the page returns to the pose: the first joint stays, and
Newton's method turns the other six, so that the same point of the self-motion is found. The steps
are damped least squares (Wampler 1986) with a damping that only singular arms feel.
`pages/atlas/kinematics.js` has the same iteration in JavaScript, with the numbers of `SETTINGS`.

All witnesses are tried here. Where the result misses its pose, lies outside the limits or is
another configuration, the witness is stored as it is in the map.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from baxter_kin.ik.result import ORIENTATION_TOLERANCE_RAD, POSITION_TOLERANCE_M
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray, Indices
from planner.atlas.reach_map import ReachMap
from planner.atlas.reach_search import RAD_PER_STEP
from sim.view.atlas.shown_map import ShownMap

FIRST_BITS, OTHER_BITS = 16, 8
_MAX_STEPS = 2.0 ** np.array([FIRST_BITS] + 6 * [OTHER_BITS]) - 1.0

SAME_RAD = 0.02
"""Maximum difference of a joint from the map's own witness; margins on the page have steps of 0.01
rad."""

TOLERANCE = min(POSITION_TOLERANCE_M, ORIENTATION_TOLERANCE_RAD) / 2.0
"""Maximum error of a witness found again, m and rad: half of what a witness may have."""

SETTINGS = MappingProxyType({"iterations": 10, "damping": 1e-12, "longest_rad": 0.1, "met": 1e-8})
"""Maximum number of iterations, the value added to the diagonal, the maximum turn of a joint in one
iteration, and the error at which it ends, m and rad: a hundredth of what a witness may have."""

CHUNK = 8192
"""Number of configurations processed together, which bounds the memory."""


@dataclass(frozen=True, slots=True, eq=False)
class PackedWitnesses:
    """Witnesses as the page reads them.

    They are sorted by arm, position and direction, for all that have a reachable roll.

    Attributes:
        of_roll: index of each reachable cell's witness among those of its arm, position and
            direction, shape (m,).
        first: s0 in steps of its range, shape (n,).
        others: the other joints, shape (6, n).
        kept: indices of the witnesses stored as they are, shape (k,), ascending.
        q_kept: these, w2 at roll zero, shape (k, 7), rad.
    """

    of_roll: NDArray[np.uint8]
    first: NDArray[np.uint16]
    others: NDArray[np.uint8]
    kept: NDArray[np.uint32]
    q_kept: FloatArray


def pack(reach_map: ReachMap, shown: ShownMap) -> PackedWitnesses:
    """Pack the witnesses of a map's shown part."""
    cells, rolls = shown.cells, reach_map.rotations.rolls
    at_zero = shown.q.copy()
    at_zero[:, 6] = wrapped(at_zero[:, 6] - rolls[cells[4] % len(rolls)])
    pairs = np.ravel_multi_index(tuple(cells), shown.codes.shape) // len(rolls)
    first, which = _different(pairs, at_zero)
    ranges = [_range(reach_map.robot.arm(side)) for side in reach_map.arms]
    ranges_of = np.array(ranges).reshape(-1, 2, 7)[cells[0, first]]
    low, span = ranges_of[:, 0], ranges_of[:, 1] - ranges_of[:, 0]
    steps = np.rint((at_zero[first] - low) / span * _MAX_STEPS)
    fails = _fail(reach_map, shown, first, which, low + steps * span / _MAX_STEPS)
    in_order, first_of_pair = np.unique(pairs[first], return_index=True)
    begun = first_of_pair[np.searchsorted(in_order, pairs)]
    return PackedWitnesses(
        (which - begun).astype(np.uint8),
        steps[:, 0].astype(np.uint16),
        steps[:, 1:].T.astype(np.uint8),
        np.flatnonzero(fails).astype(np.uint32),
        at_zero[first[fails]],
    )


def wrapped(angles: FloatArray) -> FloatArray:
    """The same angles between -pi and pi."""
    turned: FloatArray = (angles + np.pi) % (2.0 * np.pi) - np.pi
    return turned


def _range(arm: Arm) -> tuple[FloatArray, FloatArray]:
    """The range in which joints are rounded; w2 at roll zero may lie anywhere in a turn."""
    turn = np.array([0.0] * 6 + [np.pi])
    return np.minimum(arm.limits.q_min, -turn), np.maximum(arm.limits.q_max, turn)


def _different(pairs: Indices, q: FloatArray) -> tuple[Indices, Indices]:
    """The first cell of each different witness, sorted by pairs; and each cell's witness."""
    rounded = np.rint(q / RAD_PER_STEP).astype(np.int64)
    rounded[:, 6] = np.rint(q[:, 6] / 1e-6)  # w2 less its roll is a multiple of no step
    columns = np.column_stack([pairs, rounded])
    _, first, which = np.unique(columns, axis=0, return_index=True, return_inverse=True)
    return first, which.reshape(-1)


def _fail(
    reach_map: ReachMap, shown: ShownMap, first: Indices, which: Indices, q_near: FloatArray
) -> NDArray[np.bool_]:
    """Whether each witness fails: it misses its pose, or a cell that it serves.

    Args:
        reach_map: the map.
        shown: its shown part.
        first: the first cell of each witness, shape (n,).
        which: the witness of each cell, shape (m,).
        q_near: the rounded witnesses, w2 at roll zero, shape (n, 7), rad.
    """
    cells, rotations = shown.cells, reach_map.rotations
    rolls = rotations.rolls[cells[4] % len(rotations.rolls)]
    Ts = np.tile(np.eye(4), (len(first), 1, 1))
    Ts[:, :3, 3] = shown.points(cells[:, first])
    Ts[:, :3, :3] = rotations.matrices[cells[4, first]]
    q = q_near.copy()
    q[:, 6] = wrapped(q[:, 6] + rolls[first])
    fails = np.zeros(len(first), bool)
    for index, side in enumerate(reach_map.arms):
        arm, own, of_cells = reach_map.robot.arm(side), cells[0, first] == index, cells[0] == index
        q[own], errors = polished(arm, q[own], Ts[own])
        fails[own] = errors > TOLERANCE
        q_cells = q[which[of_cells]]
        q_cells[:, 6] = wrapped(q_cells[:, 6] - rolls[first[which[of_cells]]] + rolls[of_cells])
        is_off = (q_cells < arm.limits.q_min).any(axis=1) | (q_cells > arm.limits.q_max).any(axis=1)
        is_off |= np.abs(q_cells - shown.q[of_cells]).max(axis=1) > SAME_RAD
        fails[which[of_cells][is_off]] = True
    return fails


def polished(arm: Arm, q: FloatArray, Ts: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Configurations at poses, found from near ones, and the errors left, m and rad.

    Args:
        arm: the arm.
        q: near configurations, shape (m, 7), rad.
        Ts: poses of the tip in base, shape (m, 4, 4).
    """
    q, errors = q.copy(), np.zeros(len(q))
    for begin in range(0, len(q), CHUNK):
        moving = np.arange(begin, min(begin + CHUNK, len(q)))
        for iteration in range(int(SETTINGS["iterations"]) + 1):
            error, J = tip_errors(arm, q[moving], Ts[moving])
            errors[moving] = np.abs(error).max(axis=1)
            is_far = errors[moving] > SETTINGS["met"]
            moving = moving[is_far]
            if iteration == SETTINGS["iterations"] or not moving.size:
                break
            q[moving, 1:] += _step(error[is_far], J[is_far, :, 1:])
    return q, errors


def T_last_tip(arm: Arm) -> FloatArray:
    """The tip seen from the last joint, shape (4, 4)."""
    frame = arm.model.frames[arm.model.getFrameId(arm.tip_frame)]
    T: FloatArray = frame.placement.homogeneous
    return T


def tip_errors(arm: Arm, q: FloatArray, Ts: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Displacements of poses from the tip, shape (m, 6), and Jacobians (m, 6, 7), linear first."""
    joints = arm.chain.poses(q)
    tips = joints[:, -1] @ T_last_tip(arm)
    axes = (joints[:, :, :3, :3] @ arm.chain.axes[:, :, None])[..., 0]
    levers = tips[:, None, :3, 3] - joints[:, :, :3, 3]
    J = np.concatenate([np.cross(axes, levers), axes], axis=2).swapaxes(1, 2)
    turns = _rotation_vectors(Ts[:, :3, :3] @ tips[:, :3, :3].swapaxes(1, 2))
    return np.concatenate([Ts[:, :3, 3] - tips[:, :3, 3], turns], axis=1), J


def _step(error: FloatArray, J: FloatArray) -> FloatArray:
    """A step of the six joints, no longer than allowed."""
    normal = J @ J.swapaxes(1, 2) + SETTINGS["damping"] * np.eye(6)
    step = (J.swapaxes(1, 2) @ np.linalg.solve(normal, error[..., None]))[..., 0]
    longest = np.abs(step).max(axis=1, keepdims=True)
    shortened: FloatArray = step * np.minimum(1.0, SETTINGS["longest_rad"] / (longest + 1e-300))
    return shortened


def _rotation_vectors(Rs: FloatArray) -> FloatArray:
    """Axis times angle of rotations below half a turn, shape (m, 3), rad."""
    off = np.stack([Rs[:, 2, 1], Rs[:, 0, 2], Rs[:, 1, 0]], axis=1)
    off = (off - np.stack([Rs[:, 1, 2], Rs[:, 2, 0], Rs[:, 0, 1]], axis=1)) / 2.0
    sine = np.linalg.norm(off, axis=1, keepdims=True)
    cosine = (np.trace(Rs, axis1=1, axis2=2)[:, None] - 1.0) / 2.0
    vectors: FloatArray = off * (np.arctan2(sine, cosine) / np.maximum(sine, 1e-300))
    return vectors
