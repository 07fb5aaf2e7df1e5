"""The live view: a simulation slowed to real time and shown in the browser."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from sim import Event, EventKind, Observer, Snapshot

if TYPE_CHECKING:  # a headless run needs no web server
    from sim.viewer import Viewer

FRAME_S = 1.0 / 60.0
"""Shortest time between two frames that are sent."""


class LiveView(Observer):
    """Shows snapshots when their time has come."""

    def __init__(self, viewer: Viewer) -> None:
        """Show in that viewer; the clock starts with the first snapshot."""
        self._viewer = viewer
        self._zero_s: float | None = None
        self._next_frame_s = 0.0

    def on_event(self, event: Event) -> None:
        """A body appears or disappears."""
        if event.body is not None and event.kind is EventKind.SPAWNED:
            self._viewer.add_body(event.body)
        elif event.body is not None:
            self._viewer.remove_body(event.body.name)

    def on_snapshot(self, snapshot: Snapshot) -> None:
        """Wait until it is due, then show it; planning pauses count as time, so nothing rushes."""
        now = time.perf_counter()
        planned = now if self._zero_s is None else self._zero_s + snapshot.time_s
        due = max(planned, now)  # late, as after planning: go on from here
        self._zero_s = due - snapshot.time_s
        time.sleep(due - now)
        if snapshot.time_s >= self._next_frame_s:
            self._viewer.show(snapshot.q, snapshot.T_base_bodies, snapshot.caption)
            self._next_frame_s = snapshot.time_s + FRAME_S
