"""The requested outputs are written, and complete once they are closed."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import pytest

from baxter_kin import Baxter
from baxter_kin.command_line import parse
from planner import Body
from sim import Recorder, Simulation, World, read_recording
from sim.demo import Interrupt
from sim.demo.options import DemoOptions
from sim.demo.outputs import outputs
from sim.demo.session import InterruptCheck


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


@pytest.mark.parametrize("suffix", [".bag", ".csv", ".mcap"])
def test_closed_files_hold_all_that_was_shown(
    world: World, robot: Baxter, tmp_path: Path, suffix: str
) -> None:
    path = tmp_path / f"run{suffix}"
    assert recorded(world, ["--record", str(path)], wait_s=0.2) == [Recorder]
    assert len(read_recording(path, robot).recording.times_s) == 21


def test_every_output_that_is_requested_is_made_the_csv_first(world: World, tmp_path: Path) -> None:
    paths = {kind: str(tmp_path / f"run.{kind}") for kind in ("csv", "mcap", "html")}
    line = ["--html", paths["html"], "--record", paths["mcap"], "--csv", paths["csv"]]
    assert recorded(world, line) == [Recorder, Recorder, Recorder]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run.csv", "run.html", "run.mcap"]


def test_where_nothing_happened_there_is_no_recording_and_no_replay(
    world: World, tmp_path: Path
) -> None:
    line = ["--record", str(tmp_path / "run.bag"), "--html", str(tmp_path / "run.html")]
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
