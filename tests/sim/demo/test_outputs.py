"""The requested outputs are written, and complete once they are closed."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import pytest

from baxter_kin import Baxter
from baxter_kin.command_line import parse
from planner import Body
from sim import (
    BagRecorder,
    CsvRecorder,
    LogRecorder,
    McapRecorder,
    Recorder,
    Simulation,
    World,
    load_recording,
    read_log,
)
from sim.demo import Interrupt
from sim.demo.options import DemoOptions
from sim.demo.outputs import outputs
from sim.demo.run import InterruptCheck


@pytest.fixture
def world(robot: Baxter, table: Body) -> World:
    world = World(robot)
    world.spawn(table)
    return world


def recorded(world: World, line: list[str], wait_s: float = 0.1) -> list[type]:
    """The classes of what records, after it has seen some time pass."""
    options = parse(DemoOptions, ["--headless", *line])
    with ExitStack() as cleanup:
        observers = list(outputs(options, world, print, cleanup))
        if wait_s:
            Simulation(world, observers).wait(wait_s)
    return [type(observer) for observer in observers]


def test_without_options_a_headless_demo_records_nothing(world: World) -> None:
    assert recorded(world, []) == []


@pytest.mark.parametrize(
    ("file", "kind"),
    [
        ("run.npz", Recorder),
        ("run.jsonl", LogRecorder),
        ("run.mcap", McapRecorder),
        ("run.bag", BagRecorder),
    ],
)
def test_the_suffix_says_the_format(world: World, tmp_path: Path, file: str, kind: type) -> None:
    assert recorded(world, ["--record", str(tmp_path / file)]) == [kind]
    assert (tmp_path / file).stat().st_size > 0


def test_closed_files_hold_all_that_was_shown(world: World, tmp_path: Path) -> None:
    npz, log = tmp_path / "run.npz", tmp_path / "run.jsonl"
    for path in (npz, log):
        recorded(world, ["--record", str(path)], wait_s=0.2)
    found = load_recording(npz), read_log(log).recording
    assert [len(recording.times_s) for recording in found] == [21, 21]


def test_every_output_that_is_requested_is_made_the_csv_first(world: World, tmp_path: Path) -> None:
    paths = {kind: str(tmp_path / f"run.{kind}") for kind in ("csv", "npz", "html")}
    line = ["--html", paths["html"], "--record", paths["npz"], "--csv", paths["csv"]]
    assert recorded(world, line) == [CsvRecorder, Recorder, Recorder]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run.csv", "run.html", "run.npz"]


def test_where_nothing_happened_there_is_no_recording_and_no_replay(
    world: World, tmp_path: Path
) -> None:
    line = ["--record", str(tmp_path / "run.npz"), "--html", str(tmp_path / "run.html")]
    recorded(world, line, wait_s=0.0)
    assert list(tmp_path.iterdir()) == []


def test_a_run_ends_at_the_tick_after_ctrl_c(world: World) -> None:
    interrupt = Interrupt()
    simulation = Simulation(world, [InterruptCheck(interrupt)])
    simulation.wait(0.1)
    interrupt.is_requested = True
    with pytest.raises(KeyboardInterrupt):
        simulation.wait(1.0)
    assert simulation.time_s < 0.15
