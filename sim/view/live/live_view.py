"""The live view: a simulation slowed to real time and shown in the browser."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from baxter_kin.errors import expect
from sim.errors import ViewerError
from sim.events import Event, EventKind, Observer, Snapshot
from sim.view.gripper_status import GripperStatus

if TYPE_CHECKING:  # a headless run needs no web server
    from sim.view.live.viewer import Viewer

FRAME_S = 1.0 / 60.0
"""Shortest time between two frames that are sent."""

PAUSE_S = 0.1
"""When more time than this passes before an event, somebody was planning. The clock stands still
meanwhile, so that nothing rushes."""

LATEST_S = 1.0
"""A snapshot that is less late, as on a busy machine, is caught up with, so that the clock does not
drift; one that is later comes after a pause too."""


class LiveView(Observer):
    """Shows snapshots when their time has come: a simulation that it observes runs in real time."""

    def __init__(self, viewer: Viewer, *, keeps_time: bool = True) -> None:
        """Show in a view, which stays open when the simulation ends.

        Args:
            viewer: where.
            keeps_time: whether to wait for each snapshot's time; what runs in real time by itself
                is shown as it comes.

        Raises:
            ViewerError: when `keeps_time` is no bool.
        """
        self._viewer = viewer
        self._keeps_time = expect(keeps_time, bool, "keeps_time", ViewerError)
        self._story = GripperStatus()
        self._seed, self._seed_until_s = "", 0.0
        self._zero_s: float | None = None
        self._last_s = 0.0
        self._next_frame_s = 0.0

    def on_event(self, event: Event) -> None:
        """A body appears or disappears, or a gripper does something.

        Raises:
            ViewerError: when it is no event, or the view is closed.
        """
        expect(event, Event, "event", ViewerError)
        self._stand_still()
        self._story.hear(event)
        if event.body is not None and event.kind is EventKind.SPAWNED:
            self._viewer.add_body(event.body)
        elif event.body is not None and event.kind is EventKind.DELETED:
            self._viewer.remove_body(event.body.name)
        elif event.move is not None:
            self._seed = "" if event.move.ik is None else event.move.seed_label
            self._seed_until_s = event.time_s + event.move.trajectory.duration

    def on_snapshot(self, snapshot: Snapshot) -> None:
        """Wait until it is due, then show it.

        Raises:
            ViewerError: when it is no snapshot, or the view is closed.
        """
        expect(snapshot, Snapshot, "snapshot", ViewerError)
        self._story.see({side: state.percent for side, state in snapshot.grippers.items()})
        if self._keeps_time:
            time.sleep(self._until(snapshot.time_s))
        if snapshot.time_s >= self._next_frame_s:
            self._viewer.show(
                snapshot.q,
                snapshot.T_base_bodies,
                snapshot.caption,
                seed=self._seed if snapshot.time_s <= self._seed_until_s else "",
                grippers=self._story.phases,
            )
            self._next_frame_s = snapshot.time_s + FRAME_S
        self._last_s = time.perf_counter()

    def _stand_still(self) -> None:
        """Take the time since the last snapshot off the clock, if it was a pause."""
        now = time.perf_counter()
        if self._zero_s is not None and now - self._last_s > PAUSE_S:
            self._zero_s += now - self._last_s
        self._last_s = now

    def _until(self, time_s: float) -> float:
        """How long to wait for a simulated time; the clock is set back when it is long past."""
        now = time.perf_counter()
        if self._zero_s is None or now - (self._zero_s + time_s) > LATEST_S:
            self._zero_s = now - time_s
        return max(self._zero_s + time_s - now, 0.0)
