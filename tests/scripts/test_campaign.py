"""The campaign that kills builds: what it compares, and what it ends with."""

from __future__ import annotations

import importlib
import os
import resource
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("zarr", reason="maps need zarr, and it Python 3.11", exc_type=ImportError)
script: Any = importlib.import_module("atlas_campaign")


def write(path: Path) -> None:
    """Two files, as if they were a map."""
    (path / "margins").mkdir(parents=True)
    (path / "zarr.json").write_text("{}")
    (path / "margins" / "0").write_bytes(b"\x01\x02")


def run(monkeypatch: pytest.MonkeyPatch, change: Any, *options: str) -> int:
    """The status of a campaign of one map a kind, which is changed before it is compared."""

    class Written:
        def __init__(self, words: list[str]) -> None:
            write(Path(next(word for word in words[::-1] if word.endswith(".zarr"))))

        def finished(self) -> None:
            pass

    def killed(first: Path, *_: object) -> Iterator[tuple[Path, str]]:
        write(first.with_name("again"))
        change(first.with_name("again"))
        yield first.with_name("again"), "killed"

    monkeypatch.setattr(script, "Build", Written)
    monkeypatch.setattr(script, "_killed", killed)
    return int(script.main(list(options)))


@pytest.mark.parametrize("only", [[], ["reach"], ["redundancy"]])
def test_the_same_bytes_are_status_0(
    only: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, Path.exists, *(f"--only={each}" for each in only)) == 0
    said = capsys.readouterr().out
    for kind in ("reach", "redundancy"):
        assert (f"{kind}, killed: the same bytes" in said) == (not only or kind in only)
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


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="peaks are read from Linux' /proc")
def test_peaks_are_those_of_the_system_and_a_failure_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told_mb = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    assert script.peak_mb(os.getpid()) == pytest.approx(told_mb, rel=0.05)
    assert script.peak_mb(2**30) == 0.0
    assert not script.told("nothing", ["info", str(tmp_path / "nothing.zarr")])
    assert "exit status 1" in capsys.readouterr().out
    assert script.told("nothing", ["info", str(tmp_path / "nothing.zarr")], status=1)
