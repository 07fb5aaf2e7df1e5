"""`plot`, through a parser of its own."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from baxter_kin.command_line import UsageError, parse
from planner.atlas import ReachMap
from planner.atlas.commands.plot import Plot
from planner.errors import AtlasError

pytest.importorskip("matplotlib", exc_type=ImportError)


def run(*arguments: str) -> int:
    return parse(Plot, arguments).run()


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
    assert f"{path.stat().st_size / 1e6:.1f} MB" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("", "say what to write: --out FILE for a figure, --html FILE for a page"),
        ("--out a.svg --show profile --height 1", "a profile is of all heights"),
        ("--out a.svg --show margin --compare x", "--compare is of shares"),
        ("--html a.html --height 0.1", "--height is of a figure; say where to write one by --out"),
        ("--html a.html --show margin", "--show is of a figure; say where to write one by --out"),
        ("--out reach.gif", "reach.gif must end in one of .svg, .pdf, .png"),
    ],
)
def test_options_that_contradict_each_other_are_refused_in_one_sentence(
    options: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        parse(Plot, ["map.zarr", *options.split()])
    assert ended.value.code == 2
    text = capsys.readouterr().err
    assert words in text
    assert text.count("\n") == 1


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("--height 5", "a height of 5 m lies outside of the map"),
        ("--arm mid", "unknown arm of this map 'mid'; use one of: left, right"),
        ("--pointing 0 0 0", "the direction (0, 0, 0) points nowhere"),
    ],
)
def test_what_the_map_does_not_have_is_wrong_usage(
    small_map: ReachMap, tmp_path: Path, options: str, words: str
) -> None:
    with pytest.raises(UsageError) as refused:
        run(str(small_map.path), "--out", str(tmp_path / "a.svg"), *options.split())
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)
    assert list(tmp_path.iterdir()) == []


def test_a_map_to_compare_with_that_is_not_there_is_told(
    small_map: ReachMap, tmp_path: Path
) -> None:
    with pytest.raises(AtlasError, match="there is no map at nowhere"):
        run(str(small_map.path), "--out", str(tmp_path / "a.svg"), "--compare", "nowhere")
