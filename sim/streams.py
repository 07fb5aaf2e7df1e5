"""Streams: what one arm does, activity by activity, or what both do at the same time.

An arm is a stream of activities: moves, travels of its fingers, waits. Streams run on one clock.
Time passes up to the next end of an activity; then that stream goes on to its next one, and what it
reports comes in the order of time. In between, the paths of the arms are checked for contacts where
that is asked for.

When one stream fails, all stop where they are: a move or a wait ends at that instant, as this is
kinematics and nothing brakes. Fingers and falling bodies go on to the end of what they do.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterable, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from baxter_kin.validation import FloatArray
from sim.events import stop_text
from sim.timeline import Timeline
from sim.world.contacts import CHECK_S, Contact, ContactWatch


class Activity(NamedTuple):
    """What an arm does for some time.

    Attributes:
        duration_s: how long it takes.
        update: brings the world to a time since its beginning.
        can_stop: whether it may end early; fingers and falling bodies do not.
        label: the step that it belongs to.
        path: configurations of the arm at times since its beginning, shape (n,): (n, 7), rad; None
            where the arm stands still.
    """

    duration_s: float
    update: Callable[[float], None] = lambda _: None
    can_stop: bool = True
    label: str = ""
    path: Callable[[FloatArray], FloatArray] | None = None


Activities: TypeAlias = Generator[Activity, None, str | None]
"""Activities in order; returns why they ended early, or None."""


class Stream:
    """The activities of one arm.

    Attributes:
        limb: the arm, "left" or "right".
        activity: the present one; None before the first and after the last one.
        begin_s: when it began.
        failure: why the activities ended early, or None.
    """

    def __init__(self, limb: str, activities: Activities) -> None:
        self.limb, self._activities = limb, activities
        self.activity: Activity | None = None
        self.begin_s = 0.0
        self.failure: str | None = None

    def go_on(self, now_s: float) -> None:
        """Begin the next activity, if there is one."""
        try:
            self.activity, self.begin_s = next(self._activities), now_s
        except StopIteration as end:
            self.activity, self.failure = None, end.value


class _Running(NamedTuple):
    """A stream in an activity, at a time."""

    stream: Stream
    activity: Activity
    passed_s: float

    @property
    def left_s(self) -> float:
        """The time until its end."""
        return self.activity.duration_s - self.passed_s


def run_streams(
    streams: Sequence[Stream],
    timeline: Timeline,
    watch: Callable[[], ContactWatch | None],
    on_hit: Callable[[str, Contact], None],
) -> str | None:
    """Run streams until all of them have ended, or one fails.

    Args:
        streams: one, or those of both arms.
        timeline: the clock.
        watch: what finds contacts until the next activity ends; None where that need not be.
        on_hit: called with an arm and its contact, at the time of that.

    Returns:
        Why they ended early, or None.
    """
    sides = [stream.limb for stream in streams]
    failure: str | None = None
    for stream in streams:
        stream.go_on(timeline.time_s)
    while True:
        failure = failure or next((s.failure for s in streams if s.failure is not None), None)
        running = [
            _Running(stream, stream.activity, timeline.time_s - stream.begin_s)
            for stream in streams
            if stream.activity is not None and (failure is None or not stream.activity.can_stop)
        ]
        if not running:
            return failure
        stopped = _pass(running, sides, timeline, watch(), on_hit)
        if stopped is not None:
            failure = failure or stopped
            continue
        span_s = min(each.left_s for each in running)
        for each in running:
            if each.left_s <= span_s:
                each.stream.go_on(timeline.time_s)


def _pass(
    running: Sequence[_Running],
    sides: Sequence[str],
    timeline: Timeline,
    watch: ContactWatch | None,
    on_hit: Callable[[str, Contact], None],
) -> str | None:
    """Let time pass until the first activity ends; returns what stopped an arm before, or None."""
    begin_s, span_s = timeline.time_s, min(each.left_s for each in running)

    def follow(end_s: float) -> None:
        first_s = timeline.time_s - begin_s

        def update(time_s: float) -> None:
            for each in running:
                each.activity.update(each.passed_s + first_s + time_s)

        timeline.pass_s(begin_s + end_s - timeline.time_s if first_s else end_s, update)

    for side, contact in _contacts(running, span_s, sides, watch) if watch else ():
        follow(contact.free_s if contact.stops else contact.time_s)
        on_hit(side, contact)
        if contact.stops:
            moving = [each for each in running if each.activity.path is not None]
            own = min(moving, key=lambda each: each.stream.limb != side)
            return f"{own.activity.label}: {stop_text(contact, side)}"
    follow(span_s)
    return None


def _contacts(
    running: Iterable[_Running], span_s: float, sides: Sequence[str], watch: ContactWatch
) -> list[tuple[str, Contact]]:
    """The contacts until the first activity ends."""
    times_s = np.linspace(0.0, span_s, max(1, math.ceil(span_s / CHECK_S)) + 1)
    paths = {
        each.stream.limb: each.activity.path(each.passed_s + times_s)
        for each in running
        if each.activity.path is not None
    }
    return watch.along(paths, times_s, sides) if paths else []
