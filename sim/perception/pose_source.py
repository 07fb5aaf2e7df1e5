"""Pose sources: where bodies seem to be, exactly or as a camera would estimate them.

A source is queried for one body at a time and returns a `Sighting`, or None when it does not see
the body. `TruePoses` sees everything exactly. `NoisyPoses` adds errors: those of the position are
normal and independent along x, y and z of base; that of the yaw turns the body about the vertical
through its centre. An observation may see nothing (dropout), and what it sees may be old (latency).
Each draws the same number of random numbers, whatever its result, so runs with the same generator
stay comparable when one parameter changes.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Mapping
from typing import Protocol

import numpy as np
import pinocchio as pin

from baxter_kin.display import OneLine, quoted, seconds
from baxter_kin.fields import frozen, scalar
from baxter_kin.validation import FloatArray, expect, finite_scalar
from planner import Body
from sim.errors import SimulationError
from sim.events import Observer, Snapshot
from sim.world.world import World

MAX_SNAPSHOTS = 1000
"""Number of ticks that the past of a world goes back: 10 s at 100 Hz."""


@frozen(error=SimulationError)
class Sighting:
    """An observation of one body.

    Attributes:
        body: the body where it seems to be.
        time_s: simulated time of the observation.
    """

    body: Body
    time_s: float = scalar()

    def _facts(self) -> tuple[str, ...]:
        return repr(self.body), f"seen at {seconds(self.time_s)}"


class PoseSource(Protocol):
    """Estimates the poses of bodies."""

    def observe(self, name: str, time_s: float) -> Sighting | None:
        """The body as it is seen at a time, or None when it is not seen.

        Args:
            name: of the body.
            time_s: simulated time, never less than in the call before.
        """


def checked_source(source: PoseSource) -> PoseSource:
    """The argument, if it is a source of poses."""
    if isinstance(source, type) or not callable(getattr(source, "observe", None)):
        raise SimulationError(
            "source must be an object with a method observe(name, time_s), such as "
            f"TruePoses(world), got {quoted(source)}"
        )
    return source


class TruePoses(Observer):
    """Sees every body of a world exactly, now or some seconds ago.

    Only a source that observes the simulation knows the past; any other returns the present.
    """

    def __init__(self, world: World) -> None:
        """Observe a world.

        Raises:
            SimulationError: when it has the wrong type.
        """
        self._world = expect(world, World, "world", SimulationError)
        self._past: deque[tuple[float, Mapping[str, pin.SE3]]] = deque(maxlen=MAX_SNAPSHOTS)

    def on_snapshot(self, snapshot: Snapshot) -> None:
        """Remember where everything was."""
        expect(snapshot, Snapshot, "snapshot", SimulationError)
        self._past.append((snapshot.time_s, snapshot.T_base_bodies))

    def observe(self, name: str, time_s: float) -> Sighting | None:
        """The body where it was at a time; None when it was not there."""
        finite_scalar(time_s, "time_s", SimulationError)
        expect(name, str, "name", SimulationError)
        bodies = self._world.scene.bodies
        if name not in bodies:
            return None
        if not self._past or time_s >= self._past[-1][0]:
            return Sighting(bodies[name], time_s)
        index = bisect_right(self._past, time_s, key=lambda entry: entry[0])
        seen_s, poses = self._past[max(0, index - 1)]
        return Sighting(bodies[name].at(poses[name]), seen_s) if name in poses else None

    def _facts(self) -> tuple[str, ...]:
        return (repr(self._world),)


@frozen(error=SimulationError, eq=True)
class Noise:
    """The errors of a pose source.

    Attributes:
        position_m: standard deviation along each axis of base.
        yaw_rad: standard deviation of the turn about the vertical.
        dropout: probability that an observation sees nothing, 0 .. 1.
        latency_s: age of what it sees.
    """

    position_m: float = scalar(least=0.0, default=0.0)
    yaw_rad: float = scalar(least=0.0, default=0.0)
    dropout: float = scalar(least=0.0, most=1.0, default=0.0)
    latency_s: float = scalar(least=0.0, default=0.0)


class NoisyPoses(OneLine):
    """A pose source that adds noise to another one."""

    def __init__(self, source: PoseSource, noise: Noise, rng: np.random.Generator) -> None:
        """Observe through a source.

        Args:
            source: the more exact source.
            noise: the errors.
            rng: where they come from; the same numbers make the same errors.

        Raises:
            SimulationError: when an argument has the wrong type.
        """
        self._source = checked_source(source)
        self._noise = expect(noise, Noise, "noise", SimulationError)
        self._rng = expect(rng, np.random.Generator, "rng", SimulationError)

    def observe(self, name: str, time_s: float) -> Sighting | None:
        """The body as it is seen at a time; None when it is not seen."""
        time_s = finite_scalar(time_s, "time_s", SimulationError)
        errors, is_seen = self._rng.normal(size=4), self._rng.random() >= self._noise.dropout
        sighting = self._source.observe(name, max(0.0, time_s - self._noise.latency_s))
        if sighting is None or not is_seen:
            return None
        shift, yaw = self._noise.position_m * errors[:3], self._noise.yaw_rad * errors[3]
        return Sighting(displaced(sighting.body, shift, float(yaw)), sighting.time_s)

    def _facts(self) -> tuple[str, ...]:
        return (repr(self._noise),)


def displaced(body: Body, shift_base: FloatArray, yaw_rad: float) -> Body:
    """A body moved, and turned about the vertical through its centre.

    Args:
        body: the body.
        shift_base: translation seen from base, shape (3,), m.
        yaw_rad: angle about z of base.
    """
    turn, centre = pin.rpy.rpyToMatrix(0.0, 0.0, yaw_rad), body.centre_base
    T = body.T_base_body
    position = centre + turn @ (T.translation - centre) + shift_base
    return body.at(pin.SE3(turn @ T.rotation, position))
