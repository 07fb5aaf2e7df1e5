"""RosExecutor: executes a plan on a Baxter, as `Simulation.execute` does in a world.

An `Execution` is one plan on its way, from the first set-point to an arm that stands. At every
tick the watch is asked first, so that nothing is sent once there is a reason to stop; then the
set-point is sent, and then the guard compares what was measured with the path. The arm is
commanded without a break from the first set-point to the last, also while it stands.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager

import numpy as np

from baxter_kin import Arm
from baxter_kin.display import OneLine, seconds
from baxter_kin.fields import NotCopied, evolve, frozen
from baxter_kin.validation import FloatArray, expect, expect_all
from planner import Grip, GripperAction, Move, Plan
from planner.completion import state_of
from planner.motion.tracking_tube import SETTLED_RAD
from sim.errors import SimulationError
from sim.events import EventKind, Observer, Sample
from sim.ros1.execution.channel import ArmChannel, GripperCommand
from sim.ros1.execution.guard import MoveClearance, PathGuard
from sim.ros1.execution.link import ArmReading, BaxterLink
from sim.ros1.execution.readiness import (
    ExecutionOptions,
    NotReadyError,
    Readiness,
    ReadyPlan,
    check_plan,
    check_unmoved,
)
from sim.ros1.execution.set_points import (
    PlanTime,
    Schedule,
    SentMotion,
    SetPoint,
    parts_of,
    slowed,
)
from sim.ros1.execution.stops import Stop, StopCause, Watch
from sim.ros1.execution.twin import Twin
from sim.simulation import Outcome

ENABLE_S, ENABLE_HZ = 5.0, 20.0
"""How long, and how often, the robot is asked to switch its motors on."""

CONNECT_S = 3.0
"""A robot that subscribes to the set-points has connected by then."""

SETTLED_RAD_S = 0.02
"""An arm has arrived when no joint is farther off, half a degree as in the original, or faster."""

SETTLE_TIMEOUT_S = 8.0

HOLD_S = 1.0
"""How long an arm is commanded to stay where it is after a stop."""

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
    """Drives an arm of a Baxter along plans."""

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

    def prepare(self, plan: Plan) -> Readiness:
        """Whether a plan may be executed on the robot as it stands; nothing is sent.

        Raises:
            SimulationError: when the plan is invalid.
            RosError: when the master cannot be reached.
        """
        return check_plan(self._link, plan, self.options)

    def stop(self, cause: StopCause = StopCause.SIGINT) -> None:
        """Request a stop, from another thread or a signal handler; the arm then holds."""
        self._requested = cause
        if self._watch is not None:
            self._watch.request(cause)

    def enable(self, limb: str) -> None:
        """Switch the motors on, if they are off.

        Raises:
            SimulationError: when the robot is not enabled in time.
        """
        if self._is_enabled():
            return
        with ArmChannel(self._link, limb) as channel:
            end_s = time.monotonic() + ENABLE_S
            while not self._is_enabled():
                if time.monotonic() > end_s:
                    raise SimulationError(
                        f"the robot is not enabled after {ENABLE_S:g} s; a tucked one must be "
                        "untucked first"
                    )
                channel.enable()
                self._link.wait_until(self._is_enabled, 1.0 / ENABLE_HZ)

    def execute(self, plan: Plan | ReadyPlan, title: str = "") -> MeasuredOutcome:
        """Execute every step of a plan, or stop at the first that fails.

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
        ready = plan if isinstance(plan, ReadyPlan) else self._prepared(plan)
        check_unmoved(self._link, ready)
        self.enable(ready.plan.limb)
        with Execution(self._link, self._observers, ready, title) as execution:
            self._watch = execution.watch
            if self._requested is not None:
                execution.watch.request(self._requested)
            try:
                return execution.run(self.time_s)
            finally:
                self._watch = None

    def _prepared(self, plan: Plan) -> ReadyPlan:
        readiness = self.prepare(plan)
        if readiness.ready is None:
            raise NotReadyError(readiness)
        return readiness.ready

    def _is_enabled(self) -> bool:
        report = self._link.robot
        return report is not None and report.is_enabled

    def _facts(self) -> tuple[str, ...]:
        return repr(self._link), repr(self.options.pace)


