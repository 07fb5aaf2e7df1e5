"""ArmStream: set-points sent at 100 Hz, and all that is watched meanwhile.

At every tick the stop causes are asked first, so that nothing is sent after one; then the set-point
is sent, and then the guard looks at what was measured. The arm is commanded without a break from
the first set-point to the last, also while it stands.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np

from baxter_kin.fields import evolve
from baxter_kin.validation import FloatArray
from planner.motion.tracking_tube import SETTLED_RAD
from sim.ros1.execution.guard.path_guard import PathGuard
from sim.ros1.execution.guard.stages import Room
from sim.ros1.execution.guard.watch import Watch
from sim.ros1.execution.link.baxter_link import BaxterLink
from sim.ros1.execution.link.channel import ArmChannel
from sim.ros1.execution.link.joint_table import ArmReading
from sim.ros1.execution.stops import Stop, StopCause
from sim.ros1.execution.stream.set_points import SentMotion, SetPoint
from sim.ros1.execution.stream.ticks import PlanTime, Schedule
from sim.samples import Sample

SETTLED_RAD_S = 0.02
"""An arm has arrived when no joint is farther off, half a degree as in the original, or faster."""

SETTLE_TIMEOUT_S = 8.0

HOLD_S = 1.0
"""For so long an arm is told to stay where it is after a stop."""


class ArmStream:
    """Drives one arm.

    Attributes:
        lateness_s: of every tick so far.
        label: what is under way.
        last_sent_s: when the last set-point was sent, on the monotonic clock.
    """

    def __init__(
        self,
        link: BaxterLink,
        channel: ArmChannel,
        watch: Watch,
        names: tuple[str, ...],
        tell: Callable[[Sample], None],
        *,
        rest_s: float = 0.0,
    ) -> None:
        """Send nothing yet.

        Args:
            link: what is measured.
            channel: where set-points go.
            watch: why to stop.
            names: of the joints.
            tell: gets every tick; must be quick.
            rest_s: how long the last set-point of a motion stands at least.
        """
        self._link, self._channel, self._watch, self._names = link, channel, watch, names
        self._tell, self._rest_s = tell, rest_s
        self._begin_s = time.monotonic()
        self._schedule = Schedule(self._begin_s)
        self._guard: PathGuard | None = None
        self._end_s = np.inf
        self._timeout_s = np.inf
        self._last: SetPoint | None = None
        self._was_connected = False
        self.lateness_s: list[float] = []
        self.label = ""
        self.last_sent_s = 0.0

    @property
    def time_s(self) -> float:
        """Since the stream was made."""
        return time.monotonic() - self._begin_s

    def limit(self, timeout_s: float) -> None:
        """Stop when so much time has passed from now."""
        self._timeout_s = timeout_s
        self._end_s = time.monotonic() + timeout_s

    def guarded_by(self, guard: PathGuard) -> None:
        """From now on that guard looks."""
        self._guard = guard

    def follow(
        self, motion: SentMotion, rooms: Sequence[Room], started: Callable[[int], None]
    ) -> Stop | None:
        """Carry out a motion and wait until the arm has settled; returns why it ended early.

        Args:
            motion: what is sent.
            rooms: by how much each of its moves is clear.
            started: told the number of each move as it begins.
        """
        clock, number, end_s = PlanTime(time.monotonic()), -1, motion.trajectory.duration
        settle_by_s = np.inf
        while True:
            now_s = self._wait()
            plan_s = min(clock.advance(now_s) * motion.pace.speed, end_s)
            while number < motion.number_at(plan_s):
                number += 1
                self.label = motion.moves[number].label
                started(number)
            stop = self._step(now_s, motion.at(plan_s), rooms[number])
            if stop is not None:
                return stop
            if plan_s >= end_s:
                settle_by_s = min(settle_by_s, now_s + SETTLE_TIMEOUT_S)
                reading = self._reading()
                goal = motion.trajectory.q_goal
                if _is_settled(reading, goal, settle_by_s - SETTLE_TIMEOUT_S + self._rest_s):
                    return None
                if now_s > settle_by_s:
                    return self._told(_unsettled(reading, goal, self._names))

    def stand(
        self, is_done: Callable[[float], bool | Stop], at: SetPoint, room: Room
    ) -> Stop | None:
        """Stay at a set-point until something is done, which is asked at every tick.

        Args:
            is_done: given the time on the monotonic clock; a stop ends it early.
            at: where.
            room: by how much the arm is clear there.
        """
        while True:
            now_s = self._wait()
            stop = self._step(now_s, at, room)
            if stop is not None:
                return stop
            answer = is_done(now_s)
            if isinstance(answer, Stop):
                return self._told(answer)
            if answer:
                return None

    def hold(self) -> None:
        """Tell the arm to stay where it is measured, for `HOLD_S`, unless the robot is stopped."""
        reading = self._link.joints.arm(self._names)
        if reading is None:
            return
        end_s = time.monotonic() + HOLD_S
        self._schedule = Schedule(time.monotonic())
        while (now_s := self._wait()) < end_s:
            stop = self._watch.stop(now_s)
            if stop is not None and not stop.cause.holds:
                return
            self._send(now_s, SetPoint(reading.q, reading.q))

    def _wait(self) -> float:
        """Wait for the next tick; returns the time when it came, on the monotonic clock."""
        time.sleep(max(0.0, self._schedule.due_s - time.monotonic()))
        now_s = time.monotonic()
        self.lateness_s.append(self._schedule.came(now_s))
        return now_s

    def _step(self, now_s: float, at: SetPoint, room: Room) -> Stop | None:
        stop = self._stop(now_s)
        if stop is not None:
            return self._told(stop)
        reading = self._send(now_s, at)
        if self._guard is None or reading is None:
            return None
        self._guard.passes(now_s, at.q_path, room)
        alarm = self._guard.look(reading.q, at.q_path)
        if alarm is None:
            return None
        cause, subject, value, bound = alarm
        return self._told(Stop(cause, subject=subject, value=value, bound=bound))

    def _stop(self, now_s: float) -> Stop | None:
        found = self._watch.stop(now_s)
        if found is not None:
            return found
        if now_s > self._end_s:
            return Stop(StopCause.TIME_OUT, bound=self._timeout_s)
        is_connected = bool(self._channel.readers)
        if self._was_connected and not is_connected:
            return Stop(StopCause.CONNECTION_LOST, detail="nobody takes the set-points any more")
        self._was_connected = is_connected
        return None

    def _send(self, now_s: float, at: SetPoint) -> ArmReading | None:
        self._channel.send(at.q_sent)
        self.last_sent_s, self._last = time.monotonic(), at
        reading, robot = self._reading(), self._link.robot
        if reading is None or robot is None:
            return reading
        sample = Sample(
            now_s - self._begin_s,
            self._channel.limb,
            at.q_path,
            at.q_sent,
            reading.q,
            reading.v,
            now_s - reading.time_s,
            self.lateness_s[-1],
            robot.is_enabled,
            robot.is_stopped,
            robot.has_error,
        )
        self._tell(sample)
        return reading

    def _reading(self) -> ArmReading | None:
        return self._link.joints.arm(self._names)

    def _told(self, stop: Stop) -> Stop:
        return evolve(stop, label=self.label, time_s=self.time_s)


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
    detail = f"{SETTLED_RAD:g} rad are allowed, and {SETTLED_RAD_S:g} rad/s"
    return Stop(
        StopCause.NOT_SETTLED,
        subject=names[worst],
        value=float(off[worst]),
        bound=SETTLE_TIMEOUT_S,
        detail=detail,
    )
