"""The campaign that kills builds: what it compares, and what it ends with."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

builds: Any = importlib.import_module("campaign.builds")
efficiency: Any = importlib.import_module("campaign.efficiency")


class Written:
    """Stands for a build: writes two files, as if it were a map."""

    @classmethod
    def begin(cls, path: Path, *_: object) -> Written:
        (path / "margins").mkdir(parents=True)
        (path / "zarr.json").write_text("{}")
        (path / "margins" / "0").write_bytes(b"\x01\x02")
        return cls()

    def finished(self) -> dict[str, object]:
        return {}


def run(monkeypatch: pytest.MonkeyPatch, change: Any, *options: str) -> int:
    """The status of a campaign of one map a kind, which is changed before it is compared."""
    script: Any = importlib.import_module("atlas_campaign")

    def maps(folder: Path, *_: object) -> Iterator[Path]:
        Written.begin(folder / "killed")
        change(folder / "killed")
        yield folder / "killed"

    monkeypatch.setattr(script, "Build", Written)
    monkeypatch.setattr(script, "_maps", maps)
    return int(script.main(list(options)))


@pytest.mark.parametrize(
    ("options", "kinds"),
    [
        ((), ["reach map", "redundancy map"]),
        (("--only", "reach"), ["reach map"]),
        (("--only", "redundancy"), ["redundancy map"]),
    ],
)
def test_the_same_bytes_are_status_0(
    options: tuple[str, ...],
    kinds: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run(monkeypatch, Path.exists, *options) == 0
    said = capsys.readouterr().out
    assert [line[10:].partition(",")[0] for line in said.splitlines() if "serial" in line] == kinds
    assert said.count("killed: the same bytes") == len(kinds)
    assert said.endswith("all maps have the same bytes\n")


@pytest.mark.parametrize(
    ("change", "name"),
    [
        (lambda path: (path / "margins" / "0").write_bytes(b"\x01\x03"), "margins/0"),
        (lambda path: (path / "margins" / "0").unlink(), "margins/0"),
        (lambda path: (path / "left.partial").touch(), "left.partial"),
    ],
    ids=["other bytes", "missing", "left over"],
)
def test_a_difference_is_named_and_status_1(
    change: Any, name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, change) == 1
    said = capsys.readouterr().out
    assert said.count(f"killed: 1 files DIFFER: ['{name}']") == 2
    assert said.endswith("2 maps differ\n")


@pytest.mark.parametrize("reach", [None, Path("reach.zarr")], ids=["reach", "redundancy"])
def test_blocks_are_counted_by_what_is_written_last(reach: Path | None, tmp_path: Path) -> None:
    layout = builds.Wanted(0.1, 0, reach).layout
    chunk = tmp_path.joinpath(layout.last, "c", "0", "1", "0", "2", *["0"] * layout.inner)
    assert builds.blocks_stored(tmp_path, layout) == 0
    chunk.parent.mkdir(parents=True)
    chunk.with_name("0.f00d.partial").touch()
    assert builds.blocks_stored(tmp_path, layout) == 0
    chunk.touch()
    assert builds.blocks_stored(tmp_path, layout) == 1


def test_the_balance_is_the_share_of_time_in_which_workers_work() -> None:
    blocks = efficiency.Run(1.0, 1.0, (1.0, 1.0, 1.0, 3.0))
    assert blocks.balance(1) == 1.0
    assert blocks.balance(2) == pytest.approx(6.0 / (2.0 * 4.0))


def test_efficiency_is_that_of_medians() -> None:
    one = [efficiency.Run(wall, 10.0, (5.0, 5.0)) for wall in (9.0, 10.0, 30.0)]
    two = [efficiency.Run(wall, 12.5, (5.0, 5.0)) for wall in (5.5, 6.25, 7.0)]
    found = efficiency.Efficiency(one, two)
    assert found.by_wall == pytest.approx(0.8)
    assert found.by_core == pytest.approx(0.8)
