"""What the page's panel shows of the arms: joints, bounds, waypoints, and what the grippers do.

Joints are shown against their limits over time. Where a move was recorded, angles, velocities and
accelerations are those of its exact cubics, with all instants at which a jerk changes among the
rows: there the accelerations peak. Elsewhere they are differences of positions.

What a gripper does (open, closing, holding the block, missed) does not follow from positions alone:
fingers at rest half open may hold something or not. Events state it; those without a side, as in
the first recordings, have no effect here.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum

import numpy as np
import pinocchio as pin

from baxter_kin import Arm, Baxter, JointLimits
from baxter_kin.description.hands import finger_joints
from baxter_kin.kinematics.arm import LIMBS, arm_joints
from baxter_kin.validation import FloatArray, Indices
from planner import Move
from planner.motion.paths.straight_line import Turn
from sim.events import Event, EventKind
from sim.recording.recorded_motion import ROUNDING_S, ArmMotion, RecordedMove
from sim.recording.recording import Recording
from sim.view.animation import frame_samples, key_samples
from sim.view.meshcat_commands import Command, short_numbers

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

MOTION_TOLERANCE_PERCENT = 0.1
"""Fingers at rest begin to move when they are farther than this from where they came to rest: the
noise of a real gripper is smaller."""

MIN_CHANGE_PERCENT = 1e-6
"""Moving fingers that advance by less between two observations have come to rest."""

END_TOLERANCE_PERCENT = 0.5
"""Within this distance from an end, fingers are fully open or closed."""

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


def recorded_bounds(recording: Recording, robot: Baxter) -> list[Command]:
    """What moves were to keep within a bound, and how far they went, by kind.

    Kinds are "distance", m, and "turn", rad, of a tip from its path, and "tilt", rad, of a held
    body. Each has spans of time with values at times in seconds from the start, and their limit.
    """
    kinds: dict[str, list[Command]] = {}
    begun = [event for event in recording.events if event.kind is EventKind.MOVE_STARTED]
    for number, event in enumerate(begun):
        if event.move is None or event.side is None:
            continue
        later = (other.time_s for other in begun[number + 1 :] if other.side == event.side)
        end_s = min([event.time_s + event.move.trajectory.duration, *later])
        first, end = np.searchsorted(recording.times_s, [event.time_s, end_s + ROUNDING_S])
        if end < first + 2:
            continue
        rows = first + frame_samples(recording.times_s[first:end])
        times_s = recording.times_s[rows]
        for kind, values, limit in _bounded(
            event.move, times_s - event.time_s, rows, recording, robot
        ):
            chosen = key_samples(times_s, values[:, None], ROW_TOLERANCE * limit)
            kinds.setdefault(kind, []).append(
                {
                    "times": (times_s[chosen] - recording.times_s[0]).astype(np.float32),
                    "values": values[chosen].astype(np.float32),
                    "limit": limit,
                }
            )
    return [{"kind": kind, "spans": spans} for kind, spans in kinds.items()]


def _bounded(
    move: Move, since_s: FloatArray, rows: Indices, recording: Recording, robot: Baxter
) -> Iterator[tuple[str, FloatArray, float]]:
    """Kind, values at recorded rows, shape (n,), and limit of what a move was to keep."""
    arm = robot.arm(move.limb)
    if move.path is not None:
        q = recording.q[rows][:, list(robot.indices(arm.joint_names))]
        off, tolerance = move.path.deviations(arm.T_base_tips(q), since_s), move.path.tolerance
        yield "distance", off.off_m, tolerance.position_m
        if tolerance.turn is not Turn.FREE:
            yield "turn", off.off_rad, tolerance.rotation_rad
    held = None if move.state is None else move.state.holding(move.limb)
    if held is None or held.body not in recording.body_poses:
        return
    for claim in move.claims:
        if claim.kind == "upright":
            axis = np.array([claim.values[f"axis_{name}"] for name in "xyz"])
            quats = recording.body_poses[held.body][rows, 3:]
            up = np.array([pin.Quaternion(quat).matrix() @ axis for quat in quats])
            tilt = np.arctan2(np.hypot(up[:, 0], up[:, 1]), up[:, 2])
            yield "tilt", tilt, claim.values["max_tilt_rad"]


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


class GripperMood(str, Enum):
    """What a gripper's state means for the task, by which pages colour it."""

    EMPTY = "empty"
    MOVING = "moving"
    HOLDING = "holding"
    MISSED = "missed"


