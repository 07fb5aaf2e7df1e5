"""Recording: what happened, as data, and the CSV of the RSDK's recorder.

The CSV is what `joint_recorder.py` of the Rethink SDK writes and `joint_position_file_playback.py`
reads: header and 17 columns, time in seconds with six decimals, angles in rad, grippers 0..100.
"""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import TextIO

import numpy as np

from baxter_kin import Baxter, quaternion_xyzw
from baxter_kin.arrays import Vector, finite_array, float_array
from baxter_kin.errors import expect
from baxter_kin.model import JOINTS, LIMBS
from planner import Body, Scene
from planner.errors import expect_all
from sim.errors import RecordingError
from sim.events import Event, Observer, Snapshot


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """A finished recording of n snapshots.

    Attributes:
        joint_names: the 19 joints of the robot.
        times_s: shape (n,), increasing.
        q: full configurations, shape (n, 19), rad and m.
        gripper_percent: left and right gripper, shape (n, 2), 0 closed .. 100 open.
        bodies: every body that ever was in the world, by name.
        body_poses: for each, shape (n, 7): x, y, z, then quaternion x, y, z, w, seen from base; NaN
            while it is not in the world.
        captions: (time in s, text) wherever the caption changed.
        events: everything that happened.

    Raises:
        RecordingError: when shapes do not fit, times do not increase, or there is no snapshot.
    """

    joint_names: tuple[str, ...]
    times_s: Vector
    q: Vector
    gripper_percent: Vector
    bodies: Mapping[str, Body]
    body_poses: Mapping[str, Vector]
    captions: tuple[tuple[float, str], ...]
    events: tuple[Event, ...]

    def __post_init__(self) -> None:
        """Check and freeze."""
        count = float_array(self.times_s, "times_s", RecordingError).size
        if count == 0:
            raise RecordingError("the recording is empty: nothing was simulated")
        for name, kind in (("joint_names", str), ("captions", tuple), ("events", Event)):
            items = expect_all(getattr(self, name), kind, name, RecordingError)
            object.__setattr__(self, name, items)
        shapes = {
            "times_s": (count,),
            "q": (count, len(self.joint_names)),
            "gripper_percent": (count, len(LIMBS)),
        }
        for name, shape in shapes.items():
            array = finite_array(getattr(self, name), shape, name, RecordingError)
            object.__setattr__(self, name, array)
        if not (np.diff(self.times_s) > 0.0).all():
            raise RecordingError("times_s must increase from one snapshot to the next")
        object.__setattr__(self, "body_poses", self._frozen_poses())
        object.__setattr__(self, "bodies", Scene(self.bodies).bodies)

    @property
    def duration_s(self) -> float:
        """From the first snapshot to the last."""
        return float(self.times_s[-1] - self.times_s[0])

    def write_csv(self, path: str | Path) -> None:
        """Write the RSDK's CSV.

        Raises:
            RecordingError: when the file cannot be written.
        """
        indices = _arm_indices(self.joint_names)
        with CsvFile(path) as file:
            for time_s, q, percent in zip(self.times_s, self.q, self.gripper_percent, strict=True):
                file.write(float(time_s), q[indices], percent)

    def _frozen_poses(self) -> Mapping[str, Vector]:
        if not isinstance(self.body_poses, Mapping):
            raise RecordingError(
                f"body_poses must be a mapping, got {type(self.body_poses).__name__}"
            )
        poses = {}
        for name, track in self.body_poses.items():
            array = float_array(track, f"poses of {name!r}", RecordingError)
            if array.shape != (len(self.times_s), 7):
                raise RecordingError(
                    f"poses of {name!r} have shape {array.shape}; need {(len(self.times_s), 7)}"
                )
            array.setflags(write=False)
            poses[name] = array
        return MappingProxyType(poses)


