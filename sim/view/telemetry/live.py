"""LiveTelemetry: what the live page tells beside the picture, from snapshots and events.

The same values as of a recording, as far as they are known by then: the clearance is measured some
ten times a second, and velocities and accelerations are exact while a move that was told of is
under way. Bodies that it was not told of do not count.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping

import numpy as np

from baxter_kin import Baxter
from baxter_kin.display import OneLine, listing
from baxter_kin.validation import FloatArray, expect
from planner import Body
from planner.collision.robot.robot_shapes import RobotShapes
from planner.errors import SceneError
from planner.state import State
from sim.errors import ViewerError
from sim.events import Event, EventKind, Snapshot
from sim.recording.recorded_motion import AGREEMENT_RAD, RecordedMove, recorded_move
from sim.view.telemetry.arms import MOVED_RAD, MOVING_RAD_S, limits_of
from sim.view.telemetry.clearance import NO_BODY, NO_MOTION, NO_PAIR
from sim.view.telemetry.nearest import NearestPairs
from sim.view.telemetry.stated_contacts import StatedContacts
from sim.view.telemetry.waypoints import waypoint

CLEARANCE_PERIOD_S = 0.1
"""Real time between two measurements of the clearance."""

WAYPOINTS_KEPT = 24
"""Of so many moves, the latest, the page is told."""

Topics = dict[str, object]


class LiveTelemetry(OneLine):
    """Follows one robot; not for several threads at once."""

    def __init__(
        self,
        robot: Baxter,
        *,
        shapes: RobotShapes | None = None,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        """Nothing has moved yet.

        Args:
            robot: the robot.
            shapes: its shapes, where they are known; else they are made when an arm first moves.
            clock: real time, s, which says when to measure the clearance again.
        """
        self._robot = expect(robot, Baxter, "robot", ViewerError)
        if shapes is not None:
            expect(shapes, RobotShapes, "shapes", ViewerError)
        self._shapes, self._clock = shapes, clock
        self._arms = {side: _ArmState(robot, side) for side in robot.arms}
        self._bodies: dict[str, Body] = {}
        self._contacts = StatedContacts()
        self._pairs: NearestPairs | None = None
        self._measured_s = -np.inf
        self._moving: tuple[str, ...] = ()
        self._waypoints: deque[Topics] = deque(maxlen=WAYPOINTS_KEPT)
        self._told: Topics = {}
        self._has_shapes = True

    def start(self, state: State) -> None:
        """A run begins: what is there counts, and what the hands hold, and nothing else."""
        expect(state, State, "state", ViewerError)
        self._arms = {side: _ArmState(self._robot, side) for side in self._robot.arms}
        self._bodies = dict(state.scene.bodies)
        self._contacts, self._pairs = StatedContacts(), None
        self._moving = ()
        for held in state.attachments:
            self._contacts.hold(held.side, held.body)
        self._waypoints.clear()
        self._told.clear()
        self._measured_s = -np.inf

    def hear(self, event: Event) -> None:
        """Take note of something that happened."""
        expect(event, Event, "event", ViewerError)
        if event.body is not None and event.kind is EventKind.SPAWNED:
            self._add(event.body)
        elif event.body is not None and event.kind is EventKind.DELETED:
            self._remove(event.body.name)
        self._contacts.on_event(event)
        move = recorded_move(event)
        if move is not None:
            self._begin(move)

    def see(self, snapshot: Snapshot) -> Topics:
        """What is new of each topic: `arms`, `state`, `clearance` and `waypoints`.

        `unmeasured` says why there is no clearance, "" when there is one.
        """
        shot = expect(snapshot, Snapshot, "snapshot", ViewerError)
        if shot.q.shape != (len(self._robot.joint_names),):
            raise ViewerError(
                f"the snapshot has {shot.q.size} joints, the robot {len(self._robot.joint_names)}"
            )
        states = {side: arm.see(shot.time_s, shot.q) for side, arm in self._arms.items()}
        moved = [side for side, arm in self._arms.items() if arm.has_moved]
        speeds = {side: max(map(abs, states[side]["v"])) for side in moved}
        now = tuple(side for side, speed in speeds.items() if speed > MOVING_RAD_S)
        self._moving = now or self._moving
        self._end_waypoints(shot.time_s)
        news: Topics = {
            "arms": {side: self._arms[side].limits for side in moved},
            "state": {"time": shot.time_s, "arms": {side: states[side] for side in moved}},
            "waypoints": list(self._waypoints),
        }
        now_s = self._clock()
        if now_s - self._measured_s >= CLEARANCE_PERIOD_S:
            self._measured_s = now_s
            news |= self._clearance(shot, tuple(moved))
        return self._changed(news)

    def _changed(self, news: Topics) -> Topics:
        changed = {topic: value for topic, value in news.items() if value != self._told.get(topic)}
        self._told |= {
            topic: [dict(each) for each in value] if isinstance(value, list) else value
            for topic, value in changed.items()
        }
        return changed

    def _add(self, body: Body) -> None:
        self._bodies[body.name] = body
        self._pairs = None

    def _remove(self, name: str) -> None:
        self._bodies.pop(name, None)
        self._pairs = None

    def _begin(self, move: RecordedMove) -> None:
        self._arms[move.limb].begin(move)
        self._end_waypoints(move.start_s, side=move.limb)
        self._waypoints.append(waypoint(self._robot, move, move.start_s, None))
        self._measured_s = -np.inf  # its first frame tells of it
        self._contacts.on_move(move)

    def _end_waypoints(self, time_s: float, side: str | None = None) -> None:
        """Those that have come to their end, or have been stopped by the next of their side."""
        for told in self._waypoints:
            if told["end"] is None:
                end_s = self._arms[str(told["side"])].end_s
                if side == told["side"] or time_s >= end_s:
                    told["end"] = min(time_s, end_s)

    def _clearance(self, shot: Snapshot, sides: tuple[str, ...]) -> Topics:
        if not sides:
            return {"clearance": None, "unmeasured": NO_MOTION}
        pairs = self._known_pairs(sides)
        if pairs is None:
            return {"clearance": None, "unmeasured": NO_BODY}
        poses = {name: T.homogeneous for name, T in shot.T_base_bodies.items()}
        near = pairs.at(shot.q, poses, self._contacts.now, self._moving)
        if near is None:
            return {"clearance": None, "unmeasured": NO_PAIR}
        told = {"time": shot.time_s, "distance_m": near.distance_m, "first": near.first}
        told |= {"second": near.second, "points": near.points_base.reshape(-1).tolist()}
        return {"clearance": told, "unmeasured": ""}

    def _known_pairs(self, sides: tuple[str, ...]) -> NearestPairs | None:
        """What is to be measured; None for a robot without some of the links of the body."""
        if self._has_shapes and (self._pairs is None or self._pairs.sides != sides):
            try:
                self._shapes = self._shapes or RobotShapes(self._robot)
                self._pairs = NearestPairs(self._shapes, sides, self._bodies)
            except SceneError:
                self._has_shapes = False
        return self._pairs if self._has_shapes else None

    def _facts(self) -> tuple[str, ...]:
        moved = [f"{side} arm has moved" for side, arm in self._arms.items() if arm.has_moved]
        return listing(self._bodies, "body"), *moved


class _ArmState:
    """Where an arm is and how fast.

    Attributes:
        has_moved: whether it was seen to move, or told to.
        limits: its joints and their limits, as the page takes them.
        end_s: when the latest move ends.
    """

    def __init__(self, robot: Baxter, side: str) -> None:
        self._arm = robot.arm(side)
        self._where = list(robot.indices(self._arm.joint_names))
        self.has_moved, self.limits, self.end_s = False, limits_of(self._arm), -np.inf
        self._move: RecordedMove | None = None
        self._order: list[int] = []
        self._first_q: FloatArray | None = None
        self._last: tuple[float, FloatArray, FloatArray] | None = None

    def begin(self, move: RecordedMove) -> None:
        """A move begins."""
        self._move, self.end_s, self.has_moved = move, move.end_s, True
        self._order = [move.joint_names.index(name) for name in self._arm.joint_names]
        self.limits = limits_of(self._arm, [move.trajectory.limits])

    def see(self, time_s: float, full: FloatArray) -> Mapping[str, list[float]]:
        """The state at a time, in numbers for the page."""
        q = full[self._where]
        first = self._first_q = q if self._first_q is None else self._first_q
        self.has_moved = self.has_moved or bool(np.abs(q - first).max() > MOVED_RAD)
        v, a = self._exact(time_s, q) or self._differences(time_s, q)
        self._last = time_s, q, v
        return {"q": q.tolist(), "v": v.tolist(), "a": a.tolist()}

    def _exact(self, time_s: float, q: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """From the move under way, if the arm is where that has it."""
        move = self._move
        if move is None or not move.start_s <= time_s <= move.end_s:
            return None
        at = move.trajectory.sample(time_s - move.start_s)
        planned, v, a = (each[self._order] for each in at)
        return (v, a) if np.abs(planned - q).max() <= AGREEMENT_RAD else None

    def _differences(self, time_s: float, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        none = np.zeros_like(q)
        if self._last is None or time_s <= self._last[0]:
            return none, none
        last_s, last_q, last_v = self._last
        v = (q - last_q) / (time_s - last_s)
        if not v.any():
            return none, none
        return v, (v - last_v) / (time_s - last_s)
