"""Measurement: what a robot said of its joints at n times, and the recording that is made of it.

Files of real robots say less than a simulation does: of one arm alone, or without grippers. What is
missing stands still in the recording, with a note.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from baxter_kin import Baxter
from baxter_kin.display import count
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray
from sim.recording.reading.plausibility import Rows, check_rows
from sim.recording.recorded_motion import arm_joints, finger_joints
from sim.recording.recording import NotedRecording, Recording

GAP_TICKS = 5.0
"""A pause of more than so many times the usual one is a gap."""

NO_GRIPPER_PERCENT = 100.0
"""Shown for a gripper that was not recorded: open, as a hand that holds nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class Measurement:
    """What was measured.

    Attributes:
        rows: joints at n times; of an arm all seven or none.
        percent: of the left and the right gripper, shape (n,) each, by side; NaN where it was not
            recorded, and absent where it never was.
        notes: what was odd about the file.
    """

    rows: Rows
    percent: Mapping[str, FloatArray]
    notes: tuple[str, ...] = ()


def limbs_in(names: Mapping[str, object]) -> tuple[str, ...]:
    """The arms of which all joints are there."""
    return tuple(side for side in LIMBS if set(arm_joints(side)) <= names.keys())


def noted_recording(measured: Measurement, robot: Baxter) -> NotedRecording:
    """The recording of a measurement; a joint that was not measured stands in neutral."""
    rows, limbs = measured.rows, limbs_in(measured.rows.joints)
    notes = [*measured.notes, *_gap_notes(rows.times_s), *check_rows(rows, robot)]
    notes += [
        f"the {side} arm was not recorded: shown in neutral" for side in LIMBS if side not in limbs
    ]
    percent = np.empty((len(rows.times_s), len(LIMBS)))
    for i, side in enumerate(LIMBS):
        absent = np.full(len(rows.times_s), np.nan)
        percent[:, i], odd = _gripper(measured.percent.get(side, absent), side)
        notes += odd if side in limbs or side in measured.percent else ()
    recording = Recording(
        joint_names=robot.joint_names,
        times_s=rows.times_s,
        q=_configurations(robot, rows.joints, percent),
        gripper_percent=percent,
        bodies={},
        body_poses={},
        captions=((float(rows.times_s[0]), ""),),
        events=(),
        limbs=limbs,
    )
    return NotedRecording(recording, tuple(notes))


def _gap_notes(times: FloatArray) -> list[str]:
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
        f"{count(gaps.size, 'gap')} in time, {pauses[gaps].sum():.3f} s in all, the longest of "
        f"{pauses[longest]:.3f} s at {times[longest]:.3f} s, where a row usually follows after "
        f"{usual:.4g} s"
    ]


def _gripper(percent: FloatArray, side: str) -> tuple[FloatArray, list[str]]:
    """Positions inside 0 .. 100, and what was odd about them."""
    notes = []
    absent = np.isnan(percent)
    if absent.any():
        where = "" if absent.all() else f" in {count(int(absent.sum()), 'row')}"
        notes.append(f"the {side} gripper was not recorded{where}: shown open")
    filled = np.where(absent, NO_GRIPPER_PERCENT, percent)
    clipped = np.clip(filled, 0.0, 100.0)
    odd = clipped != filled
    if odd.any():
        notes.append(
            f"the {side} gripper was outside 0 .. 100 % in {count(int(odd.sum()), 'row')}, "
            f"from {filled.min():.6g} to {filled.max():.6g} %: taken as the nearer end"
        )
    return clipped, notes


def _configurations(
    robot: Baxter, joints: Mapping[str, FloatArray], percent: FloatArray
) -> FloatArray:
    """Full configurations, shape (n, 19): joints as measured, the rest in neutral."""
    q = np.tile(robot.configuration(), (len(percent), 1))
    for i, side in enumerate(LIMBS):
        if finger_joints(side)[0] not in robot.joint_names:
            continue
        first, second = robot.indices(finger_joints(side))
        q[:, first] = percent[:, i] / 100.0 * robot.model.upperPositionLimit[first]
        q[:, second] = -q[:, first]
    for name, values in joints.items():
        if name in robot.joint_names:
            q[:, robot.indices((name,))[0]] = values
    return q
