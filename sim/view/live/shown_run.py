"""Shown run: what one simulation has told a live view, to be shown now and replayed in the end."""

from __future__ import annotations

from collections.abc import Mapping

from baxter_kin import Baxter
from baxter_kin.fields import FrozenMapping, evolve
from planner import Body, Scene, State
from sim.events import Event, EventKind, Snapshot
from sim.recording.recorder import Recorder
from sim.recording.recording import Recording
from sim.timeline import DEFAULT_TICK_S
from sim.view.gripper_status import GripperPhase, GripperStatus, sides_with_fingers
from sim.view.telemetry.live import LiveTelemetry

FRAME_S = 1.0 / 60.0
"""Shortest time between two frames that are sent."""

KEPT_SNAPSHOTS = 12_000
"""What was shown is kept for the replay at the end: the last two minutes at 100 Hz."""

_NONE: Mapping[str, Body] = FrozenMapping({})


class ShownRun:
    """One simulation, from its begin on.

    Attributes:
        bodies: those of its world, by name.
        drawn_only: the names of the others that were drawn meanwhile.
    """

    def __init__(self, robot: Baxter, state: State) -> None:
        """Nothing told yet.

        Args:
            robot: which is shown.
            state: how its world is when it begins.
        """
        self.bodies = dict(state.scene.bodies)
        self.drawn_only: set[str] = set()
        self._recorder = Recorder(robot, keep=KEPT_SNAPSHOTS)
        self._recorder.remember(state.scene)
        self._telemetry = LiveTelemetry(robot)
        self._telemetry.start(state)
        self._grippers = GripperStatus()
        self._fingered = sides_with_fingers(robot.joint_names)
        self._seed, self._seed_until_s = "", 0.0
        self._next_frame_s = 0.0
        self._last: Snapshot | None = None

    @property
    def is_empty(self) -> bool:
        """Whether there was no snapshot yet."""
        return self._last is None

    @property
    def phases(self) -> Mapping[str, GripperPhase]:
        """What the grippers do, by side."""
        return self._grippers.phases

    def is_over(self, time_s: float) -> bool:
        """Whether what happens at a time belongs to another run: time only goes forward."""
        return self._last is not None and time_s < self._last.time_s

    def hear(self, event: Event) -> None:
        """Take note of what happened."""
        self._recorder.on_event(event)
        self._telemetry.hear(event)
        self._grippers.hear(event)
        if event.body is not None and event.kind is EventKind.SPAWNED:
            self.bodies[event.body.name] = event.body
        elif event.body is not None and event.kind is EventKind.DELETED:
            self.bodies.pop(event.body.name, None)
        if event.move is not None:
            self._seed = "" if event.move.ik is None else event.move.seed_label
            self._seed_until_s = event.time_s + event.move.trajectory.duration

    def see(self, snapshot: Snapshot, others: Mapping[str, Body] = _NONE) -> None:
        """Take note of how everything is, and of other bodies that are drawn, where they are."""
        if others:
            snapshot = self._with(others, snapshot)
        states = snapshot.grippers.items()
        self._grippers.see(
            {side: state.percent for side, state in states if side in self._fingered}
        )
        if self._last is None or snapshot.time_s > self._last.time_s:
            self._recorder.on_snapshot(snapshot)
        self._last = snapshot

    def _with(self, others: Mapping[str, Body], snapshot: Snapshot) -> Snapshot:
        """A snapshot that has other bodies, too."""
        self.drawn_only |= others.keys() - snapshot.T_base_bodies.keys()
        self._recorder.remember(Scene(others))
        poses = {name: body.T_base_body for name, body in others.items()}
        return evolve(snapshot, T_base_bodies={**poses, **snapshot.T_base_bodies})

    def takes_frame(self, time_s: float, speed: float) -> bool:
        """Whether a frame of that time is to be sent, at so much of real time; it then counts."""
        if time_s < self._next_frame_s:
            return False
        self._next_frame_s = time_s + speed * FRAME_S
        return True

    def news(self, snapshot: Snapshot) -> dict[str, object]:
        """What a page is told of it beside the picture, by topic.

        The seed is that of inverse kinematics which led to where the arm moves, empty between
        moves.
        """
        seed = self._seed if snapshot.time_s <= self._seed_until_s else ""
        return {"caption": snapshot.caption, "seed": seed, **self._telemetry.see(snapshot)}

    def recording(self, note: str = "") -> Recording:
        """What was shown, or the end of it.

        Args:
            note: what came of it, as its last caption.
        """
        if note and self._last is not None:
            time_s = self._last.time_s + DEFAULT_TICK_S
            self.see(evolve(self._last, time_s=time_s, caption=note))
        return self._recorder.recording()
