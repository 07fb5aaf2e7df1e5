"""`python -m planner.atlas`: what it builds, tells and refuses, in one sentence each."""

from __future__ import annotations

import json
import os
import resource
import shlex
import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from baxter_kin import engine_options
from baxter_kin.parallel import Serial
from planner.atlas import ReachMap
from planner.atlas.commands import build
from planner.atlas.commands.command_line import SUBCOMMANDS, main
from planner.atlas.reach_map import ARRAYS
from planner.errors import AtlasError
from tests.planner.atlas.test_building import digests

GRID = ["--step-m", "0.1", "--box", "0.5", "0", "0", "0.8", "0.9", "0.2", "--hopf", "0"]
"""As the small map of these tests."""

ONE = ["--step-m", "0.1", "--box", *["0.6", "0.3", "0.1"] * 2, "--hopf", "0", "-q"]
"""One position, in silence."""

NEEDED = {
    "build": [],
    "info": [],
    "verify": [],
    "query": ["pose", "0.7", "0.2", "0.1", "0", "1", "0", "0"],
    "plot": ["--out", "none.svg"],
    "redundancy": ["none.zarr"],
}
"""What each command takes beside the map."""

QUICK = ["--measure-s", "0.001"]


@pytest.fixture(autouse=True)
def no_pool(monkeypatch: pytest.MonkeyPatch) -> None:
    """Processes take long to start, and have tests of their own."""
    monkeypatch.setattr(engine_options, "LocalPool", lambda _: Serial())


@pytest.fixture
def own(small_map: ReachMap, tmp_path: Path) -> str:
    """A copy of the small map that may be changed."""
    return str(shutil.copytree(small_map.path, tmp_path / "own.zarr"))


def damage(path: str, name: str = "margins/c/0/0/0/0/0") -> None:
    file = Path(path, name)
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 4
    file.write_bytes(content)


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
    assert main(["verify", path, "--cells", "60", "--json", report]) == 0
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

    monkeypatch.setattr(engine_options, "LocalPool", lambda _: Interrupted())
    path = str(tmp_path / "stopped.zarr")
    said = refusal(["build", path, *GRID, *QUICK], capsys, 130)
    assert "stopped by Ctrl-C; 1 of 4 blocks are stored and stay; the same command goes on" in said
    assert len(ReachMap(path).missing_blocks()) == 3


@pytest.mark.parametrize(("answer", "status"), [("y", 0), ("n", 1), ("", 1)])
def test_large_maps_are_asked_about(
    answer: str, status: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(build, "LARGE_CORE_S", 0.0)
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    asked: list[str] = []

    def ask(text: str) -> str:
        asked.append(text)
        return answer

    monkeypatch.setattr("builtins.input", ask)
    path = tmp_path / "asked.zarr"
    assert main(["build", str(path), *ONE, *QUICK]) == status
    assert asked[0].startswith("this takes ")
    assert asked[0].endswith("free on disk; build it? [y/N] ")
    assert path.exists() == (status == 0)


def test_large_maps_need_a_yes_where_nobody_can_be_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(build, "LARGE_BYTES", 0.0)
    monkeypatch.setattr("sys.stdin.isatty", lambda: False, raising=False)
    path = tmp_path / "asked.zarr"
    command = ["build", str(path), *ONE, *QUICK]
    assert "give --yes to build it without being asked" in refusal(command, capsys, 2)
    assert not path.exists()
    assert main([*command, "--yes"]) == 0


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


def test_a_build_begins_anew_where_the_making_of_its_map_was_killed(
    small_map: ReachMap, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The group, which makes a map of the arrays, is written last."""
    path = tmp_path / "own.zarr"
    assert {array.name for array in small_map.path.iterdir() if array.is_dir()} == {*ARRAYS}
    for name in ARRAYS:
        shutil.copytree(small_map.path / name, path / name, ignore=lambda *_: {"c"})
    assert main(["build", str(path), *ONE, *QUICK]) == 0
    assert not capsys.readouterr().err
    assert not ReachMap(path).missing_blocks()


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


def test_a_full_disk_is_told_and_the_build_goes_on_later(
    tmp_path: Path, small_map: ReachMap, capsys: pytest.CaptureFixture[str]
) -> None:
    """A limit on the size of files stands for the disk: what is beyond it cannot be written."""
    path, (soft, hard) = str(tmp_path / "full.zarr"), resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (30_000, hard))
    try:
        status = main(["build", path, *GRID, *QUICK, "-q"])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    said = capsys.readouterr().err
    assert status == 1
    assert said.count("\n") == 1
    assert "full.zarr cannot be read or written: File too large" in said
    assert main(["build", path, *QUICK]) == 0
    assert digests(Path(path)) == digests(small_map.path)


def test_a_map_of_another_version_is_told(
    own: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    file = Path(own, "zarr.json")
    file.write_text(file.read_text().replace('"version": 1', '"version": 7'))
    assert list(NEEDED) == list(SUBCOMMANDS)
    calls = [[command, own, *more] for command, more in NEEDED.items()]
    for call in calls:
        assert "is of version 7, this toolkit reads 1" in refusal(call, capsys, 1)
    file.write_text("{")
    for call in calls:
        assert "is damaged" in refusal(call, capsys, 1)


def test_damaged_blocks_are_told_discarded_and_computed_again(
    own: str, small_map: ReachMap, capsys: pytest.CaptureFixture[str]
) -> None:
    damage(own)
    assert "1 block cannot be read, such as: block (0, 0, 0, 0)" in refusal(
        ["info", own, "-q"], capsys, 1
    )
    verify = ["verify", own, "--cells", "10", "-q"]
    assert "forget them by --discard-damaged" in refusal(verify, capsys, 1)
    said = refusal([*verify, "--discard-damaged"], capsys, 1)
    assert "they are forgotten now, and build computes them again" in said
    assert main(["build", own, "-q", *QUICK]) == 0
    assert digests(Path(own)) == digests(small_map.path)


def test_witnesses_that_are_missing_are_told(own: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path(own, "witnesses/c/0/0/0/0/0/0").unlink()
    said = refusal(["verify", own, "--cells", "10", "-q"], capsys, 1)
    assert "block (0, 0, 0, 0) of the map" in said
    assert "its witnesses are missing" in said
    found = ReachMap(own)
    x, y, z, rotation = map(int, np.argwhere(found.margins("left")[:, :8] >= 0)[0])
    with pytest.raises(AtlasError, match=r"the witnesses around \(.*\) are missing"):
        found.cell("left", (x, y, z), rotation)


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
