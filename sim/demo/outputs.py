"""Where the demo is written to, as its options say."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

from baxter_kin import Baxter
from planner import Plan, RobotBody
from sim import (
    BagRecorder,
    CsvRecorder,
    LogRecorder,
    McapRecorder,
    Observer,
    Recorder,
    Snapshot,
    World,
)
from sim.demo.interrupt import Interrupt
from sim.demo.narration import Narrator
from sim.demo.options import DemoOptions
from sim.recording.csv_writing import PlanCsvFile, warn_if_as_drawn
from sim.recording.npz_file import save_recording

REPLAY_SNAPSHOTS = 12_000
"""The replay shows the last two minutes; only --forever ever has more."""


def outputs(
    options: DemoOptions, world: World, narrator: Narrator, cleanup: ExitStack
) -> Iterator[Observer]:
    """Who writes what happens.

    Args:
        options: what the user asked for.
        world: what is shown.
        narrator: tells what was written.
        cleanup: finishes files.

    Raises:
        RecordingError: when a file cannot be written.
    """
    robot = world.robot
    if options.csv is not None and options.dwell_s is None:
        csv = CsvRecorder(options.csv, robot)
        warn_if_as_drawn(robot.description.identity, options.csv)
        cleanup.callback(csv.close)
        yield csv
    if options.record is not None:
        yield _recorder(options.record, robot, cleanup)
    if options.html is not None:
        recorder = Recorder(robot, keep=REPLAY_SNAPSHOTS)
        body = world.shapes.body if options.shows_body else None
        cleanup.callback(_write_replay, options.html, recorder, robot, narrator, body)
        yield recorder


def playback(options: DemoOptions, cleanup: ExitStack) -> Callable[[Plan], None]:
    """What takes the plans for the file that a robot is to play back, or nothing.

    Raises:
        RecordingError: when the file cannot be written.
    """
    if options.csv is None or options.dwell_s is None:
        return lambda _: None
    file = cleanup.enter_context(PlanCsvFile(options.csv, dwell_s=options.dwell_s))
    return lambda plan: file.add(plan) if plan.is_valid else None


def _recorder(path: Path, robot: Baxter, cleanup: ExitStack) -> Observer:
    """What writes everything that happens, in the format that the suffix says."""
    if path.suffix == ".npz":
        recorder = Recorder(robot)
        cleanup.callback(_save, recorder, path)
        return recorder
    makers: dict[str, Callable[[Path, Baxter], BagRecorder | LogRecorder | McapRecorder]]
    makers = {".bag": BagRecorder, ".jsonl": LogRecorder, ".mcap": McapRecorder}
    stream = makers[path.suffix](path, robot)
    cleanup.callback(stream.close)
    return stream


def _save(recorder: Recorder, path: Path) -> None:
    if recorder.has_snapshots:
        save_recording(recorder.recording(), path)


def _write_replay(
    path: Path, recorder: Recorder, robot: Baxter, narrator: Narrator, body: RobotBody | None
) -> None:
    from sim.view.replay import write_replay  # noqa: PLC0415 - only when asked for

    if recorder.has_snapshots:
        write_replay(path, recorder.recording(), robot, body=body)
        narrator.say(f"replay: {path}")


class StopWatch(Observer):
    """Looks at every tick whether Ctrl-C was pressed."""

    def __init__(self, interrupt: Interrupt) -> None:
        self._interrupt = interrupt

    def on_snapshot(self, snapshot: Snapshot) -> None:  # noqa: ARG002 - only its coming matters
        """Look, and raise KeyboardInterrupt if it was."""
        self._interrupt.check()
