"""The CSV of the RSDK's recorder, written.

It is what `joint_recorder.py` of the Rethink SDK writes and `joint_position_file_playback.py`
reads: header and 17 columns, time in seconds with six decimals, angles in rad, grippers 0..100.
`sim.recording.csv_writing` writes recordings and plans so.
`sim.recording.reading.rsdk_reading` reads it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from baxter_kin import Baxter
from baxter_kin.display import OneLine
from baxter_kin.fields import NotCopied
from baxter_kin.files import PathLike
from baxter_kin.kinematics.arm import JOINTS, LIMBS
from baxter_kin.validation import FloatArray, expect
from sim.errors import RecordingError
from sim.events import Observer, Snapshot
from sim.files import LineFile

_TIME, _VALUE = "{:.6f}", "{:.12g}"


class CsvFile(NotCopied, OneLine):
    """The RSDK's CSV while it is being written; use it as a context manager."""

    def __init__(self, path: PathLike, limbs: Sequence[str] = LIMBS) -> None:
        """Open the file and write the header.

        Args:
            path: the file; an older one is replaced.
            limbs: the arms that have columns.
        """
        header = csv_header(limbs)
        self._row = ",".join([_TIME, *[_VALUE] * (len(header) - 1)])
        self._file = LineFile(path)
        self._file.write(",".join(header))

    def __enter__(self) -> CsvFile:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def write(self, time_s: float, arms: FloatArray, percent: FloatArray) -> None:
        """One row, which reaches the system at once.

        Args:
            time_s: time.
            arms: the arms one after the other, shape (7 m,) for m arms, rad.
            percent: their grippers, shape (m,).
        """
        self.write_row(time_s, arms.tolist(), percent.tolist())

    def write_row(self, time_s: float, joints: list[float], percent: list[float]) -> None:
        """The same from plain numbers."""
        values = []
        for i, gripper in enumerate(percent):
            values += [*joints[7 * i : 7 * i + 7], gripper]
        self._file.write(self._row.format(time_s, *values))

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _facts(self) -> tuple[str, ...]:
        return self._file._facts()


class CsvRecorder(NotCopied, Observer):
    """Writes the RSDK's CSV while the simulation runs, so that a run cut short keeps its rows."""

    def __init__(self, path: PathLike, robot: Baxter) -> None:
        """Open the file.

        Raises:
            RecordingError: when it cannot be written.
        """
        joint_names = expect(robot, Baxter, "robot", RecordingError).joint_names
        self._indices = np.array(arm_indices(joint_names))
        self._csv = CsvFile(path)

    def on_snapshot(self, snapshot: Snapshot) -> None:
        """Write a row.

        Raises:
            RecordingError: when it is no snapshot, or the file cannot be written.
        """
        expect(snapshot, Snapshot, "snapshot", RecordingError)
        percent = [snapshot.grippers[side].percent for side in LIMBS]
        self._csv.write_row(snapshot.time_s, snapshot.q[self._indices].tolist(), percent)

    def close(self) -> None:
        """Close the file."""
        self._csv.close()

    def _facts(self) -> tuple[str, ...]:
        return self._csv._facts()


def csv_header(limbs: Sequence[str] = LIMBS) -> list[str]:
    """The names of the columns: time, and of each arm seven joints and the gripper."""
    columns = ["time"]
    for side in limbs:
        columns += [*(f"{side}_{joint}" for joint in JOINTS), f"{side}_gripper"]
    return columns


def arm_indices(joint_names: tuple[str, ...], limbs: Sequence[str] = LIMBS) -> list[int]:
    """Where the joints of the arms stand in a configuration."""
    wanted = [f"{side}_{joint}" for side in limbs for joint in JOINTS]
    missing = [name for name in wanted if name not in joint_names]
    if missing:
        raise RecordingError(f"the recording lacks {', '.join(missing)}, which the CSV needs")
    return [joint_names.index(name) for name in wanted]
