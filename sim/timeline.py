"""The simulated time of a world: a clock with ticks, and the timeline that informs observers."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Protocol

import numpy as np

from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray, expect_all, positive_scalar
from planner import Body, Move
from sim.errors import SimulationError
from sim.events import Detail, Event, EventKind, Observer, Snapshot
from sim.world.contacts import Contact
from sim.world.gripper import NO_GRIPPER, GripperState
from sim.world.world import World

DEFAULT_TICK_S = 0.01
"""100 Hz, the rate of the original's commands and of its recorder."""

SHORTEST_TICK_S = 1e-6
"""Shorter ticks only fill memory."""


class Clock:
    """Time that ends anywhere, and ticks at whole multiples of their length.

    Attributes:
        time_s: time since the start.
    """

    def __init__(self, tick_s: float) -> None:
        """At time zero."""
        self._tick_s = positive_scalar(tick_s, "tick_s", SimulationError)
        if self._tick_s < SHORTEST_TICK_S:
            raise SimulationError(
                f"tick_s must be at least {SHORTEST_TICK_S:g} s, got {self._tick_s:g}"
            )
        self.time_s = 0.0
        self._next_tick = 0

    @property
    def is_past_tick(self) -> bool:
        """Whether time has passed since the last tick."""
        return self.time_s > (self._next_tick - 1) * self._tick_s

    def ticks_until(self, end_s: float) -> FloatArray:
        """The times of the ticks from now until then, shape (n,), s."""
        return self._tick_s * np.array(self._numbers(end_s), dtype=np.float64)

    def advance(
        self, duration_s: float, update: Callable[[float], None], show: Callable[[], None]
    ) -> None:
        """Let time pass and end exactly at the end.

        Args:
            duration_s: how long.
            update: brings the world to a time since the beginning; called at each tick and at the
                end.
            show: called at each tick after that.
        """
        begin_s = self.time_s
        for tick in self._numbers(begin_s + duration_s):
            self.time_s = tick * self._tick_s
            self._next_tick = tick + 1
            update(self.time_s - begin_s)
            show()
        update(duration_s)
        self.time_s = begin_s + duration_s

    def _numbers(self, end_s: float) -> range:
        return range(self._next_tick, math.floor(end_s / self._tick_s) + 1)


class _ReportsState(Protocol):
    """What is shown of a gripper, simulated or real."""

    @property
    def state(self) -> GripperState:
        """What it reports now."""


class Timeline(Clock):
    """Time, and those who are told of it.

    Attributes:
        caption: what is going on, in words.
        hits: every contact that was told of as a hit, in order.
    """

    def __init__(
        self,
        world: World,
        grippers: Mapping[str, _ReportsState],
        observers: Iterable[Observer],
        tick_s: float,
    ) -> None:
        """At time zero."""
        super().__init__(tick_s)
        self._world, self._grippers = world, grippers
        self._observers = expect_all(observers, Observer, "the observers", SimulationError)
        self._told = {body.name: body for body in world.scene}
        self._shown_s: float | None = None
        self.caption = ""
        self.hits: list[Contact] = []

    def begin(self) -> None:
        """Tell all observers how the world is before anything happens."""
        state = self._world.state
        for observer in self._observers:
            observer.on_start(state)

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
        if kind is EventKind.HIT and isinstance(detail, Contact):
            self.hits.append(detail)
        if body is not None and kind is EventKind.SPAWNED:
            self._told[body.name] = body
        elif body is not None and kind is EventKind.DELETED:
            self._told.pop(body.name, None)
        for observer in self._observers:
            observer.on_event(event)

    def spawn(self, body: Body) -> None:
        """Add a body to the world, and tell; a movable one falls on what is below it."""
        self._world.spawn(body)
        on = " and ".join(self._world.supports.get(body.name, ()))
        on = f", at rest on {on}" if on else ""
        settled = self._world.body(body.name)
        self.tell(EventKind.SPAWNED, f"{body.name} spawned{on}", body=settled)

    def delete(self, name: str) -> None:
        """Remove a body from the world, and tell."""
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
