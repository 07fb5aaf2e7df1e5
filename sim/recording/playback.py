"""A recording told again: what observers saw when it was made, for any observer."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from baxter_kin.fields import evolve
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray, expect
from planner import Scene, State
from sim.errors import RecordingError
from sim.events import Event, EventKind, Observer, Snapshot
from sim.recording.recording import Recording
from sim.world.gripper import GripperState


def retell(recording: Recording, observer: Observer) -> None:
    """Tell an observer every event and snapshot of a recording, in order of time.

    Events come before the snapshot of the same time. A recording does not say whether a gripper was
    gripping or had missed, so these are told as false; its events say it. Of a move, label,
    trajectory and what inverse kinematics answered are told. Nobody knows what hands held at its
    beginning.

    Raises:
        RecordingError: when an argument has the wrong type.
    """
    expect(recording, Recording, "recording", RecordingError)
    expect(observer, Observer, "observer", RecordingError)
    events = deque(_with_moves(recording))
    captions = deque(recording.captions)
    caption = ""
    observer.on_start(_state(recording))
    for row, time_s in enumerate(recording.times_s.tolist()):
        while events and events[0].time_s <= time_s:
            observer.on_event(events.popleft())
        while captions and captions[0][0] <= time_s:
            caption = captions.popleft()[1]
        observer.on_snapshot(_snapshot(recording, row, caption))
    for event in events:
        observer.on_event(event)


def _state(recording: Recording) -> State:
    """What was there at the beginning and no event tells of."""
    start_s = float(recording.times_s[0])
    told = {
        event.body.name
        for event in recording.events
        if event.body is not None and event.kind is EventKind.SPAWNED and event.time_s <= start_s
    }
    rows = {name: track[0] for name, track in recording.body_poses.items() if name not in told}
    scene = Scene.of(
        recording.bodies[name].at(_pose(row))
        for name, row in rows.items()
        if name in recording.bodies and np.isfinite(row).all()
    )
    return State(scene, dict(zip(recording.joint_names, recording.q[0].tolist(), strict=True)))


def _with_moves(recording: Recording) -> Iterator[Event]:
    """The events; those that began a move with that move, also when they were loaded without."""
    moves = deque(recording.moves)
    for event in recording.events:
        is_start = event.kind is EventKind.MOVE_STARTED
        while is_start and moves and moves[0].start_s < event.time_s:
            moves.popleft()
        is_of = is_start and moves and moves[0].start_s == event.time_s
        began = moves.popleft() if is_of and event.side in (None, moves[0].limb) else None
        yield event if began is None or event.move else evolve(event, move=began.move)


def _snapshot(recording: Recording, row: int, caption: str) -> Snapshot:
    percents = zip(LIMBS, recording.gripper_percent[row].tolist(), strict=True)
    poses = {name: track[row] for name, track in recording.body_poses.items()}
    return Snapshot(
        time_s=float(recording.times_s[row]),
        q=recording.q[row],
        T_base_bodies={n: _pose(row) for n, row in poses.items() if np.isfinite(row).all()},
        grippers={side: GripperState(percent, False, False) for side, percent in percents},
        caption=caption,
    )


def _pose(row: FloatArray) -> pin.SE3:
    """The pose of a row: x, y, z, quaternion x, y, z, w."""
    return pin.SE3(pin.Quaternion(row[3:]).normalized(), row[:3])
