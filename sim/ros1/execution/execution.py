"""Execution: one plan carried out, from the first set-point to an arm that stands."""

from __future__ import annotations

import time
from contextlib import ExitStack
from functools import partial

import numpy as np

from baxter_kin.display import seconds
from baxter_kin.fields import evolve, frozen
from planner import GripperAction, Move
from planner.trajectory import Trajectory
from sim.errors import SimulationError
from sim.events import EventKind, Observer
from sim.outcome import Outcome
from sim.ros1.execution.deviation import deviation_of
from sim.ros1.execution.guard.path_guard import PathGuard
from sim.ros1.execution.guard.stages import GripStage, MoveStage, Room
from sim.ros1.execution.guard.watch import Watch
from sim.ros1.execution.link.baxter_link import BaxterLink
from sim.ros1.execution.link.channel import ArmChannel
from sim.ros1.execution.ready_plan import ExecutionOptions, ReadyPlan
from sim.ros1.execution.stops import Stop, StopCause
from sim.ros1.execution.stream.arm_stream import ArmStream
from sim.ros1.execution.stream.collection import short_collections
from sim.ros1.execution.stream.fingers import CLOSED_PERCENT, FingerStep
from sim.ros1.execution.stream.set_points import SentMotion, SetPoint, motions_of, slowed
from sim.ros1.execution.twin import Twin
from sim.samples import Sample

CONNECT_S = 3.0
"""A robot that listens has connected by then."""


@frozen(error=SimulationError, eq=True)
class MeasuredOutcome(Outcome):
    """How the execution of a plan on a robot ended.

    Attributes:
        failure: None, or why it stopped early, as one sentence.
        duration_s: time it took.
        stop: the same as facts.
        joint_deviation_rad: how far a joint was off its path, at most, whenever it was.
        tip_deviation_m: how far the tip was off its path, at most.
        lateness_s: of the set-points: median, 99th percentile and greatest.
    """

    stop: Stop | None = None
    joint_deviation_rad: float = 0.0
    tip_deviation_m: float = 0.0
    lateness_s: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def _facts(self) -> tuple[str, ...]:
        failure = "success" if self.failure is None else f"failed: {self.failure}"
        return seconds(self.duration_s), f"{self.joint_deviation_rad:.4f} rad off", failure


