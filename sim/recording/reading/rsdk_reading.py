"""The CSV of the RSDK's recorder, read back: also recordings made on a real Baxter.

A real recorder stalls, repeats a time stamp, writes twelve digits, is stopped in the middle of a
line, has no gripper or one arm alone, and reads joints slightly outside their limits. All that
loads, with a note of what was odd. What cannot be a recording of Baxter is refused.
"""

from __future__ import annotations

from baxter_kin import Baxter
from baxter_kin.display import shown_path
from baxter_kin.files import PathLike
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import expect
from sim.errors import RecordingError
from sim.files import checked_path, read_lines
from sim.recording.reading.csv_table import read_table
from sim.recording.reading.measurement import Measurement, noted_recording
from sim.recording.reading.plausibility import Rows
from sim.recording.recording import NotedRecording


def read_rsdk_csv(path: PathLike, robot: Baxter) -> NotedRecording:
    """A recording of the RSDK's `joint_recorder.py`, or of `write_csv`.

    Columns are found by name, in any order (`sim.recording.reading.csv_table`). Kept with a note:
    columns that are not of the format (unread), one arm without the other (`Recording.limbs`; the
    other is shown in neutral), grippers that are missing (shown open) or outside 0 .. 100 (the
    nearer end), pauses of more than `GAP_TICKS` times the usual one, joints up to `LIMIT_SLACK_RAD`
    outside their limits, with their true values. Left out with a note: rows whose time does not
    come after that of the row before, and a last line without its end, which may be half written.
    Joints that the format lacks stand in neutral.

    Args:
        path: the file.
        robot: the robot it was recorded on, whose limits count.

    Raises:
        RecordingError: when the file cannot be read, is empty or no text, lacks the time or a
            joint's column, or has a row that is malformed or cannot be of a Baxter's joints
            (`sim.recording.reading.plausibility`); says which line.
    """
    expect(robot, Baxter, "robot", RecordingError)
    file = checked_path(path)
    table = read_table(file, read_lines(file))
    percent = {
        side: table.columns.pop(f"{side}_gripper")
        for side in LIMBS
        if f"{side}_gripper" in table.columns
    }
    times_s = table.columns.pop("time")

    def place(row: int) -> str:
        return f"{shown_path(file)}, line {table.lines[row]}"

    rows = Rows(times_s, table.columns, place)
    return noted_recording(Measurement(rows, percent, tuple(table.notes)), robot)
