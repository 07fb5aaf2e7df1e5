"""One simulation as a live view shows it: what its page displays beside the picture, and a record.

The values are those of a recording, as far as they are known yet: velocities and accelerations are
exact during a move of a plan, and the clearance is measured some ten times a second. Bodies that no
event reported do not count.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping

import numpy as np

from baxter_kin import Baxter
from baxter_kin.fields import FrozenMapping, evolve
from baxter_kin.validation import FloatArray
from planner import Body, Scene, State
from planner.collision.robot.robot_shapes import RobotShapes
from planner.errors import SceneError
from sim.events import Event, EventKind, Snapshot
from sim.recording.recorded_motion import AGREEMENT_RAD, RecordedMove, recorded_move
from sim.recording.recorder import Recorder
from sim.recording.recording import Recording
from sim.timeline import DEFAULT_TICK_S
from sim.view.clearance import (
    MIN_SPEED_RAD_S,
    NO_BODY,
    NO_MOTION,
    NO_PAIR,
    ClearanceMeter,
    Hands,
)
from sim.view.panel import (
    MIN_MOVED_RAD,
    GripperPhase,
    GripperStatus,
    limits_of,
    sides_with_fingers,
    waypoints,
)

MIN_FRAME_S = 1.0 / 60.0
"""Minimum time between two frames that are sent."""

CLEARANCE_PERIOD_S = 0.1
"""Real time between two measurements of the clearance."""

MAX_WAYPOINTS = 24
"""Number of moves, the latest, that the page lists."""

MAX_SNAPSHOTS = 12_000
"""Number of snapshots for the replay at the end: the last two minutes at 100 Hz."""

_NO_BODIES: Mapping[str, Body] = FrozenMapping({})


class ShownRun:
    """One simulation, from its beginning. Not for several threads at once.

    Attributes:
        bodies: those of its world, by name.
        drawn_only: the names of other bodies that were drawn meanwhile.
    """

    def __init__(
        self, robot: Baxter, state: State, *, clock: Callable[[], float] = time.perf_counter
    ) -> None:
        """Begin a run.

        Args:
            robot: the robot.
            state: its world at the beginning.
            clock: real time, s, which decides when to measure the clearance again.
        """
        self._robot, self._clock = robot, clock
        self.bodies = dict(state.scene.bodies)
        self.drawn_only: set[str] = set()
        self._recorder = Recorder(robot, keep=MAX_SNAPSHOTS)
        if state.joints:
            self._recorder.on_start(state)
        else:  # the beginning, and what hands hold, is unknown
            self._recorder.remember(state.scene)
        self._arms = {side: _ArmState(robot, side) for side in robot.arms}
        self._hands = Hands({held.side: held.body for held in state.attachments})
        self._grippers = GripperStatus()
        self._fingered = sides_with_fingers(robot.joint_names)
        self._shapes: RobotShapes | None = None
        self._meter: ClearanceMeter | None = None
        self._measured_s = -np.inf
        self._moving: tuple[str, ...] = ()
        self._moves: deque[RecordedMove] = deque(maxlen=MAX_WAYPOINTS)
        self._listed_until_s = -np.inf  # when a move ends, and the waypoints change
        self._seed, self._seed_until_s = "", 0.0
        self._next_frame_s = 0.0
        self._last: Snapshot | None = None

    @property
    def phases(self) -> Mapping[str, GripperPhase]:
        """What the grippers do, by side."""
        return self._grippers.phases

    def is_over(self, time_s: float) -> bool:
        """Whether a time belongs to another run: it is before the last snapshot."""
        return self._last is not None and time_s < self._last.time_s

    def on_event(self, event: Event) -> None:
        """Process an event."""
        for observer in (self._recorder, self._grippers, self._hands):
            observer.on_event(event)
        if event.body is not None and event.kind is EventKind.SPAWNED:
            self.bodies[event.body.name] = event.body
            self._meter = None
        elif event.body is not None and event.kind is EventKind.DELETED:
            self.bodies.pop(event.body.name, None)
            self._meter = None
        if event.move is not None:
            self._seed = "" if event.move.ik is None else event.move.seed_label
            self._seed_until_s = event.time_s + event.move.trajectory.duration
        if (move := recorded_move(event)) is not None:
            self._hands.on_move(move)
            self._arms[move.limb].on_move(move)
            self._moves.append(move)
            self._listed_until_s = self._measured_s = -np.inf  # its first frame has both

    def on_snapshot(self, snapshot: Snapshot, others: Mapping[str, Body] = _NO_BODIES) -> None:
        """Process a snapshot; `others` are further bodies that are drawn, where they are."""
        if others:
            self.drawn_only |= others.keys() - snapshot.T_base_bodies.keys()
            self._recorder.remember(Scene(others))
            poses = {name: body.T_base_body for name, body in others.items()}
            snapshot = evolve(snapshot, T_base_bodies={**poses, **snapshot.T_base_bodies})
        states = snapshot.grippers.items()
        self._grippers.on_percents({s: state.percent for s, state in states if s in self._fingered})
        if self._last is None or snapshot.time_s > self._last.time_s:
            self._recorder.on_snapshot(snapshot)
        self._last = snapshot

    def is_frame_due(self, time_s: float, speed: float) -> bool:
        """Whether to send a frame of that time; `speed` is that of simulated time. If so, once."""
        if time_s < self._next_frame_s:
            return False
        self._next_frame_s = time_s + speed * MIN_FRAME_S
        return True

    def topics(self, snapshot: Snapshot) -> dict[str, object]:
        """What the page displays of a snapshot beside the picture, by topic.

        The seed is that of the move under way, "" between moves. `unmeasured` is the reason why
        there is no clearance, "" when there is one. Waypoints are absent unless they have changed,
        and the clearance is absent until the next measurement.
        """
        time_s = snapshot.time_s
        states = {side: arm.at(time_s, snapshot.q) for side, arm in self._arms.items()}
        moved = [side for side, arm in self._arms.items() if arm.has_moved]
        speeds = {side: max(map(abs, states[side]["v"])) for side in moved}
        now = tuple(side for side, speed in speeds.items() if speed > MIN_SPEED_RAD_S)
        self._moving = now or self._moving or tuple(moved)
        topics: dict[str, object] = {
            "caption": snapshot.caption,
            "seed": self._seed if time_s <= self._seed_until_s else "",
            "arms": {side: self._arms[side].limits for side in moved},
            "state": {"time": time_s, "arms": {side: states[side] for side in moved}},
        }
        if time_s >= self._listed_until_s:
            topics["waypoints"] = waypoints(self._moves, 0.0, time_s, is_live=True)
            ends_s = (move.end_s for move in self._moves)
            self._listed_until_s = min((s for s in ends_s if s > time_s), default=np.inf)
        now_s = self._clock()
        if now_s - self._measured_s >= CLEARANCE_PERIOD_S:
            self._measured_s = now_s
            clearance = self._clearance(snapshot)
            is_known = isinstance(clearance, dict)
            topics["clearance"] = clearance if is_known else None
            topics["unmeasured"] = "" if is_known else clearance
        return topics

    def recording(self, note: str = "") -> Recording:
        """What was shown, or the end of it; `note` is added as the last caption."""
        if note and self._last is not None:
            time_s = self._last.time_s + DEFAULT_TICK_S
            self.on_snapshot(evolve(self._last, time_s=time_s, caption=note))
        return self._recorder.recording()

    def _clearance(self, snapshot: Snapshot) -> dict[str, object] | str:
        """The nearest pair, or the reason why it is unknown."""
        if not self._moving:
            return NO_MOTION
        try:
            self._shapes = self._shapes or RobotShapes(self._robot)
            self._meter = self._meter or ClearanceMeter(self._shapes, self.bodies)
        except SceneError:
            return NO_BODY
        found = self._meter.at(snapshot.q, snapshot.T_base_bodies, self._hands.now, self._moving)
        if found is None:
            return NO_PAIR
        near, points = found
        pair = {"distance_m": near.distance_m, "first": near.first, "second": near.second}
        return {"time": snapshot.time_s, **pair, "points": points.reshape(-1).tolist()}


class _ArmState:
    """Position and speed of an arm.

    Attributes:
        has_moved: whether it has moved, or a move has begun.
        limits: its joints and their limits, as the page reads them.
    """

    def __init__(self, robot: Baxter, side: str) -> None:
        self._arm = robot.arm(side)
        self._where = list(robot.indices(self._arm.joint_names))
        self.has_moved, self.limits = False, limits_of(self._arm)
        self._move: RecordedMove | None = None
        self._order: list[int] = []
        self._first_q: FloatArray | None = None
        self._last: tuple[float, FloatArray, FloatArray] | None = None

    def on_move(self, move: RecordedMove) -> None:
        """Process the beginning of a move."""
        self._move, self.has_moved = move, True
        self._order = [move.joint_names.index(name) for name in self._arm.joint_names]
        self.limits = limits_of(self._arm, [move.trajectory.limits])

    def at(self, time_s: float, full: FloatArray) -> Mapping[str, list[float]]:
        """Position, velocity and acceleration of the joints at a full configuration."""
        q = full[self._where]
        first = self._first_q = q if self._first_q is None else self._first_q
        self.has_moved = self.has_moved or bool(np.abs(q - first).max() > MIN_MOVED_RAD)
        v, a = self._exact(time_s, q) or self._differences(time_s, q)
        self._last = time_s, q, v
        return {"q": q.tolist(), "v": v.tolist(), "a": a.tolist()}

    def _exact(self, time_s: float, q: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Velocity and acceleration of the move under way, if the arm is where the move has it."""
        move = self._move
        if move is None or not move.start_s <= time_s <= move.end_s:
            return None
        at = move.trajectory.sample(time_s - move.start_s)
        planned, v, a = (each[self._order] for each in at)
        return (v, a) if np.abs(planned - q).max() <= AGREEMENT_RAD else None

    def _differences(self, time_s: float, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        zero = np.zeros_like(q)
        if self._last is None or time_s <= self._last[0]:
            return zero, zero
        last_s, last_q, last_v = self._last
        v = (q - last_q) / (time_s - last_s)
        return (v, (v - last_v) / (time_s - last_s)) if v.any() else (zero, zero)
