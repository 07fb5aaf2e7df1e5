"""The recorder: an observer that keeps what happens in memory, or writes it to a file."""

from __future__ import annotations

import sys
from abc import abstractmethod
from collections import deque

import numpy as np
import pinocchio as pin

from baxter_kin import Baxter, quaternion_xyzw
from baxter_kin.description import RobotIdentity
from baxter_kin.display import OneLine, count
from baxter_kin.fields import NotCopied, evolve
from baxter_kin.files import PathLike
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.kinematics.robot import given_or_stock
from baxter_kin.validation import expect, whole_scalar
from planner import Body, Plan, RobotBody, Scene, State, TwoArmPlan
from sim.errors import RecordingError
from sim.events import Event, Sample, SampleObserver, Snapshot
from sim.recording.record_file import open_record
from sim.recording.recorded_motion import RecordedMove, recorded_move
from sim.recording.recording import Caption, Entry, RecordedSample, Recording, Row
from sim.simulation import Simulation
from sim.world.world import World


class RecordingBuilder:
    """The entries so far; `build` makes a recording of them.

    Attributes:
        rows: the snapshots so far.
        bodies: the bodies so far, by name.
    """

    def __init__(
        self,
        joint_names: tuple[str, ...],
        robot: RobotIdentity | None,
        *,
        limbs: tuple[str, ...] = LIMBS,
        keep: int | None = None,
    ) -> None:
        """Start empty; `keep` as of `Recorder`."""
        self.joint_names, self.robot, self.limbs = joint_names, robot, limbs
        self.rows: deque[Row] = deque(maxlen=keep)
        self.bodies: dict[str, Body] = {}
        self._start: State | None = None
        self._captions: deque[Caption] = deque()
        self._events: deque[Event] = deque()
        self._moves: deque[RecordedMove] = deque()
        self._samples: deque[RecordedSample] = deque()

    def add(self, entry: Entry) -> None:
        """Add an entry.

        Beyond `keep` snapshots, drop the oldest one and the entries that ended before the next.
        """
        if isinstance(entry, Row):
            drops = len(self.rows) == self.rows.maxlen
            self.rows.append(entry)
            if drops:
                self._drop_before(self.rows[0].time_s)
        elif isinstance(entry, Caption):
            self._captions.append(entry)
        elif isinstance(entry, RecordedSample):
            self._samples.append(entry)
        elif isinstance(entry, Event):
            self._events.append(entry)
        elif isinstance(entry, RecordedMove):
            self._moves.append(entry)
        elif isinstance(entry, Body):
            self.bodies[entry.name] = entry
        elif not self.rows:  # an executor reports the state at the start of each of its plans
            self._start = entry

    def build(self) -> Recording:
        """Make a recording; what is added later does not change it."""
        if not self.rows:
            raise RecordingError("the recording is empty: no snapshot was recorded")
        absent = np.full(7, np.nan)
        return Recording(
            joint_names=self.joint_names,
            times_s=np.array([row.time_s for row in self.rows]),
            q=np.array([row.q for row in self.rows]),
            gripper_percent=np.array([row.gripper_percent for row in self.rows]),
            bodies=self.bodies,
            body_poses={
                name: np.array([row.poses.get(name, absent) for row in self.rows])
                for name in self.bodies
            },
            captions=tuple((caption.time_s, caption.text) for caption in self._captions),
            events=tuple(self._events),
            moves=tuple(self._moves),
            robot=self.robot,
            limbs=self.limbs,
            samples=tuple(self._samples),
            start=self._start,
        )

    def _drop_before(self, first_s: float) -> None:
        self._start = None
        while len(self._captions) > 1 and self._captions[1].time_s <= first_s:
            self._captions.popleft()
        if self._captions and self._captions[0].time_s < first_s:
            self._captions[0] = evolve(self._captions[0], time_s=first_s)
        while self._moves and self._moves[0].end_s < first_s:
            self._moves.popleft()
        for left in (self._events, self._samples):
            while left and left[0].time_s < first_s:
                left.popleft()


class RecordFile(NotCopied, OneLine):
    """A file that entries are written to."""

    @abstractmethod
    def add(self, entry: Entry) -> None:
        """Write an entry, if the format has a place for it."""

    @abstractmethod
    def close(self) -> None:
        """Finish the file; a second call does nothing."""