@dataclass(frozen=True, slots=True)
class GripperPhase:
    """What one gripper does.

    Attributes:
        words: such as "closing" or "holding block".
        mood: what that means.
    """

    words: str
    mood: GripperMood

    @property
    def is_holding(self) -> bool:
        """Whether something is between the pads."""
        return self.mood is GripperMood.HOLDING

    def for_page(self) -> list[str]:
        """Words and mood, as the pages read them."""
        return [self.words, self.mood.value]


_OPENING = GripperPhase("opening", GripperMood.MOVING)
_CLOSING = GripperPhase("closing", GripperMood.MOVING)


class GripperStatus:
    """Tracks the phase of each gripper from positions and events.

    Attributes:
        phases: what each gripper does now, by side; empty before the first observation.
    """

    def __init__(self) -> None:
        self.phases: dict[str, GripperPhase] = {}
        self._percents: dict[str, float] = {}  # at the last change

    def on_percents(self, percents: Mapping[str, float]) -> None:
        """Process positions by side, 0 closed .. 100 open."""
        for side, percent in percents.items():
            change = percent - self._percents.get(side, percent)
            phase = _next_phase(self.phases.get(side), percent, change)
            is_at_rest = phase.mood in (GripperMood.EMPTY, GripperMood.MISSED)
            if not is_at_rest or abs(change) > MOTION_TOLERANCE_PERCENT:
                self._percents[side] = percent
            self._percents.setdefault(side, percent)
            self.phases[side] = phase

    def on_event(self, event: Event) -> None:
        """Process an event."""
        if event.side is None:
            return
        if event.kind is EventKind.GRASPED and event.body is not None:
            held = f"holding {event.body.name}"
            self.phases[event.side] = GripperPhase(held, GripperMood.HOLDING)
        elif event.kind is EventKind.MISSED:
            self.phases[event.side] = GripperPhase("missed", GripperMood.MISSED)
        elif event.kind is EventKind.RELEASED:
            self.phases[event.side] = _OPENING


def sides_with_fingers(joint_names: Collection[str]) -> tuple[str, ...]:
    """The sides whose hand has fingers, by the joints of a robot; a tool has no status."""
    return tuple(side for side in LIMBS if finger_joints(side)[0] in joint_names)


def gripper_timelines(recording: Recording) -> dict[str, list[tuple[float, GripperPhase]]]:
    """The phases of each side with their start times in recorded time.

    The timeline is empty for a hand without fingers and for an arm that was not recorded. At the
    beginning of a cut recording, phases follow from the fingers' positions alone.
    """
    sides = set(sides_with_fingers(recording.joint_names)).intersection(recording.limbs)
    status, (start_s, end_s) = GripperStatus(), recording.times_s[[0, -1]].tolist()
    timelines: dict[str, list[tuple[float, GripperPhase]]] = {side: [] for side in LIMBS}
    # an event comes after the snapshot of its own time
    steps: list[tuple[float, int, Event | dict[str, float]]] = [
        (event.time_s, 1, event) for event in recording.events if start_s <= event.time_s <= end_s
    ]
    for time_s, row in zip(recording.times_s.tolist(), recording.gripper_percent, strict=True):
        percents = zip(LIMBS, row.tolist(), strict=True)
        steps.append((time_s, 0, {side: each for side, each in percents if side in sides}))
    for time_s, _, item in sorted(steps, key=lambda each: each[:2]):
        if isinstance(item, Event):
            status.on_event(item)
        else:
            status.on_percents(item)
        for side, phase in status.phases.items():
            if not timelines[side] or timelines[side][-1][1] != phase:
                timelines[side].append((time_s, phase))
    return timelines


def _next_phase(phase: GripperPhase | None, percent: float, change: float) -> GripperPhase:
    """The phase after the fingers have moved by `change` since the last change."""
    if phase is not None and phase.is_holding:
        return phase
    if change > (MIN_CHANGE_PERCENT if phase == _OPENING else MOTION_TOLERANCE_PERCENT):
        return _OPENING
    if phase is not None and phase.mood is GripperMood.MISSED:
        return phase
    if -change > (MIN_CHANGE_PERCENT if phase == _CLOSING else MOTION_TOLERANCE_PERCENT):
        return _CLOSING
    words = f"{percent:.0f} % open"
    if percent >= 100.0 - END_TOLERANCE_PERCENT:
        words = "open"
    elif percent <= END_TOLERANCE_PERCENT:
        words = "closed"
    return GripperPhase(words, GripperMood.EMPTY)
