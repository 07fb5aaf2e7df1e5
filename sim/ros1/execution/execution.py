"""RosExecutor: executes a plan on a Baxter, as `Simulation.execute` does in a world.

An `Execution` is one plan on its way, from the first set-point to arms that stand. At every tick
the watch is asked first, so that nothing is sent once there is a reason to stop; then the
set-points are sent, and then the guards compare what was measured with the paths. Each arm
(`Track`) is commanded without a break from the first set-point to the last, also while it stands.

A plan of one arm goes step by step (`PlanExecution`), and one of both by a clock
(`TwoArmExecution`).
"""

from __future__ import annotations

import gc
import math
import time
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from typing import overload

import numpy as np

from baxter_kin import Arm
from baxter_kin.display import OneLine, seconds
from baxter_kin.fields import NotCopied, evolve, frozen
from baxter_kin.validation import FloatArray, expect, expect_all
from planner import Grip, Move, Plan, TwoArmPlan
from planner.motion.response import TICK_S
from planner.two_arms.tracking.clocked_arm import waits_of
from sim.errors import SimulationError
from sim.events import EventKind, Observer, Sample
from sim.ros1.execution.guard import MoveClearance, arms_stop
from sim.ros1.execution.link import ArmReading, BaxterLink
from sim.ros1.execution.readiness.plans import check_plan, check_two_arm_plan, check_unmoved
from sim.ros1.execution.readiness.ready import (
    ExecutionOptions,
    NotReadyError,
    Readiness,
    ReadyPlan,
    ReadyTwoArmPlan,
)
from sim.ros1.execution.set_points import (
    CommonClock,
    PlanTime,
    Schedule,
    SentMotion,
    SetPoint,
    parts_of,
    slowed,
    slowing_s_for,
)
from sim.ros1.execution.stops import Stop, StopCause, Watch
from sim.ros1.execution.tracks import TimedTrack, Track
from sim.ros1.execution.twin import Twin
from sim.ros1.transport.event_loop import quick_switches
from sim.simulation import Outcome

ENABLE = "/robot/set_super_enable"
ENABLE_S, ENABLE_HZ = 5.0, 20.0
"""How long, and how often, the robot is asked to switch its motors on."""

CONNECT_S = 3.0
"""A robot that subscribes to the set-points has connected by then."""

HOLD_S = 1.0
"""How long an arm is commanded to stay where it is after a stop."""

PHASE = 0.4
"""Share of a tick by which set-points follow joint states; these leave at the end of a tick."""

WINDOW = 150
"""Set-points of 1.5 s, the path that the tip is compared with afterwards."""


@frozen(error=SimulationError, eq=True)
class MeasuredOutcome(Outcome):
    """How the execution of a plan on a robot ended.

    Attributes:
        failure: None, or why it stopped early, as one sentence.
        duration_s: time it took.
        stop: the failure as facts.
        joint_deviation_rad: greatest distance of a joint from its path at the same instant.
        tip_deviation_m: greatest distance of the tip from its path, at any instant.
        lateness_s: of the set-points: median, 99th percentile and greatest.
    """

    stop: Stop | None = None
    joint_deviation_rad: float = 0.0
    tip_deviation_m: float = 0.0
    lateness_s: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def _facts(self) -> tuple[str, ...]:
        failure = "success" if self.failure is None else f"failed: {self.failure}"
        return seconds(self.duration_s), f"{self.joint_deviation_rad:.4f} rad off", failure


