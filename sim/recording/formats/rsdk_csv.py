"""The CSV of the RSDK's recorder: recordings and plans written, recordings read.

The format is that of the Rethink SDK's `joint_recorder.py`, which its
`joint_position_file_playback.py` reads: a header and 17 columns, time in seconds with six decimals,
angles in rad, grippers 0..100.

A simulated hand closes on its body in hundredths of a second and the arm leaves at once. A robot
that plays such a file lags, and leaves before it grips. A plan is therefore written with its
grippers as commanded, 0 % to close, and a dwell before and after, so that the arm stands while the
fingers move and has settled before they do. Such a file is for
`joint_trajectory_file_playback.py` of Rethink's examples, with its joint trajectory action server:
it keeps the times of the rows, goes slowly to the first one, and stops where a joint is more than
0.2 rad off. Plan it at a speed ratio of 0.25 or less: a Baxter lags 0.4 s behind, so these 0.2 rad
are met at 0.5 rad/s, and the demo's plan, whose joints reach such speeds only shortly, came to 0.09
rad at a ratio of 0.3. `joint_position_file_playback.py` plays the file, too, but nothing stops it,
and it leaves the robot at its own speed ratio: 0.3 by default, which caps joints at 0.6 rad/s and
wrists at 1.2, above the 0.375 and 1.0 of a plan at 0.25. Both scripts take *both* arms to the first
row, on a way that nobody has checked. They know nothing of the robot that the set-points are for:
those of a plan for Baxter as it is drawn put the hand of a real one 9 to 13 mm beside, so writing
such a file logs a warning.

Files in the wild were edited, cut and made by other programs. Read is whatever has one meaning:
columns in any order, in any case and in quotation marks; commas, semicolons, tabs or spaces between
fields; a header or rows that end with a separator; a header behind a "#", and lines of comments. A
real recorder stalls, repeats a time stamp, writes twelve digits, is stopped in the middle of a
line, has no gripper or one arm alone. All that is read, with a note of what was odd.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from baxter_kin import Baxter
from baxter_kin.description import RobotDescription, RobotIdentity
from baxter_kin.description.hands import finger_joints
from baxter_kin.display import OneLine, count, shown_path
from baxter_kin.fields import NotCopied
from baxter_kin.files import PathLike
from baxter_kin.kinematics.arm import JOINTS, LIMBS, arm_joints
from baxter_kin.validation import FloatArray, expect, finite_scalar
from planner import Grip, GripperAction, Move, Plan, TwoArmPlan
from planner.errors import TaskError
from planner.grasping.finger_travel import FINGER_SPEED_M_S
from sim.errors import RecordingError
from sim.files import Line, LineFile, read_lines
from sim.recording.formats.joint_states import Rows, noted_recording
from sim.recording.recorder import RecordFile
from sim.recording.recording import Entry, NotedRecording, Recording, Row, entries_of
from sim.simulation import MAX_DWELL_S, ROBOT_DWELL_S
from sim.timeline import DEFAULT_TICK_S, Clock

logger = logging.getLogger(__name__)

STROKE_M = 0.020833
"""Travel of a finger from 0 to 100 %, of the electric gripper in Rethink's URDF."""

TRAVEL_S = STROKE_M / FINGER_SPEED_M_S
"""Time that the fingers are given for any way, on top of the dwells."""

START_TOLERANCE_RAD = 1e-6
"""Maximum distance of an arm from the start of the next plan."""

MAX_TIME_S = 1e12
"""Later times have no microseconds in a float; they are no seconds."""

COMMENT = "#"

SEPARATORS = (",", ";", "\t", None)
"""The first that is in the header counts; None is any space."""

_TIME, _VALUE = "{:.6f}", "{:.12g}"


def csv_header(limbs: Sequence[str] = LIMBS) -> list[str]:
    """The names of the columns: time, and of each arm seven joints and the gripper."""
    columns = ["time"]
    for side in limbs:
        columns += [*(f"{side}_{joint}" for joint in JOINTS), f"{side}_gripper"]
    return columns


