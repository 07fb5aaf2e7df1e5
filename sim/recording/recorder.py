"""Recorder: an observer that keeps what happens in memory, until data is made of it.

And `StoredEvent`: what the files that keep all of a recording keep of an event. The move that began
is not kept with it: its motion is among the moves.
"""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from baxter_kin import Baxter, quaternion_xyzw
from baxter_kin.errors import expect
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray, whole_scalar
from baxter_kin.value_objects import count
from planner import Body, Scene
from sim.errors import RecordingError
from sim.events import Event, EventKind, Observer, Snapshot
from sim.recording.recorded_motion import RecordedMove, recorded_move
from sim.recording.recording import Recording


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


class Recorder(Observer):
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
        self._robot = expect(robot, Baxter, "robot", RecordingError)
        self._snapshots: deque[Snapshot] = deque(maxlen=keep)
        self._events: deque[Event] = deque()
        self._moves: deque[RecordedMove] = deque()
        self._bodies: dict[str, Body] = {}

    @property
    def has_snapshots(self) -> bool:
        """Whether there is anything to make a recording of."""
        return bool(self._snapshots)

    def remember(self, scene: Scene) -> None:
        """Note the shapes of bodies that were in the world before the simulation began.

        Those that it spawns are noted as they appear; snapshots carry only their poses.

        Raises:
            RecordingError: when it is no scene.
        """
        self._bodies.update(expect(scene, Scene, "scene", RecordingError).bodies)

    def on_snapshot(self, snapshot: Snapshot) -> None:
        """Keep it.

        Raises:
            RecordingError: when it is no snapshot.
        """
        self._snapshots.append(expect(snapshot, Snapshot, "snapshot", RecordingError))

    def on_event(self, event: Event) -> None:
        """Keep it, the move that began, and the shapes of a body that appeared.

        Raises:
            RecordingError: when it is no event.
        """
        expect(event, Event, "event", RecordingError)
        self._events.append(event)
        if event.body is not None and event.is_of_appearance:
            self._bodies[event.body.name] = event.body
        move = recorded_move(event)
        if move is not None:
            self._moves.append(move)
        self._forget_the_past()

    def recording(self) -> Recording:
        """All so far.

        Raises:
            RecordingError: when there is no snapshot yet.
        """
        shots = self._snapshots
        self._forget_the_past()
        return Recording(
            joint_names=self._robot.joint_names,
            times_s=np.array([shot.time_s for shot in shots]),
            q=np.array([shot.q for shot in shots]),
            gripper_percent=np.array(
                [[shot.grippers[side].percent for side in LIMBS] for shot in shots]
            ),
            bodies=self._bodies,
            body_poses={name: self._track(name) for name in self._bodies},
            captions=self._captions(),
            events=tuple(self._events),
            moves=tuple(self._moves),
            robot=self._robot.description.identity,
        )

    def _facts(self) -> tuple[str, ...]:
        return (count(len(self._snapshots), "snapshot"),)

    def _forget_the_past(self) -> None:
        """What ended before the first snapshot that is kept, once others were dropped."""
        if len(self._snapshots) != self._snapshots.maxlen:
            return
        first_s = self._snapshots[0].time_s
        while self._moves and self._moves[0].end_s < first_s:
            self._moves.popleft()
        while self._events and self._events[0].time_s < first_s:
            self._events.popleft()

    def _track(self, name: str) -> FloatArray:
        absent = np.full(7, np.nan)
        poses = (shot.T_base_bodies.get(name) for shot in self._snapshots)
        return np.array([absent if T is None else pose_row(T) for T in poses])

    def _captions(self) -> tuple[tuple[float, str], ...]:
        captions: list[tuple[float, str]] = []
        for shot in self._snapshots:
            if not captions or captions[-1][1] != shot.caption:
                captions.append((shot.time_s, shot.caption))
        return tuple(captions)


def pose_row(T_base_body: pin.SE3) -> list[float]:
    """A pose seen from base as x, y, z, then quaternion x, y, z, w; seven numbers, m."""
    return [*T_base_body.translation.tolist(), *quaternion_xyzw(T_base_body).tolist()]
