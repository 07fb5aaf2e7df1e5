"""Files that a run is recorded to while it goes on, in the format of their suffix."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from baxter_kin.command_line import file_of_format, option

if TYPE_CHECKING:  # --help needs none of them
    from baxter_kin import Baxter
    from sim.events import Observer

RECORD_SUFFIXES = (".bag", ".jsonl", ".mcap", ".npz")


def record_option(group: str, *, repeats: bool = False) -> Any:
    """The field of `--record`, a file or several."""
    return option(
        "--record",
        type=file_of_format(RECORD_SUFFIXES),
        repeats=repeats,
        metavar="FILE",
        group=group,
        help="write all that happens: .jsonl (a log, complete even when killed), .mcap (for "
        "Foxglove), .bag (for ROS 1) or .npz (at the end)" + ("; may be repeated" * repeats),
    )


def recorder_of(path: Path, robot: Baxter, cleanup: ExitStack) -> Observer:
    """What records to a file with one of `RECORD_SUFFIXES`; the stack finishes the file."""
    from sim.recording.log_recorder import LogRecorder  # noqa: PLC0415 - loads NumPy
    from sim.recording.npz_file import save_recording  # noqa: PLC0415 - likewise
    from sim.recording.recorder import Recorder  # noqa: PLC0415 - likewise
    from sim.recording.ros1_files.bag_file import BagRecorder  # noqa: PLC0415 - likewise
    from sim.recording.ros1_files.mcap_file import McapRecorder  # noqa: PLC0415 - likewise

    if path.suffix == ".npz":
        recorder = Recorder(robot)

        def save() -> None:
            if recorder.has_snapshots:
                save_recording(recorder.recording(), path)

        cleanup.callback(save)
        return recorder
    writers: dict[str, type[BagRecorder | LogRecorder | McapRecorder]]
    writers = {".bag": BagRecorder, ".jsonl": LogRecorder, ".mcap": McapRecorder}
    writer = writers[path.suffix](path, robot)
    cleanup.callback(writer.close)
    return writer
