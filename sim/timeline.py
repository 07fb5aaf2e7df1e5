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
from sim.events import (
    Detail,
    Event,
    EventKind,
    Observer,
    Snapshot,
    contact_text,
    grasp_text,
    miss_text,
    opening_text,
    push_text,
    rest_text,
)
from sim.world.contacts import Contact
from sim.world.falling import Rest
from sim.world.gripper import NO_GRIPPER, Closing, GripperState
from sim.world.world import World

DEFAULT_TICK_S = 0.01
"""100 Hz, the rate of the original's commands and of its recorder."""

MIN_TICK_S = 1e-6
"""Shorter ticks only fill memory."""

MOVED_M = 1e-6
"""A body pushed or fallen by less was not; contacts are found to 1e-8 m."""


class Clock:
    """Time that ends anywhere, and ticks at whole multiples of their length.

    Attributes:
        time_s: time since the start.
    """

    def __init__(self, tick_s: float) -> None:
        self._tick_s = positive_scalar(tick_s, "tick_s", SimulationError)
        if self._tick_s < MIN_TICK_S:
            raise SimulationError(f"tick_s must be at least {MIN_TICK_S:g} s, got {self._tick_s:g}")
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


class ReportsState(Protocol):
    """A gripper, simulated or real."""

    @property
    def state(self) -> GripperState:
        """What it reports now."""


class Timeline(Clock):
    """The time of a world, and the observers that are informed of it.

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
        super().__init__(tick_s)
        self._world, self._grippers = world, grippers
        self._observers = expect_all(observers, Observer, "the observers", SimulationError)
        self._announced = {body.name: body for body in world.scene}
        self._shown_s: float | None = None
        self.caption = ""

    def begin(self) -> None:
        """Notify all observers of the initial state."""
        state = self._world.state
        for observer in self._observers:
            observer.on_start(state)

    def finish(self) -> None:
        """Show the world as it is now, unless that was done; a run ends between two ticks."""
        self.pass_s(0.0)  # at first, a tick is due
        if self.is_past_tick and self.time_s != self._shown_s:
            self.show()

    def pass_s(self, duration_s: float, update: Callable[[float], None] = lambda _: None) -> None:
        """Let time pass: bring the world to each tick, show it, and end exactly at the end."""
        self.advance(duration_s, update, self.show)

    def show(self) -> None:
        """Pass a snapshot to all observers, after the events of bodies that others put or took."""
        self._shown_s = self.time_s
        if not self._observers:
            return
        poses = self._world.body_poses()
        if poses.keys() != self._announced.keys():
            self._announce(poses.keys())
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

    def notify(
        self,
        kind: EventKind,
        text: str,
        side: str | None = None,
        *,
        move: Move | None = None,
        body: Body | None = None,
        detail: Detail | None = None,
    ) -> None:
        """Notify all observers of an event; arguments as of `Event`."""
        event = Event(self.time_s, kind, text, side, move, body, detail)
        if body is not None and kind is EventKind.SPAWNED:
            self._announced[body.name] = body
        elif body is not None and kind is EventKind.DELETED:
            self._announced.pop(body.name, None)
        for observer in self._observers:
            observer.on_event(event)

    def spawn(self, body: Body) -> None:
        """Add a body to the world, and report it; a movable one falls on what is below it."""
        self._world.spawn(body)
        on = " and ".join(self._world.supports.get(body.name, ()))
        on = f", at rest on {on}" if on else ""
        settled = self._world.body(body.name)
        self.notify(EventKind.SPAWNED, f"{body.name} spawned{on}", body=settled)

    def delete(self, name: str) -> None:
        """Remove a body from the world, and report it."""
        body = self._world.body(name)
        self._world.delete(name)
        self.notify(EventKind.DELETED, f"{name} deleted", body=body)

    def hit(self, side: str, contact: Contact) -> None:
        """Report a collision."""
        self.notify(EventKind.HIT, contact_text(contact, side), side, detail=contact)

    def pushed(self, side: str, closing: Closing) -> None:
        """Report the bodies that closing fingers pushed; those that are not held settle."""
        for push in closing.pushes:
            if push.is_riding:
                continue
            if push.distance_m > MOVED_M:
                body = self._world.body(push.body)
                self.notify(EventKind.PUSHED, push_text(push, side), side, body=body, detail=push)
            if push.body != closing.body:
                rest = self._world.settle(push.body)
                if rest.fall_m > MOVED_M:
                    self.settled(push.body, rest)

    def grasped(self, side: str, closing: Closing) -> None:
        """Report a grasp; a closing that found nothing is not reported."""
        if closing.body is not None and closing.grasp is not None:
            percent = self._grippers[side].state.percent
            text = grasp_text(closing.body, closing.grasp, percent)
            body = self._world.body(closing.body)
            self.notify(EventKind.GRASPED, text, side, body=body, detail=closing.grasp)

    def missed(self, side: str, closing: Closing, wanted: str | None = None) -> str:
        """Report a closing that found nothing to hold, and return the text of the report.

        Args:
            side: of the hand.
            closing: how it ended.
            wanted: name of the body that it was about.
        """
        gap_m = self._world.hand(side).gap_m(self._world.finger_m(side))
        text = miss_text(closing.miss, wanted, gap_m, is_closed=closing.finger_m == 0.0)
        body = None if wanted is None else self._world.scene.bodies.get(wanted)
        self.notify(EventKind.MISSED, text, side, body=body, detail=closing.miss)
        return text

    def opened(self, side: str) -> None:
        """Report that an empty hand has opened."""
        self.notify(EventKind.OPENED, opening_text(side, self._grippers[side].state.percent), side)

    def released(self, side: str, name: str) -> None:
        """Report that a hand begins to release a body."""
        body = self._world.body(name)
        self.notify(EventKind.RELEASED, f"{name} released", side, body=body)

    def settled(self, name: str, rest: Rest) -> None:
        """Report that a body has come to rest."""
        body = self._world.body(name)
        self.notify(EventKind.SETTLED, rest_text(name, rest), body=body, detail=rest)

    def _announce(self, present: Collection[str]) -> None:
        """Report bodies that were put into the world, or taken out, without the simulation."""
        for name in [name for name in self._announced if name not in present]:
            body = self._announced[name]
            self.notify(EventKind.DELETED, f"{name} taken out of the world", body=body)
        for name in [name for name in present if name not in self._announced]:
            body = self._world.body(name)
            self.notify(EventKind.SPAWNED, f"{name} put into the world", body=body)
