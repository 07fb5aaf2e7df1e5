"""Recordings read from any of the files that are known, by their suffixes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from baxter_kin import Baxter
from baxter_kin.display import shown_path
from baxter_kin.files import PathLike
from baxter_kin.validation import expect
from sim.errors import RecordingError
from sim.files import checked_path
from sim.recording.npz_file import load_recording
from sim.recording.reading.bag_reading import read_bag
from sim.recording.reading.log_reading import read_log
from sim.recording.reading.mcap_reading import read_mcap
from sim.recording.reading.rsdk_reading import read_rsdk_csv
from sim.recording.recording import NotedRecording

READERS: Mapping[str, Callable[[Path, Baxter], NotedRecording]] = {
    ".bag": read_bag,
    ".csv": read_rsdk_csv,
    ".jsonl": lambda path, _: read_log(path),
    ".mcap": read_mcap,
    ".npz": lambda path, _: NotedRecording(load_recording(path), ()),
}


def read_recording(path: PathLike, robot: Baxter) -> NotedRecording:
    """A recording from a file: npz, log, the RSDK's CSV, a bag of ROS 1, or MCAP.

    Args:
        path: the file; its suffix says the format.
        robot: the robot it was recorded on; npz files and logs say themselves which it was.

    Raises:
        RecordingError: when the suffix is another, or the file cannot be read as such.
    """
    expect(robot, Baxter, "robot", RecordingError)
    file = checked_path(path)
    read = READERS.get(file.suffix.lower())
    if read is None:
        raise RecordingError(
            f"{shown_path(file)} must end in one of {', '.join(READERS)}, which say the format"
        )
    return read(file, robot)