class Recorder(SampleObserver):
    """Collects what happens in memory and, if it is given a file, writes it there as well.

    MCAP and CSV files are written while it happens: a process that is killed loses what happened in
    the last half second. Other files are written by `close`. A recorder is a context manager.
    """

    def __init__(
        self, robot: Baxter, file: PathLike | RecordFile | None = None, *, keep: int | None = None
    ) -> None:
        """Start empty.

        Args:
            robot: the robot whose joints are recorded.
            file: a file, in the format of its suffix: .mcap, .csv (of the RSDK) or .bag (of ROS 1);
                an older one is replaced. Or one that is open.
            keep: maximum number of snapshots kept in memory, with the events and moves of that
                time; by default all.

        Raises:
            RecordingError: when the file cannot be written, or `keep` is not a whole number above
                zero.
        """
        if keep is not None:
            keep = whole_scalar(keep, "keep", RecordingError, least=1, most=sys.maxsize)
        names = expect(robot, Baxter, "robot", RecordingError).joint_names
        self._builder = RecordingBuilder(names, robot.description.identity, keep=keep)
        if file is None or isinstance(file, RecordFile):
            self._file = file
        else:
            self._file = open_record(file, self._builder)
        self._caption: str | None = None

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __getstate__(self) -> dict[str, object]:
        """Refuse to copy a recorder that writes a file."""
        if self._file is not None:
            self._file.__reduce__()
        return self.__dict__

    @property
    def has_snapshots(self) -> bool:
        """Whether there is anything to make a recording of."""
        return bool(self._builder.rows)

    def remember(self, scene: Scene) -> None:
        """Record the shapes of bodies, which snapshots do not have.

        A simulation reports the bodies that are in its world at the start and those that it spawns;
        this is for other bodies.

        Raises:
            RecordingError: when it is not a scene.
        """
        for body in expect(scene, Scene, "scene", RecordingError):
            self._add(body)

    def on_start(self, state: State) -> None:
        """Record the state at the start."""
        self.remember(expect(state, State, "state", RecordingError).scene)
        self._add(state)

    def on_snapshot(self, snapshot: Snapshot) -> None:
        """Record a snapshot."""
        shot = expect(snapshot, Snapshot, "snapshot", RecordingError)
        if shot.caption != self._caption:
            self._caption = shot.caption
            self._add(Caption(shot.time_s, shot.caption))
        percent = [shot.grippers[side].percent for side in LIMBS]
        poses = {name: pose_row(T) for name, T in shot.T_base_bodies.items()}
        self._add(Row(shot.time_s, shot.q, percent, poses))

    def on_event(self, event: Event) -> None:
        """Record an event, the move that begins, and the shapes of a body that appears."""
        expect(event, Event, "event", RecordingError)
        if event.body is not None and event.is_of_appearance:
            self._add(event.body)
        self._add(event)
        move = recorded_move(event)
        if move is not None:
            self._add(move)

    def on_sample(self, sample: Sample) -> None:
        """Record what was sent to a robot and measured."""
        expect(sample, Sample, "sample", RecordingError)
        names = RecordedSample.__dataclass_fields__
        self._add(RecordedSample(**{name: getattr(sample, name) for name in names}))

    def recording(self) -> Recording:
        """Make a recording of everything so far.

        Raises:
            RecordingError: when there is no snapshot yet.
        """
        return self._builder.build()

    def close(self) -> None:
        """Finish the file, if there is one; a second call does nothing."""
        if self._file is not None:
            self._file.close()

    def _add(self, entry: Entry) -> None:
        self._builder.add(entry)
        if self._file is not None:
            self._file.add(entry)

    def _facts(self) -> tuple[str, ...]:
        file = "" if self._file is None else repr(self._file)
        return count(len(self._builder.rows), "snapshot"), file


def pose_row(T_base_body: pin.SE3) -> list[float]:
    """A pose seen from base as x, y, z, then quaternion x, y, z, w; seven numbers, m."""
    return [*T_base_body.translation.tolist(), *quaternion_xyzw(T_base_body).tolist()]


def planned_recording(
    plan: Plan | TwoArmPlan, robot: Baxter | None = None, *, body: RobotBody | None = None
) -> Recording:
    """The recording of an execution exactly as planned; contacts are not checked.

    Args:
        plan: a valid plan, of one arm or both; its own `start` is the world that it begins in.
        robot: the robot that it is for; by default the stock robot.
        body: the shapes of that robot; by default `RobotBody.load()`.
    """
    if not isinstance(plan, TwoArmPlan):
        expect(plan, Plan, "plan", RecordingError)
    if plan.failure is not None:
        raise RecordingError(f"an invalid plan has nothing to show: {plan.failure}")
    known = given_or_stock(robot, RecordingError)
    difference = difference_of(plan, known)
    if difference:
        raise RecordingError(f"the plan is for another robot: {difference}; give that one")
    recorder = Recorder(known)
    world = World.from_state(plan.start, known, body)
    simulation = Simulation(world, [recorder], check_contacts=False)
    simulation.execute(_for_any_body(plan), unverified=True)
    simulation.finish()
    return recorder.recording()


def difference_of(plan: Plan | TwoArmPlan, robot: Baxter) -> str:
    """How the robot that a plan is for differs from another one; "" where it does not."""
    plans = plan.plans.values() if isinstance(plan, TwoArmPlan) else (plan,)
    own = robot.description.identity
    found = (own.difference(each.robot) for each in plans if each.robot is not None)
    return next(filter(None, found), "")


def _for_any_body(plan: Plan | TwoArmPlan) -> Plan | TwoArmPlan:
    """The plan without the robot that it is for, as it may be shown with another body."""
    if isinstance(plan, TwoArmPlan):
        plans = {side: evolve(each, robot=None) for side, each in plan.plans.items()}
        return evolve(plan, plans=plans)
    return evolve(plan, robot=None)
