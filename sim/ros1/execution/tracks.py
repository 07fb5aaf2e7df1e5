"""Tracks: the arms of an execution, each with its channel, its guard and its step."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from baxter_kin.validation import FloatArray
from planner import Grip, GripperAction, Move, TwoArmPlan
from planner.completion import state_of
from planner.motion.tracking_tube import SETTLED_RAD
from sim.events import Sample
from sim.ros1.execution.channel import ArmChannel, GripperCommand
from sim.ros1.execution.guard import MoveClearance, PathGuard
from sim.ros1.execution.link import ArmReading, BaxterLink
from sim.ros1.execution.readiness.ready import ReadyPlan
from sim.ros1.execution.set_points import SentMotion, SetPoint
from sim.ros1.execution.stops import Stop, StopCause

SETTLED_RAD_S = 0.02
"""An arm has arrived when no joint is farther off, half a degree as in the original, or faster."""

SETTLE_TIMEOUT_S = 8.0


class Track:
    """One arm of an execution: its channel, its guard, and the step that is under way.

    Attributes:
        ready: the arm's own plan.
        limb: "left" or "right".
        channel: to the arm and its gripper.
        label: of the step that is under way; empty before the first.
        stand: the set-point where the arm rests.
        samples: of all ticks.
    """

    def __init__(self, link: BaxterLink, ready: ReadyPlan) -> None:
        self._link, self.ready, self.limb = link, ready, ready.plan.limb
        self.arm, self._hand = ready.manipulator.arm, ready.manipulator.hand
        self.channel = ArmChannel(link, self.limb)
        self.guard: PathGuard | None = None
        self.clearance: MoveClearance | None = None
        self.stand = SetPoint(ready.plan.q_start, ready.plan.q_start)
        self.label = ""
        self.samples: list[Sample] = []
        self._was_connected = False

    def guarded(
        self, parts: Iterable[SentMotion | Grip]
    ) -> Iterator[tuple[SentMotion | Grip, PathGuard | None]]:
        """Motions and actions of the fingers, each with the guard that then checks.

        Between two actions nothing changes but the arm, so one guard checks all motions there.
        """
        guard: PathGuard | None = None
        has_acted = True
        for part in parts:
            if isinstance(part, SentMotion) and has_acted:
                context = self.ready.manipulator.at(state_of(part.moves[0]))
                guard = PathGuard(context, self.arm.joint_names)
            has_acted = isinstance(part, Grip)
            yield part, guard

    @property
    def reading(self) -> ArmReading | None:
        """Where the arm was measured last."""
        return self._link.joints.arm(self.arm.joint_names)

    def command(self, grip: Grip) -> GripperCommand:
        """Send an action to the gripper."""
        dwell, opening_m = self.ready.options.dwell, self._hand.stroke_m
        if grip.opening_m is not None:
            opening_m = min(grip.opening_m, opening_m)
        is_close = grip.action is GripperAction.CLOSE
        return GripperCommand(
            self.channel,
            self._link,
            grip,
            open_percent=self._hand.percent(opening_m),
            dwell_s=dwell.after_grasp_s if is_close else dwell.after_release_s,
        )

    def connection_stop(self) -> Stop | None:
        """The stop where the robot does not receive the set-points any more, or None."""
        is_connected = bool(self.channel.readers)
        if self._was_connected and not is_connected:
            return Stop(
                StopCause.CONNECTION_LOST, detail="no node receives the set-points any more"
            )
        self._was_connected = is_connected
        return None

    def settled_stop(self, now_s: float, since_s: float) -> bool | Stop:
        """Whether the arm rests where it stands, whose set-point was sent first at `since_s`."""
        goal, reading = self.stand.q_path, self.reading
        if _is_settled(reading, goal, since_s + self.ready.options.rest_s):
            return True
        if now_s > since_s + SETTLE_TIMEOUT_S:
            return _unsettled(reading, goal, self.arm.joint_names)
        return False

    def path_stop(self, now_s: float, at: SetPoint, reading: ArmReading | None) -> Stop | None:
        """The stop where the arm is off its path, or None."""
        if self.guard is None or self.clearance is None or reading is None:
            return None
        self.guard.advance(now_s, at.q_path, self.clearance)
        return self.guard.check(reading.q, self.guard.path_at(reading.time_s))


class TimedTrack:
    """One arm on the common clock: the steps that have begun, and the set-point of each time.

    Attributes:
        track: the arm.
        grip: the gripper action that has begun and is not done; None where there is none.
        due_s: when it must be done, on the clock; infinite where there is none.
    """

    def __init__(self, track: Track, plan: TwoArmPlan) -> None:
        options = track.ready.options
        self.track, self._grip_s = track, plan.grip_s
        self._clearances = iter(track.ready.clearances)
        steps = [timed.step for timed in plan.steps_of(track.limb)]
        parts = [
            step if isinstance(step, Grip) else SentMotion([step], options.pace) for step in steps
        ]
        self._parts = list(track.guarded(parts))
        self._begins_s = plan.begins_s[track.limb]
        track.guard = next(guard for _, guard in self._parts if guard is not None)
        track.clearance = track.ready.clearances[0]
        self._begun, self._standing_s = 0, np.inf
        self._motion: SentMotion | None = None
        self._command: GripperCommand | None = None
        self.grip: Grip | None = None
        self.due_s = np.inf

    def begun(self, clock_s: float) -> Iterator[tuple[Move, MoveClearance]]:
        """Begin the steps whose time has come; gives the moves among them."""
        while self._begun < len(self._parts) and self._begins_s[self._begun] <= clock_s:
            part, guard = self._parts[self._begun]
            self.track.guard = guard or self.track.guard
            begin_s = self._begins_s[self._begun]
            self._begun += 1
            if isinstance(part, Grip):
                self.grip, self.due_s, self.track.label = part, begin_s + self._grip_s, part.label
                continue
            goal = part.trajectory.q_goal
            self._motion, self._motion_begin_s = part, begin_s
            self.track.stand, self._standing_s = SetPoint(goal, goal), np.inf
            yield part.moves[0], next(self._clearances)

    def at(self, clock_s: float, rate: float) -> SetPoint:
        """The set-point of a time, not before the last step that has begun."""
        motion = self._motion
        if motion is None or clock_s >= self._motion_begin_s + motion.trajectory.duration:
            return self.track.stand
        return motion.at(max(clock_s - self._motion_begin_s, 0.0), rate)

    def is_settled(self, now_s: float, at: SetPoint) -> bool | Stop:
        """Whether the arm rests at the end of its last motion; `at` was sent now."""
        if at is not self.track.stand:
            return False
        self._standing_s = min(self._standing_s, now_s)
        return self.track.settled_stop(now_s, self._standing_s)

    def act(self, now_s: float, at: SetPoint) -> float | Stop | None:
        """Let the fingers act once the arm has settled.

        Returns:
            The gripper's position, percent, when the action is done; None as long as it is not; why
            it failed.
        """
        if self.grip is None:
            return None
        if self._command is None:
            is_settled = self.is_settled(now_s, at)
            if is_settled is not True:
                return is_settled or None
            self._command = self.track.command(self.grip)
        is_done = self._command.is_done(now_s)
        if is_done is not True:
            return is_done or None
        percent = self._command.percent
        self._command, self.due_s = None, np.inf
        return percent


def _is_settled(reading: ArmReading | None, goal: FloatArray, since_s: float) -> bool:
    """Whether what was measured after a time is at a goal, at rest."""
    if reading is None or reading.time_s < since_s:
        return False
    is_there = bool((np.abs(reading.q - goal) <= SETTLED_RAD).all())
    return is_there and bool((np.abs(reading.v) <= SETTLED_RAD_S).all())


def _unsettled(reading: ArmReading | None, goal: FloatArray, names: tuple[str, ...]) -> Stop:
    if reading is None:
        return Stop(StopCause.CONNECTION_LOST, detail="no joint states")
    off = np.abs(reading.q - goal)
    worst = int(off.argmax())
    return Stop(
        StopCause.NOT_SETTLED,
        subject=names[worst],
        value=float(off[worst]),
        bound=SETTLE_TIMEOUT_S,
        detail=f"{SETTLED_RAD:g} rad are allowed, and {SETTLED_RAD_S:g} rad/s",
    )