class Execution:
    """One execution: what is sent, what watches it, and who is told."""

    def __init__(
        self,
        link: BaxterLink,
        observers: tuple[Observer, ...],
        options: ExecutionOptions,
        ready: ReadyPlan,
        title: str,
    ) -> None:
        self._link, self._options, self._ready, self._title = link, options, ready, title
        self._observers, self._limb = observers, ready.plan.limb
        self._arm = ready.robot.arm(self._limb)
        self._samples: list[Sample] = []
        self._caption = ""
        self._cleanup = ExitStack()

    def __enter__(self) -> Execution:
        names = self._arm.joint_names
        try:
            self._cleanup.enter_context(short_collections())
            self._channel = self._cleanup.enter_context(ArmChannel(self._link, self._limb, names))
            self.watch = Watch(self._link, self._limb)
            self.twin = Twin(self._ready.robot, self._ready.plan.start, self._observers)
            self.twin.begin()
            self._cleanup.callback(self.twin.end)
        except BaseException:
            self._cleanup.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._cleanup.close()

    def run(self, begin_s: float) -> MeasuredOutcome:
        """All of it; ends with an arm that stands."""
        self._offset_s = begin_s
        if not self._link.wait_until(lambda: bool(self._channel.readers), CONNECT_S):
            raise SimulationError("the robot does not connect to the set-points; is it reachable?")
        self._stream = ArmStream(
            self._link,
            self._channel,
            self.watch,
            self._arm.joint_names,
            self._seen,
            rest_s=self._options.rest_s,
        )
        if self._options.timeout_s is not None:
            self._stream.limit(self._options.timeout_s)
        self.watch.begin()
        self._channel.begin(self._ready.ratio)
        self._tell(EventKind.ENABLED, "robot enabled")
        try:
            stop = self._interruptible_steps()
            if stop is not None and stop.cause.holds:
                self._stream.hold()
        finally:
            self._channel.end()
        return self._ended(stop)

    def _interruptible_steps(self) -> Stop | None:
        """Where nobody handles Ctrl-C, it is a stop like others; a second one is out at once."""
        try:
            return self._steps()
        except KeyboardInterrupt:
            if self.watch.is_requested:
                raise
            self.watch.request(StopCause.SIGINT)
            return Stop(StopCause.SIGINT, self._stream.label, self._stream.time_s)

    def _steps(self) -> Stop | None:
        guard: PathGuard | None = None
        room = Room("", (np.inf,) * 8)
        at = SetPoint(self._ready.plan.q_start, self._ready.plan.q_start)
        for stage in self._ready.stages:
            if isinstance(stage, MoveStage):
                guard = PathGuard(stage.context, self._arm.joint_names)
                self._stream.guarded_by(guard)
                stop = self._moves(stage)
                goal = stage.moves[-1].trajectory.q_goal
                at, room = SetPoint(goal, goal), stage.rooms[-1]
            else:
                stop = self._fingers(stage, at, room)
            if stop is not None:
                return stop
        return None

    def _moves(self, stage: MoveStage) -> Stop | None:
        first = 0
        for motion in motions_of(stage.moves, self._options.pace):
            rooms = stage.rooms[first : first + len(motion.moves)]
            stop = self._stream.follow(motion, rooms, partial(self._started, motion))
            first += len(motion.moves)
            if stop is not None:
                return stop
        return None

    def _started(self, motion: SentMotion, number: int) -> None:
        move, caption = motion.moves[number], f"{self._title}{motion.moves[number].label}"
        sent = evolve(move, trajectory=_slow(move.trajectory, motion))
        self._caption = caption
        self._tell(EventKind.MOVE_STARTED, caption, self._limb, sent)

    def _fingers(self, stage: GripStage, at: SetPoint, room: Room) -> Stop | None:
        grip, dwell = stage.grip, self._options.dwell
        is_close = grip.action is GripperAction.CLOSE
        hand = self.twin.world.hand(self._limb)
        percent = CLOSED_PERCENT if is_close else hand.percent(stage.finger_m)
        self._stream.label = grip.label
        self._caption = f"{self._title}{grip.label}"
        step = FingerStep(
            self._link,
            self._limb,
            grip,
            percent,
            sequence=self._channel.go(percent),
            now_s=time.monotonic(),
            dwell_s=dwell.after_grasp_s if is_close else dwell.after_release_s,
        )
        stop = self._stream.stand(step, at, room)
        time_s = self._time_s
        if stop is None:
            self.twin.put(lambda: self.twin.gripped(time_s, self._limb, grip, step.percent))
        elif stop.cause is StopCause.GRIPPER_MISSED:
            text = str(evolve(stop, label=""))
            self.twin.put(lambda: self.twin.missed(time_s, self._limb, text))
        return stop

    @property
    def _time_s(self) -> float:
        return self._offset_s + self._stream.time_s

    def _tell(
        self, kind: EventKind, text: str, side: str | None = None, move: Move | None = None
    ) -> None:
        time_s, twin = self._time_s, self.twin
        twin.put(lambda: twin.tell(time_s, kind, text, side, move))

    def _seen(self, sample: Sample) -> None:
        """A tick has passed: show what is measured."""
        self._samples.append(sample)
        if self.twin.error is not None:
            self.watch.request(StopCause.OBSERVER_FAILED, str(self.twin.error))
        if not self._observers:
            return
        time_s, caption, twin = self._offset_s + sample.time_s, self._caption, self.twin
        joints, grippers = self._link.joints.positions(), self._link.gripper_states()
        told = evolve(sample, time_s=time_s)

        def show() -> None:
            twin.sample(told)
            twin.see(time_s, joints, grippers, caption)

        twin.put(show)

    def _ended(self, stop: Stop | None) -> MeasuredOutcome:
        duration_s = self._stream.time_s
        self.twin.end()
        if self.twin.error is not None:
            raise self.twin.error
        late = np.percentile(self._stream.lateness_s or [0.0], [50, 99, 100]).tolist()
        off = deviation_of(self._arm, self._samples)
        return MeasuredOutcome(
            None if stop is None else str(stop),
            duration_s,
            stop,
            off.joint_rad,
            off.tip_m,
            (late[0], late[1], late[2]),
        )


def _slow(trajectory: Trajectory, motion: SentMotion) -> Trajectory:
    return trajectory if motion.pace.speed == 1.0 else slowed(trajectory, motion.pace.speed)