class RosExecutor(NotCopied, OneLine):
    """Drives the arms of a Baxter along plans, of one arm or of both."""

    def __init__(
        self,
        link: BaxterLink,
        observers: Iterable[Observer] = (),
        *,
        options: ExecutionOptions | None = None,
    ) -> None:
        """Prepare an executor; nothing is sent yet.

        Args:
            link: to the robot.
            observers: informed in this order, in a thread of their own; a `SampleObserver` gets
                every set-point as well.
            options: how plans are executed.

        Raises:
            SimulationError: when an argument has the wrong type.
        """
        self._link = expect(link, BaxterLink, "link", SimulationError)
        self._observers = expect_all(observers, Observer, "the observers", SimulationError)
        given = ExecutionOptions() if options is None else options
        self.options = expect(given, ExecutionOptions, "options", SimulationError)
        self._begin_s = time.monotonic()
        self._watch: Watch | None = None
        self._requested: StopCause | None = None

    @property
    def time_s(self) -> float:
        """Time since the executor was made."""
        return time.monotonic() - self._begin_s

    @overload
    def prepare(self, plan: Plan) -> Readiness[ReadyPlan]: ...
    @overload
    def prepare(self, plan: TwoArmPlan) -> Readiness[ReadyTwoArmPlan]: ...
    def prepare(self, plan: Plan | TwoArmPlan) -> Readiness[ReadyPlan] | Readiness[ReadyTwoArmPlan]:
        """Whether a plan may be executed on the robot as it stands; nothing is sent.

        Raises:
            SimulationError: when the plan is invalid.
            RosError: when the master cannot be reached.
        """
        if isinstance(plan, TwoArmPlan):
            return check_two_arm_plan(self._link, plan, self.options)
        return check_plan(self._link, plan, self.options)

    def stop(self, cause: StopCause = StopCause.SIGINT) -> None:
        """Request a stop, from another thread or a signal handler.

        One arm then holds; two slow down along their paths first.
        """
        self._requested = cause
        if self._watch is not None:
            self._watch.request(cause)

    def enable(self) -> None:
        """Switch the motors on, if they are off.

        Raises:
            SimulationError: when the robot is not enabled in time.
        """
        if self._is_enabled():
            return
        with closing(self._link.node.advertise(ENABLE, "std_msgs/Bool")) as publisher:
            end_s = time.monotonic() + ENABLE_S
            while not self._is_enabled():
                if time.monotonic() > end_s:
                    raise SimulationError(
                        f"the robot is not enabled after {ENABLE_S:g} s; a tucked one must be "
                        "untucked first"
                    )
                publisher.send(data=True)
                self._link.wait_until(self._is_enabled, 1.0 / ENABLE_HZ)

    def execute(
        self, plan: Plan | ReadyPlan | TwoArmPlan | ReadyTwoArmPlan, title: str = ""
    ) -> MeasuredOutcome:
        """Execute every step of a plan, or stop at the first that fails.

        Whatever stops one arm of a plan of both stops both.

        Args:
            plan: a valid plan, or one that was prepared right before, whose options count.
            title: put before each caption.

        Raises:
            NotReadyError: when a condition does not hold; nothing was sent then.
            SimulationError: when the plan is invalid, the arm was moved since it was prepared, or
                the robot cannot be enabled.
            RosError: when the master cannot be reached.
        """
        expect(title, str, "title", SimulationError)
        ready = plan if isinstance(plan, ReadyPlan | ReadyTwoArmPlan) else self._prepared(plan)
        arms = [ready] if isinstance(ready, ReadyPlan) else list(ready.arms.values())
        for arm in arms:
            check_unmoved(self._link, arm)
        self.enable()
        with self._execution(ready, title) as execution:
            self._watch = execution.watch
            if self._requested is not None:
                execution.watch.request(self._requested)
            try:
                return execution.run(self.time_s)
            finally:
                self._watch = None

    def _execution(self, ready: ReadyPlan | ReadyTwoArmPlan, title: str) -> Execution:
        if isinstance(ready, ReadyPlan):
            return PlanExecution(self._link, self._observers, ready, title)
        return TwoArmExecution(self._link, self._observers, ready, title)

    def _prepared(self, plan: Plan | TwoArmPlan) -> ReadyPlan | ReadyTwoArmPlan:
        readiness = self.prepare(plan)
        if readiness.ready is None:
            raise NotReadyError(readiness)
        return readiness.ready

    def _is_enabled(self) -> bool:
        report = self._link.robot
        return report is not None and report.is_enabled

    def _facts(self) -> tuple[str, ...]:
        return repr(self._link), repr(self.options.pace)


