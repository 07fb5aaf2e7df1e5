"""The table in a CSV file of joints: its columns by name, its rows as numbers.

Files in the wild were edited, cut and made by other programs. Read is whatever has one meaning:
names in any order, in any case and in quotation marks; commas, semicolons, tabs or spaces between
fields; a header or rows that end with a separator; a header behind a "#", and lines of comments.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from baxter_kin.display import count, shown_path
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray
from sim.errors import RecordingError
from sim.files import Line
from sim.recording.recorded_motion import arm_joints
from sim.recording.rsdk_csv import csv_header

LARGEST_TIME_S = 1e12
"""Later times have no microseconds in a float; they are no seconds."""

COMMENT = "#"

SEPARATORS = (",", ";", "\t", None)
"""The first that is in the header counts; None is any space."""


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """The rows that are kept; n of them.

    Attributes:
        lines: line of the file each stands in, from 1.
        columns: shape (n,) each, by name; grippers may be NaN.
        notes: what was odd.
    """

    lines: list[int]
    columns: dict[str, FloatArray]
    notes: list[str]


@dataclass(frozen=True, slots=True)
class _Header:
    """Where columns stand in the file.

    Attributes:
        positions: of those that are read, by name.
        separator: what stands between fields; None for any space.
        least: the fewest fields of a row: the columns up to the last that has a name.
        most: the most fields that may hold something.
    """

    positions: dict[str, int]
    separator: str | None
    least: int
    most: int


def read_table(file: object, lines: Iterator[Line]) -> Table:
    """The table in the lines of a file."""
    filled = (line for line in lines if line.text.strip())
    notes: list[str] = []
    header = _first_header(file, filled, notes)
    kept: list[tuple[int, list[float]]] = []
    dropped: list[int] = []
    comments = 0
    for line in filled:
        if not line.is_complete:
            notes.append(f"line {line.number} has no end, so it may be half written: left out")
        elif line.text.lstrip().startswith(COMMENT):
            comments += 1
        else:
            row = _row(file, line, header)
            is_next = not kept or row[0] > kept[-1][1][0]
            kept.append((line.number, row)) if is_next else dropped.append(line.number)
    if not kept:
        raise RecordingError(f"{shown_path(file)} has a header but no complete row")
    columns = dict(zip(header.positions, np.array([row for _, row in kept]).T, strict=True))
    notes += [f"{count(comments, 'comment')} among the rows: left out"] if comments else []
    return Table([number for number, _ in kept], columns, [*notes, *_order_notes(dropped)])


def _order_notes(dropped: list[int]) -> list[str]:
    """A note on the lines whose time does not come after that of the row before."""
    if not dropped:
        return []
    return [
        f"{count(len(dropped), 'row')} did not come after the row before in time, the first in "
        f"line {dropped[0]}: left out"
    ]


def _first_header(file: object, filled: Iterator[Line], notes: list[str]) -> _Header:
    """The header: the first line, or the first of its comments that names columns."""
    for line in filled:
        text = line.text.lstrip()
        names, separator = _names(text.lstrip(COMMENT))
        if text.startswith(COMMENT) and "time" not in names:
            continue
        return _header(file, names, separator, notes)
    raise RecordingError(f"{shown_path(file)} is empty")


def _names(text: str) -> tuple[list[str], str | None]:
    separator = next(each for each in SEPARATORS if each is None or each in text)
    fields = text.strip("\r\n ").split(separator)
    names = [name.strip().strip("\"'").strip() for name in fields]
    known = set(csv_header())
    return [name.lower() if name.lower() in known else name for name in names], separator


def _header(file: object, names: list[str], separator: str | None, notes: list[str]) -> _Header:
    wanted = _wanted(file, names)
    double = next((name for name in wanted if names.count(name) > 1), None)
    if double is not None:
        raise RecordingError(
            f"{shown_path(file)} has the column {double} {names.count(double)} times"
        )
    least = max(i for i, name in enumerate(names, start=1) if name)
    extra = [name for name in names if name not in wanted]
    if any(extra):
        shown = ", ".join(name[:30] or "(no name)" for name in extra[:5])
        notes.append(f"{count(len(extra), 'column')} not of the format, left out: {shown}")
    return _Header({name: names.index(name) for name in wanted}, separator, least, len(names))


def _wanted(file: object, names: list[str]) -> list[str]:
    """The columns to read: the time, the arms that are whole, and the grippers that are there."""
    arms = {side: [name for name in arm_joints(side) if name in names] for side in LIMBS}
    missing = [] if "time" in names else ["time"]
    for side, found in arms.items():
        if found or not any(arms.values()):
            missing += [name for name in arm_joints(side) if name not in found]
    if missing:
        raise RecordingError(
            f"{shown_path(file)} is no recording of the RSDK: its first line has no column "
            f"{', '.join(missing[:3])}{' ...' if len(missing) > 3 else ''}"
        )
    grippers = [f"{side}_gripper" for side in LIMBS if f"{side}_gripper" in names]
    return ["time", *(name for found in arms.values() for name in found), *grippers]


def _row(file: object, line: Line, header: _Header) -> list[float]:
    fields = [field.strip().strip("\"'") for field in line.text.strip().split(header.separator)]
    while len(fields) > header.most and not fields[-1]:
        fields.pop()
    if not header.least <= len(fields) <= header.most:
        raise RecordingError(
            f"{shown_path(file)}, line {line.number}: {len(fields)} fields under {header.least} "
            "columns"
        )
    row = []
    for name, position in header.positions.items():
        value = _number(fields[position])
        if not math.isfinite(value) and not name.endswith("_gripper"):
            raise RecordingError(
                f"{shown_path(file)}, line {line.number}: {name} is {fields[position][:30]!r}, "
                "which is no finite number"
            )
        row.append(value if math.isfinite(value) else math.nan)
    if abs(row[0]) > LARGEST_TIME_S:
        raise RecordingError(
            f"{shown_path(file)}, line {line.number}: time {row[0]:g} s is no time"
        )
    return row


def _number(text: str) -> float:
    """NaN for what is none."""
    try:
        return math.nan if "_" in text else float(text)
    except ValueError:
        return math.nan
