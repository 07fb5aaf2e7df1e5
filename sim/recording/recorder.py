"""Recorder: an observer that keeps what happens in memory, until data is made of it.

`RecordingMemory` is that memory, which logs that are read back fill, too.

And `StoredEvent`: what the files that keep all of a recording keep of an event. The move that began
is not kept with it: its motion is among the moves.
"""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from baxter_kin import Baxter, quaternion_xyzw
from baxter_kin.description import RobotIdentity
from baxter_kin.display import count
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray, expect, whole_scalar
from planner import Body, Scene, State
from sim.errors import RecordingError
from sim.events import Event, EventKind, Snapshot
from sim.recording.recorded_motion import RecordedMove, recorded_move
from sim.recording.recording import Commands, Recording
from sim.samples import Sample, SampleObserver


@dataclass(frozen=True, slots=True)
class StoredEvent:
    """An event as it is kept.

    Attributes:
        time_s: simulated time.
        kind: what.
        text: one readable phrase.
        body: name of the body that it is about; before sides were kept, only of one that appeared
            or disappeared.
        side: of the arm that it is about.
    """

    time_s: float
    kind: EventKind
    text: str
    body: str | None = None
    side: str | None = None

    @classmethod
    def of(cls, event: Event) -> StoredEvent:
        """What is kept of an event."""
        body = None if event.body is None else event.body.name
        return cls(event.time_s, event.kind, event.text, body, event.side)

    def event(self, bodies: Mapping[str, Body]) -> Event:
        """The event, with the body of its name."""
        body = bodies.get(self.body or "")
        return Event(self.time_s, self.kind, self.text, self.side, body=body)


class Row(NamedTuple):
    """What is recorded of a snapshot.

    Attributes:
        time_s: simulated time.
        q: full configuration, rad and m.
        gripper_percent: of the left and the right gripper.
        poses: of every body present, by name, as `pose_row`.
        caption: what is going on, in words.
    """

    time_s: float
    q: FloatArray
    gripper_percent: Sequence[float] | FloatArray
    poses: Mapping[str, Sequence[float] | FloatArray]
    caption: str


class CommandSample(NamedTuple):
    """What is recorded of a `Sample`.

    Attributes:
        limb: "left" or "right".
        time_s: since the execution began.
        q_sent: the set-point, shape (7,), rad.
        q_measured: what was measured last, shape (7,), rad.
    """

    limb: str
    time_s: float
    q_sent: FloatArray
    q_measured: FloatArray

    @classmethod
    def of(cls, sample: Sample) -> CommandSample:
        """The commands of a sample."""
        return cls(sample.limb, sample.time_s, sample.q_sent, sample.q_measured)


class RecordingMemory:
    """What happened so far, in memory: of a simulation, or of the lines of a log.

    Attributes:
        rows: of the snapshots, in order.
        bodies: by name, as last told.
        events: in order.
        moves: in order.
        samples: what was sent to a robot and measured, in order.
    """

    def __init__(
        self, joint_names: tuple[str, ...], robot: RobotIdentity | None, keep: int | None = None
    ) -> None:
        """Start empty; `keep` as of `Recorder`."""
        self.joint_names, self._robot = joint_names, robot
        self.rows: deque[Row] = deque(maxlen=keep)
        self.bodies: dict[str, Body] = {}
        self.events: deque[Event] = deque()
        self.moves: deque[RecordedMove] = deque()
        self.samples: deque[CommandSample] = deque()

    def recording(self) -> Recording:
        """All of it."""
        if not self.rows:
            raise RecordingError("the recording is empty: nothing was simulated")
        self.forget_the_past()
        return Recording(
            joint_names=self.joint_names,
            times_s=np.array([row.time_s for row in self.rows]),
            q=np.array([row.q for row in self.rows]),
            gripper_percent=np.array([row.gripper_percent for row in self.rows]),
            bodies=self.bodies,
            body_poses={name: self._track(name) for name in self.bodies},
            captions=self._captions(),
            events=tuple(self.events),
            moves=tuple(self.moves),
            robot=self._robot,
            commands=self._commands(),
        )

    def forget_the_past(self) -> None:
        """What ended before the first snapshot that is kept, once others were dropped."""
        if len(self.rows) != self.rows.maxlen:
            return
        first_s = self.rows[0].time_s
        while self.moves and self.moves[0].end_s < first_s:
            self.moves.popleft()
        while self.events and self.events[0].time_s < first_s:
            self.events.popleft()
        while self.samples and self.samples[0].time_s < first_s:
            self.samples.popleft()

    def _commands(self) -> dict[str, Commands]:
        found = {}
        for limb in sorted({sample.limb for sample in self.samples}):
            times, sent, measured = zip(
                *(sample[1:] for sample in self.samples if sample.limb == limb), strict=True
            )
            found[limb] = Commands(np.array(times), np.array(sent), np.array(measured))
        return found

    def _track(self, name: str) -> FloatArray:
        absent = np.full(7, np.nan)
        return np.array([row.poses.get(name, absent) for row in self.rows])

    def _captions(self) -> tuple[tuple[float, str], ...]:
        captions: list[tuple[float, str]] = []
        for row in self.rows:
            if not captions or captions[-1][1] != row.caption:
                captions.append((row.time_s, row.caption))
        return tuple(captions)