class CsvFile(RecordFile):
    """The RSDK's CSV while it is being written; every row reaches the system at once."""

    def __init__(
        self, path: PathLike, joint_names: tuple[str, ...], limbs: Sequence[str] = LIMBS
    ) -> None:
        """Open the file and write the header.

        Args:
            path: the file; an older one is replaced.
            joint_names: the joints of full configurations.
            limbs: the arms that have columns.
        """
        header = csv_header(limbs)
        missing = [n for side in limbs for n in arm_joints(side) if n not in joint_names]
        if missing:
            raise RecordingError(f"the recording lacks {', '.join(missing)}, which the CSV needs")
        self._limbs = tuple(limbs)
        self._arms = [[joint_names.index(n) for n in arm_joints(side)] for side in limbs]
        self._row = ",".join([_TIME, *[_VALUE] * (len(header) - 1)])
        self._file = LineFile(path)
        self._file.write(",".join(header))

    def add(self, entry: Entry) -> None:
        """Write a snapshot."""
        if isinstance(entry, Row):
            percent = [entry.gripper_percent[LIMBS.index(side)] for side in self._limbs]
            self.write_row(entry.time_s, entry.q, percent)

    def write_row(self, time_s: float, q: FloatArray, percent: Sequence[float]) -> None:
        """Write a row.

        Args:
            time_s: time.
            q: full configuration.
            percent: the grippers of `limbs`, in that order.
        """
        values: list[float] = []
        for arm, gripper in zip(self._arms, percent, strict=True):
            values += [*q[arm].tolist(), gripper]
        self._file.write(self._row.format(time_s, *values))

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _facts(self) -> tuple[str, ...]:
        return self._file._facts()


_ARM_JOINTS = tuple(name for side in LIMBS for name in arm_joints(side))


