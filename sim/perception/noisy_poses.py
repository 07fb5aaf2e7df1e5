"""Noisy poses: what a camera makes of the truth.

Position errors are normal and independent along x, y and z of base; the yaw error turns the body
about the vertical through its centre. A look may see nothing (dropout), and what it sees may be old
(latency). Every look draws the same number of random numbers, whatever comes of it, so runs with
the same generator stay comparable when one parameter changes.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from baxter_kin.display import OneLine
from baxter_kin.fields import frozen, scalar
from baxter_kin.validation import FloatArray, expect, finite_scalar
from planner import Body
from sim.errors import SimulationError
from sim.perception.pose_source import PoseSource, Sighting, checked_source


@frozen(error=SimulationError, eq=True)
class Noise:
    """How badly something sees.

    Attributes:
        position_m: standard deviation along each axis of base.
        yaw_rad: standard deviation of the turn about the vertical.
        dropout: probability that a look sees nothing, 0 .. 1.
        latency_s: how old what it sees is.

    Raises:
        SimulationError: when one is not a number, or outside its range.
    """

    position_m: float = scalar(least=0.0, default=0.0)
    yaw_rad: float = scalar(least=0.0, default=0.0)
    dropout: float = scalar(least=0.0, most=1.0, default=0.0)
    latency_s: float = scalar(least=0.0, default=0.0)


class NoisyPoses(OneLine):
    """A pose source that sees what another one sees, but worse."""

    def __init__(self, source: PoseSource, noise: Noise, rng: np.random.Generator) -> None:
        """Look through a source.

        Args:
            source: what sees better.
            noise: how much worse.
            rng: where the errors come from; the same numbers make the same errors.

        Raises:
            SimulationError: when an argument has the wrong type.
        """
        self._source = checked_source(source, "source")
        self._noise = expect(noise, Noise, "noise", SimulationError)
        self._rng = expect(rng, np.random.Generator, "rng", SimulationError)

    def look(self, name: str, time_s: float) -> Sighting | None:
        """What it sees of a body at a time; None when it does not see it.

        Raises:
            SimulationError: when the time is no number.
        """
        time_s = finite_scalar(time_s, "time_s", SimulationError)
        errors, is_seen = self._rng.normal(size=4), self._rng.random() >= self._noise.dropout
        sighting = self._source.look(name, max(0.0, time_s - self._noise.latency_s))
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
        shift_base: how far, seen from base, shape (3,), m.
        yaw_rad: how much, about z of base.
    """
    turn, centre = pin.rpy.rpyToMatrix(0.0, 0.0, yaw_rad), body.centre_base
    T = body.T_base_body
    position = centre + turn @ (T.translation - centre) + shift_base
    return body.at(pin.SE3(turn @ T.rotation, position))
