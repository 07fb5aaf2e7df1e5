"""Recordings: what happened, as data, and the `Recorder` that makes them.

`save_recording` and `read_recording` (`sim.recording.record_file`) move recordings to files and
back; `plot_recording` draws them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin.description import RobotIdentity
from baxter_kin.display import count, line, listing, quoted, seconds
from baxter_kin.errors import UnknownNameError
from baxter_kin.fields import (
    FrozenMapping,
    array,
    evolve,
    field,
    frozen,
    sequence,
    shown,
)
from baxter_kin.kinematics.arm import LIMBS, arm_joints
from baxter_kin.validation import FloatArray, expect, float_array
from planner import Body, Response, Scene, State
from planner import fit_response as fit_arrays
from sim.errors import RecordingError
from sim.events import Event, EventKind, Observer, Snapshot
from sim.recording.recorded_motion import (
    ArmMotion,
    RecordedMove,
    arm_motion,
)
from sim.world.gripper import GripperState


class Row(NamedTuple):
    """A recorded snapshot; `poses` are those of all bodies present, as of `pose_row`."""

    time_s: float
    q: FloatArray
    gripper_percent: Sequence[float] | FloatArray
    poses: Mapping[str, Sequence[float] | FloatArray]


@dataclass(frozen=True, slots=True)
class Caption:
    """What is going on from a time on, in words."""

    time_s: float
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class RecordedSample:
    """A `sim.events.Sample` as it is kept; old files have its first four values only."""

    limb: str
    time_s: float
    q_sent: FloatArray
    q_measured: FloatArray
    q_path: FloatArray | None = None
    v_measured: FloatArray | None = None
    age_s: float | None = None
    lateness_s: float | None = None
    is_enabled: bool | None = None
    is_stopped: bool | None = None
    has_error: bool | None = None


Entry: TypeAlias = Body | State | Row | Caption | Event | RecordedMove | RecordedSample
"""What a recording is made of, in order of time. A `State` is the one at the start; bodies come
before they are named."""


@frozen(error=RecordingError)
class Commands:
    """The set-points that an arm was sent, and what was measured at these times.

    Attributes:
        times_s: shape (k,), in the recording's time.
        q_sent: set-points, each in force until the next, shape (k, 7), rad.
        q_measured: last measured positions at these times, shape (k, 7), rad.

    Raises:
        RecordingError: when an array has another shape or is not finite.
    """

    times_s: FloatArray = array(None)
    q_sent: FloatArray = array(None, 7)
    q_measured: FloatArray = array(None, 7)

    def __attrs_post_init__(self) -> None:
        for name in ("q_sent", "q_measured"):
            if len(getattr(self, name)) != len(self.times_s):
                raise RecordingError(
                    f"{name} has {len(getattr(self, name))} rows for {len(self.times_s)} times"
                )

    def _facts(self) -> tuple[str, ...]:
        return (count(len(self.times_s), "set-point"),)


def _bodies(given: Mapping[str, Body]) -> Mapping[str, Body]:
    return Scene(given).bodies


def _tracks(given: Mapping[str, ArrayLike]) -> Mapping[str, FloatArray]:
    """Copies of pose tracks in which a pose is finite or NaN as a whole."""
    if not isinstance(given, Mapping):
        raise RecordingError(f"body_poses must be a mapping, got {type(given).__name__}")
    tracks = {}
    for name, values in given.items():
        track = tracks[name] = float_array(values, f"the poses of {quoted(name)}", RecordingError)
        if track.ndim == 2:
            track[~np.isfinite(track).all(axis=1)] = np.nan
        track.setflags(write=False)
    return FrozenMapping(tracks)


@frozen(error=RecordingError)
class Recording:
    """A finished recording of n snapshots.

    Attributes:
        joint_names: the joints of the robot, 19 with both grippers.
        times_s: shape (n,), increasing.
        q: full configurations, shape (n, joints), rad and m.
        gripper_percent: left and right gripper, shape (n, 2), 0 closed .. 100 open.
        bodies: every body that was in the world at any time, by name.
        body_poses: pose track of each of these bodies seen from base, shape (n, 7): x, y, z, then
            quaternion x, y, z, w; NaN while it is not in the world.
        captions: (time in s, text) wherever the caption changed.
        events: everything that happened.
        moves: every move of an arm with its exact motion, in order.
        robot: which robot it was; None if unknown.
        limbs: the arms that were recorded, in the order left, right. A file of a real robot may
            have only one; the other stands still in `q` then.
        samples: what a robot was sent and measured; empty for a simulation.
        start: robot, bodies and what the hands held before the first snapshot; None if unknown.

    Raises:
        RecordingError: when shapes do not fit, times do not increase, there is no snapshot, or no
            arm.
    """

    joint_names: tuple[str, ...] = sequence()
    times_s: FloatArray = array(None)
    q: FloatArray = array(None, None)
    gripper_percent: FloatArray = array(None, 2)
    bodies: Mapping[str, Body] = field(converter=_bodies)
    body_poses: Mapping[str, FloatArray] = field(converter=_tracks)
    captions: tuple[tuple[float, str], ...] = sequence()
    events: tuple[Event, ...] = sequence()
    moves: tuple[RecordedMove, ...] = sequence(default=())
    robot: RobotIdentity | None = None
    limbs: tuple[str, ...] = sequence(default=LIMBS)
    samples: tuple[RecordedSample, ...] = sequence(default=())
    start: State | None = None

    def __attrs_post_init__(self) -> None:
        rows = len(self.times_s)
        if rows == 0:
            raise RecordingError("the recording is empty: no snapshot was recorded")
        if not (np.diff(self.times_s) > 0.0).all():
            raise RecordingError("times_s must increase from one snapshot to the next")
        if self.limbs not in (LIMBS, *((side,) for side in LIMBS)):
            raise RecordingError(
                f"limbs must be {quoted(LIMBS)}, or one of them alone, got {quoted(self.limbs)}"
            )
        arrays = {"q": (self.q, (rows, len(self.joint_names)))}
        arrays["gripper_percent"] = (self.gripper_percent, (rows, len(LIMBS)))
        for name, track in self.body_poses.items():
            arrays[f"the poses of {quoted(name)}"] = (track, (rows, 7))
        for name, (values, shape) in arrays.items():
            if values.shape != shape:
                raise RecordingError(f"{name} has shape {values.shape}; it must have shape {shape}")
        for sample in self.samples:
            checked_limb(sample.limb)
        absent = np.full((rows, 7), np.nan)
        tracks = {name: self.body_poses.get(name, absent) for name in self.bodies}
        object.__setattr__(self, "body_poses", _tracks(tracks))

    @property
    def duration_s(self) -> float:
        """Time between the first and the last snapshot."""
        return float(self.times_s[-1] - self.times_s[0])

    @property
    def commands(self) -> dict[str, Commands]:
        """By limb, the set-points that were sent to a robot; empty for a simulation."""
        commands = {}
        for limb in sorted({sample.limb for sample in self.samples}):
            own = [sample for sample in self.samples if sample.limb == limb]
            commands[limb] = Commands(
                np.array([sample.time_s for sample in own]),
                np.array([sample.q_sent for sample in own]),
                np.array([sample.q_measured for sample in own]),
            )
        return commands

    def motion(self, limb: str, *, with_knots: bool = False) -> ArmMotion:
        """Position, velocity, acceleration and jerk of an arm.

        The positions are those of `q`: commanded ones of a simulation, measured ones of a robot.
        Velocity, acceleration and jerk are those of the commands where a recorded move explains the
        positions, and differences of the positions elsewhere. `commands` has the set-points that a
        robot was sent.

        Args:
            limb: "left" or "right".
            with_knots: whether to add the times where the jerk of a move changes.

        Raises:
            UnknownNameError: when there is no such limb.
            RecordingError: when its joints were not recorded, or `with_knots` is not a bool.
        """
        expect(with_knots, bool, "with_knots", RecordingError)
        names = arm_joints(checked_limb(limb))
        missing = [name for name in names if name not in self.joint_names]
        if missing:
            raise RecordingError(f"the recording lacks {', '.join(missing)}")
        q = self.q[:, [self.joint_names.index(name) for name in names]]
        moves = [move for move in self.moves if move.limb == limb]
        return arm_motion(names, self.times_s, q, moves, with_knots=with_knots)

    def _facts(self) -> tuple[str, ...]:
        rows, bodies = count(len(self.times_s), "snapshot"), listing(self.bodies, "body")
        arms = "" if self.limbs == LIMBS else f"{self.limbs[0]} arm alone"
        return rows, seconds(self.duration_s), arms, count(len(self.events), "event"), bodies


class NotedRecording(NamedTuple):
    """A recording read from a file that may be damaged or odd, and what was odd about it.

    Attributes:
        recording: the recording.
        notes: a sentence for each oddity.
    """

    recording: Recording
    notes: tuple[str, ...]

    def __repr__(self) -> str:
        is_known = isinstance(self.notes, tuple)  # a named tuple takes anything
        notes = count(len(self.notes), "note") if is_known else shown(self.notes)
        return line("NotedRecording", (notes, quoted(self.recording)))


def entries_of(recording: Recording) -> Iterator[Entry]:
    """Yield the content of a recording; events come before the snapshot of the same time."""
    yield from recording.bodies.values()
    if recording.start is not None:
        yield recording.start
    timed: list[Row | Caption | Event | RecordedMove | RecordedSample]
    timed = [*recording.events, *recording.moves, *recording.samples]
    timed += [Caption(time_s, text) for time_s, text in recording.captions]
    for i, time_s in enumerate(recording.times_s.tolist()):
        rows = {name: track[i] for name, track in recording.body_poses.items()}
        poses = {name: row for name, row in rows.items() if np.isfinite(row[0])}
        timed.append(Row(time_s, recording.q[i], recording.gripper_percent[i], poses))
    yield from sorted(timed, key=_time_of)


def _time_of(entry: Event | RecordedMove | Caption | RecordedSample | Row) -> float:
    return entry.start_s if isinstance(entry, RecordedMove) else entry.time_s


def _events_with_moves(events: Sequence[Event], moves: Sequence[RecordedMove]) -> Iterator[Event]:
    """The events, those that began a move with that move, which old files have apart from them."""
    left = deque(moves)
    for event in events:
        is_start = event.kind is EventKind.MOVE_STARTED
        while is_start and left and left[0].start_s < event.time_s:
            left.popleft()
        is_of = is_start and left and left[0].start_s == event.time_s
        began = left.popleft() if is_of and event.side in (None, left[0].limb) else None
        yield event if began is None or event.move else evolve(event, move=began.move)


def play_back(recording: Recording, observer: Observer) -> None:
    """Report every event and snapshot of a recording to an observer, in order of time.

    Events come before the snapshot of the same time. A recording does not state whether a gripper
    was gripping or had missed, so both are reported as false; its events have it. A recording that
    has no `start` is reported as one of empty hands.

    Raises:
        RecordingError: when an argument has the wrong type.
    """
    expect(recording, Recording, "recording", RecordingError)
    expect(observer, Observer, "observer", RecordingError)
    observer.on_start(_state(recording) if recording.start is None else recording.start)
    caption = ""
    events = tuple(_events_with_moves(recording.events, recording.moves))
    for entry in entries_of(evolve(recording, events=events)):
        if isinstance(entry, Event):
            observer.on_event(entry)
        elif isinstance(entry, Caption):
            caption = entry.text
        elif isinstance(entry, Row):
            observer.on_snapshot(_snapshot(entry, caption))


def fit_response(recording: Recording, limb: str) -> Response:
    """Bounds on how an arm follows its set-points, by `planner.fit_response`.

    Args:
        recording: the recording of an execution on a robot.
        limb: "left" or "right".

    Raises:
        RecordingError: when no commands of that arm were recorded.
        UnknownNameError: when there is no such limb.
        ResponseError: when the commands do not determine the response; says why.
    """
    expect(recording, Recording, "recording", RecordingError)
    if checked_limb(limb) not in recording.commands:
        raise RecordingError(
            f"the recording has no set-points of the {limb} arm: a simulation sends none, and of "
            "files only MCAP has them; let a Recorder observe an execution on a robot, or execute "
            "with --record FILE.mcap"
        )
    sent = recording.commands[limb]
    return fit_arrays(sent.times_s, sent.q_sent, sent.q_measured)


def checked_limb(limb: object) -> str:
    """A limb, if there is such a one."""
    if not isinstance(limb, str) or limb not in LIMBS:
        raise UnknownNameError("limb", limb, LIMBS)
    return limb


def _state(recording: Recording) -> State:
    """What was there at the start and no event reports."""
    start_s = float(recording.times_s[0])
    spawned = {
        event.body.name
        for event in recording.events
        if event.body is not None and event.kind is EventKind.SPAWNED and event.time_s <= start_s
    }
    rows = {name: track[0] for name, track in recording.body_poses.items() if name not in spawned}
    scene = Scene.of(
        recording.bodies[name].at(_pose(row))
        for name, row in rows.items()
        if name in recording.bodies and np.isfinite(row).all()
    )
    return State(scene, dict(zip(recording.joint_names, recording.q[0].tolist(), strict=True)))


def _snapshot(row: Row, caption: str) -> Snapshot:
    return Snapshot(
        time_s=row.time_s,
        q=row.q,
        T_base_bodies={name: _pose(pose) for name, pose in row.poses.items()},
        grippers={
            side: GripperState(float(percent), False, False)
            for side, percent in zip(LIMBS, row.gripper_percent, strict=True)
        },
        caption=caption,
    )


def _pose(row: Sequence[float] | FloatArray) -> pin.SE3:
    """The pose of a row: x, y, z, quaternion x, y, z, w."""
    return pin.SE3(pin.Quaternion(np.array(row[3:])).normalized(), np.array(row[:3]))
