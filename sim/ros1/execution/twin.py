"""Twin: a world that follows a robot, so that observers are informed as by a simulation.

Arms and fingers are where they are measured. Nothing reports bodies: they are where the plan has
them, move with the hand that reports to grip them, and fall where it opens.

Observers are informed in a thread of their own, in order, so that slow ones delay no set-point. An
error that one raises is stored, and nothing more is reported.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from baxter_kin import Baxter
from baxter_kin.kinematics.arm import LIMBS
from planner import Grip, GripperAction, Move
from planner.grasping.hand import reported_finger_m
from planner.state import State
from sim.events import EventKind, Observer, Sample, SampleObserver, opening_text
from sim.timeline import Timeline
from sim.world.gripper import GripperState
from sim.world.world import World


@dataclass
class _Report:
    """The last state of a gripper."""

    state: GripperState


class Twin:
    """A world that follows a robot.

    Attributes:
        world: robot and bodies as they are reported and planned.
        error: what an observer has raised; None as long as none has.
    """

    def __init__(self, robot: Baxter, state: State, observers: Iterable[Observer]) -> None:
        """Build the world of a state; observers are informed from `begin` on."""
        self.world = World.from_state(state, robot)
        unknown = GripperState(100.0, is_gripping=False, has_missed=False)
        self._reports = {side: _Report(unknown) for side in LIMBS}
        self._observers = tuple(observers)
        self._timeline = Timeline(self.world, self._reports, self._observers, 1.0)
        self._tasks: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self._last_s = -np.inf
        self.error: Exception | None = None

    def begin(self) -> None:
        """Start the thread, in which observers are first informed of the state at the start."""
        self.put(self._timeline.begin)
        self._thread = threading.Thread(target=self._run, name="observers", daemon=True)
        self._thread.start()

    def end(self) -> None:
        """Report what is left, and end the thread."""
        if self._thread is not None:
            self._tasks.put(None)
            self._thread.join()
            self._thread = None

    def put(self, task: Callable[..., None], *arguments: object) -> None:
        """Call a method below in the observers' thread, after all that was put before."""
        self._tasks.put(partial(task, *arguments))

    def update(
        self,
        time_s: float,
        joints: Mapping[str, float],
        grippers: Mapping[str, GripperState],
        caption: str,
    ) -> None:
        """Follow what is measured, and show it.

        Args:
            time_s: of the execution; snapshots increase in it.
            joints: positions by name, rad.
            grippers: their reports by side.
            caption: what is going on.
        """
        if time_s <= self._last_s:
            return
        self._last_s = self._timeline.time_s = time_s
        self._timeline.caption = caption
        for side, arm in self.world.robot.arms.items():
            if all(name in joints for name in arm.joint_names):
                q = np.array([joints[name] for name in arm.joint_names])
                self.world.move_arm(side, np.clip(q, arm.limits.q_min, arm.limits.q_max))
        for side, state in grippers.items():
            self._reports[side].state = state
            hand = self.world.hands.get(side)
            if hand is not None:
                finger_m = reported_finger_m(state.percent, hand.stroke_m)
                self.world.set_fingers(side, finger_m)
        self._timeline.show()

    def sample(self, sample: Sample) -> None:
        """Report a tick to the observers of samples."""
        for observer in self._observers:
            if isinstance(observer, SampleObserver):
                observer.on_sample(sample)

    def notify(
        self,
        time_s: float,
        kind: EventKind,
        text: str,
        side: str | None = None,
        move: Move | None = None,
    ) -> None:
        """Report an event."""
        self._timeline.time_s = time_s
        self._timeline.notify(kind, text, side, move=move)

    def gripped(self, time_s: float, side: str, grip: Grip, percent: float) -> None:
        """Attach the body that the fingers closed on, or drop the one that they let go."""
        self._timeline.time_s = time_s
        world, timeline = self.world, self._timeline
        if grip.action is GripperAction.CLOSE:
            name = grip.body
            if name is not None and name in world.scene.bodies:
                T_tip_body = world.T_base_tip(side).inverse() * world.body(name).T_base_body
                world.attach(side, name, T_tip_body)
                text = f"{name} grasped, as the gripper reports ({percent:.0f} % open)"
                timeline.notify(EventKind.GRASPED, text, side, body=world.body(name))
            return
        name = world.detach(side)
        if name is None:
            timeline.notify(EventKind.OPENED, opening_text(side, percent), side)
        else:
            timeline.released(side, name)
            if not world.is_held(name):
                timeline.settled(name, world.settle(name))

    def _run(self) -> None:
        while (task := self._tasks.get()) is not None:
            if self.error is not None:
                continue
            try:
                task()
            except Exception as error:  # whatever an observer raises ends the execution
                self.error = error