class PlanCsvFile(NotCopied, OneLine):
    """The CSV of plans, one after the other, for a robot to play back; use it as a context manager.

    The arms' rows are their exact trajectories at 100 Hz. Grippers change from one row to the next.
    """

    def __init__(self, path: PathLike, *, dwell_s: float = ROBOT_DWELL_S) -> None:
        """Open the file and write the header.

        Args:
            path: the file; an older one is replaced.
            dwell_s: how long an arm stands before each gripper action and after it, 0 to 60 s.

        Raises:
            RecordingError: when the file cannot be written, or the dwell is no such number.
        """
        self._dwell_s = finite_scalar(dwell_s, "dwell_s", RecordingError)
        if not 0.0 <= self._dwell_s <= MAX_DWELL_S:
            raise RecordingError(f"dwell_s must be 0 to {MAX_DWELL_S:g} s, got {dwell_s:g} s")
        self._file, self._path = CsvFile(path, _ARM_JOINTS), path
        self._clock = Clock(DEFAULT_TICK_S)
        self._arms: dict[str, FloatArray] = {}
        self._percent: dict[str, float] = {}

    def __enter__(self) -> PlanCsvFile:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def add(self, plan: Plan | TwoArmPlan) -> None:
        """Write the steps of a plan.

        A plan of both arms is written on its clock, to which no dwell is added: an arm stands for
        `grip_s` at each gripper action, and the fingers act in the middle of that.

        Raises:
            RecordingError: when it has the wrong type, is invalid, does not say where the other
                arm stands, or starts elsewhere than the last one ended; when an arm of both has no
                moves; or when the file cannot be written.
        """
        if isinstance(plan, TwoArmPlan):
            _refuse_invalid(plan)
            for each in plan.plans.values():
                self._begin(each)
            self._on_clock(plan)
            return
        self._begin(expect(plan, Plan, "plan", RecordingError))
        for step in plan:
            if isinstance(step, Move):
                self._move(plan.limb, step)
            else:
                self._grip(plan.limb, step)

    def close(self) -> None:
        """Write where everything ends, and close; a second call does nothing.

        Raises:
            RecordingError: when the file cannot be written.
        """
        try:
            if self._arms:
                self._stand(DEFAULT_TICK_S)
        finally:
            self._arms = {}
            self._file.close()

    def _facts(self) -> tuple[str, ...]:
        return self._file._facts()

    def _begin(self, plan: Plan) -> None:
        _refuse_invalid(plan)
        if not self._arms:
            self._arms, self._percent = _start(plan)
            if plan.robot is not None:
                warn_if_as_drawn(plan.robot, self._path)
        off = float(np.abs(self._arms[plan.limb] - plan.q_start).max())
        if off > START_TOLERANCE_RAD:
            raise RecordingError(
                f"the plan starts {off:.3g} rad from where the {plan.limb} arm stands after the "
                "last one; plan from there"
            )

    def _move(self, limb: str, move: Move) -> None:
        names = move.trajectory.limits.names
        order = [names.index(name) for name in arm_joints(limb)]

        def follow(time_s: float) -> None:
            q: FloatArray = move.trajectory.sample(min(time_s, move.trajectory.duration)).q
            self._arms[limb] = q[order]

        self._clock.advance(move.trajectory.duration, follow, self._write)

    def _on_clock(self, plan: TwoArmPlan) -> None:
        """Write the motion of both arms; grippers are commanded in the middle of their actions."""
        try:
            motion = plan.trajectory
        except TaskError as cause:
            raise RecordingError(str(cause)) from cause
        names, zero_s = motion.limits.names, self._clock.time_s
        orders = {side: [names.index(name) for name in arm_joints(side)] for side in LIMBS}
        wait_s = max(plan.grip_s - TRAVEL_S, 0.0) / 2
        grips = [each for each in plan.steps if isinstance(each.step, Grip)]
        for end_s, grip in [*((each.begin_s + wait_s, each) for each in grips), (None, None)]:
            begin_s = self._clock.time_s - zero_s

            def follow(time_s: float, begin_s: float = begin_s) -> None:
                q: FloatArray = motion.sample(min(begin_s + time_s, motion.duration)).q
                self._arms = {side: q[order] for side, order in orders.items()}

            self._clock.advance(
                (motion.duration if end_s is None else end_s) - begin_s, follow, self._write
            )
            if grip is not None and isinstance(grip.step, Grip):
                self._command(grip.side, grip.step)

    def _grip(self, limb: str, grip: Grip) -> None:
        self._stand(self._dwell_s)
        self._command(limb, grip)
        self._stand(TRAVEL_S + self._dwell_s)

    def _command(self, limb: str, grip: Grip) -> None:
        if grip.action is GripperAction.CLOSE:
            self._percent[limb] = 0.0
        else:
            self._percent[limb] = 100.0 if grip.opening_m is None else _percent(grip.opening_m)

    def _stand(self, duration_s: float) -> None:
        self._clock.advance(duration_s, lambda _: None, self._write)

    def _write(self) -> None:
        q = np.concatenate([self._arms[side] for side in LIMBS])
        self._file.write_row(self._clock.time_s, q, [self._percent[side] for side in LIMBS])


def warn_if_as_drawn(robot: RobotIdentity, path: PathLike) -> None:
    """Log a warning where the arms of a robot are mounted as drawn, as on no real Baxter known.

    Args:
        robot: for which the set-points in a file are.
        path: the file.
    """
    drawn = RobotDescription.as_in_urdf().identity
    mounts = [f"{side}_torso_arm_mount" for side in LIMBS]
    has_own = any(robot.places.get(name) != drawn.places[name] for name in mounts)
    if robot.kinematics == drawn.kinematics or not has_own:
        logger.warning(
            "%s has set-points for Baxter as it is drawn; real Baxters' shoulders sit about 10 mm "
            "lower, so their hands would be 9 to 13 mm off: plan with the robot's own URDF "
            "(--urdf, Baxter.load(urdf=...); docs/how_to/my_baxters_urdf.md)",
            shown_path(path),
        )


