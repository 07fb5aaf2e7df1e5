"""Pose sources: where the planner believes the bodies are, because something has seen them.

A source is asked for one body at a time and answers with a `Sighting`, or with None when it does
not see the body. `TruePoses` sees everything exactly; `sim.perception.noisy_poses` makes that
worse.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Mapping
from typing import Protocol

import pinocchio as pin

from baxter_kin.display import quoted, seconds
from baxter_kin.fields import frozen, scalar
from baxter_kin.validation import expect, finite_scalar
from planner import Body
from sim.errors import SimulationError
from sim.events import Observer, Snapshot
from sim.world.world import World

KEPT_SNAPSHOTS = 1000
"""How many ticks back a world is remembered: 10 s at 100 Hz."""


@frozen(error=SimulationError)
class Sighting:
    """What was seen of one body.

    Attributes:
        body: the body where it seems to be.
        time_s: simulated time that it was seen at.
    """

    body: Body
    time_s: float = scalar()

    def _facts(self) -> tuple[str, ...]:
        return repr(self.body), f"seen at {seconds(self.time_s)}"


class PoseSource(Protocol):
    """Sees bodies."""

    def look(self, name: str, time_s: float) -> Sighting | None:
        """What it sees of a body at a time, or None when it does not see it.

        Args:
            name: of the body.
            time_s: simulated time, never less than at the look before.
        """


def checked_source(source: PoseSource, what: str) -> PoseSource:
    """A source of poses, if it is one."""
    if isinstance(source, type) or not callable(getattr(source, "look", None)):
        raise SimulationError(
            f"{what} must be an object with a method look(name, time_s), such as TruePoses(world), "
            f"got {quoted(source)}"
        )
    return source


class TruePoses(Observer):
    """Sees every body of a world exactly, now or as it was some seconds ago.

    What was is known only to a source that observes the simulation; one that does not answers with
    what is.
    """

    def __init__(self, world: World) -> None:
        """Look at a world.

        Raises:
            SimulationError: when it has the wrong type.
        """
        self._world = expect(world, World, "world", SimulationError)
        self._past: deque[tuple[float, Mapping[str, pin.SE3]]] = deque(maxlen=KEPT_SNAPSHOTS)

    def on_snapshot(self, snapshot: Snapshot) -> None:
        """Remember where everything was.

        Raises:
            SimulationError: when it is no snapshot.
        """
        expect(snapshot, Snapshot, "snapshot", SimulationError)
        self._past.append((snapshot.time_s, snapshot.T_base_bodies))

    def look(self, name: str, time_s: float) -> Sighting | None:
        """The body where it was at a time; None when it was not there.

        Raises:
            SimulationError: when the time is no number, or the name none.
        """
        finite_scalar(time_s, "time_s", SimulationError)
        expect(name, str, "name", SimulationError)
        bodies = self._world.scene.bodies
        if name not in bodies:
            return None
        if not self._past or time_s >= self._past[-1][0]:
            return Sighting(bodies[name], time_s)
        number = bisect_right(self._past, time_s, key=lambda entry: entry[0])
        seen_s, poses = self._past[max(0, number - 1)]
        return Sighting(bodies[name].at(poses[name]), seen_s) if name in poses else None

    def _facts(self) -> tuple[str, ...]:
        return (repr(self._world),)
