"""The RSDK's CSV, written: of a recording as it happened, or of a plan for a robot to play back.

A simulated hand closes on its body in hundredths of a second and the arm leaves at once. A robot
that plays such a file lags, and leaves before it grips. A plan is therefore written with its
grippers as commanded, 0 % to close, and a dwell before and after, so that the arm stands while the
fingers move and has settled before they do.

Such a file is for `joint_trajectory_file_playback.py` of Rethink's examples, with its joint
trajectory action server: it keeps the times of the rows, goes slowly to the first one, and stops
where a joint is more than 0.2 rad off. Plan it at a speed ratio of 0.25 or less: a Baxter lags
0.4 s behind, so these 0.2 rad are met at 0.5 rad/s, and the demo's plan, whose joints reach such
speeds only shortly, came to 0.09 rad at a ratio of 0.3. `joint_position_file_playback.py` plays the
file, too, but nothing stops it, and it leaves the robot at its own speed ratio: 0.3 by default,
which caps joints at 0.6 rad/s and wrists at 1.2, above the 0.375 and 1.0 of a plan at 0.25. Both
scripts take *both* arms to the first row, on a way that nobody has checked.

Nothing there knows for which robot the set-points are. Those of a plan for Baxter as it is drawn
put the hand of a real one 9 to 13 mm beside, so whoever writes such a file is warned.
"""

from __future__ import annotations

import logging

import numpy as np

from baxter_kin.description import RobotDescription, RobotIdentity
from baxter_kin.display import OneLine, shown_path
from baxter_kin.fields import NotCopied
from baxter_kin.files import PathLike
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray, expect, finite_scalar
from planner import Grip, GripperAction, Move, Plan
from planner.grasping.finger_travel import FINGER_SPEED_M_S
from sim.errors import RecordingError
from sim.outcome import LONGEST_DWELL_S, ROBOT_DWELL_S
from sim.recording.recorded_motion import arm_joints, finger_joints
from sim.recording.recording import Recording
from sim.recording.rsdk_csv import CsvFile, arm_indices
from sim.timeline import DEFAULT_TICK_S, Clock

logger = logging.getLogger(__name__)

STROKE_M = 0.020833
"""A finger's travel from 0 to 100 %, of the electric gripper in Rethink's URDF."""

TRAVEL_S = STROKE_M / FINGER_SPEED_M_S
"""What the fingers are given for any way, on top of the dwells."""

SAME_RAD = 1e-6
"""How far an arm may stand from where the next plan starts."""


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
        if not 0.0 <= self._dwell_s <= LONGEST_DWELL_S:
            raise RecordingError(f"dwell_s must be 0 to {LONGEST_DWELL_S:g} s, got {dwell_s:g} s")
        self._file, self._path = CsvFile(path), path
        self._clock = Clock(DEFAULT_TICK_S)
        self._arms: dict[str, FloatArray] = {}
        self._percent: dict[str, float] = {}

    def __enter__(self) -> PlanCsvFile:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def add(self, plan: Plan) -> None:
        """Write the steps of a plan.

        Raises:
            RecordingError: when it has the wrong type, is invalid, does not say where the other
                arm stands, or starts elsewhere than the last one ended; or when the file cannot be
                written.
        """
        self._begin(expect(plan, Plan, "plan", RecordingError))
        for step in plan:
            if isinstance(step, Move):
                self._move(plan.limb, step)
            else:
                self._grip(plan.limb, step)

    def close(self) -> None:
        """Write where everything ends, and close; twice is no trouble.

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
        if off > SAME_RAD:
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

    def _grip(self, limb: str, grip: Grip) -> None:
        self._stand(self._dwell_s)
        if grip.action is GripperAction.CLOSE:
            self._percent[limb] = 0.0
        else:
            self._percent[limb] = 100.0 if grip.opening_m is None else _percent(grip.opening_m)
        self._stand(TRAVEL_S + self._dwell_s)

    def _stand(self, duration_s: float) -> None:
        self._clock.advance(duration_s, lambda _: None, self._write)

    def _write(self) -> None:
        joints = [x for side in LIMBS for x in self._arms[side].tolist()]
        self._file.write_row(self._clock.time_s, joints, [self._percent[side] for side in LIMBS])


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


def write_csv(what: Recording | Plan, path: PathLike, *, dwell_s: float | None = None) -> None:
    """Write a recording, or a plan for a robot to play back, as the RSDK's CSV.

    A recording is written as it happened, of one arm alone when no more was recorded. A plan is
    written as it is commanded, at 100 Hz, its grippers with dwells: for
    `joint_trajectory_file_playback.py`, planned at a speed ratio of at most 0.25
    (`sim.recording.csv_writing` says why). A plan for Baxter as it is drawn is written with a
    warning in the log.

    Args:
        what: what to write.
        path: the file; an older one is replaced.
        dwell_s: of a plan: how long the arm stands before each gripper action and after it, 0 to
            60 s; 1 s when not given.

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
    told = expect(what, Recording, "what is written: a plan, or else the recording", RecordingError)
    if dwell_s is not None:
        raise RecordingError("dwell_s is for plans; a recording is written as it happened")
    indices = arm_indices(told.joint_names, told.limbs)
    percent = told.gripper_percent[:, [LIMBS.index(side) for side in told.limbs]]
    with CsvFile(path, told.limbs) as file:
        for time_s, q, grippers in zip(told.times_s, told.q, percent, strict=True):
            file.write(float(time_s), q[indices], grippers)


def _refuse_invalid(plan: Plan) -> None:
    if plan.failure is not None:
        raise RecordingError(f"an invalid plan cannot be executed: {plan.failure}")


def _start(plan: Plan) -> tuple[dict[str, FloatArray], dict[str, float]]:
    """Where both arms stand and what both grippers were told before a plan's first step."""
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
