"""The log: a recording written while the simulation runs; a killed run loses nothing.

The file is JSON Lines: ASCII, one object to a line, each handed to the system as it is written.
Every line but the first has one entry that says what it is:

- first `{"format": "baxter-kin log", "version": 4, "joint_names": [...], "robot": {...}}`, of which
  the last says which robot it is and may be missing,
- `{"body": {...}}`: shapes and pose of a body, before it appears or disappears,
- `{"event": {...}}`: time, kind, text, the name of the body and the side that it is about,
- `{"move": {...}}`: a command: when it starts, its label, its exact trajectory, what inverse
  kinematics answered, and which contacts are meant,
- `{"snapshot": {...}}`: `time_s`, `q` and `gripper_percent`; `caption` where it changed; `poses`,
  x, y, z and quaternion x, y, z, w by name, of the bodies whose pose changed, null of one that is
  gone,
- `{"sample": {...}}`: what was sent to a robot and measured at a tick, as `sim.samples.Sample`,
- last `{"end": n}`: the number of snapshots; missing when the run was cut short.

SI units, radians, poses seen from base; the rules of `baxter_kin.json_data`, so every number reads
back as the same float. `sim.recording.reading.log_reading` reads it.
"""

from __future__ import annotations

from baxter_kin import Baxter
from baxter_kin.description import RobotIdentity
from baxter_kin.fields import NotCopied
from baxter_kin.files import PathLike
from baxter_kin.json_data import to_json
from baxter_kin.json_text import Json, as_text
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import expect
from planner import Body, Scene, State
from sim.errors import RecordingError
from sim.events import Event, Observer, Snapshot
from sim.files import LineFile
from sim.recording.recorded_motion import RecordedMove, recorded_move
from sim.recording.recorder import StoredEvent, pose_row

FORMAT = "baxter-kin log"
VERSION = 4
READABLE = (1, 2, 3, 4)
"""In the first one events named no side, and moves not what inverse kinematics answered; the first
two have no samples, and in the first three moves do not name the contacts that are meant."""


class LogRecorder(NotCopied, Observer):
    """Writes the log while the simulation runs. Its memory does not grow."""

    def __init__(self, path: PathLike, robot: Baxter, *, scene: Scene | None = None) -> None:
        """Open the file.

        Args:
            path: the file, by convention ending in ".jsonl"; an older one is replaced.
            robot: whose joints are recorded.
            scene: bodies that snapshots will have and no simulation tells of.

        Raises:
            RecordingError: when the file cannot be written.
        """
        names = expect(robot, Baxter, "robot", RecordingError).joint_names
        robot_data = to_json(robot.description.identity, RobotIdentity, "robot", RecordingError)
        bodies = Scene({}) if scene is None else expect(scene, Scene, "scene", RecordingError)
        self._poses: dict[str, list[float]] = {}
        self._caption: str | None = None
        self._count = 0
        self._is_open = True
        self._file = LineFile(path)
        head: dict[str, Json] = {
            "format": FORMAT,
            "version": VERSION,
            "joint_names": list(names),
        }
        self._write({**head, "robot": robot_data})
        self._written: set[str] = set()
        self._write_bodies(bodies)

    def on_start(self, state: State) -> None:
        """Write the bodies that are there, unless they are written.

        Raises:
            RecordingError: when it is no state, or the file cannot be written.
        """
        self._write_bodies(expect(state, State, "state", RecordingError).scene)

    def on_snapshot(self, snapshot: Snapshot) -> None:
        """Write it.

        Raises:
            RecordingError: when it is no snapshot, or the file cannot be written.
        """
        expect(snapshot, Snapshot, "snapshot", RecordingError)
        entries: dict[str, Json] = {
            "time_s": snapshot.time_s,
            "q": snapshot.q.tolist(),
            "gripper_percent": [snapshot.grippers[side].percent for side in LIMBS],
        }
        poses = self._changed_poses(snapshot)
        if poses:
            entries["poses"] = poses
        if snapshot.caption != self._caption:
            entries["caption"] = self._caption = snapshot.caption
        self._write({"snapshot": entries})
        self._count += 1

    def on_event(self, event: Event) -> None:
        """Write it, the body it is about, and the move that begins.

        Raises:
            RecordingError: when it is no event, or the file cannot be written.
        """
        expect(event, Event, "event", RecordingError)
        if event.body is not None and event.is_of_appearance:
            self._write_part("body", event.body, Body)
        self._write_part("event", StoredEvent.of(event), StoredEvent)
        move = recorded_move(event)
        if move is not None:
            self._write_part("move", move, RecordedMove)

    def close(self) -> None:
        """Write the end and close; twice is no trouble.

        Raises:
            RecordingError: when the file cannot be written.
        """
        if self._is_open:
            self._is_open = False
            try:
                self._write({"end": self._count})
            finally:
                self._file.close()

    def _facts(self) -> tuple[str, ...]:
        return self._file._facts()

    def _changed_poses(self, snapshot: Snapshot) -> dict[str, Json]:
        poses = {name: pose_row(T) for name, T in snapshot.T_base_bodies.items()}
        changed: dict[str, Json] = {
            name: list(row) for name, row in poses.items() if self._poses.get(name) != row
        }
        changed.update((name, None) for name in self._poses if name not in poses)
        self._poses = poses
        return changed

    def _write(self, entries: dict[str, Json]) -> None:
        self._file.write(as_text(entries, RecordingError))

    def _write_bodies(self, scene: Scene) -> None:
        for body in scene:
            if body.name not in self._written:
                self._write_part("body", body, Body)
                self._written.add(body.name)

    def _write_part(self, what: str, part: object, kind: type) -> None:
        self._write({what: to_json(part, kind, what, RecordingError)})