class Execution(ABC):
    """The execution of a plan of one arm or both; a context manager.

    Attributes:
        watch: ends it early.
        twin: informs the observers.
    """

    def __init__(
        self,
        link: BaxterLink,
        observers: tuple[Observer, ...],
        ready: ReadyPlan | ReadyTwoArmPlan,
        arms: Sequence[ReadyPlan],
        title: str,
    ) -> None:
        self._link, self._options, self._title = link, ready.options, title
        self._observers, self._robot, self._start = observers, ready.robot, ready.plan.start
        self._arms = arms
        self._tracks: tuple[Track, ...] = ()
        self._lateness_s: list[float] = []
        self._cleanup = ExitStack()

    def __enter__(self) -> Execution:
        with ExitStack() as cleanup:
            cleanup.enter_context(_short_collections())
            cleanup.enter_context(quick_switches())
            for ready in self._arms:
                track = Track(self._link, ready)
                cleanup.enter_context(track.channel)
                self._tracks = (*self._tracks, track)
            self.watch = Watch(self._link, [track.limb for track in self._tracks])
            self._compose()
            self.twin = Twin(self._robot, self._start, self._observers)
            self.twin.begin()
            cleanup.callback(self.twin.end)
            self._cleanup = cleanup.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._cleanup.close()

    def run(self, offset_s: float) -> MeasuredOutcome:
        """Execute the plan; events count their time from `offset_s` on."""
        channels = [track.channel for track in self._tracks]
        if not self._link.wait_until(lambda: all(each.readers for each in channels), CONNECT_S):
            raise SimulationError("the robot does not connect to the set-points; is it reachable?")
        self._offset_s, self._begin_s = offset_s, time.monotonic()
        self._schedule = Schedule(self._begin_s + self._phase_s(self._begin_s))
        self.watch.begin()
        for track in self._tracks:
            track.channel.begin(track.ready.ratio)
        self._tell(EventKind.ENABLED, "robot enabled")
        try:
            stop = self._interruptible_steps()
            if stop is not None and stop.cause.holds:
                self._end(stop)
        finally:
            for channel in channels:
                channel.end()
        return self._outcome(stop and self.watch.named(stop))

    @abstractmethod
    def _compose(self) -> None:
        """Prepare what is sent, before anything is timed."""

    @abstractmethod
    def _steps(self) -> Stop | None:
        """Execute all steps; returns why they ended early."""

    @abstractmethod
    def _end(self, stop: Stop) -> None:
        """Bring the arms to rest after a stop."""

    @property
    def _time_s(self) -> float:
        return time.monotonic() - self._begin_s

    def _phase_s(self, now_s: float) -> float:
        """Time until a robot that takes set-points as often as it reports is between two of these.

        It then takes those of one instant at the same time, and not one of them a tick later.
        """
        age_s = now_s - self._link.joints.latest_s
        return (PHASE * TICK_S - age_s) % TICK_S if math.isfinite(age_s) else 0.0

    @property
    def _label(self) -> str:
        """The steps under way; of both arms, with the arm."""
        if len(self._tracks) == 1:
            return self._tracks[0].label
        labels = (f"{track.limb}: {track.label}" for track in self._tracks if track.label)
        return "; ".join(labels)

    @property
    def _caption(self) -> str:
        return f"{self._title}{self._label}" if self._label else ""

    def _interruptible_steps(self) -> Stop | None:
        """Stop at the first Ctrl-C where nobody handles it; a second one is raised."""
        try:
            return self._steps()
        except KeyboardInterrupt:
            if self.watch.is_requested:
                raise
            self.watch.request(StopCause.SIGINT)
            return self._located(Stop(StopCause.SIGINT))

    def _start_move(self, track: Track, move: Move, clearance: MoveClearance) -> None:
        track.label, track.clearance = move.label, clearance
        sent = evolve(move, trajectory=slowed(move.trajectory, self._options.pace.speed))
        self._tell(EventKind.MOVE_STARTED, f"{self._title}{move.label}", track.limb, sent)

    def _gripped(self, track: Track, grip: Grip, percent: float) -> None:
        self.twin.put(self.twin.gripped, self._event_s, track.limb, grip, percent)

    def _missed(self, track: Track, stop: Stop) -> Stop:
        """Report a gripper that has missed; returns where it stopped."""
        event_s, located = self._event_s, self._located(stop, track)
        if stop.cause is StopCause.GRIPPER_MISSED:
            text = str(stop)
            self.twin.put(self.twin.notify, event_s, EventKind.MISSED, text, track.limb)
        return located

    def _hold(self) -> None:
        """Command the arms to stay where they are measured, unless the robot is stopped."""
        readings = [track.reading for track in self._tracks]
        self._schedule = Schedule(time.monotonic())
        self._stay([each and SetPoint(each.q, each.q) for each in readings])

    def _stay(self, held: Sequence[SetPoint | None]) -> None:
        """Command the arms to stay for a moment; one without a set-point is sent none."""
        if all(at is None for at in held):
            return
        end_s = time.monotonic() + HOLD_S
        while (now_s := self._wait()) < end_s:
            stop = self.watch.stop(now_s)
            if stop is not None and not stop.cause.holds:
                return
            self._send(now_s, held)

    def _wait(self) -> float:
        """Wait for the next tick; returns the time when it came, on the monotonic clock."""
        time.sleep(max(0.0, self._schedule.due_s - time.monotonic()))
        now_s = time.monotonic()
        self._lateness_s.append(self._schedule.advance(now_s))
        return now_s

    def _step(
        self, now_s: float, points: Sequence[SetPoint], *, is_ending: bool = False
    ) -> Stop | None:
        """Send the set-points unless there is a reason to stop, which is returned."""
        stop = self.watch.stop(now_s, is_ending=is_ending) or self._own_stop(now_s, is_ending)
        if stop is not None:
            return self._located(stop)
        readings = self._send(now_s, points)
        for track, at, reading in zip(self._tracks, points, readings, strict=True):
            stop = track.path_stop(now_s, at, reading)
            if stop is not None:
                return self._located(stop, track)
        return None

    def _own_stop(self, now_s: float, is_ending: bool) -> Stop | None:
        timeout_s = self._options.timeout_s
        if timeout_s is not None and now_s > self._begin_s + timeout_s and not is_ending:
            return Stop(StopCause.TIME_OUT, bound=timeout_s)
        stops = [track.connection_stop() for track in self._tracks]
        return next((stop for stop in stops if stop is not None), None)

    def _send(
        self, now_s: float, points: Sequence[SetPoint | None]
    ) -> tuple[ArmReading | None, ...]:
        """Send the set-points of all arms; returns what was measured last."""
        with self._link.node.together():
            for track, at in zip(self._tracks, points, strict=True):
                if at is not None:
                    track.channel.send(at.q_sent)
        readings, robot = tuple(track.reading for track in self._tracks), self._link.robot
        samples = [
            Sample(
                now_s - self._begin_s,
                track.limb,
                at.q_path,
                at.q_sent,
                reading.q,
                reading.v,
                now_s - reading.time_s,
                self._lateness_s[-1],
                robot.is_enabled,
                robot.is_stopped,
                robot.has_error,
            )
            for track, at, reading in zip(self._tracks, points, readings, strict=True)
            if at is not None and reading is not None and robot is not None
        ]
        self._report(samples)
        return readings

    def _located(self, stop: Stop, track: Track | None = None) -> Stop:
        label = self._label if track is None else track.label
        return evolve(stop, label=label, time_s=self._time_s)

    @property
    def _event_s(self) -> float:
        return self._offset_s + self._time_s

    def _tell(
        self, kind: EventKind, text: str, side: str | None = None, move: Move | None = None
    ) -> None:
        self.twin.put(self.twin.notify, self._event_s, kind, text, side, move)

    def _report(self, samples: Sequence[Sample]) -> None:
        """Store the samples of a tick, and show them with what is measured to the observers."""
        twin, link = self.twin, self._link
        for sample in samples:
            track = next(each for each in self._tracks if each.limb == sample.limb)
            track.samples.append(sample)
        if twin.error is not None and samples:
            self.watch.request(StopCause.OBSERVER_FAILED, str(twin.error))
        if self._observers and samples:
            time_s = self._offset_s + samples[0].time_s
            for sample in samples:
                twin.put(twin.sample, evolve(sample, time_s=time_s))
            twin.put(
                twin.update, time_s, link.joints.positions(), link.gripper_states(), self._caption
            )

    def _outcome(self, stop: Stop | None) -> MeasuredOutcome:
        duration_s = self._time_s
        self.twin.end()
        if self.twin.error is not None:
            raise self.twin.error
        late = np.percentile(self._lateness_s or [0.0], [50, 99, 100]).tolist()
        off = [deviation_of(track.arm, track.samples) for track in self._tracks]
        joint_rad, tip_m = (max(each) for each in zip(*off, strict=True))
        failure = None if stop is None else str(stop)
        lateness_s = late[0], late[1], late[2]
        return MeasuredOutcome(failure, duration_s, stop, joint_rad, tip_m, lateness_s)


