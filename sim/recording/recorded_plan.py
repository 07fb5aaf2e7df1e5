"""Plans made of recordings: what an arm did, smooth, within all limits, and near what was recorded.

The positions are those of the recording, commanded ones of a simulation, measured ones of a robot.
A measured arm lags behind its commands; that lag is a part of the recording, and remains. Where the
opening of the gripper changes, the arm comes to rest, the gripper acts, and the motion continues; a
recording in which the arm moves meanwhile is refused.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from baxter_kin import Baxter
from baxter_kin.display import count, quoted, seconds
from baxter_kin.fields import evolve, frozen, scalar
from baxter_kin.kinematics.arm import LIMBS, arm_joints
from baxter_kin.validation import FloatArray, expect, positive_scalar
from planner import (
    Certificate,
    Grip,
    GripperAction,
    Manipulator,
    Move,
    Plan,
    PlanFailure,
    Scene,
    State,
    Trajectory,
    complete,
    verify,
)
from planner.completion import after
from planner.errors import MotionError
from planner.grasping.grasp import Grasp
from planner.motion.recorded.fastest import as_fast_as_possible
from planner.motion.recorded.smoothing import NearMotion, at_recorded_speed
from planner.plan import Step
from sim.errors import RecordingError
from sim.recording.recording import Recording, checked_limb

Speed: TypeAlias = "Literal['recorded', 'fastest'] | float"
"""The recorded speed, a multiple of it, or the fastest that the limits allow."""

MAX_TOLERANCE_RAD = 0.5
"""Greater tolerances have nothing to do with what was recorded."""

SPEEDS, MAX_RATIO = ("recorded", "fastest"), 100.0
"""The speeds that have a name; and the greatest ratio, whose inverse is the smallest."""

LABEL = "replay"

MAX_GAP_S = 0.5
"""Longest time without samples in which the arm may have moved."""

ACTED_PERCENT, STEADY_PERCENT, STEADY_S = 3.0, 0.5, 0.1
"""Change of a gripper's opening that is an action; it ends when the opening has changed by less
than the second value for the time."""

OPEN_PERCENT = 95.0
"""From here on a gripper is wide open."""


@frozen(error=RecordingError)
class RecordedPlan:
    """The plan of a recording, and how near it is to what was recorded.

    Attributes:
        plan: moves and grips in order; invalid, with the reason, where the limits forbid the
            tolerance at the speed that was asked for, or where it is not certified.
        tolerance_rad: allowed difference of each joint from each recorded position.
        deviation_rad: greatest difference of any motion found at that speed: at the time of each
            sample, or, of the fastest motion, from its nearest point.
        joint: of which joint.
        time_s: when, in the recording's time.
        certificate: what was proven in the scene that was given; None without a scene.
        fastest: where the recorded speed is impossible, the fastest plan; else None.

    Raises:
        RecordingError: when a value has the wrong type.
    """

    plan: Plan
    tolerance_rad: float = scalar()
    deviation_rad: float = scalar()
    joint: str
    time_s: float = scalar()
    certificate: Certificate | None = None
    fastest: RecordedPlan | None = None

    @property
    def is_valid(self) -> bool:
        """Whether the plan may be executed."""
        return self.plan.is_valid

    @property
    def excess_rad(self) -> float:
        """By how much the limits force the motion out of the tolerance; 0 where they do not."""
        return max(0.0, self.deviation_rad - self.tolerance_rad)

    @property
    def duration_s(self) -> float:
        """Total duration of the moves."""
        return self.plan.motion_time_s

    def _facts(self) -> tuple[str, ...]:
        off = f"at most {1e3 * self.deviation_rad:.1f} mrad off ({self.joint}, {self.time_s:.2f} s)"
        verdict = "valid" if self.plan.failure is None else f"invalid: {self.plan.failure}"
        return (
            self.plan.limb,
            count(len(self.plan.steps), "step"),
            seconds(self.duration_s),
            off,
            verdict,
        )


def motion_from(
    recording: Recording,
    limb: str,
    *,
    tolerance_rad: float,
    speed: Speed = "recorded",
    scene: Scene | None = None,
    manipulator: Manipulator | None = None,
) -> RecordedPlan:
    """The motion of a recorded arm as a plan: smooth, within all limits, and near every sample.

    At the recorded speed or a multiple of it, every joint is within the tolerance of every sample
    at its time. As fast as possible, pauses are left out, and every sample is within the tolerance
    of the path. A recording that begins or ends in motion is run more slowly there, from and to
    rest. The tolerance is one of joints: 10 mrad are about 8 mm at the tip. It should be five times
    the noise.

    One arm is planned, and the other stands where it was at the beginning; call it twice for both.

    Args:
        recording: of a simulation, or of a robot, from any file that `read_recording` reads.
        limb: "left" or "right".
        tolerance_rad: allowed difference of each joint from each sample, rad.
        speed: "recorded", a multiple of it, or "fastest".
        scene: all bodies when the recording begins. The plan is then verified; what stands between
            the fingers is grasped.
        manipulator: the arm, with its limits; that of the stock robot when not given.

    Raises:
        RecordingError: when an argument is invalid, the arm was not recorded, it moves in a time
            without samples or while its gripper acts, or no motion is found.
        UnknownNameError: when there is no such limb.
    """
    tolerance_rad = positive_scalar(tolerance_rad, "tolerance_rad", RecordingError)
    if tolerance_rad > MAX_TOLERANCE_RAD:
        raise RecordingError(
            f"tolerance_rad must be at most {MAX_TOLERANCE_RAD:g} rad, got {tolerance_rad:g}"
        )
    request = _Request.of(recording, limb, tolerance_rad, scene, manipulator)
    return request.plan(_checked_speed(speed))


def _checked_speed(speed: object) -> Speed:
    if isinstance(speed, str):
        if speed not in SPEEDS:
            raise RecordingError(f"speed must be {quoted(SPEEDS)}, or a ratio, got {quoted(speed)}")
        return "fastest" if speed == "fastest" else "recorded"
    ratio = positive_scalar(speed, "speed", RecordingError)
    if not 1.0 / MAX_RATIO <= ratio <= MAX_RATIO:
        raise RecordingError(f"speed must be {1 / MAX_RATIO:g} to {MAX_RATIO:g}, got {ratio:g}")
    return ratio


class _Action(NamedTuple):
    """A change of the opening of a gripper.

    Attributes:
        first: row of the last sample before it.
        last: row of the sample at which it has ended.
        percent: opening then.
        action: what the gripper does.
    """

    first: int
    last: int
    percent: float
    action: GripperAction


class _Track(NamedTuple):
    """The samples of an arm between two actions of its gripper, and the one that follows.

    Attributes:
        times_s: in the recording's time, shape (m,).
        q: shape (m, 7), rad.
        then: the action; None at the end of the recording.
    """

    times_s: FloatArray
    q: FloatArray
    then: _Action | None

    def near(
        self, speed: Speed, arm: Manipulator, tolerance_rad: float, q: FloatArray | None
    ) -> NearMotion:
        """The motion near the samples at a speed, from `q` where that is given."""
        ratio = speed if isinstance(speed, (int, float)) else 1.0
        times_s = (self.times_s - self.times_s[0]) / ratio
        make = as_fast_as_possible if speed == "fastest" else at_recorded_speed
        try:
            return make(times_s, self.q, arm.limits, tolerance_rad, q)
        except MotionError as cause:
            raise RecordingError(
                f"from {self.times_s[0]:.2f} s to {self.times_s[-1]:.2f} s: {cause}"
            ) from cause


@dataclass(frozen=True, slots=True, eq=False)
class _Request:
    """What a plan is made of.

    Attributes:
        tracks: the samples of the arm, cut at the actions of its gripper.
        tolerance_rad: allowed difference from them.
        arm: the arm that moves.
        start: all joints and bodies when the recording begins.
        is_verified: whether the plan is to be verified among these bodies.
    """

    tracks: Sequence[_Track]
    tolerance_rad: float
    arm: Manipulator
    start: State
    is_verified: bool

    @classmethod
    def of(
        cls,
        recording: Recording,
        limb: str,
        tolerance_rad: float,
        scene: Scene | None,
        manipulator: Manipulator | None,
    ) -> _Request:
        """The request, after its parts are checked."""
        names = arm_joints(checked_limb(limb))
        expect(recording, Recording, "recording", RecordingError)
        if limb not in recording.limbs:
            raise RecordingError(f"the recording has the {recording.limbs[0]} arm alone")
        arm = Manipulator.of(Baxter.load(), limb) if manipulator is None else manipulator
        if expect(arm, Manipulator, "manipulator", RecordingError).arm.side != limb:
            raise RecordingError(f"limb is {quoted(limb)}, the manipulator is the other arm")
        own = arm.robot.description.identity
        difference = "" if recording.robot is None else own.difference(recording.robot)
        if difference:
            raise RecordingError(f"the recording is of another robot: {difference}; give that one")
        bodies = Scene({}) if scene is None else expect(scene, Scene, "scene", RecordingError)
        first = dict(zip(recording.joint_names, recording.q[0].tolist(), strict=True))
        state = State.of(arm, bodies)
        known = {name: first.get(name, value) for name, value in state.joints.items()}
        q = recording.q[:, [recording.joint_names.index(name) for name in names]]
        tracks = list(
            _tracks(recording.times_s, q, recording.gripper_percent[:, LIMBS.index(limb)])
        )
        if not tracks:
            raise RecordingError("the recording has a single snapshot, in which nothing moves")
        for track in tracks:
            _check_gaps(track, names, tolerance_rad)
            if track.then is not None:
                _check_rest(track.then, recording.times_s, q, names, tolerance_rad)
        start = evolve(state, joints=known)
        return cls(tracks, tolerance_rad, arm, start, scene is not None)

    def plan(self, speed: Speed) -> RecordedPlan:
        """The plan at a speed; invalid, with the fastest one, where the limits forbid that."""
        found: list[NearMotion] = []
        for track in self.tracks:
            q = found[-1].trajectory.q_goal if found else None
            found.append(track.near(speed, self.arm, self.tolerance_rad, q))
        worst = max(range(len(found)), key=lambda i: found[i].deviation_rad)
        off_rad = np.abs(found[worst].off_rad)
        row, joint = np.unravel_index(int(off_rad.argmax()), off_rad.shape)
        made = RecordedPlan(
            plan=self._plan([near.trajectory for near in found]),
            tolerance_rad=self.tolerance_rad,
            deviation_rad=found[worst].deviation_rad,
            joint=self.arm.arm.joint_names[joint],
            time_s=float(self.tracks[worst].times_s[row]),
        )
        if not made.excess_rad:
            return self._verified(made) if self.is_verified else made
        if speed == "fastest":
            return _refused(made, _not_found(made))
        fastest = None
        with suppress(RecordingError):  # then none is offered
            fastest = self.plan("fastest")
        return _refused(evolve(made, fastest=fastest), _reason(made, fastest))

    def _plan(self, trajectories: Sequence[Trajectory]) -> Plan:
        q_start = trajectories[0].q_start
        state = self.start.moved(self.arm.robot, self.arm.arm.joints(q_start))
        start, steps = state, list[Step]()
        for track, trajectory in zip(self.tracks, trajectories, strict=True):
            if trajectory.duration > 0.0:
                T_base_tip = self.arm.arm.T_base_tip(trajectory.q_goal)
                steps.append(Move(LABEL, trajectory, T_base_tip, state=state))
                state = after(steps[-1], state, self.arm)
            grip = None if track.then is None else self._grip(track.then, state)
            if grip is not None:
                steps.append(evolve(grip, state=state))
                state = after(grip, state, self.arm)
        plan = Plan(start, tuple(steps), robot=self.arm.identity, limb=self.arm.arm.side)
        return complete(plan, manipulator=self.arm)

    def _grip(self, action: _Action, state: State) -> Grip | None:
        """What the gripper does in a state; None where it closes further on what it holds."""
        held, label = state.holding(self.arm.arm.side), f"{LABEL}: {action.action.value}"
        if action.action is GripperAction.CLOSE:
            return None if held else Grip(label, action.action, body=self._between(state))
        stroke_m = self.arm.hand.stroke_m
        is_wide = action.percent >= OPEN_PERCENT
        opening_m = None if is_wide else stroke_m * action.percent / 100.0
        return Grip(label, action.action, held.body if held else None, opening_m)

    def _between(self, state: State) -> str | None:
        """The body between the fingers."""
        hand, arm = self.arm.hand, self.arm.arm
        T_base_tip = arm.T_base_tip(state.q(arm.joint_names))
        opening_m = state.joints[hand.joint_names[0]]
        grasps = ((body.name, hand.close_on(T_base_tip, body, opening_m)) for body in state.scene)
        return next((name for name, grasp in grasps if isinstance(grasp, Grasp)), None)

    def _verified(self, made: RecordedPlan) -> RecordedPlan:
        certificate = verify(made.plan, description=self.arm.robot.description)
        proven = evolve(made, certificate=certificate)
        return proven if certificate.is_valid else _refused(proven, certificate.verdict)


def _refused(made: RecordedPlan, reason: str) -> RecordedPlan:
    return evolve(made, plan=evolve(made.plan, failure=PlanFailure(LABEL, reason)))


def _not_found(made: RecordedPlan) -> str:
    """Why there is no fastest motion: a search that fails proves nothing about the limits."""
    tolerance, deviation = 1e3 * made.tolerance_rad, 1e3 * made.deviation_rad
    return (
        f"no fastest motion was found within {tolerance:g} mrad of the recording: the nearest one "
        f"found takes {made.joint} {deviation:.1f} mrad off at {made.time_s:.2f} s; try a greater "
        "tolerance, or speed='recorded'"
    )


def _reason(made: RecordedPlan, fastest: RecordedPlan | None) -> str:
    """Why the limits forbid the speed, and what would do."""
    tolerance, deviation = 1e3 * made.tolerance_rad, 1e3 * made.deviation_rad
    text = (
        f"the limits take {made.joint} {deviation:.1f} mrad off the recording at "
        f"{made.time_s:.2f} s, and {tolerance:g} mrad are allowed; a tolerance of "
        f"{math.ceil(deviation)} mrad would do"
    )
    if fastest is None or not fastest.is_valid:
        return text
    return f"{text}, or speed='fastest', which takes {seconds(fastest.duration_s)}"


def _tracks(times_s: FloatArray, q: FloatArray, percent: FloatArray) -> Iterator[_Track]:
    """The samples, cut where the gripper acts; those during an action belong to no track."""
    first = 0
    for action in (*_actions(times_s, percent), None):
        last = len(times_s) if action is None else action.first + 1
        rows = slice(first, max(last, first + 2))
        if len(times_s[rows]) > 1:
            yield _Track(times_s[rows], q[rows], action)
        first = 0 if action is None else action.last


def _actions(times_s: FloatArray, percent: FloatArray) -> Iterator[_Action]:
    before, row = 0, 1
    while row < len(percent):
        change = percent[row] - percent[before]
        if abs(change) < ACTED_PERCENT:
            row += 1
            continue
        still = np.flatnonzero(np.abs(percent[:row] - percent[before]) <= STEADY_PERCENT)
        last = _steady(times_s, percent, row)
        kind = GripperAction.OPEN if change > 0.0 else GripperAction.CLOSE
        yield _Action(int(still[-1]), last, float(percent[last]), kind)
        before, row = last, last + 1


def _steady(times_s: FloatArray, percent: FloatArray, row: int) -> int:
    """The first row from which the opening stays for a time, or the last row."""
    for i in range(row, len(percent)):
        near = percent[i : int(np.searchsorted(times_s, times_s[i] + STEADY_S)) + 1]
        if np.ptp(near) <= STEADY_PERCENT:
            return i
    return len(percent) - 1


def _check_gaps(track: _Track, names: Sequence[str], tolerance_rad: float) -> None:
    moved = np.abs(np.diff(track.q, axis=0))
    gaps_s = np.diff(track.times_s)
    for i in np.flatnonzero((gaps_s > MAX_GAP_S) & (moved.max(axis=1) > tolerance_rad)).tolist():
        joint = int(moved[i].argmax())
        raise RecordingError(
            f"the recording has no samples from {track.times_s[i]:.2f} s to "
            f"{track.times_s[i + 1]:.2f} s, when {names[joint]} moved by {moved[i, joint]:.3g} "
            "rad; cut it there"
        )


def _check_rest(
    action: _Action, times_s: FloatArray, q: FloatArray, names: Sequence[str], tolerance_rad: float
) -> None:
    """Refuse a recording whose arm moves while its gripper acts, as the plan makes it stand."""
    moved = np.abs(q[action.first : action.last + 1] - q[action.first])
    row, joint = np.unravel_index(int(moved.argmax()), moved.shape)
    if moved[row, joint] > tolerance_rad:
        raise RecordingError(
            f"the gripper acts from {times_s[action.first]:.2f} s to {times_s[action.last]:.2f} s, "
            f"when {names[int(joint)]} moved by {moved[row, joint]:.3g} rad (at "
            f"{times_s[action.first + row]:.2f} s); the arm must stand meanwhile, within "
            f"{tolerance_rad:g} rad"
        )