class Execution:
    """The execution of one plan; a context manager.

    Attributes:
        watch: ends it early.
        twin: informs the observers.
    """

    def __init__(
        self,
        link: BaxterLink,
        observers: tuple[Observer, ...],
        ready: ReadyPlan,
        title: str,
    ) -> None:
        self._link, self._options, self._ready, self._title = link, ready.options, ready, title
        self._observers, self._limb = observers, ready.plan.limb
        self._arm, self._hand = ready.manipulator.arm, ready.manipulator.hand
        self._parts = list(self._guarded_parts())
        self._guard: PathGuard | None = None
        self._clearance: MoveClearance | None = None
        self._stand = SetPoint(ready.plan.q_start, ready.plan.q_start)
        self._label = self._caption = ""
        self._was_connected = False
        self._samples: list[Sample] = []
        self._lateness_s: list[float] = []
        self._cleanup = ExitStack()

    def __enter__(self) -> Execution:
        with ExitStack() as cleanup:
            cleanup.enter_context(_short_collections())
            self._channel = cleanup.enter_context(ArmChannel(self._link, self._limb))
            self.watch = Watch(self._link, self._limb)
            self.twin = Twin(self._ready.robot, self._ready.plan.start, self._observers)
            self.twin.begin()
            cleanup.callback(self.twin.end)
            self._cleanup = cleanup.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._cleanup.close()

    def run(self, offset_s: float) -> MeasuredOutcome:
        """Execute the plan; events count their time from `offset_s` on."""
        if not self._link.wait_until(lambda: bool(self._channel.readers), CONNECT_S):
            raise SimulationError("the robot does not connect to the set-points; is it reachable?")
        self._offset_s, self._begin_s = offset_s, time.monotonic()
        self._schedule = Schedule(self._begin_s)
        self.watch.begin()
        self._channel.begin(self._ready.ratio)
        self._tell(EventKind.ENABLED, "robot enabled")
        try:
            stop = self._interruptible_steps()
            if stop is not None and stop.cause.holds:
                self._hold()
        finally:
            self._channel.end()
        return self._outcome(stop)

    @property
    def _time_s(self) -> float:
        return time.monotonic() - self._begin_s

    def _interruptible_steps(self) -> Stop | None:
        """Stop at the first Ctrl-C where nobody handles it; a second one is raised."""
        try:
            return self._steps()
        except KeyboardInterrupt:
            if self.watch.is_requested:
                raise
            self.watch.request(StopCause.SIGINT)
            return self._located(Stop(StopCause.SIGINT))

    def _guarded_parts(self) -> Iterator[tuple[SentMotion | Grip, PathGuard | None]]:
        """Motions and actions of the fingers, each with the guard that then checks.

        Between two actions nothing changes but the arm, so one guard checks all motions there.
        """
        guard: PathGuard | None = None
        has_acted = True
        for part in parts_of(self._ready.plan, self._options.pace):
            if isinstance(part, SentMotion) and has_acted:
                context = self._ready.manipulator.at(state_of(part.moves[0]))
                guard = PathGuard(context, self._arm.joint_names)
            has_acted = isinstance(part, Grip)
            yield part, guard

    def _steps(self) -> Stop | None:
        clearances = iter(self._ready.clearances)
        for part, guard in self._parts:
            self._guard = guard
            if isinstance(part, Grip):
                stop = self._grip(part)
            else:
                stop = self._follow(part, [next(clearances) for _ in part.moves])
            if stop is not None:
                return stop
        return None

    def _follow(self, motion: SentMotion, clearances: Sequence[MoveClearance]) -> Stop | None:
        """Send a motion and wait until the arm has settled."""
        clock, index, end_s = PlanTime(time.monotonic()), -1, motion.trajectory.duration
        goal, sent_s = motion.trajectory.q_goal, np.inf
        self._stand = SetPoint(goal, goal)
        while True:
            now_s = self._wait()
            plan_s = min(clock.advance(now_s) * motion.pace.speed, end_s)
            while index < motion.index_at(plan_s):
                index += 1
                self._start(motion.moves[index], motion.pace.speed)
                self._clearance = clearances[index]
            stop = self._step(now_s, motion.at(plan_s))
            if stop is not None:
                return stop
            if plan_s < end_s:
                continue
            sent_s = min(sent_s, now_s)
            reading = self._reading()
            if _is_settled(reading, goal, sent_s + self._options.rest_s):
                return None
            if now_s > sent_s + SETTLE_TIMEOUT_S:
                return self._located(_unsettled(reading, goal, self._arm.joint_names))

    def _start(self, move: Move, speed: float) -> None:
        self._label, self._caption = move.label, f"{self._title}{move.label}"
        sent = evolve(move, trajectory=slowed(move.trajectory, speed))
        self._tell(EventKind.MOVE_STARTED, self._caption, self._limb, sent)

    def _grip(self, grip: Grip) -> Stop | None:
        """Let the fingers act while the arm stands at its last set-point."""
        dwell, opening_m = self._options.dwell, self._hand.stroke_m
        if grip.opening_m is not None:
            opening_m = min(grip.opening_m, opening_m)
        is_close = grip.action is GripperAction.CLOSE
        self._label, self._caption = grip.label, f"{self._title}{grip.label}"
        command = GripperCommand(
            self._channel,
            self._link,
            grip,
            open_percent=self._hand.percent(opening_m),
            dwell_s=dwell.after_grasp_s if is_close else dwell.after_release_s,
        )
        is_done: bool | Stop = False
        while not is_done:
            now_s = self._wait()
            is_done = self._step(now_s, self._stand) or command.is_done(now_s)
        event_s, twin = self._event_s, self.twin
        if not isinstance(is_done, Stop):
            twin.put(twin.gripped, event_s, self._limb, grip, command.percent)
            return None
        stop = self._located(is_done)
        if stop.cause is StopCause.GRIPPER_MISSED:
            twin.put(twin.notify, event_s, EventKind.MISSED, str(is_done), self._limb)
        return stop

    def _hold(self) -> None:
        """Command the arm to stay where it is measured, unless the robot is stopped meanwhile."""
        reading = self._reading()
        if reading is None:
            return
        end_s = time.monotonic() + HOLD_S
        self._schedule = Schedule(time.monotonic())
        while (now_s := self._wait()) < end_s:
            stop = self.watch.stop(now_s)
            if stop is not None and not stop.cause.holds:
                return
            self._send(now_s, SetPoint(reading.q, reading.q))

    def _wait(self) -> float:
        """Wait for the next tick; returns the time when it came, on the monotonic clock."""
        time.sleep(max(0.0, self._schedule.due_s - time.monotonic()))
        now_s = time.monotonic()
        self._lateness_s.append(self._schedule.advance(now_s))
        return now_s

    def _step(self, now_s: float, at: SetPoint) -> Stop | None:
        """Send a set-point unless there is a reason to stop, which is returned."""
        stop = self.watch.stop(now_s) or self._own_stop(now_s)
        if stop is None:
            reading = self._send(now_s, at)
            guard, clearance = self._guard, self._clearance
            if guard is not None and clearance is not None and reading is not None:
                guard.advance(now_s, at.q_path, clearance)
                stop = guard.check(reading.q, at.q_path)
        return stop and self._located(stop)

    def _own_stop(self, now_s: float) -> Stop | None:
        timeout_s = self._options.timeout_s
        if timeout_s is not None and now_s > self._begin_s + timeout_s:
            return Stop(StopCause.TIME_OUT, bound=timeout_s)
        is_connected = bool(self._channel.readers)
        if self._was_connected and not is_connected:
            return Stop(
                StopCause.CONNECTION_LOST, detail="no node receives the set-points any more"
            )
        self._was_connected = is_connected
        return None

    def _send(self, now_s: float, at: SetPoint) -> ArmReading | None:
        """Send a set-point; returns what was measured last."""
        self._channel.send(at.q_sent)
        reading, robot = self._reading(), self._link.robot
        if reading is not None and robot is not None:
            sample = Sample(
                now_s - self._begin_s,
                self._channel.limb,
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
            self._report(sample)
        return reading

    def _reading(self) -> ArmReading | None:
        return self._link.joints.arm(self._arm.joint_names)

    def _located(self, stop: Stop) -> Stop:
        return evolve(stop, label=self._label, time_s=self._time_s)

    @property
    def _event_s(self) -> float:
        return self._offset_s + self._time_s

    def _tell(
        self, kind: EventKind, text: str, side: str | None = None, move: Move | None = None
    ) -> None:
        self.twin.put(self.twin.notify, self._event_s, kind, text, side, move)

    def _report(self, sample: Sample) -> None:
        """Store a sample, and show it with what is measured to the observers."""
        self._samples.append(sample)
        twin, link = self.twin, self._link
        if twin.error is not None:
            self.watch.request(StopCause.OBSERVER_FAILED, str(twin.error))
        if self._observers:
            time_s = self._offset_s + sample.time_s
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
        joint_rad, tip_m = deviation_of(self._arm, self._samples)
        failure = None if stop is None else str(stop)
        lateness_s = late[0], late[1], late[2]
        return MeasuredOutcome(failure, duration_s, stop, joint_rad, tip_m, lateness_s)


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