class PlanExecution(Execution):
    """The execution of a plan of one arm: each step begins when the one before is done."""

    def __init__(
        self, link: BaxterLink, observers: tuple[Observer, ...], ready: ReadyPlan, title: str
    ) -> None:
        super().__init__(link, observers, ready, [ready], title)
        self._ready = ready

    def _compose(self) -> None:
        (self._track,) = self._tracks
        parts = parts_of(self._ready.plan, self._options.pace)
        self._parts = list(self._track.guarded(parts))

    def _steps(self) -> Stop | None:
        clearances = iter(self._ready.clearances)
        for part, guard in self._parts:
            self._track.guard = guard
            if isinstance(part, Grip):
                stop = self._grip(part)
            else:
                stop = self._follow(part, [next(clearances) for _ in part.moves])
            if stop is not None:
                return stop
        return None

    def _end(self, stop: Stop) -> None:  # noqa: ARG002 - one arm holds whatever the cause
        self._hold()

    def _follow(self, motion: SentMotion, clearances: Sequence[MoveClearance]) -> Stop | None:
        """Send a motion and wait until the arm has settled."""
        clock, index, end_s = PlanTime(time.monotonic()), -1, motion.trajectory.duration
        goal, sent_s, track = motion.trajectory.q_goal, np.inf, self._track
        track.stand = SetPoint(goal, goal)
        while True:
            now_s = self._wait()
            plan_s = min(clock.advance(now_s) * motion.pace.speed, end_s)
            while index < motion.index_at(plan_s):
                index += 1
                self._start_move(track, motion.moves[index], clearances[index])
            stop = self._step(now_s, [motion.at(plan_s)])
            if stop is not None:
                return stop
            if plan_s < end_s:
                continue
            sent_s = min(sent_s, now_s)
            is_settled = track.settled_stop(now_s, sent_s)
            if isinstance(is_settled, Stop):
                return self._located(is_settled)
            if is_settled:
                return None

    def _grip(self, grip: Grip) -> Stop | None:
        """Let the fingers act while the arm stands at its last set-point."""
        track = self._track
        track.label = grip.label
        command = track.command(grip)
        is_done: bool | Stop = False
        while not is_done:
            now_s = self._wait()
            stop = self._step(now_s, [track.stand])
            if stop is not None:
                return stop
            is_done = command.is_done(now_s)
        if isinstance(is_done, Stop):
            return self._missed(track, is_done)
        self._gripped(track, grip, command.percent)
        return None


