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


def run(monkeypatch: pytest.MonkeyPatch, change: Any) -> int:
    """The status of a campaign of one map, which is changed before it is compared."""
    script: Any = importlib.import_module("atlas_campaign")

    def maps(folder: Path, *_: object) -> Iterator[Path]:
        Written.begin(folder / "killed")
        change(folder / "killed")
        yield folder / "killed"

    monkeypatch.setattr(script, "Build", Written)
    monkeypatch.setattr(script, "_maps", maps)
    return int(script.main([]))


def test_the_same_bytes_are_status_0(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, Path.exists) == 0
    assert "killed: the same bytes" in capsys.readouterr().out


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
    assert f"killed: 1 files DIFFER: ['{name}']" in capsys.readouterr().out


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
