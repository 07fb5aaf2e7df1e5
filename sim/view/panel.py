"""What the page's panel shows of the arms: joints against their limits over time, and waypoints.

Where a move was recorded, angles, velocities and accelerations are those of its exact cubics, with
all instants at which a jerk changes among the rows: there the accelerations peak. Elsewhere they
are differences of positions.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from baxter_kin import Arm, Baxter, JointLimits
from baxter_kin.kinematics.arm import arm_joints
from baxter_kin.validation import FloatArray, Indices
from sim.recording.recorded_motion import ArmMotion, RecordedMove
from sim.recording.recording import Recording
from sim.view.animation import key_samples
from sim.view.encoding import Command
from sim.view.meshcat_commands import short_numbers

MAX_ROWS = 1500
"""Maximum number of rows of an arm, unless the peaks of its joints are more."""

ROW_TOLERANCE = 1e-3
"""Maximum error of interpolation where a row is left out, as a share of the range or limit. It
doubles until there are no more than `MAX_ROWS`."""

MIN_MOVED_RAD = 1e-4
"""An arm all of whose joints stay within this stands still."""

POSITION_STEP = 2.0**-13
"""Resolution of positions, rad; those of velocities and accelerations are twice and eight times
this."""

_UPPER = ("q_max", "v_max", "a_max")


def moving_arms(recording: Recording) -> tuple[str, ...]:
    """The sides of the arms that were recorded and moved."""
    index = {name: number for number, name in enumerate(recording.joint_names)}
    return tuple(
        side
        for side in recording.limbs
        if all(name in index for name in arm_joints(side))
        and np.ptp(recording.q[:, [index[name] for name in arm_joints(side)]], axis=0).max()
        > MIN_MOVED_RAD
    )


def recorded_arms(recording: Recording, robot: Baxter) -> dict[str, Command]:
    """The curves of every arm that moves, by side; times in seconds from the start.

    Args:
        recording: what happened.
        robot: its robot, for limits where no move states those it was planned with.
    """
    arms = {}
    for side in moving_arms(recording):
        moves = (move.trajectory.limits for move in recording.moves if move.limb == side)
        limits = limits_of(robot.arm(side), moves)
        arms[side] = limits | _rows(recording.motion(side, with_knots=True), limits, recording)
    return arms


def limits_of(arm: Arm, planned: Iterable[JointLimits] = ()) -> Command:
    """An arm's joints and their limits.

    Args:
        arm: the arm.
        planned: the limits that its moves were planned with; the widest of them count, and the
            arm's own where there are none.
    """
    every = [_ordered(limits, arm.joint_names) for limits in planned] or [
        _ordered(arm.limits, arm.joint_names)
    ]
    lower = np.min([limits["q_min"] for limits in every], axis=0)
    upper = {name: np.max([limits[name] for limits in every], axis=0) for name in _UPPER}
    return {
        "joints": list(arm.joint_names),
        "q_min": lower.tolist(),
        **{name: values.tolist() for name, values in upper.items()},
    }


def _ordered(limits: JointLimits, names: tuple[str, ...]) -> Mapping[str, FloatArray]:
    order = [limits.names.index(name) for name in names]
    return {name: np.asarray(getattr(limits, name))[order] for name in ("q_min", *_UPPER)}


def _rows(motion: ArmMotion, limits: Command, recording: Recording) -> Command:
    chosen = key_rows(motion, limits, until_s=float(recording.times_s[-1]))
    steps = {"q": POSITION_STEP, "v": 2 * POSITION_STEP, "a": 8 * POSITION_STEP}
    return {
        "times": (motion.times_s[chosen] - recording.times_s[0]).astype(np.float32),
        **{
            name: short_numbers(getattr(motion, name)[chosen].reshape(-1), step)
            for name, step in steps.items()
        },
    }


def key_rows(motion: ArmMotion, limits: Command, until_s: float = np.inf) -> Indices:
    """Rows of a motion at increasing times, from which interpolation gives the others.

    The extreme velocities and accelerations of every joint are always among them.

    Args:
        motion: of an arm.
        limits: as `limits_of` gives them.
        until_s: the latest time.
    """
    times, first = np.unique(motion.times_s[motion.times_s <= until_s], return_index=True)
    q_range = np.subtract(limits["q_max"], limits["q_min"])
    scaled = np.hstack(
        [motion.q / q_range, motion.v / limits["v_max"], motion.a / limits["a_max"]]
    )[first]
    peaks = np.unique([scaled.argmin(axis=0), scaled.argmax(axis=0)])
    rows, tolerance = key_samples(times, scaled, ROW_TOLERANCE), ROW_TOLERANCE
    while len(rows) > max(MAX_ROWS - len(peaks), 2):
        tolerance *= 2.0
        rows = rows[key_samples(times[rows], scaled[rows], tolerance)]
    kept: Indices = first[np.union1d(rows, peaks)]
    return kept


def waypoints(
    moves: Iterable[RecordedMove], zero_s: float, now_s: float, *, is_live: bool = False
) -> list[Command]:
    """The waypoints at the ends of moves, in order.

    Seed and errors are those of inverse kinematics, "" and None where it was not used. A move that
    was stopped ends where the next one of its arm begins.

    Args:
        moves: the moves.
        zero_s: beginning of the page's clock; earlier moves are left out.
        now_s: end of a recording, or the present.
        is_live: whether moves that have not ended yet have no end.
    """
    in_order = sorted(moves, key=lambda move: move.start_s)
    found = []
    for number, move in enumerate(in_order):
        later = [other.start_s for other in in_order[number + 1 :] if other.limb == move.limb]
        end_s = min([move.end_s, *later[:1]])
        if end_s < zero_s:
            continue
        ik, is_open = move.ik, is_live and end_s > now_s
        found.append(
            {
                "start": max(move.start_s, zero_s) - zero_s,
                "end": None if is_open else min(end_s, now_s) - zero_s,
                "side": move.limb,
                "label": move.label,
                "seed": "" if ik is None else move.move.seed_label,
                "position_error_m": None if ik is None else float(ik.position_error_m),
                "orientation_error_rad": None if ik is None else float(ik.orientation_error_rad),
            }
        )
    return found