class TwoArmExecution(Execution):
    """The execution of a plan of both arms on one clock.

    At each tick, both set-points are those of one time on the clock. The clock waits for grippers:
    an action begins when its time has come and its arm has settled, and the clock slows to rest
    before the action's time is over, and goes on when it is done. So no gripper action takes
    longer on the clock than the proof assumes, and each arm stays on its path.

    Where the arms are proven for a lag, set-points that are later than the proof assumes stop both;
    all time for which the clock stood still since it last waited counts.

    Whatever stops one arm stops both. Where both still follow their paths
    (`StopCause.keeps_paths`), the clock slows to rest, and they hold where it rests; else they hold
    where they are measured.
    """

    def __init__(
        self, link: BaxterLink, observers: tuple[Observer, ...], ready: ReadyTwoArmPlan, title: str
    ) -> None:
        super().__init__(link, observers, ready, list(ready.arms.values()), title)
        self._ready = ready
        self._clock: CommonClock | None = None

    def _compose(self) -> None:
        self._timed = [TimedTrack(track, self._ready.plan) for track in self._tracks]

    def _steps(self) -> Stop | None:
        ready = self._ready
        speed = self._options.pace.speed
        waits = waits_of(ready.plan, slowing_s_for(ready.ramp_s, speed))
        self._clock = clock = CommonClock(
            time.monotonic(), ready.plan.duration_s, speed, ready.ramp_s, waits
        )
        while True:
            now_s = self._wait()
            points = self._advance(clock, now_s)
            stop = self._step(now_s, points)
            if stop is not None:
                return stop
            for timed, at in zip(self._timed, points, strict=True):
                stop = self._act(timed, now_s, at)
                if stop is not None:
                    return stop
            if clock.is_over and all(timed.grip is None for timed in self._timed):
                settled = [
                    timed.is_settled(now_s, at)
                    for timed, at in zip(self._timed, points, strict=True)
                ]
                for timed, found in zip(self._timed, settled, strict=True):
                    if isinstance(found, Stop):
                        return self._located(found, timed.track)
                if all(settled):
                    return None

    def _advance(
        self, clock: CommonClock, now_s: float, *, is_ending: bool = False
    ) -> list[SetPoint]:
        """Both set-points of the tick that has come."""
        due_s = min(timed.due_s for timed in self._timed)
        clock_s = clock.advance(now_s, due_s, is_ending=is_ending)
        for timed in self._timed:
            for move, clearance in timed.begun(clock_s):
                self._start_move(timed.track, move, clearance)
        return [timed.at(clock_s, clock.rate) for timed in self._timed]

    def _act(self, timed: TimedTrack, now_s: float, at: SetPoint) -> Stop | None:
        grip = timed.grip
        found = timed.act(now_s, at)
        if isinstance(found, Stop):
            return self._missed(timed.track, found)
        if grip is not None and found is not None:
            timed.grip = None
            self._gripped(timed.track, grip, found)
        return None

    def _step(
        self, now_s: float, points: Sequence[SetPoint], *, is_ending: bool = False
    ) -> Stop | None:
        """As of one arm, and both arms must be far enough from each other."""
        return super()._step(now_s, points, is_ending=is_ending) or self._arms_stop()

    def _own_stop(self, now_s: float, is_ending: bool) -> Stop | None:
        """As of one arm, and set-points must not be later than the proof assumes."""
        stop, bound_s = super()._own_stop(now_s, is_ending), self._ready.max_late_s
        if stop is not None or is_ending or self._clock is None or self._clock.late_s <= bound_s:
            return stop
        return Stop(StopCause.TOO_LATE, value=self._clock.late_s, bound=bound_s)

    def _arms_stop(self) -> Stop | None:
        guards = [track.guard for track in self._tracks if track.guard is not None]
        qs = [reading.q for track in self._tracks if (reading := track.reading) is not None]
        stop = arms_stop(guards, qs, self._ready.apart_m)
        return stop and self._located(stop)

    def _end(self, stop: Stop) -> None:
        clock = self._clock
        if clock is None or not stop.cause.keeps_paths:
            self._hold()
            return
        while True:
            now_s = self._wait()
            points = self._advance(clock, now_s, is_ending=True)
            worse = self._step(now_s, points, is_ending=True)
            if worse is not None:
                if worse.cause.holds:
                    self._hold()
                return
            if clock.rate == 0.0 or clock.is_over:
                self._stay(points)
                return