class Recorder(Observer):
    """Collects snapshots and events in memory; `recording()` makes data of them."""

    def __init__(self, robot: Baxter, *, keep: int | None = None) -> None:
        """Start empty.

        Args:
            robot: whose joints are recorded.
            keep: how many snapshots, and as many events, to keep; all when not given.

        Raises:
            RecordingError: when `keep` is not a whole number above zero.
        """
        if keep is not None and not 1 <= expect(keep, int, "keep", RecordingError) <= sys.maxsize:
            raise RecordingError(f"keep must be from 1 to {sys.maxsize}, got {keep}")
        self._joint_names = expect(robot, Baxter, "robot", RecordingError).joint_names
        self._snapshots: deque[Snapshot] = deque(maxlen=keep)
        self._events: deque[Event] = deque(maxlen=keep)
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
        """Keep it."""
        self._snapshots.append(snapshot)

    def on_event(self, event: Event) -> None:
        """Keep it, and the shapes of a body that appeared."""
        self._events.append(event)
        if event.body is not None:
            self._bodies[event.body.name] = event.body

    def recording(self) -> Recording:
        """All so far.

        Raises:
            RecordingError: when there is no snapshot yet.
        """
        shots = self._snapshots
        return Recording(
            joint_names=self._joint_names,
            times_s=np.array([shot.time_s for shot in shots]),
            q=np.array([shot.q for shot in shots]),
            gripper_percent=np.array(
                [[shot.grippers[side].percent for side in LIMBS] for shot in shots]
            ),
            bodies=self._bodies,
            body_poses={name: self._track(name) for name in self._bodies},
            captions=self._captions(),
            events=tuple(self._events),
        )

    def _track(self, name: str) -> Vector:
        absent = np.full(7, np.nan)
        poses = (shot.T_base_bodies.get(name) for shot in self._snapshots)
        return np.array(
            [absent if T is None else [*T.translation, *quaternion_xyzw(T)] for T in poses]
        )

    def _captions(self) -> tuple[tuple[float, str], ...]:
        captions: list[tuple[float, str]] = []
        for shot in self._snapshots:
            if not captions or captions[-1][1] != shot.caption:
                captions.append((shot.time_s, shot.caption))
        return tuple(captions)


class CsvFile:
    """The RSDK's CSV while it is being written; use it as a context manager."""

    def __init__(self, path: str | Path) -> None:
        """Open the file and write the header.

        Raises:
            RecordingError: when the file cannot be opened.
        """
        if not isinstance(path, (str, Path)):
            raise RecordingError(f"a path must be text or a Path, got {type(path).__name__}")
        self._path = path
        with self._explained():
            self._file: TextIO = open(path, "w", encoding="ascii", newline="\n")  # noqa: SIM115
        self._file.write(",".join(csv_header()) + "\n")

    def __enter__(self) -> CsvFile:
        """The open file."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close it."""
        self.close()

    def write(self, time_s: float, arms: Vector, percent: Vector) -> None:
        """One row.

        Args:
            time_s: time.
            arms: left, then right arm, shape (14,), rad.
            percent: left and right gripper, shape (2,).

        Raises:
            RecordingError: when the file cannot be written.
        """
        left = ",".join(f"{value:.12g}" for value in [*arms[:7], percent[0]])
        right = ",".join(f"{value:.12g}" for value in [*arms[7:], percent[1]])
        with self._explained():
            self._file.write(f"{time_s:.6f},{left},{right}\n")

    def close(self) -> None:
        """Write what is left and close.

        Raises:
            RecordingError: when the file cannot be written.
        """
        with self._explained():
            self._file.close()

    @contextmanager
    def _explained(self) -> Iterator[None]:
        try:
            yield
        except (OSError, ValueError) as cause:  # ValueError: no path, or a closed file
            reason = getattr(cause, "strerror", None) or str(cause)
            raise RecordingError(f"cannot write {self._path}: {reason}") from cause


class CsvRecorder(Observer):
    """Writes the RSDK's CSV while the simulation runs, so that a run cut short keeps its rows."""

    def __init__(self, path: str | Path, robot: Baxter) -> None:
        """Open the file.

        Raises:
            RecordingError: when it cannot be opened.
        """
        self._indices = _arm_indices(expect(robot, Baxter, "robot", RecordingError).joint_names)
        self._csv = CsvFile(path)

    def on_snapshot(self, snapshot: Snapshot) -> None:
        """Write a row."""
        percent = np.array([snapshot.grippers[side].percent for side in LIMBS])
        self._csv.write(snapshot.time_s, snapshot.q[self._indices], percent)

    def close(self) -> None:
        """Write what is left and close."""
        self._csv.close()


def csv_header() -> list[str]:
    """The 17 column names."""
    columns = ["time"]
    for side in LIMBS:
        columns += [*(f"{side}_{joint}" for joint in JOINTS), f"{side}_gripper"]
    return columns


def _arm_indices(joint_names: tuple[str, ...]) -> list[int]:
    wanted = [f"{side}_{joint}" for side in LIMBS for joint in JOINTS]
    missing = [name for name in wanted if name not in joint_names]
    if missing:
        raise RecordingError(f"the recording lacks {', '.join(missing)}, which the CSV needs")
    return [joint_names.index(name) for name in wanted]
