"""Timeline: the simulated time of a world; what passes in it is shown, and told as it happens."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Protocol

from baxter_kin.errors import expect_all
from baxter_kin.kinematics.arm import LIMBS
from planner import Body, Move, Situation
from sim.clock import Clock
from sim.errors import SimulationError
from sim.events import Detail, Event, EventKind, Observer, Snapshot
from sim.world.gripper import NO_GRIPPER, GripperState
from sim.world.world import World


class ReportsState(Protocol):
    """What is shown of a gripper, simulated or real."""

    @property
    def state(self) -> GripperState:
        """What it reports now."""


class Timeline(Clock):
    """Time, and those who are told of it.

    Attributes:
        caption: what is going on, in words.
    """

    def __init__(
        self,
        world: World,
        grippers: Mapping[str, ReportsState],
        observers: Iterable[Observer],
        tick_s: float,
    ) -> None:
        """At time zero.

        Raises:
            SimulationError: when the tick is not a number or too short, or one of the observers is
                of another class.
        """
        super().__init__(tick_s)
        self._world, self._grippers = world, grippers
        self._observers = expect_all(observers, Observer, "the observers", SimulationError)
        self._told = {body.name: body for body in world.scene}
        self._shown_s: float | None = None
        self.caption = ""

    def begin(self) -> None:
        """Tell all observers how the world is before anything happens."""
        joints = dict(zip(self._world.robot.joint_names, self._world.q.tolist(), strict=True))
        situation = Situation(self._world.scene, joints, self._world.held)
        for observer in self._observers:
            observer.on_start(situation)

    def finish(self) -> None:
        """Show the world as it is now, unless that was done; a run ends between two ticks."""
        if self.is_past_tick and self.time_s != self._shown_s:
            self.show()

    def pass_s(self, duration_s: float, update: Callable[[float], None] = lambda _: None) -> None:
        """Let time pass: bring the world to each tick, show it, and end exactly at the end."""
        self.advance(duration_s, update, self.show)

    def show(self) -> None:
        """Show the world to all observers, after telling which bodies others put there or took."""
        self._shown_s = self.time_s
        if not self._observers:
            return
        poses = self._world.body_poses()
        if poses.keys() != self._told.keys():
            self._tell_of_others(poses.keys())
        snapshot = Snapshot(
            time_s=self.time_s,
            q=self._world.q,
            T_base_bodies=poses,
            grippers=dict.fromkeys(LIMBS, NO_GRIPPER)
            | {side: gripper.state for side, gripper in self._grippers.items()},
            caption=self.caption,
        )
        for observer in self._observers:
            observer.on_snapshot(snapshot)

    def tell(
        self,
        kind: EventKind,
        text: str,
        side: str | None = None,
        *,
        move: Move | None = None,
        body: Body | None = None,
        detail: Detail | None = None,
    ) -> None:
        """Tell all observers what happened; arguments as of `Event`."""
        event = Event(self.time_s, kind, text, side, move, body, detail)
        if body is not None and kind is EventKind.SPAWNED:
            self._told[body.name] = body
        elif body is not None and kind is EventKind.DELETED:
            self._told.pop(body.name, None)
        for observer in self._observers:
            observer.on_event(event)

    def spawn(self, body: Body) -> None:
        """Add a body to the world, and tell; a movable one falls on what is below it.

        Raises:
            SceneError: when the name is taken.
        """
        support = self._world.spawn(body)
        on = f", at rest on {support}" if body.is_movable else ""
        settled = self._world.body(body.name)
        self.tell(EventKind.SPAWNED, f"{body.name} spawned{on}", body=settled)

    def delete(self, name: str) -> None:
        """Remove a body from the world, and tell.

        Raises:
            SceneError: when it is not there.
        """
        body = self._world.body(name)
        self._world.delete(name)
        self.tell(EventKind.DELETED, f"{name} deleted", body=body)

    def _tell_of_others(self, present: Collection[str]) -> None:
        """Bodies that were put into the world, or taken out of it, without the simulation."""
        for name in [name for name in self._told if name not in present]:
            self.tell(EventKind.DELETED, f"{name} taken out of the world", body=self._told[name])
        for name in [name for name in present if name not in self._told]:
            body = self._world.body(name)
            self.tell(EventKind.SPAWNED, f"{name} put into the world", body=body)
