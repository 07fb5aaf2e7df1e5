"""`plot`, through a parser of its own."""

from __future__ import annotations

import shlex
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from baxter_kin.command_line import OneSentenceParser
from planner.atlas import ReachMap
from planner.atlas.commands import plot
from planner.atlas.commands.exit_status import UsageError
from planner.errors import AtlasError

pytest.importorskip("matplotlib", exc_type=ImportError)


def run(*arguments: str) -> int:
    parser = OneSentenceParser(prog="plot")
    plot.add_arguments(parser)
    return plot.run(parser.parse_args(arguments))


@pytest.mark.parametrize(
    "options", ["--height 0 0.2 --arm left", "--show margin --pointing 0 0 -1", "--show profile"]
)
def test_figures_are_written_and_the_same_each_time(
    small_map: ReachMap, tmp_path: Path, options: str
) -> None:
    files = [tmp_path / "one.svg", tmp_path / "other.svg"]
    for file in files:
        assert run(str(small_map.path), "--out", str(file), *options.split()) == 0
    assert files[0].read_bytes() == files[1].read_bytes()
    assert ET.parse(files[0]).getroot().tag.endswith("svg")


@pytest.mark.parametrize(("suffix", "magic"), [("pdf", b"%PDF"), ("png", b"\x89PNG")])
def test_the_suffix_says_what_is_written(
    small_map: ReachMap, tmp_path: Path, suffix: str, magic: bytes
) -> None:
    path = tmp_path / f"reach.{suffix}"
    map_path = str(small_map.path)
    assert run(map_path, "--out", str(path), "--compare", map_path) == 0
    assert path.read_bytes().startswith(magic)


def test_a_page_is_written_by_what_knows_viewers(
    small_map: ReachMap, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "reach.html"
    assert run(str(small_map.path), "--html", str(path)) == 0
    assert path.read_text().startswith("<!DOCTYPE html>")
    assert "2." in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("", "say what to write: --out FILE for a figure, --html FILE for a page"),
        ("--out a.svg --height 5", "a height of 5 m lies outside of the map"),
        ("--out a.svg --arm mid", "unknown arm of this map 'mid'; use one of: left, right"),
        ("--out a.svg --show profile --height 1", "a profile is of all heights"),
        ("--out a.svg --show margin --compare x", "--compare is of shares"),
        ("--out a.svg --pointing 0 0 0", "the direction (0, 0, 0) points nowhere"),
        ("--html a.html --height 0.1", "--height is of a figure; say where to write one by --out"),
        ("--html a.html --show margin", "--show is of a figure; say where to write one by --out"),
    ],
)
def test_what_makes_no_sense_is_answered_in_one_sentence(
    small_map: ReachMap,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    options: str,
    words: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError) as refused:
        run(str(small_map.path), *options.split())
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)
    assert list(tmp_path.iterdir()) == []


def test_a_map_to_compare_with_that_is_not_there_is_told(
    small_map: ReachMap, tmp_path: Path
) -> None:
    with pytest.raises(AtlasError, match="there is no map at nowhere"):
        run(str(small_map.path), "--out", str(tmp_path / "a.svg"), "--compare", "nowhere")


def test_another_kind_of_file_is_refused(
    small_map: ReachMap, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        run(str(small_map.path), "--out", "reach.gif")
    assert "reach.gif ends in none of .svg, .pdf, .png" in capsys.readouterr().err


def test_examples_parse(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    parser = OneSentenceParser(prog="plot")
    plot.add_arguments(parser)
    lines = [line for line in plot.EXAMPLES.splitlines() if line.startswith("  ")]
    assert len(lines) >= 2
    for line in lines:
        assert shlex.split(line)[:4] == ["python", "-m", "planner.atlas", "plot"]
        parser.parse_args(shlex.split(line)[4:])
