"""Timeline: the simulated time of a world; what passes in it is shown, and told as it happens."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Protocol

from baxter_kin.errors import expect_all
from baxter_kin.kinematics.arm import LIMBS
from planner import Body, Move
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
        self.caption = ""

    def finish(self) -> None:
        """Show the world as it is now, unless the last tick did; a run ends between two ticks."""
        if self.is_past_tick:
            self.show()

    def pass_s(self, duration_s: float, update: Callable[[float], None] = lambda _: None) -> None:
        """Let time pass: bring the world to each tick, show it, and end exactly at the end."""
        self.advance(duration_s, update, self.show)

    def show(self) -> None:
        """Show the world to all observers."""
        if not self._observers:
            return
        snapshot = Snapshot(
            time_s=self.time_s,
            q=self._world.q,
            T_base_bodies=self._world.body_poses(),
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
