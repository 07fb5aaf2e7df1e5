"""Logs read back: cut anywhere, damaged, or none at all."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Baxter
from planner import Body
from sim import LogRecorder, Simulation, World, read_log
from sim.errors import RecordingError


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory, robot: Baxter, block: Body) -> bytes:
    """The bytes of a log of eleven snapshots."""
    path = tmp_path_factory.mktemp("small") / "small.jsonl"
    recorder = LogRecorder(path, robot)
    simulation = Simulation(World(robot), [recorder])
    simulation.spawn(block)
    simulation.wait(0.1)
    recorder.close()
    return path.read_bytes()


@given(st.data())
def test_a_log_cut_anywhere_keeps_the_lines_before(
    small: bytes, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    path = tmp_path_factory.getbasetemp() / "cut.jsonl"
    content = small[: data.draw(st.integers(0, len(small) - 1))]
    path.write_bytes(content)
    complete = [line for line in content.split(b"\n")[:-1] if b"snapshot" in line]
    if not complete:
        with pytest.raises(RecordingError):
            read_log(path)
        return
    found, notes = read_log(path)
    assert len(found.times_s) == len(complete)
    assert "the run was cut short" in notes[-1]
    assert ("half written" in notes[0]) == (not content.endswith(b"\n"))


def test_nul_bytes_after_a_power_failure_are_a_half_written_line(
    small: bytes, tmp_path: Path
) -> None:
    path = tmp_path / "run.jsonl"
    path.write_bytes(small[: small.rindex(b'{"end"')] + bytes(512))
    found, notes = read_log(path)
    assert len(found.times_s) == 11
    assert len(notes) == 2


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (b"baxter-kin log", b"something", "is no log: it does not begin with its format"),
        (
            b'"version":4',
            b'"version":"1"',
            r"has version '1', but only \(1, 2, 3, 4\) are read here",
        ),
        (b'{"snapshot"', b'{"picture"', "line 4: has the entry 'picture'; known are body"),
        (b'{"snapshot":', b'{"event":', "line 4: event has no entry|line 4: event"),
        (b'"q":[', b'"q":[0.5,', r"line 4: q has shape \(20,\); it must have \(19,\)"),
        (b'"q":[', b'"q":[NaN,', "line 4: has NaN where a finite number must be"),
        (b'"q":[', b'"q":[1e999,', "line 4: has 1e999 where a finite number must be"),
        (b'"q":[', b'"q":[1e99,', r"line 4: snapshot\.q must be a finite number up to 1e\+30"),
        (b'"q":[', b'"q":[' + 400 * b"1" + b",", r"line 4: snapshot\.q must be a finite"),
        (b'"q":[', b'"q":' + 100_000 * b"[", "line 4: is nested too deeply|not complete JSON"),
        (b'"time_s":0.01', b'"time_s":0.0', "line 5: is at 0 s, after one at 0 s"),
        (b'{"snapshot"', b'[1,2]\n{"snapshot"', "line 4: must be an object of one entry"),
        (b'{"snapshot"', b'{"end":0}\n{"snapshot"', "line 5: comes after the end"),
        (b'{"snapshot"', b'\n{"snapshot"', "line 4: is not complete JSON"),
        (b'"kind":"SPAWNED"', b'"kind":"HATCHED"', "line 3: event.kind is 'HATCHED'; use one of"),
        (b'"is_movable"', b'"has_legs"', "line 2: body has unknown entry 'has_legs'|has_legs"),
    ],
)
def test_a_damaged_line_is_refused_with_its_number(
    small: bytes, tmp_path: Path, old: bytes, new: bytes, words: str
) -> None:
    path = tmp_path / "run.jsonl"
    path.write_bytes(small.replace(old, new, 1))
    with pytest.raises(RecordingError, match=words):
        read_log(path)


def test_snapshots_that_are_missing_are_noted(small: bytes, tmp_path: Path) -> None:
    lines = small.splitlines(keepends=True)
    (tmp_path / "run.jsonl").write_bytes(b"".join(lines[:6] + lines[7:]))
    assert read_log(tmp_path / "run.jsonl").notes == ("1 of 11 snapshots are missing",)


def test_a_body_that_nobody_introduced_is_noted(small: bytes, tmp_path: Path) -> None:
    lines = small.splitlines(keepends=True)
    (tmp_path / "run.jsonl").write_bytes(b"".join(line for line in lines if b'{"body"' not in line))
    found, notes = read_log(tmp_path / "run.jsonl")
    assert found.bodies == {}
    assert notes == ("left out, as their shapes are not in the log: ['block']",)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty"),
        (b"\n", "is no log"),
        (b"time,left_s0\n", "is no log"),
        (b"[]\n", "is no log"),
        (b"PK\x03\x04\xff\n", "is no text"),
    ],
)
def test_what_is_no_log_is_refused(tmp_path: Path, content: bytes, words: str) -> None:
    (tmp_path / "run.jsonl").write_bytes(content)
    with pytest.raises(RecordingError, match=words):
        read_log(tmp_path / "run.jsonl")