@contextmanager
def _short_collections() -> Iterator[None]:
    """Exempt what exists now from garbage collection inside the block.

    With the planner loaded, a full collection takes 0.1 s, in which every thread stands still. What
    was frozen before stays so.
    """
    was_frozen = gc.get_freeze_count() > 0
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        if not was_frozen:
            gc.unfreeze()


def deviation_of(arm: Arm, samples: Sequence[Sample]) -> tuple[float, float]:
    """Greatest deviations over the samples of one execution, in order.

    Returns:
        Of a joint from its set-point of the same instant, which a lag alone makes, rad; and of the
        tip from its path over the last `WINDOW` set-points as straight pieces, whenever it was
        there, m.
    """
    if not samples:
        return 0.0, 0.0
    q_path = np.array([sample.q_path for sample in samples])
    q_measured = np.array([sample.q_measured for sample in samples])
    paths, tips = (arm.T_base_tips(q)[:, :3, 3] for q in (q_path, q_measured))
    tip_m = max(
        _distance_m(paths[max(0, index - WINDOW) : index + 1], tip)
        for index, tip in enumerate(tips)
    )
    return float(np.abs(q_measured - q_path).max()), tip_m


def _distance_m(path: FloatArray, point: FloatArray) -> float:
    """Distance of a point, shape (3,), from the pieces between points, shape (n, 3), m."""
    begin, along = path[:-1], np.diff(path, axis=0)
    if not len(begin):
        return float(np.linalg.norm(point - path[0]))
    squared = np.maximum((along**2).sum(axis=1), 1e-18)
    share = np.clip(((point - begin) * along).sum(axis=1) / squared, 0.0, 1.0)
    feet = begin + share[:, None] * along
    return float(np.linalg.norm(point - feet, axis=1).min())
