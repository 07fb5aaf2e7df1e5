"""The files that the demo writes and the live view, as its options say."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import TYPE_CHECKING

from planner import Plan
from sim import Observer, Recorder, World
from sim.demo.options import DemoOptions
from sim.recording.formats.rsdk_csv import PlanCsvFile, warn_if_as_drawn
from sim.recording.record_file import csv_recorder_of, recorder_of

if TYPE_CHECKING:  # a headless run needs no web server
    from sim.view.live.viewer import Viewer

Say = Callable[[str], None]

REPLAY_SNAPSHOTS = 12_000
"""The replay shows the last two minutes; only --forever has more."""


def outputs(options: DemoOptions, world: World, say: Say, cleanup: ExitStack) -> Iterator[Observer]:
    """The observers that write the files.

    Args:
        options: what the user requested.
        world: what is shown.
        say: prints a line.
        cleanup: finishes the files.
    """
    robot = world.robot
    if options.csv is not None and options.dwell_s is None:
        csv = csv_recorder_of(options.csv, robot, cleanup)
        warn_if_as_drawn(robot.description.identity, options.csv)
        yield csv
    if options.record is not None:
        yield recorder_of(options.record, robot, cleanup)
    if options.html is not None:
        recorder = Recorder(robot, keep=REPLAY_SNAPSHOTS)
        cleanup.callback(_write_replay, options, recorder, world, say)
        yield recorder


def playback(options: DemoOptions, cleanup: ExitStack) -> Callable[[Plan], None]:
    """The function that adds plans to the file for a robot to play back, if there is one."""
    if options.csv is None or options.dwell_s is None:
        return lambda _: None
    file = cleanup.enter_context(PlanCsvFile(options.csv, dwell_s=options.dwell_s))
    return lambda plan: file.add(plan) if plan.is_valid else None


def _write_replay(options: DemoOptions, recorder: Recorder, world: World, say: Say) -> None:
    from sim.view.replay import write_replay  # noqa: PLC0415 - only on request

    if options.html is not None and recorder.has_snapshots:
        body = world.shapes.body if options.shows_body else None
        write_replay(options.html, recorder.recording(), world.robot, body=body)
        say(f"replay: {options.html}")


def live_view(options: DemoOptions, world: World, say: Say, cleanup: ExitStack) -> Viewer | None:
    """The view, once a page watches or the wait for one is over; None when headless.

    Args:
        options: what the user requested.
        world: the scene that is shown first.
        say: prints where it is served.
        cleanup: closes the view.
    """
    if options.is_headless:
        return None
    from sim.view.live.viewer import Viewer  # noqa: PLC0415 - a headless run needs no web server

    viewer = cleanup.enter_context(Viewer(world.robot, port=options.port))
    viewer.show(world.q, {}, "ready")
    viewer.present(say, may_open=not options.no_browser, wait_s=options.wait_s)
    return viewer
