"""The files that the demo writes and the live view, as its options say."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from baxter_kin import Baxter
from planner import Plan, RobotBody
from sim import CsvRecorder, Observer, Recorder, Snapshot, World
from sim.demo.interrupt import Interrupt
from sim.demo.narration import Narrator
from sim.demo.options import DemoOptions
from sim.recording.csv_writing import PlanCsvFile, warn_if_as_drawn
from sim.recording.record_file import recorder_of

if TYPE_CHECKING:  # a headless run needs no web server
    from sim.view.live.viewer import Viewer

REPLAY_SNAPSHOTS = 12_000
"""The replay shows the last two minutes; only --forever has more."""


def outputs(
    options: DemoOptions, world: World, narrator: Narrator, cleanup: ExitStack
) -> Iterator[Observer]:
    """The observers that write the files.

    Args:
        options: what the user asked for.
        world: what is shown.
        narrator: reports what was written.
        cleanup: finishes the files.
    """
    robot = world.robot
    if options.csv is not None and options.dwell_s is None:
        csv = CsvRecorder(options.csv, robot)
        warn_if_as_drawn(robot.description.identity, options.csv)
        cleanup.callback(csv.close)
        yield csv
    if options.record is not None:
        yield recorder_of(options.record, robot, cleanup)
    if options.html is not None:
        recorder = Recorder(robot, keep=REPLAY_SNAPSHOTS)
        body = world.shapes.body if options.shows_body else None
        cleanup.callback(_write_replay, options.html, recorder, robot, narrator, body)
        yield recorder


def playback(options: DemoOptions, cleanup: ExitStack) -> Callable[[Plan], None]:
    """The function that adds plans to the file for a robot to play back, if there is one."""
    if options.csv is None or options.dwell_s is None:
        return lambda _: None
    file = cleanup.enter_context(PlanCsvFile(options.csv, dwell_s=options.dwell_s))
    return lambda plan: file.add(plan) if plan.is_valid else None


def _write_replay(
    path: Path, recorder: Recorder, robot: Baxter, narrator: Narrator, body: RobotBody | None
) -> None:
    from sim.view.replay import write_replay  # noqa: PLC0415 - only when asked for

    if recorder.has_snapshots:
        write_replay(path, recorder.recording(), robot, body=body)
        narrator.say(f"replay: {path}")


class StopWatch(Observer):
    """Checks at every tick whether Ctrl-C was pressed."""

    def __init__(self, interrupt: Interrupt) -> None:
        self._interrupt = interrupt

    def on_snapshot(self, snapshot: Snapshot) -> None:  # noqa: ARG002 - a tick is enough
        """Raise KeyboardInterrupt if Ctrl-C was pressed."""
        self._interrupt.check()


def live_view(
    options: DemoOptions, world: World, narrator: Narrator, cleanup: ExitStack
) -> tuple[Viewer, ...]:
    """The view, once a page watches or the wait for one is over; empty when headless.

    Args:
        options: what the user asked for.
        world: the scene that is shown first.
        narrator: reports where it is served.
        cleanup: closes the view.
    """
    if options.is_headless:
        return ()
    from sim.view.live.viewer import Viewer  # noqa: PLC0415 - a headless run needs no web server

    viewer = cleanup.enter_context(Viewer(world.robot, port=options.port))
    viewer.show(world.q, {}, "ready")
    viewer.present(narrator.say, may_open=not options.no_browser, wait_s=options.wait_s)
    return (viewer,)


@contextmanager
def shown(views: Iterable[Viewer], failure: Callable[[], str | None]) -> Iterator[None]:
    """Keep pages live inside the block; afterwards they replay what was shown and name the failure.

    Args:
        views: the live view, if there is one.
        failure: returns at the end what failed, or None.
    """
    with ExitStack() as cleanup:
        for viewer in views:
            cleanup.enter_context(viewer)  # shows what is raised
        yield
        for viewer in views:
            viewer.close(failure() or "")
