"""Joint angles, velocities and accelerations of a recording's arms, against their limits.

Where a move was recorded they are those of its exact cubics, with all instants at which a jerk
changes among the rows: there the accelerations peak. Elsewhere they are differences of positions.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from baxter_kin import Arm, Baxter, JointLimits
from baxter_kin.validation import FloatArray, Indices
from sim.recording.recorded_motion import ArmMotion, arm_joints
from sim.recording.recording import Recording
from sim.view.animation import telling_samples
from sim.view.meshcat_commands import Command, short_numbers

MOST_ROWS = 1500
"""So many rows at most are told of an arm, as long as the peaks of its joints are not more."""

FINEST = 1e-3
"""What a row left out may be off, when interpolated, as a share of its range or limit. It doubles
until there are no more than `MOST_ROWS`."""

MOVED_RAD = 1e-4
"""An arm all of whose joints stay within this stands still."""

MOVING_RAD_S = 0.02
"""An arm moves at a time when one of its joints is faster than this."""

STEP = 2.0**-13
"""To which positions are rounded, rad; velocities and accelerations to twice and eight times
that."""


def arms_that_move(recording: Recording) -> tuple[str, ...]:
    """The sides of the arms that were recorded and moved."""
    index = {name: number for number, name in enumerate(recording.joint_names)}
    return tuple(
        side
        for side in recording.limbs
        if all(name in index for name in arm_joints(side))
        and np.ptp(recording.q[:, [index[name] for name in arm_joints(side)]], axis=0).max()
        > MOVED_RAD
    )


def recorded_arms(recording: Recording, robot: Baxter) -> dict[str, Command]:
    """By side, of every arm that moves, what the page draws over time; seconds from the start.

    Args:
        recording: what happened.
        robot: the robot it happened to, for limits where no move says those it was planned with.
    """
    arms = {}
    for side in arms_that_move(recording):
        moves = (move.trajectory.limits for move in recording.moves if move.limb == side)
        told = limits_of(robot.arm(side), moves)
        arms[side] = told | _rows(recording.motion(side, with_knots=True), told, recording)
    return arms


def limits_of(arm: Arm, planned: Iterable[JointLimits] = ()) -> Command:
    """An arm's joints and their limits, as the page takes them.

    Args:
        arm: the arm.
        planned: the limits that its moves were planned with; the widest of them count, and the
            arm's own where there are none.
    """
    every = [_ordered(limits, arm.joint_names) for limits in planned] or [
        _ordered(arm.limits, arm.joint_names)
    ]
    least = np.min([limits["q_min"] for limits in every], axis=0)
    most = {name: np.max([limits[name] for limits in every], axis=0) for name in _UPPER}
    return {
        "joints": list(arm.joint_names),
        "q_min": least.tolist(),
        **{name: values.tolist() for name, values in most.items()},
    }


_UPPER = ("q_max", "v_max", "a_max")


def _ordered(limits: JointLimits, names: tuple[str, ...]) -> Mapping[str, FloatArray]:
    order = [limits.names.index(name) for name in names]
    return {name: np.asarray(getattr(limits, name))[order] for name in ("q_min", *_UPPER)}


def _rows(motion: ArmMotion, limits: Command, recording: Recording) -> Command:
    chosen = telling_rows(motion, limits, until_s=float(recording.times_s[-1]))
    steps = {"q": STEP, "v": 2 * STEP, "a": 8 * STEP}
    return {
        "times": (motion.times_s[chosen] - recording.times_s[0]).astype(np.float32),
        **{
            name: short_numbers(getattr(motion, name)[chosen].reshape(-1), step)
            for name, step in steps.items()
        },
    }


def telling_rows(motion: ArmMotion, limits: Command, until_s: float = np.inf) -> Indices:
    """Which rows of a motion to tell, at times that increase: the others lie between them.

    Every joint's greatest velocity and acceleration, either way, are always among them.

    Args:
        motion: of an arm.
        limits: as `limits_of` gives them.
        until_s: the latest time to tell of.
    """
    times, first = np.unique(motion.times_s[motion.times_s <= until_s], return_index=True)
    q_range = np.subtract(limits["q_max"], limits["q_min"])
    scaled = np.hstack(
        [motion.q / q_range, motion.v / limits["v_max"], motion.a / limits["a_max"]]
    )[first]
    peaks = np.unique([scaled.argmin(axis=0), scaled.argmax(axis=0)])
    rows, tolerance = telling_samples(times, scaled, FINEST), FINEST
    while len(rows) > max(MOST_ROWS - len(peaks), 2):
        tolerance *= 2.0
        rows = rows[telling_samples(times[rows], scaled[rows], tolerance)]
    kept: Indices = first[np.union1d(rows, peaks)]
    return kept
