from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from inspect import signature
from pathlib import Path

import pytest

from baxter_kin.command_line import parse
from baxter_kin.kinematics.limits import PRESETS
from planner import PickAndPlace
from planner.atlas.questions.table_task import TableTransfer
from planner.pick_place.task import DEFAULT_CLEAR_M, DEFAULT_HOVER_M
from sim import Transfer, simulation
from sim.demo import options as demo_options
from sim.demo.options import DEFAULT_POSES_M, DEFAULT_RETRIES, DemoOptions


def parse_options(line: Sequence[str]) -> DemoOptions:
    return parse(DemoOptions, line)


def test_default_is_the_original_demo() -> None:
    options = parse_options([])
    assert options.limb == "left"
    assert options.hover_m == DEFAULT_HOVER_M
    assert options.poses_m == DEFAULT_POSES_M == ((0.70, 0.15, -0.129), (0.75, 0.00, -0.129))
    assert options.cycles == 2
    assert options.speed_ratio == 1.0
    assert not options.is_headless
    assert options.retries is None


def test_the_hover_distance_is_the_same_for_whoever_does_not_give_one(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert demo_options.DEFAULT_HOVER_M == DEFAULT_HOVER_M
    with pytest.raises(SystemExit):
        parse_options(["--help"])
    assert f"sideways above {100.0 * DEFAULT_CLEAR_M:g} cm" in " ".join(
        capsys.readouterr().out.split()
    )
    for maker in (PickAndPlace, Transfer, TableTransfer, TableTransfer.from_above):
        defaults = {name: p.default for name, p in signature(maker).parameters.items()}
        assert defaults["hover_m"] == DEFAULT_HOVER_M
        assert defaults["clear_m"] == DEFAULT_CLEAR_M


def test_a_dwell_is_that_of_a_robot_unless_it_is_said(tmp_path: Path) -> None:
    csv = ["--csv", str(tmp_path / "x.csv")]
    found = [parse_options([*csv, *more]).dwell_s for more in ([], ["--dwell"], ["--dwell", "0"])]
    assert found == [None, 1.0, 0.0]


def test_poses_are_mirrored_for_the_right_arm_and_added_ones_add_cycles() -> None:
    assert parse_options(["--limb", "right"]).poses_m[0] == (0.70, -0.15, -0.129)
    options = parse_options(
        ["--add-pose", "0.72", "0.075", "-0.129", "--add-pose", "0.7", "0", "-.13"]
    )
    assert options.poses_m[2:] == ((0.72, 0.075, -0.129), (0.7, 0.0, -0.13))
    assert options.cycles == 4
    assert parse_options(["--forever"]).cycles is None


def test_noise_asks_for_retries_by_itself() -> None:
    assert parse_options(["--noise-mm", "1"]).retries == DEFAULT_RETRIES
    assert parse_options(["--noise-deg", "1", "--retries", "0"]).retries == 0
    assert parse_options(["--retries", "2"]).retries == 2


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("--limb up", "--limb: invalid choice: 'up'"),
        ("--hover 0", "--hover: 0 is not above zero"),
        ("--both-arms --limb right --cycles 2", "goes without --limb right, --cycles"),
        ("--both-arms --noise-mm 1", "goes without --retries or noise"),
        ("--hover nan", "--hover: 'nan' is not a finite number"),
        ("--speed 1.5", "--speed: 1.5 is not from 0.001 to 1"),
        ("--speed 0", "--speed: 0 is not from 0.001 to 1"),
        ("--cycles 0", "--cycles: 0 is not at least 1"),
        ("--cycles two", "--cycles: 'two' is not a whole number"),
        ("--add-pose 1 2", "--add-pose: expected 3 arguments"),
        ("--add-pose 1 2 inf", "--add-pose: 'inf' is not a finite number"),
        ("--add-pose 1 2 here", "--add-pose: 'here' is not a number"),
        ("--forever --cycles 3", "exclude each other"),
        ("--csv /no/such/folder/x.csv", "the folder of /no/such/folder/x.csv does not exist"),
        ("--html /", "cannot write /: it is a folder, not a regular file"),
        ("--html /dev/null", "cannot write /dev/null: it is a device, not a regular file"),
        (f"--html {'a' * 300}", f"cannot write {'a' * 200}...: File name too long"),
        ("--dwell 1", "--dwell is for the file of --csv; give both"),
        ("--csv x --dwell -1", "-1"),
        ("--csv x --dwell 61", "--dwell: 61 is not from 0 to 60 s"),
        ("--csv x --dwell --retries 1", "leave noise and --retries out"),
        ("--csv x --dwell --noise-mm 1", "leave noise and --retries out"),
        ("--limits fast", "--limits: invalid choice: 'fast'"),
        ("--csv x --report x", "must go to different files"),
        ("--csv x.csv --record x.csv", "must go to different files"),
        ("--record run.txt", "--record: run.txt must end in one of .bag, .csv, .mcap"),
        ("--record run.bag --forever", "with --forever use .mcap"),
        ("--add-pose 1e308 0 0", "--add-pose: 1e308 is not from -10 to 10 m"),
        (
            "--add-pose 700 150 -129",
            "--add-pose: 700 is not from -10 to 10 m; are these mil",
        ),
        ("--hover 150", "are these millimetres? Lengths are in metres: 150 mm is 0.15 m"),
        ("--margin 12", "are these millimetres? Lengths are in metres: 12 mm is 0.012 m"),
        ("-v -q", "not allowed with"),
        ("--obstacle 0 0 0 1 1", "--obstacle: expected 6 arguments"),
        ("--obstacle 0 0 0 1 1 0", "the size of an obstacle must be above zero"),
        ("--obstacle 0 0 0 1 1 nan", "'nan' is not a finite number"),
        ("--line-tolerance 0 1", "--line-tolerance: 0 is not from 0.001 to 100 mm or deg"),
        ("--line-tolerance 1", "--line-tolerance: expected 2 arguments"),
        ("--margin -0.01", "--margin: -0.01 is not from 0 to 10 m"),
        ("--noise-mm -1", "--noise-mm: -1 is not from 0 to 1000 mm"),
        ("--noise-deg 181", "--noise-deg: 181 is not from 0 to 180 deg"),
        ("--retries -1", "--retries: -1 is not at least 0"),
        ("--seed 0.5", "--seed: '0.5' is not a whole number"),
        ("--plan /no/such/folder/x", "the folder of /no/such/folder/x does not exist"),
        ("--gazebo", "unrecognized arguments: --gazebo"),
    ],
)
def test_wrong_usage_is_one_sentence_and_status_2(
    line: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stopped:
        parse_options(line.split())
    said = capsys.readouterr().err
    assert stopped.value.code == 2
    assert words in said
    assert said.count("\n") == 1


def test_outputs_may_go_to_new_files_of_any_known_format(tmp_path: Path) -> None:
    for option, name in (("record", "x.bag"), ("record", "x.mcap"), ("csv", "x.csv")):
        path = tmp_path / name
        assert getattr(parse_options([f"--{option}", str(path)]), option) == path


@pytest.mark.parametrize("option", ["--html", "--csv", "--record", "--report", "--plan"])
def test_links_that_form_a_loop_are_no_output(
    tmp_path: Path, option: str, capsys: pytest.CaptureFixture[str]
) -> None:
    loop = tmp_path / "loop.mcap"
    loop.symlink_to(loop)
    with pytest.raises(SystemExit) as stopped:
        parse_options([option, str(loop)])
    said = capsys.readouterr().err
    assert stopped.value.code == 2
    assert f"{option}: cannot write {loop}: its symbolic links form a loop" in said
    assert said.count("\n") == 1


@pytest.mark.parametrize("link", [os.symlink, os.link])
def test_two_names_of_one_file_are_one_output(
    tmp_path: Path, link: Callable[[Path, Path], None], capsys: pytest.CaptureFixture[str]
) -> None:
    file, other = tmp_path / "x.csv", tmp_path / "x.json"
    file.write_text("kept")
    link(file, other)
    with pytest.raises(SystemExit) as stopped:
        parse_options(["--csv", str(file), "--report", str(other)])
    assert stopped.value.code == 2
    assert "must go to different files" in capsys.readouterr().err
    assert file.read_text() == "kept"


def test_values_that_are_repeated_are_the_same() -> None:
    assert demo_options.LIMITS == PRESETS
    dwells = demo_options.ROBOT_DWELL_S, demo_options.MAX_DWELL_S
    assert dwells == (simulation.ROBOT_DWELL_S, simulation.MAX_DWELL_S)