def write_csv(
    what: Recording | Plan | TwoArmPlan, path: PathLike, *, dwell_s: float | None = None
) -> None:
    """Write a recording, or a plan for a robot to play back, as the RSDK's CSV.

    A recording is written as it happened, of one arm alone when no more was recorded. A plan is
    written as it is commanded, at 100 Hz, its grippers with dwells: for
    `joint_trajectory_file_playback.py`, planned at a speed ratio of at most 0.25
    (`sim.recording.formats.rsdk_csv` states why). A plan for Baxter as it is drawn is written with
    a warning in the log. A plan of both arms is written on its clock (`PlanCsvFile.add`); give it a
    `grip_s` of some seconds, as a robot lags.

    Args:
        what: what to write.
        path: the file; an older one is replaced.
        dwell_s: of a plan of one arm: how long it stands before each gripper action and after it, 0
            to 60 s; 1 s when not given.

    Raises:
        RecordingError: when it has the wrong type, the file cannot be written, the recording lacks
            joints of an arm or is given a dwell, or the plan is invalid or does not say where the
            other arm stands.
    """
    if isinstance(what, Plan):
        _refuse_invalid(what)
        _start(what)
        with PlanCsvFile(path, dwell_s=ROBOT_DWELL_S if dwell_s is None else dwell_s) as plans:
            plans.add(what)
        return
    if isinstance(what, TwoArmPlan):
        if dwell_s is not None:
            raise RecordingError("dwell_s is for one arm; both stand for grip_s, which is planned")
        _refuse_invalid(what)
        with PlanCsvFile(path) as plans:
            plans.add(what)
        return
    recording = expect(
        what, Recording, "what is written: a plan, or else the recording", RecordingError
    )
    if dwell_s is not None:
        raise RecordingError("dwell_s is for plans; a recording is written as it happened")
    file = CsvFile(path, recording.joint_names, recording.limbs)
    try:
        for entry in entries_of(recording):
            file.add(entry)
    finally:
        file.close()


def _refuse_invalid(plan: Plan | TwoArmPlan) -> None:
    if plan.failure is not None:
        raise RecordingError(f"an invalid plan cannot be executed: {plan.failure}")


def _start(plan: Plan) -> tuple[dict[str, FloatArray], dict[str, float]]:
    """Positions of both arms and commands of both grippers before a plan's first step."""
    joints, full = plan.start.joints, {held.side for held in plan.start.attachments}
    arms, percent = {plan.limb: plan.q_start}, {}
    for side in LIMBS:
        missing = [name for name in arm_joints(side) if name not in joints]
        if side != plan.limb and missing:
            raise RecordingError(f"the plan's state lacks {', '.join(missing)}")
        if side != plan.limb:
            arms[side] = np.array([joints[name] for name in arm_joints(side)])
        finger_m = joints.get(finger_joints(side)[0], STROKE_M)  # some hands have none
        percent[side] = 0.0 if side in full else _percent(finger_m)
    return arms, percent


def _percent(finger_m: float) -> float:
    return min(100.0, max(0.0, 100.0 * finger_m / STROKE_M))


def read_csv(path: Path, robot: Baxter) -> NotedRecording:
    """Read a recording of the RSDK's `joint_recorder.py`, or of `write_csv`.

    Kept with a note are columns that are not of the format (left out), one arm without the other
    (`Recording.limbs`), grippers that are missing (shown open) or outside 0 .. 100 (the nearer
    end), gaps, and joints slightly outside their limits. Rows whose time does not come after that
    of the row before are left out with a note, and so is a last line without its end, which may be
    half written. Joints that the format lacks stand in neutral.

    Args:
        path: the file.
        robot: the robot that it was recorded on, whose limits count.

    Raises:
        RecordingError: when the file cannot be read, is empty or no text, lacks the time or a
            joint's column, or has a row that is malformed or cannot be of a Baxter's joints
            (`sim.recording.formats.joint_states`); says which line.
    """
    table = _read_table(path, read_lines(path))
    percent = {
        side: table.columns.pop(f"{side}_gripper")
        for side in LIMBS
        if f"{side}_gripper" in table.columns
    }
    times_s = table.columns.pop("time")

    def place(row: int) -> str:
        return f"{shown_path(path)}, line {table.lines[row]}"

    return noted_recording(Rows(times_s, table.columns, place), percent, table.notes, robot)


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


def _read_table(file: object, lines: Iterator[Line]) -> _Table:
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
    return _Table([number for number, _ in kept], columns, [*notes, *_order_notes(dropped)])


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
    if abs(row[0]) > MAX_TIME_S:
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
