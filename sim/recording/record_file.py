"""Recordings in files, in the format of their suffix.

Written are MCAP (everything, to the bit), the RSDK's CSV (joints and grippers) and bags of ROS 1
(joints, bodies and events, for other programs). Read are these and, for one more release, the .npz
and .jsonl files of earlier versions. The modules of the formats are loaded when they are needed.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from baxter_kin.command_line import file_of_format, option
from baxter_kin.display import shown_path
from sim.errors import RecordingError

if TYPE_CHECKING:  # --help needs none of them
    from baxter_kin import Baxter
    from baxter_kin.files import PathLike
    from sim.recording.recorder import Recorder, RecordFile, RecordingBuilder
    from sim.recording.recording import NotedRecording, Recording

RECORD_SUFFIXES = (".bag", ".csv", ".mcap")
READ_SUFFIXES = (".bag", ".csv", ".jsonl", ".mcap", ".npz")


def record_option(group: str, *, repeats: bool = False) -> Any:
    """The field of `--record`, a file or several."""
    return option(
        "--record",
        type=file_of_format(RECORD_SUFFIXES),
        repeats=repeats,
        metavar="FILE",
        group=group,
        help="write all that happens: .mcap (for Foxglove; kept when killed), .bag (for ROS 1, at "
        "the end) or .csv (joints alone)" + ("; may be repeated" * repeats),
    )


def recorder_of(path: Path, robot: Baxter, cleanup: ExitStack) -> Recorder:
    """A recorder that writes a file and needs little memory; the stack finishes the file."""
    from sim.recording.recorder import Recorder

    keep = None if path.suffix.lower() == ".bag" else 1
    return cleanup.enter_context(Recorder(robot, path, keep=keep))


def csv_recorder_of(path: Path, robot: Baxter, cleanup: ExitStack) -> Recorder:
    """The same for the RSDK's CSV, whatever the suffix."""
    from sim.recording.formats.rsdk_csv import CsvFile
    from sim.recording.recorder import Recorder

    return cleanup.enter_context(Recorder(robot, CsvFile(path, robot.joint_names), keep=1))


def open_record(path: PathLike, builder: RecordingBuilder) -> RecordFile:
    """Open the file that a recorder writes; a bag is made of its builder at the end."""
    from sim.recording.formats.bag_file import BagAtEnd
    from sim.recording.formats.mcap_file import McapFile
    from sim.recording.formats.rsdk_csv import CsvFile

    file = _with_suffix(path, RECORD_SUFFIXES)
    if file.suffix.lower() == ".bag":
        return BagAtEnd(file, builder)
    if file.suffix.lower() == ".csv":
        return CsvFile(file, builder.joint_names)
    return McapFile(file, builder.joint_names, builder.robot)


def save_recording(recording: Recording, path: PathLike) -> None:
    """Write a recording to a file; an older one is replaced.

    Args:
        recording: what to write.
        path: the file: .mcap keeps everything; .csv and .bag are for other programs.

    Raises:
        RecordingError: when the suffix is another one, or the file cannot be written.
    """
    from baxter_kin.validation import expect
    from sim.recording.formats.bag_file import write_bag
    from sim.recording.formats.mcap_file import write_mcap
    from sim.recording.formats.rsdk_csv import write_csv
    from sim.recording.recording import Recording

    expect(recording, Recording, "recording", RecordingError)
    file = _with_suffix(path, RECORD_SUFFIXES)
    writers: dict[str, Callable[[Recording, Path], None]]
    writers = {".bag": write_bag, ".csv": write_csv, ".mcap": write_mcap}
    writers[file.suffix.lower()](recording, file)


def read_recording(
    path: PathLike, robot: Baxter | None = None, *, topic: str | None = None
) -> NotedRecording:
    """Read a recording, also one whose writer was killed or that was made on a real Baxter.

    MCAP files that `save_recording` or a `Recorder` wrote have everything. Of MCAP files with
    messages of ROS 1 and of bags, joints, grippers and events are read
    (`sim.recording.formats.joint_states`), and of the RSDK's CSV joints and grippers
    (`sim.recording.formats.rsdk_csv`).

    Args:
        path: the file, in the format of its suffix: .mcap, .csv, .bag; deprecated are .npz and
            .jsonl.
        robot: the robot that joints were recorded on, whose limits count; by default the stock
            robot. Not needed for files that have everything.
        topic: of a bag or MCAP file, where joints were published, if there are several topics.

    Raises:
        RecordingError: when the suffix is another one, a package is missing, or the file cannot be
            read as such; says why.
    """
    from baxter_kin.kinematics.robot import given_or_stock
    from baxter_kin.validation import expect
    from sim.recording.formats.bag_file import read_bag
    from sim.recording.formats.mcap_file import read_mcap
    from sim.recording.formats.old_files import read_log, read_npz
    from sim.recording.formats.rsdk_csv import read_csv

    known = given_or_stock(robot, RecordingError)
    file = _with_suffix(path, READ_SUFFIXES)
    suffix = file.suffix.lower()
    if topic is not None:
        expect(topic, str, "topic", RecordingError)
        if suffix not in (".bag", ".mcap"):
            raise RecordingError(f"topic is for bags and MCAP files, not for {suffix}")
    if suffix == ".bag":
        return read_bag(file, known, topic)
    if suffix == ".mcap":
        return read_mcap(file, known, topic)
    if suffix == ".csv":
        return read_csv(file, known)
    return read_npz(file) if suffix == ".npz" else read_log(file)


def _with_suffix(path: PathLike, suffixes: tuple[str, ...]) -> Path:
    from sim.files import checked_path

    file = checked_path(path)
    if file.suffix.lower() not in suffixes:
        raise RecordingError(
            f"{shown_path(file)} must end in one of {', '.join(suffixes)}, which state the format"
        )
    return file
