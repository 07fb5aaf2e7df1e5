"""`query` and `plot`: what a map says, in sentences and in JSON, and pictures of it."""

from __future__ import annotations

import json
import shlex
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.command_line import UsageError, parse
from planner.atlas import ReachMap
from planner.atlas.checking.pose_finder import PoseFinder
from planner.atlas.commands.questions import EXAMPLES, Plot, PoseQuestion, Query
from planner.errors import AtlasError

NEAR = "0.7 0.2 0.03 0 1 0 0"
FAR = "0.7 0.9 0.9 0 1 0 0"


def parsed(line: str) -> Query:
    return parse(Query, shlex.split(line))


def answer(
    line: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> tuple[int, str, dict[str, Any]]:
    """Status, what was printed, and what was written."""
    file = folder / "answer.json"
    status = parsed(f"{line} --json {file}").run()
    return status, capsys.readouterr().out, json.loads(file.read_text())


def test_a_pose_is_answered_for_each_arm(
    small_map: ReachMap, tmp_path: Path, robot: Baxter, capsys: pytest.CaptureFixture[str]
) -> None:
    status, said, data = answer(f"{small_map.path} pose {NEAR}", tmp_path, capsys)
    assert status == 0
    assert said.count("\n") == 2
    assert "the left arm reaches it, " in said
    assert "the map's nearest cell, " in said
    question = parsed(f"map pose {NEAR}").question
    assert isinstance(question, PoseQuestion)
    cell = small_map.nearest_cell("left", question.T_base_tip)
    assert data["left"]["nearest_cell"].endswith(f"is {cell.status}")
    finder = PoseFinder(robot, "left")
    q = np.array(data["left"]["q_rad"])
    assert finder.holds(question.T_base_tip, q)


def test_a_pose_out_of_reach_and_of_the_map_is_a_no(
    small_map: ReachMap, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, said, data = answer(f"{small_map.path} pose {FAR}", tmp_path, capsys)
    assert status == 1
    assert "does not reach it: the pose at (0.700, 0.900, 0.900) m in base is proven" in said
    assert "the map's grid does not go there" in said
    assert data["right"]["status"] == "unreachable"
    assert data["right"]["q_rad"] is None


def test_which_arm(small_map: ReachMap, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, said, data = answer(f"{small_map.path} arm {NEAR}", tmp_path, capsys)
    assert status == 0
    assert said.startswith("the left arm: it reaches the pose, ")
    assert data["best"] == "left"
    assert parsed(f"{small_map.path} arm {FAR}").run() == 1


def test_the_nearest_pose_in_all_three_ways(
    small_map: ReachMap, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = f"{small_map.path} nearest 0.9 0.3 0.3 0 1 0 0 --arm left"
    status, said, data = answer(line, tmp_path, capsys)
    assert status == 0
    assert said.count("\n") == 3
    assert set(data["left"]) == {"orientation", "position", "nothing"}
    for keep, each in data["left"].items():
        assert 0.0 <= each["proven"] <= each["distance"]
        assert each["unit"] == ("rad" if keep == "position" else "m")
        assert len(each["pose"]) == 7


def test_where_reads_a_task_and_tells_every_place(
    table_map: ReachMap, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    look = {"name": "look", "position_m": [-0.3, 0.1, 0.9], "quat_xyzw": [0, 1, 0, 0]}
    grid = {"x_m": [1.0, 1.6], "y_m": [0.0, 0.0], "step_m": 0.6}
    task = tmp_path / "task.json"
    task.write_text(json.dumps({"visits": [look], "placements": grid}))
    status, said, data = answer(f"{table_map.path} where --tasks {task}", tmp_path, capsys)
    assert status == 0
    assert "confirmed by 1 verified plan" in said
    assert "2 placements: 1 confirmed by verified plans; 1 proven out of reach" in said
    (place,) = data["confirmed"]
    assert place["table"][:3] == [1.0, 0.0, -0.93]
    assert place["poses"][0]["name"] == "look"
    assert data["counts"]["impossible"] == 1


def test_examples_parse() -> None:
    for line in EXAMPLES.values():
        parsed(line.partition(" query ")[2])
        assert len(line) <= 98


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("map.zarr pose 1 2 3", "required: QX, QY, QZ, QW"),
        ("map.zarr pose 1 2 3 0 1 0 x", "'x' is not a number"),
        ("map.zarr where", "required: --tasks"),
        ("map.zarr near", "invalid choice: 'near'"),
        (f"map.zarr nearest {NEAR} --keep posittion", "did you mean position?"),
    ],
)
def test_wrong_usage_is_one_sentence(
    line: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        parsed(line)
    assert ended.value.code == 2
    told = capsys.readouterr().err
    assert said in told
    assert told.count("\n") == 1


@pytest.mark.parametrize(
    ("question", "said"),
    [
        ("pose 0.7 0.2 0.1 0 0 0 0", "quat_xyzw is zero"),
        (f"nearest {NEAR} --m-per-rad 0", "m_per_rad must be above zero"),
        (f"nearest {NEAR} --arm right", "unknown arm of this map 'right'; use one of: left"),
    ],
)
def test_what_no_map_can_answer_is_wrong_usage(
    question: str, said: str, small_map: ReachMap, tmp_path: Path
) -> None:
    left = ReachMap.create(
        tmp_path / "left.zarr",
        small_map.robot,
        small_map.positions,
        small_map.rotations,
        ("left",),
        backend="any",
    )
    with pytest.raises(UsageError, match=said):
        parsed(f"{left.path} {question}").run()


def test_a_map_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(AtlasError, match="there is no map at"):
        parsed(f"{tmp_path / 'none'} pose {NEAR}").run()


@pytest.mark.parametrize("question", EXAMPLES)
def test_the_help_of_a_question_has_its_example(
    question: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        parsed(f"map {question} --help")
    assert ended.value.code == 0
    said = capsys.readouterr().out
    assert f"examples:\n  {EXAMPLES[question]}\n" in said
    assert "xit status" in " ".join(said.split())


# plot --------------------------------------------------------------------------------------------

MATPLOTLIB = pytest.importorskip("matplotlib", exc_type=ImportError)


def plot(*arguments: str) -> int:
    return parse(Plot, arguments).run()


@pytest.mark.parametrize(
    "options", ["--height 0 0.2 --arm left", "--show margin --pointing 0 0 -1", "--show profile"]
)
def test_figures_are_written_and_the_same_each_time(
    small_map: ReachMap, tmp_path: Path, options: str
) -> None:
    files = [tmp_path / "one.svg", tmp_path / "other.svg"]
    for file in files:
        assert plot(str(small_map.path), "--out", str(file), *options.split()) == 0
    assert files[0].read_bytes() == files[1].read_bytes()
    assert ET.parse(files[0]).getroot().tag.endswith("svg")


@pytest.mark.parametrize(("suffix", "magic"), [("pdf", b"%PDF"), ("png", b"\x89PNG")])
def test_the_suffix_says_what_is_written(
    small_map: ReachMap, tmp_path: Path, suffix: str, magic: bytes
) -> None:
    path = tmp_path / f"reach.{suffix}"
    map_path = str(small_map.path)
    assert plot(map_path, "--out", str(path), "--compare", map_path) == 0
    assert path.read_bytes().startswith(magic)


def test_a_page_is_written_by_what_knows_viewers(
    small_map: ReachMap, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "reach.html"
    assert plot(str(small_map.path), "--html", str(path)) == 0
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
def test_options_of_figures_that_contradict_each_other_are_refused_in_one_sentence(
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
        plot(str(small_map.path), "--out", str(tmp_path / "a.svg"), *options.split())
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)
    assert list(tmp_path.iterdir()) == []


def test_a_map_to_compare_with_that_is_not_there_is_told(
    small_map: ReachMap, tmp_path: Path
) -> None:
    with pytest.raises(AtlasError, match="there is no map at nowhere"):
        plot(str(small_map.path), "--out", str(tmp_path / "a.svg"), "--compare", "nowhere")
