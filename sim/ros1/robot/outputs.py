"""Where a simulated Baxter is shown and written to, as its options say."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path

from baxter_kin import Baxter
from baxter_kin.value_objects import FrozenMapping
from sim import BagRecorder, LogRecorder, McapRecorder, Observer, Recorder, World
from sim.recording.npz_file import save_recording
from sim.ros1.robot.arguments import RobotOptions

STREAMS: Mapping[str, type[LogRecorder | McapRecorder | BagRecorder]] = FrozenMapping(
    {".jsonl": LogRecorder, ".mcap": McapRecorder, ".bag": BagRecorder}
)
"""What writes while things happen, by the suffix of its file."""


def outputs(
    options: RobotOptions, world: World, say: Callable[[str], object], cleanup: ExitStack
) -> Iterator[Observer]:
    """Who writes what happens, and the live view.

    Args:
        options: what the user asked for.
        world: what is shown.
        say: told where to look.
        cleanup: finishes files and closes the view.

    Raises:
        RecordingError: when a file cannot be written.
        ViewerError: when the live view cannot be served.
    """
    if options.record is not None:
        yield _recorder(options.record, world.robot, cleanup)
    if options.is_shown:
        from sim.view.live.viewer import Viewer  # noqa: PLC0415 - without it, no web server

        viewer = cleanup.enter_context(Viewer(world.robot, keeps_time=False))
        viewer.show(world.q, {}, "ready")
        say(f"open {viewer.url} in a browser to watch")
        yield viewer


def _recorder(path: Path, robot: Baxter, cleanup: ExitStack) -> Observer:
    """What writes everything that happens, in the format that the suffix says."""
    if path.suffix == ".npz":
        recorder = Recorder(robot)
        cleanup.callback(_save, recorder, path)
        return recorder
    stream = STREAMS[path.suffix](path, robot)
    cleanup.callback(stream.close)
    return stream


def _save(recorder: Recorder, path: Path) -> None:
    if recorder.has_snapshots:
        save_recording(recorder.recording(), path)
