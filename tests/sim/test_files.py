"""Files: lines that survive a kill, and reasons when something fails."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.errors import RecordingError
from sim.files import Line, LineFile, checked_path, opened, read_lines, replace_file

LINES = st.lists(st.text(st.characters(exclude_characters="\r\n\ufeff", exclude_categories=["Cs"])))


@settings(max_examples=25)
@given(LINES)
def test_lines_come_back_as_they_were_written(
    tmp_path_factory: pytest.TempPathFactory, lines: list[str]
) -> None:
    path = tmp_path_factory.getbasetemp() / "lines.txt"
    with LineFile(path) as file:
        for line in lines:
            file.write(line)
    wanted = [Line(i, line, is_complete=True) for i, line in enumerate(lines, start=1)]
    assert list(read_lines(path)) == wanted


def test_a_line_is_in_the_file_before_it_is_closed_and_refused_after(tmp_path: Path) -> None:
    with LineFile(tmp_path / "lines.txt") as file:
        file.write("one")
        assert (tmp_path / "lines.txt").read_text() == "one\n"
    with pytest.raises(RecordingError, match="closed file"):
        file.write("one")


def test_a_last_line_without_end_is_not_complete_even_cut_in_a_character(tmp_path: Path) -> None:
    path = tmp_path / "lines.txt"
    path.write_bytes("one\ntwo \u00e9".encode()[:-1])
    assert [line.is_complete for line in read_lines(path)] == [True, False]


@pytest.mark.usefixtures("full_disk")
def test_a_file_that_failed_is_closed_and_says_why_each_time(tmp_path: Path) -> None:
    """What came after the failure once hid it: "write to closed file"."""
    file = LineFile(tmp_path / "lines.txt")
    for line in ("one", "two"):
        with pytest.raises(RecordingError, match=r"cannot write .*: No space left on device"):
            file.write(line)
    file.close()


def test_a_pipe_is_neither_waited_for_nor_written_to(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(RecordingError, match="not a regular file"):
        list(read_lines(tmp_path / "pipe"))
    with pytest.raises(RecordingError, match="it is a pipe"):
        LineFile(tmp_path / "pipe")


def test_a_replaced_file_is_whole_or_the_old_one(tmp_path: Path) -> None:
    path = tmp_path / "file"
    replace_file(path, b"old")
    replace_file(path, b"new")
    assert path.read_bytes() == b"new"
    assert os.listdir(tmp_path) == ["file"]


@pytest.mark.parametrize("path", ["missing/file", ".", "a\0b", "x" * 5000])
def test_what_cannot_be_written_or_read_is_reported(path: str) -> None:
    for write in (lambda path: replace_file(path, b"content"), LineFile):
        with pytest.raises(RecordingError, match="cannot write"):
            write(path)
    with pytest.raises(RecordingError, match=r"cannot read|regular file"), opened(path):
        pass


@pytest.mark.parametrize("bad", [None, 1, b"file", ["file"]])
def test_what_is_no_path_is_refused(bad: Any) -> None:
    with pytest.raises(RecordingError, match="path"):
        checked_path(bad)