class Recorder(SampleObserver):
    """Collects snapshots and events in memory; `recording()` makes data of them."""

    def __init__(self, robot: Baxter, *, keep: int | None = None) -> None:
        """Start empty.

        Args:
            robot: whose joints are recorded.
            keep: how many snapshots to keep, and the events and moves of that time; all when not
                given.

        Raises:
            RecordingError: when `keep` is not a whole number above zero.
        """
        if keep is not None:
            keep = whole_scalar(keep, "keep", RecordingError, least=1, most=sys.maxsize)
        expect(robot, Baxter, "robot", RecordingError)
        self._story = RecordingMemory(robot.joint_names, robot.description.identity, keep)

    @property
    def has_snapshots(self) -> bool:
        """Whether there is anything to make a recording of."""
        return bool(self._story.rows)

    def remember(self, scene: Scene) -> None:
        """Note the shapes of bodies, which snapshots do not carry.

        A simulation tells of those that were in its world before it began and of those that it
        spawns; this is for what is recorded without one.

        Raises:
            RecordingError: when it is no scene.
        """
        self._story.bodies.update(expect(scene, Scene, "scene", RecordingError).bodies)

    def on_start(self, state: State) -> None:
        """Note the shapes of the bodies that are there.

        Raises:
            RecordingError: when it is no state.
        """
        self.remember(expect(state, State, "state", RecordingError).scene)

    def on_snapshot(self, snapshot: Snapshot) -> None:
        """Keep it.

        Raises:
            RecordingError: when it is no snapshot.
        """
        shot = expect(snapshot, Snapshot, "snapshot", RecordingError)
        percent = [shot.grippers[side].percent for side in LIMBS]
        poses = {name: pose_row(T) for name, T in shot.T_base_bodies.items()}
        self._story.rows.append(Row(shot.time_s, shot.q, percent, poses, shot.caption))

    def on_event(self, event: Event) -> None:
        """Keep it, the move that began, and the shapes of a body that appeared.

        Raises:
            RecordingError: when it is no event.
        """
        expect(event, Event, "event", RecordingError)
        self._story.events.append(event)
        if event.body is not None and event.is_of_appearance:
            self._story.bodies[event.body.name] = event.body
        move = recorded_move(event)
        if move is not None:
            self._story.moves.append(move)
        self._story.forget_the_past()

    def on_sample(self, sample: Sample) -> None:
        """Keep what was sent to a robot and measured.

        Raises:
            RecordingError: when it is no sample.
        """
        expect(sample, Sample, "sample", RecordingError)
        self._story.samples.append(CommandSample.of(sample))

    def recording(self) -> Recording:
        """All so far.

        Raises:
            RecordingError: when there is no snapshot yet.
        """
        return self._story.recording()

    def _facts(self) -> tuple[str, ...]:
        return (count(len(self._story.rows), "snapshot"),)


def pose_row(T_base_body: pin.SE3) -> list[float]:
    """A pose seen from base as x, y, z, then quaternion x, y, z, w; seven numbers, m."""
    return [*T_base_body.translation.tolist(), *quaternion_xyzw(T_base_body).tolist()]
