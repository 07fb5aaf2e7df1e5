"""`python -m planner.atlas`: maps that it builds, describes and checks, and what it refuses."""

from __future__ import annotations

import json
import os
import shlex
import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from baxter_kin import engine_options
from baxter_kin.command_line import UsageError, parse
from baxter_kin.parallel import Serial
from planner.atlas import ReachMap, RotationGrid
from planner.atlas.block_map import is_map
from planner.atlas.commands.command_line import SUBCOMMANDS, main
from planner.atlas.commands.maps import Redundancy, read_rotations
from planner.atlas.redundancy import RedundancyMap, Subset
from planner.errors import AtlasError
from tests.planner.atlas.maps import change_attributes, damage, digests, small_files

GRID = ["--step-m", "0.1", "--box", "0.5", "0", "0", "0.8", "0.9", "0.2", "--hopf", "0"]
"""As the small map of these tests."""

ONE = ["--step-m", "0.1", "--box", *["0.6", "0.3", "0.1"] * 2, "--hopf", "0", "-q"]
"""One position, in silence."""

HERE = ["--jobs", "1"]
"""In this process: others take long to start, and have tests of their own."""

QUICK = ["--measure-s", "0.001", *HERE]

LARGE = ["--step-m", "0.015", *QUICK, "-q"]
"""A map that takes days."""

NEEDED = {
    "build": [],
    "info": [],
    "verify": [],
    "query": ["pose", "0.7", "0.2", "0.1", "0", "1", "0", "0"],
    "plot": ["--out", "none.svg"],
    "redundancy": ["none.zarr"],
}
"""What each command takes beside the map."""


@pytest.fixture
def own(small_map: ReachMap, tmp_path: Path) -> str:
    """A copy of the small map that may be changed."""
    return str(shutil.copytree(small_map.path, tmp_path / "own.zarr"))


def refusal(argv: Sequence[str], capsys: pytest.CaptureFixture[str], status: int) -> str:
    """What is said on stderr, which is one sentence."""
    try:
        ended = main(argv)
    except SystemExit as cause:
        ended = int(cause.code or 0)
    assert ended == status
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    return said


