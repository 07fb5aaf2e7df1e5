"""The CSV of the RSDK's recorder, read back: also recordings made on a real Baxter.

A real recorder stalls, repeats a time stamp, writes twelve digits, is stopped in the middle of a
line, has no gripper, and reads joints slightly outside their limits. All that loads, with a note of
what was odd. What cannot be a recording of Baxter is refused.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from baxter_kin import Baxter
from baxter_kin.errors import expect, shown_path
from baxter_kin.files import PathLike
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray
from sim.errors import RecordingError
from sim.files import Line, checked_path, read_lines
from sim.recording.recording import NotedRecording, Recording
from sim.recording.rsdk_csv import csv_header

LIMIT_SLACK_RAD = 0.1
"""How far outside its limits a joint may be recorded: its encoder's offset and its spring's give,
6 degrees at most (our choice; Rethink gives no figure). What is farther outside is no angle of this
robot."""

ROUNDING_RAD = 1e-11
"""A limit written with twelve digits may be exceeded by so much."""

GAP_TICKS = 5.0
"""A pause of more than so many times the usual one is a gap."""

NO_GRIPPER_PERCENT = 100.0
"""Shown for a gripper that was not recorded: open, as a hand that holds nothing."""

LARGEST_TIME_S = 1e12
"""Later times have no microseconds in a float; they are no seconds."""


@dataclass(frozen=True, slots=True, eq=False)
class _Table:
    """The rows that are kept; n of them.

    Attributes:
        lines: line of the file each stands in, from 1.
        columns: shape (n,) each, by name; grippers may be NaN.
        notes: what was odd.
    """

    lines: list[int]
    columns: dict[str, FloatArray]
    notes: list[str]


def read_rsdk_csv(path: PathLike, robot: Baxter) -> NotedRecording:
    """A recording of the RSDK's `joint_recorder.py`, or of `write_csv`.

    Columns are found by name, in any order. Kept with a note: columns that are not of the format
    (unread), grippers that are missing (shown open) or outside 0 .. 100 (the nearer end), pauses of
    more than `GAP_TICKS` times the usual one, joints up to `LIMIT_SLACK_RAD` outside their limits.
    Left out with a note: rows whose time does not come after that of the row before, and a last
    line without its end, which may be half written. Joints that the format lacks stand in neutral.

    Args:
        path: the file.
        robot: the robot it was recorded on, whose limits count.

    Raises:
        RecordingError: when the file cannot be read, is empty or no text, lacks the time or a
            joint's column, or has a row that is malformed or far outside the limits; says which
            line.
    """
    expect(robot, Baxter, "robot", RecordingError)
    file = checked_path(path)
    table = _table(file, read_lines(file))
    times, columns = table.columns["time"], table.columns
    notes = [*table.notes, *_gaps(times), *_limit_notes(file, table, robot)]
    percent = np.empty((len(times), len(LIMBS)))
    for i, side in enumerate(LIMBS):
        percent[:, i], odd = _gripper(columns[f"{side}_gripper"], side)
        notes += odd
    recording = Recording(
        joint_names=robot.joint_names,
        times_s=times,
        q=_configurations(robot, columns, percent),
        gripper_percent=percent,
        bodies={},
        body_poses={},
        captions=((float(times[0]), ""),),
        events=(),
    )
    return NotedRecording(recording, tuple(notes))


def _table(file: object, lines: Iterator[Line]) -> _Table:
    filled = (line for line in lines if line.text.strip())
    first = next(filled, None)
    if first is None:
        raise RecordingError(f"{shown_path(file)} is empty")
    notes: list[str] = []
    header = _header(file, first.text, notes)
    numbers: list[int] = []
    rows: list[list[float]] = []
    dropped: list[int] = []
    for line in filled:
        if not line.is_complete:
            notes.append(f"line {line.number} has no end, so it may be half written: left out")
            continue
        row = _row(file, line, header)
        if rows and row[0] <= rows[-1][0]:
            dropped.append(line.number)
        else:
            rows.append(row)
            numbers.append(line.number)
    if not rows:
        raise RecordingError(f"{shown_path(file)} has a header but no complete row")
    columns = dict(zip(csv_header(), np.array(rows).T, strict=True))
    return _Table(numbers, columns, [*notes, *_order_notes(dropped)])


def _order_notes(dropped: list[int]) -> list[str]:
    """A note on the lines whose time does not come after that of the row before."""
    if not dropped:
        return []
    return [
        f"{_count(len(dropped), 'row')} did not come after the row before in time, the first in "
        f"line {dropped[0]}: left out"
    ]


@dataclass(frozen=True, slots=True)
class _Header:
    """Where the columns of the format stand in the file; None for a missing gripper."""

    positions: tuple[int | None, ...]
    width: int


def _header(file: object, text: str, notes: list[str]) -> _Header:
    names = [name.strip() for name in text.split(",")]
    wanted = csv_header()
    missing = [name for name in wanted if name not in names]
    fatal = [name for name in missing if not name.endswith("_gripper")]
    if fatal:
        raise RecordingError(
            f"{shown_path(file)} is no recording of the RSDK: its first line has no column "
            f"{', '.join(fatal[:3])}{' ...' if len(fatal) > 3 else ''}"
        )
    double = next((name for name in wanted if names.count(name) > 1), None)
    if double is not None:
        raise RecordingError(
            f"{shown_path(file)} has the column {double} {names.count(double)} times"
        )
    extra = [name for name in names if name not in wanted]
    if extra:
        shown = ", ".join(name[:30] or "(no name)" for name in extra[:5])
        notes.append(f"{_count(len(extra), 'column')} not of the format, left out: {shown}")
    return _Header(
        tuple(names.index(name) if name in names else None for name in wanted), len(names)
    )


def _row(file: object, line: Line, header: _Header) -> list[float]:
    fields = line.text.split(",")
    if len(fields) != header.width:
        raise RecordingError(
            f"{shown_path(file)}, line {line.number}: {len(fields)} fields under {header.width} "
            "columns"
        )
    row = []
    for name, position in zip(csv_header(), header.positions, strict=True):
        text = "" if position is None else fields[position].strip()
        value = _number(text)
        if not math.isfinite(value) and not name.endswith("_gripper"):
            raise RecordingError(
                f"{shown_path(file)}, line {line.number}: {name} is {text[:30]!r}, which is no "
                "finite number"
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


def _gaps(times: FloatArray) -> list[str]:
    """A note for all gaps, with the first and the longest."""
    pauses = np.diff(times)
    if pauses.size == 0:
        return []
    usual = float(np.median(pauses))
    gaps = np.flatnonzero(pauses > GAP_TICKS * usual)
    if gaps.size == 0:
        return []
    longest = gaps[pauses[gaps].argmax()]
    return [
        f"{_count(gaps.size, 'gap')} in time, {pauses[gaps].sum():.3f} s in all, the longest of "
        f"{pauses[longest]:.3f} s at {times[longest]:.3f} s, where a row usually follows after "
        f"{usual:.4g} s"
    ]


def _limit_notes(file: object, table: _Table, robot: Baxter) -> list[str]:
    """A note for each joint that was outside its limits.

    Raises:
        RecordingError: when one was outside by more than `LIMIT_SLACK_RAD`.
    """
    notes = []
    for arm in robot.arms.values():
        bounds = zip(arm.limits.q_min.tolist(), arm.limits.q_max.tolist(), strict=True)
        for name, (low, high) in zip(arm.joint_names, bounds, strict=True):
            values = table.columns[name]
            outside = np.maximum(low - values, values - high)
            worst = int(outside.argmax())
            if outside[worst] > LIMIT_SLACK_RAD:
                raise _far_outside(file, table, name, (low, high))
            if outside[worst] > ROUNDING_RAD:
                count = _count(int((outside > ROUNDING_RAD).sum()), "row")
                notes.append(
                    f"{name} was outside its limits {low:.6g} .. {high:.6g} rad in {count}, by up "
                    f"to {outside[worst]:.3g} rad"
                )
    return notes


def _far_outside(
    file: object, table: _Table, name: str, bounds: tuple[float, float]
) -> RecordingError:
    low, high = bounds
    values = table.columns[name]
    outside = np.maximum(low - values, values - high)
    row = int(np.flatnonzero(outside > LIMIT_SLACK_RAD)[0])
    return RecordingError(
        f"{shown_path(file)}, line {table.lines[row]}: {name} = {values[row]:.6g} rad is outside "
        f"{low:.6g} .. {high:.6g} by {outside[row]:.3g} rad; up to {LIMIT_SLACK_RAD:g} rad is "
        "accepted: are the angles in rad?"
    )


def _configurations(
    robot: Baxter, columns: dict[str, FloatArray], percent: FloatArray
) -> FloatArray:
    """Full configurations, shape (n, 19): arms and fingers as recorded, the rest in neutral."""
    q = np.tile(robot.configuration(), (len(percent), 1))
    for i, (side, arm) in enumerate(robot.arms.items()):
        for index, name in zip(robot.indices(arm.joint_names), arm.joint_names, strict=True):
            q[:, index] = columns[name]
        fingers = tuple(f"{side[0]}_gripper_{finger}_finger_joint" for finger in "lr")
        first, second = robot.indices(fingers)
        q[:, first] = percent[:, i] / 100.0 * robot.model.upperPositionLimit[first]
        q[:, second] = -q[:, first]  # the second finger mirrors the first
    return q


def _gripper(percent: FloatArray, side: str) -> tuple[FloatArray, list[str]]:
    """Positions inside 0 .. 100, and what was odd about them."""
    notes = []
    absent = np.isnan(percent)
    if absent.any():
        where = "" if absent.all() else f" in {_count(int(absent.sum()), 'row')}"
        notes.append(f"the {side} gripper was not recorded{where}: shown open")
    filled = np.where(absent, NO_GRIPPER_PERCENT, percent)
    clipped = np.clip(filled, 0.0, 100.0)
    odd = clipped != filled
    if odd.any():
        notes.append(
            f"the {side} gripper was outside 0 .. 100 % in {_count(int(odd.sum()), 'row')}, "
            f"from {filled.min():.6g} to {filled.max():.6g} %: taken as the nearer end"
        )
    return clipped, notes


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
