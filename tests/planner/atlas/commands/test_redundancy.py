"""The sub-command that builds redundancy maps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from baxter_kin import engine_options
from baxter_kin.command_line import UsageError, parse
from baxter_kin.parallel import Serial
from planner.atlas import ReachMap
from planner.atlas.commands.redundancy import Redundancy
from planner.atlas.redundancy import RedundancyMap, Subset, checking


@pytest.fixture(autouse=True)
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Processes and solvers take seconds to make."""
    monkeypatch.setattr(checking, "FINDERS", 1)
    monkeypatch.setattr(engine_options, "LocalPool", lambda _: Serial())


def run(*arguments: object) -> int:
    return parse(Redundancy, list(map(str, arguments))).run()


CHOICE = ("--arm", "left", "--x", "0.7", "--y", "0.2", "0.4", "--z", "0.1", "--rotations", 0, 2)


def test_a_map_is_built_and_checked(
    small_map: ReachMap, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "freedom.zarr"
    assert run(small_map.path, path, *CHOICE, "--measure-s", 0.1, "--check", 1) == 0
    told = capsys.readouterr().out
    assert told.startswith("missing: Cost(6 cells, ")
    assert "complete: RedundancyMap(left, 1 x 3 x 1 points, 2 rotations)" in told
    assert "RedundancyCheck(1 cells, 0 wrong, 0 missed pieces" in told
    found = RedundancyMap(path)
    assert found.subset == Subset(("left",), (2,), (2, 3, 4), (1,), (0, 2))
    assert not found.missing_blocks()
    found.write_block((0, 0, 0, 0), np.full((3, 6, 2), 5, np.int32))
    assert run(small_map.path, path, *CHOICE, "-q", "--check", 1) == 1
    complaint = capsys.readouterr()
    assert not complaint.out
    assert complaint.err.startswith("wrong: CellCheck(name='left, position (2, ")


def test_the_cost_is_told_and_nothing_computed(
    small_map: ReachMap, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "none.zarr"
    assert run(small_map.path, path, *CHOICE, "--cost", "-q", "--measure-s", 0.1) == 0
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
        run(small_map.path, tmp_path / "none", *options.split())
    assert not (tmp_path / "none").exists()