@pytest.mark.slow
def test_a_map_is_built_told_and_verified(
    small_map: ReachMap, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, report = str(tmp_path / "new.zarr"), str(tmp_path / "report.json")
    assert main(["build", path, *GRID, *QUICK, "--json", report]) == 0
    said = capsys.readouterr().out
    assert "17,280 cells are to be computed: " in said
    assert "of one core" in said
    assert "cells a second and core\nreachable 5,654 (32.720%), proven unreachable" in said
    assert digests(Path(path)) == digests(small_map.path)
    built = json.loads(Path(report).read_text())
    assert built["computed"]["cells"] == built["cells"] == len(small_map)
    assert main(["info", path, "--json", report]) == 0
    said = capsys.readouterr().out
    assert "the stock Baxter, digest" in said
    assert "4 x 10 x 3, 100 mm apart, (0.5, 0, 0) to (0.8, 0.9, 0.2) m in base" in said
    assert said.endswith("missing    nothing\n")
    arms = json.loads(Path(report).read_text())["arms"]
    assert sum(arm["reachable"] for arm in arms) == built["computed"]["reachable"]
    assert main(["verify", path, "--cells", "60", "--json", report, *HERE]) == 0
    said = capsys.readouterr().out
    assert "witnesses, 0 of them wrong" in said
    assert "power: the solver reaches, of the poses that have a witness, 100.000%" in said
    assert said.endswith("no block is missing\nnothing is wrong\n")
    assert json.loads(Path(report).read_text())["is_valid"] is True


def test_a_build_goes_on_with_what_is_missing_of_the_map_that_is_there(
    own: str, small_map: ReachMap, capsys: pytest.CaptureFixture[str]
) -> None:
    found = ReachMap(own)
    found.discard_block(found.blocks[2])
    assert main(["info", own]) == 0
    assert "missing    1 block; build goes on" in capsys.readouterr().out
    assert main(["build", own, *QUICK]) == 0
    assert "a map is there: 3 (75.000%) of 4 blocks are stored and stay" in capsys.readouterr().out
    assert digests(Path(own)) == digests(small_map.path)
    assert main(["build", own, *GRID, *QUICK]) == 0
    assert "\nnothing is missing\nnothing was computed; the map takes" in capsys.readouterr().out


def test_ctrl_c_keeps_what_is_stored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Interrupted(Serial):
        def run(self, task: Callable[..., Any], items: Sequence[Any]) -> Iterator[Any]:
            yield next(super().run(task, items))
            raise KeyboardInterrupt

    monkeypatch.setattr(engine_options, "Serial", Interrupted)
    path = str(tmp_path / "stopped.zarr")
    said = refusal(["build", path, *GRID, *QUICK], capsys, 130)
    assert "stopped by Ctrl-C; 1 of 4 blocks are stored and stay; the same command goes on" in said
    assert len(ReachMap(path).missing_blocks()) == 3


@pytest.mark.parametrize(
    ("answer", "said"), [("y", "File too large"), ("n", "not built"), ("", "not built")]
)
def test_large_maps_are_asked_about(
    answer: str,
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """A limit on the size of files ends the build that is wanted."""
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    asked: list[str] = []

    def ask(text: str) -> str:
        asked.append(text)
        return answer

    monkeypatch.setattr("builtins.input", ask)
    with small_files(2000):
        assert said in refusal(["build", str(tmp_path / "asked.zarr"), *LARGE], capsys, 1)
    assert asked[0].startswith("this takes ")
    assert asked[0].endswith("free on disk; build it? [y/N] ")
    assert not is_map(tmp_path / "asked.zarr")


def test_large_maps_need_a_yes_where_nobody_can_be_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin.isatty", lambda: False, raising=False)
    command = ["build", str(tmp_path / "asked.zarr"), *LARGE]
    assert "give --yes to build it without being asked" in refusal(command, capsys, 2)
    assert not list(tmp_path.iterdir())
    with small_files(2000):
        assert "File too large" in refusal([*command, "--yes"], capsys, 1)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--step-m", "25"], "are these millimetres? Lengths are in metres: 25 mm is 0.025 m"),
        (["--step-m", "0"], "0 is not from 0.0001 to 2 m"),
        (["--box", *"110000"], "no point of a grid of 0.025 m lies between"),
        (["--step-m", "0.0025"], "the map would have 1.24e+12 cells, and at most 1e+10"),
        (["--step-m", "0.0025"], "or raise --most-cells"),
        (["--step-m", "0.00011"], "points along each side must be a whole number from 1"),
        (["--hopf", "5"], "level must be a whole number from 0 to 4"),
        (["--hopf", "0", "--rotations", "r.csv"], "not allowed with argument --hopf"),
        (["--rotations", "no.csv"], "cannot read no.csv: No such file"),
        (["--jobs", "0"], "0 is not from 1 to 1024"),
        (["--most-cells", "some"], "'some' is not a number"),
        (["--most-cells", "0.5"], "0.5 is not a whole number from 1 to 1e18"),
        (["--jobs", "1", "--local-cluster", "1"], "not allowed with argument --jobs"),
        (["--arms", "left"], "did you mean --arm?"),
    ],
)
def test_wrong_usage_ends_with_2_before_anything_is_made(
    options: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "none.zarr"
    assert said in refusal(["build", str(path), *options], capsys, 2)
    assert not path.exists()


@pytest.mark.parametrize(
    "line",
    [
        "verify MAP --cells 10000001",
        "query MAP pose 0.7 0.2 0.1 0 0 0 0",
        "query MAP where --tasks task.json --wanted 100001",
        "plot MAP",
        "plot MAP --out a.svg --show profile --height 0",
        "plot MAP --out a.svg --arm middle",
        "redundancy MAP new.zarr --z 1 2 3",
        "redundancy MAP new.zarr --rotations 99",
    ],
)
def test_wrong_usage_of_a_map_that_is_there_ends_with_2(
    line: str,
    small_map: ReachMap,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    refusal(line.replace("MAP", str(small_map.path)).split(), capsys, 2)
    assert not list(tmp_path.iterdir())


def test_what_is_at_the_path_already_stays_as_it_is(
    own: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, folder = tmp_path / "notes.txt", tmp_path / "folder"
    file.write_text("mine")
    folder.mkdir()
    (folder / "more.txt").write_text("mine, too")
    before = digests(tmp_path)
    for path, options, said in (
        (str(file), [], "notes.txt exists and is no map; choose another path"),
        (str(folder), [], "folder exists and is no map; choose another path"),
        (str(file / "new.zarr"), [], "notes.txt is no folder"),
        (own, ["--step-m", "0.2"], "is of another grid of positions; nothing was changed"),
        (own, ["--hopf", "1"], "is of another set of rotations; nothing was changed"),
        (own, ["--arm", "left"], "is of another choice of arms; nothing was changed"),
        (own, ["--left-hand", "none"], "is of another robot; nothing was changed"),
    ):
        assert said in refusal(["build", path, *options], capsys, 1)
    for command in ("info", "verify"):
        for other in (file, folder, tmp_path / "nothing"):
            assert "there is no map at" in refusal([command, str(other)], capsys, 1)
    assert digests(tmp_path) == before


def test_folders_without_permission_are_told(
    own: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ReachMap(own).discard_block((0, 0, 0, 0))
    monkeypatch.setattr(os, "access", lambda *_: False)
    said = refusal(["build", str(tmp_path / "new.zarr"), *GRID], capsys, 1)
    assert "new.zarr cannot be read or written: Permission denied" in said
    said = refusal(["build", own], capsys, 1)
    assert "own.zarr cannot be read or written: Permission denied" in said
    assert main(["info", own, "-q"]) == 0


@pytest.mark.slow
def test_a_full_disk_is_told_and_the_build_goes_on_later(
    tmp_path: Path, small_map: ReachMap, capsys: pytest.CaptureFixture[str]
) -> None:
    path = str(tmp_path / "full.zarr")
    with small_files(30_000):
        said = refusal(["build", path, *GRID, *QUICK, "-q"], capsys, 1)
    assert "full.zarr cannot be read or written: File too large" in said
    assert main(["build", path, *QUICK]) == 0
    assert digests(Path(path)) == digests(small_map.path)


def test_a_map_of_another_version_is_told(
    own: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    change_attributes(Path(own), version=7)
    assert list(NEEDED) == list(SUBCOMMANDS)
    calls = [[command, own, *more] for command, more in NEEDED.items()]
    for call in calls:
        assert "is of version 7, this toolkit reads 1" in refusal(call, capsys, 1)
    Path(own, "zarr.json").write_text("{")
    for call in calls:
        assert "is damaged" in refusal(call, capsys, 1)


def test_damaged_blocks_are_told_discarded_and_computed_again(
    own: str, small_map: ReachMap, capsys: pytest.CaptureFixture[str]
) -> None:
    damage(Path(own, "margins/c/0/0/0/0/0"))
    assert "1 block cannot be read, such as: block (0, 0, 0, 0)" in refusal(
        ["info", own, "-q"], capsys, 1
    )
    verify = ["verify", own, "--cells", "10", "-q", *HERE]
    assert "forget them by --discard-damaged" in refusal(verify, capsys, 1)
    said = refusal([*verify, "--discard-damaged"], capsys, 1)
    assert "they are forgotten now, and build computes them again" in said
    assert main(["build", own, "-q", *QUICK]) == 0
    assert digests(Path(own)) == digests(small_map.path)


def test_a_scheduler_that_does_not_answer_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("distributed", reason="Dask needs Python 3.11")
    path = str(tmp_path / "new.zarr")
    command = ["build", path, *GRID, "--scheduler", "nonsense://127.0.0.1:1"]
    assert "no scheduler answers at 'nonsense://127.0.0.1:1'" in refusal(command, capsys, 1)


@pytest.mark.parametrize("name", SUBCOMMANDS)
def test_every_command_has_help_with_examples_that_parse(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main([name, "--help"])
    assert ended.value.code == 0
    text = capsys.readouterr().out
    assert max(map(len, text.splitlines())) <= 100
    assert "Exit status" in " ".join(text.split())
    lines = [line.strip() for line in text.splitlines() if line.startswith("  python")]
    assert len(lines) >= 2
    ran: list[object] = []

    def run(options: object) -> int:
        ran.append(type(options))
        return 0

    monkeypatch.setattr(SUBCOMMANDS[name], "run", run)
    for line in lines:
        assert main(shlex.split(line)[3:]) == 0
    assert ran == [SUBCOMMANDS[name]] * len(lines)


# redundancy --------------------------------------------------------------------------------------


def redundancy(*arguments: object) -> int:
    return parse(Redundancy, [*map(str, arguments), *HERE]).run()


CHOICE = ("--arm", "left", "--x", "0.7", "--y", "0.2", "0.4", "--z", "0.1", "--rotations", 0, 2)


def test_a_map_is_built_and_checked(
    small_map: ReachMap, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "freedom.zarr"
    assert redundancy(small_map.path, path, *CHOICE, "--measure-s", 0.1, "--check", 1) == 0
    told = capsys.readouterr().out
    assert told.startswith("missing: Cost(6 cells, ")
    assert "complete: RedundancyMap(left, 1 x 3 x 1 points, 2 rotations)" in told
    assert "RedundancyCheck(1 cells, 0 wrong, 0 missed pieces" in told
    found = RedundancyMap(path)
    assert found.subset == Subset(("left",), (2,), (2, 3, 4), (1,), (0, 2))
    assert not found.missing_blocks()
    found.write_rows((0, 0, 0, 0), (np.full((3, 6, 2), 5, np.int32),))
    assert redundancy(small_map.path, path, *CHOICE, "-q", "--check", 1) == 1
    complaint = capsys.readouterr()
    assert not complaint.out
    assert complaint.err.startswith("wrong: CellCheck(name='left, position (2, ")


def test_the_cost_is_told_and_nothing_computed(
    small_map: ReachMap, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "none.zarr"
    assert redundancy(small_map.path, path, *CHOICE, "--cost", "-q", "--measure-s", 0.1) == 0
    assert "6 cells" in capsys.readouterr().out
    assert not path.exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["a", "b", "--every", "0"], "0 is not at least 1"),
        (["a", "b", "--rotations", "1", "--tool-axis", "0", "0", "1"], "not allowed with"),
        (["a", "b", "--cost", "--check", "1"], "not allowed with argument --cost"),
        (["a"], "MAP"),
        (["a", "b", "--z", "1", "2", "3"], "--z takes one coordinate or two, got 3"),
    ],
)
def test_wrong_usage_gets_one_sentence(
    arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        parse(Redundancy, arguments)
    assert ended.value.code == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--z 9", "no point of the map lies within z_m = 9"),
        ("--rotations 72", "rotations must be a whole number from 0 to 71, got 72"),
        ("--tool-axis 0 0 0", "tool_axis must be a direction"),
        ("--every 1000001", "every must be a whole number from 1 to 1000000"),
        ("--most-cells 100", "at most 100 are allowed; .* or raise --most-cells"),
    ],
)
def test_poses_that_the_reach_map_does_not_have_are_wrong_usage(
    options: str, said: str, small_map: ReachMap, tmp_path: Path
) -> None:
    with pytest.raises(UsageError, match=said):
        redundancy(small_map.path, tmp_path / "none", *options.split())
    assert not (tmp_path / "none").exists()


# Files of rotations ------------------------------------------------------------------------------

QUATS = RotationGrid.hopf(0).quats_xyzw


@pytest.mark.parametrize("header", ["", "x,y,z,w\n", "# x, y, z, w\n\n"])
@pytest.mark.parametrize("between", [",", " ", "\t", ", "])
def test_text_reads_as_it_was_written(header: str, between: str, tmp_path: Path) -> None:
    file = tmp_path / "rotations.csv"
    lines = (between.join(map(repr, quat)) for quat in QUATS.tolist())
    file.write_text(header + "".join(f"{line}  # a remark\n" for line in lines))
    read = read_rotations(file)
    assert np.abs(read.matrices - RotationGrid.hopf(0).matrices).max() < 1e-12


def test_arrays_read_as_they_were_written(tmp_path: Path) -> None:
    np.save(tmp_path / "rotations.npy", QUATS * 1.0005)
    read = read_rotations(tmp_path / "rotations.npy")
    assert np.abs(read.matrices - RotationGrid.hopf(0).matrices).max() < 1e-12


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "has no rotation; write x, y, z, w on each line"),
        (b"x y z w\n# nothing\n", "has no rotation"),
        (b"0 0 0 1\n0 0 1\n", "is damaged: line 2 must be x, y, z, w, got '0 0 1'"),
        (b"0 0 0 one\n", "is damaged: line 1 must be x, y, z, w"),
        (b"0 0 0 1\n0 0 0 nan\n", "quaternion 2 of .* is nan long"),
        (b"0 0 0 2\n", "quaternion 1 of .* is 2 long, and must be 1 within 0.001"),
        (b"\xff\xfe\x00", "is damaged: 'utf-8' codec"),
        (b"\x93NUMPY...", "is damaged: "),
    ],
)
def test_what_is_no_list_of_rotations_is_refused(content: bytes, said: str, tmp_path: Path) -> None:
    file = tmp_path / "rotations"
    file.write_bytes(content)
    with pytest.raises(AtlasError, match=said):
        read_rotations(file)


def test_arrays_of_other_shapes_and_objects_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "rotations.npy"
    np.save(file, np.zeros((4, 3)))
    with pytest.raises(AtlasError, match=r"must hold an array \(n, 4\).* has float64 \(4, 3\)"):
        read_rotations(file)
    np.save(file, np.array([[{}]], dtype=object), allow_pickle=True)
    with pytest.raises(AtlasError, match="is damaged"):
        read_rotations(file)


def test_files_that_are_not_there_and_folders_are_refused(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "none.csv"):
        with pytest.raises(AtlasError, match="cannot read"):
            read_rotations(path)
