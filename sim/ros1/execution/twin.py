"""Twin: a world that follows what a robot reports, so that observers see it as any simulation.

Arms and fingers are where they are measured. Of bodies nobody reports anything: they are where the
plan has them, move with the hand that is said to grip them, and fall where it opens.

Observers are told in a thread of their own, in order, so that slow ones delay no set-point. What
one raises is kept, and nothing more is told.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterable, Mapping
from functools import partial

import numpy as np

from baxter_kin import Baxter
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray
from planner import Body, Grip, GripperAction, Move
from planner.state import State
from sim.events import EventKind, Observer, opening_text
from sim.samples import Sample, SampleObserver
from sim.timeline import Timeline
from sim.world.gripper import GripperState
from sim.world.world import World


class Twin:
    """A world that follows a robot.

    Attributes:
        world: robot and bodies as they are reported and planned.
        error: what an observer has raised; None as long as all is well.
    """

    def __init__(self, robot: Baxter, state: State, observers: Iterable[Observer]) -> None:
        """Put everything where a state has it, and tell nobody yet."""
        self.world = World(robot)
        for body in state.scene:
            self.world.spawn(body)
        for held in state.attachments:
            self.world.attach(held.side, held.body, held.T_link_body)
        self._reports = {side: ReportedGripper() for side in LIMBS}
        self._observers = tuple(observers)
        self._timeline = Timeline(self.world, self._reports, self._observers, 1.0)
        self._tasks: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self._last_s = -np.inf
        self.error: Exception | None = None

    def begin(self) -> None:
        """Start telling, first of the bodies that are there."""
        for body in self.world.scene:
            self.put(partial(self._appear, body))
        self._thread = threading.Thread(target=self._run, name="observers", daemon=True)
        self._thread.start()

    def end(self) -> None:
        """Tell what is left, and end."""
        if self._thread is not None:
            self._tasks.put(None)
            self._thread.join()
            self._thread = None

    def put(self, task: Callable[[], None]) -> None:
        """Do something after all that was told before; for the methods below."""
        self._tasks.put(task)

    def see(
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
            grippers: what they report, by side.
            caption: what is going on.
        """
        if time_s <= self._last_s:
            return
        self._last_s = self._timeline.time_s = time_s
        self._timeline.caption = caption
        for side, arm in self.world.robot.arms.items():
            if all(name in joints for name in arm.joint_names):
                self._move(side, np.array([joints[name] for name in arm.joint_names]))
        for side, state in grippers.items():
            self._reports[side].state = state
            hand = self.world.hands.get(side)
            if hand is not None:
                share = min(max(state.percent / 100.0, 0.0), 1.0)
                self.world.set_fingers(side, share * hand.stroke_m)
        self._timeline.show()

    def sample(self, sample: Sample) -> None:
        """Show a tick to those who want it."""
        for observer in self._observers:
            if isinstance(observer, SampleObserver):
                observer.on_sample(sample)

    def tell(
        self,
        time_s: float,
        kind: EventKind,
        text: str,
        side: str | None = None,
        move: Move | None = None,
    ) -> None:
        """Tell what happened."""
        self._timeline.time_s = time_s
        self._timeline.notify(kind, text, side, move=move)

    def gripped(self, time_s: float, side: str, grip: Grip, percent: float) -> None:
        """The gripper has done as told: what it closed on moves with it, what it let go falls."""
        self._timeline.time_s = time_s
        if grip.action is GripperAction.CLOSE:
            self._closed(side, grip, percent)
            return
        name = self.world.detach(side)
        if name is None:
            self._timeline.notify(EventKind.OPENED, opening_text(side, percent), side)
            return
        self._timeline.released(side, name)
        self._timeline.settled(name, self.world.settle(name))

    def _closed(self, side: str, grip: Grip, percent: float) -> None:
        name = grip.body
        if name is None or name not in self.world.scene.bodies:
            return
        T_tip_body = self.world.T_base_tip(side).inverse() * self.world.body(name).T_base_body
        self.world.attach(side, name, T_tip_body)
        text = f"{name} grasped, as the gripper reports ({percent:.0f} % open)"
        self._timeline.notify(EventKind.GRASPED, text, side, body=self.world.body(name))

    def missed(self, time_s: float, side: str, text: str) -> None:
        """The gripper holds nothing."""
        self._timeline.time_s = time_s
        self._timeline.notify(EventKind.MISSED, text, side)

    def _appear(self, body: Body) -> None:
        text = f"{body.name}, where the plan has it"
        self._timeline.notify(EventKind.SPAWNED, text, body=body)

    def _move(self, side: str, q: FloatArray) -> None:
        limits = self.world.robot.arm(side).limits
        self.world.move_arm(side, np.clip(q, limits.q_min, limits.q_max))

    def _run(self) -> None:
        while (task := self._tasks.get()) is not None:
            if self.error is not None:
                continue
            try:
                task()
            except Exception as error:  # whatever an observer raises ends the execution
                self.error = error


class ReportedGripper:
    """What a gripper reported last.

    Attributes:
        state: that.
    """

    def __init__(self) -> None:
        self.state = GripperState(100.0, is_gripping=False, has_missed=False)
