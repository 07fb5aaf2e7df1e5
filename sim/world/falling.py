"""Falling: where a body comes to rest that nothing holds.

A released body turns its most level face down and falls straight until it touches something. It
stays there if its centre is above the hull of what it touches: level or, on supports that are
tilted by up to 1 deg, tilted like these (`planner.scene.support`). Otherwise it tips off: it moves
sideways, just so far that it is clear of its footing, and falls on until it stands. It does not
turn over, roll or bounce, and what it falls on does not give way. Where something prevents it from
tipping off, it leans where it is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from baxter_kin.display import millimetres, phrase, position
from baxter_kin.fields import frozen, scalar
from baxter_kin.frames import raised
from baxter_kin.validation import FloatArray, finite_scalar
from planner import Body
from planner.scene.contact import PRESSING_TOLERANCE_M, gap_m
from planner.scene.support import Landing, settle
from sim.errors import SimulationError

GRAVITY_M_S2 = 9.81

SIDESTEP_M = 1e-3
"""Distance of a body that tipped off from its former support."""

MAX_TIPS = 16
"""Maximum number of times that a body tips off on its way down; then it stays."""


@frozen(error=SimulationError)
class Leg:
    """A straight fall.

    Attributes:
        T_base_body: pose at its beginning.
        drop_m: its height, not negative.
    """

    T_base_body: pin.SE3
    drop_m: float = scalar(least=0.0)

    @property
    def duration_s(self) -> float:
        """Its duration, from rest."""
        return math.sqrt(2 * self.drop_m / GRAVITY_M_S2)


@frozen(error=SimulationError)
class Rest:
    """Where a body comes to rest.

    Attributes:
        T_base_body: its pose there.
        supports: names of the bodies that it stands on, or the floor; the first touched first.
        fall_m: total height of its falls, not negative.
        legs: its falls one after the other.
        fell_off: names of what it tipped off on its way.
        beside_m: distance of its centre from its footing; 0 unless it leans.
        tilt_rad: its tilt, which is that of its support; 0 when level.
        slope_rad: slope of what it met first where that is too steep to stand on; else 0.
    """

    T_base_body: pin.SE3
    supports: tuple[str, ...]
    fall_m: float
    legs: tuple[Leg, ...] = ()
    fell_off: tuple[str, ...] = ()
    beside_m: float = 0.0
    tilt_rad: float = 0.0
    slope_rad: float = 0.0

    def __attrs_post_init__(self) -> None:
        if not self.supports:
            raise SimulationError("supports is empty; a body rests on something")

    @property
    def support(self) -> str:
        """The first of its supports."""
        return self.supports[0]

    @property
    def duration_s(self) -> float:
        """Duration of the fall."""
        return sum(leg.duration_s for leg in self.legs)

    def pose(self, time_s: float) -> pin.SE3:
        """Pose of the body at a time after its release."""
        time_s = finite_scalar(time_s, "time_s", SimulationError)
        for leg in self.legs:
            if time_s < leg.duration_s:
                return raised(leg.T_base_body, -GRAVITY_M_S2 * time_s * time_s / 2)
            time_s -= leg.duration_s
        return self.T_base_body

    def _facts(self) -> tuple[str, ...]:
        return (
            f"on {phrase(' and '.join(self.supports))}",
            f"fell {millimetres(self.fall_m)}",
            position(self.T_base_body),
        )


def come_to_rest(body: Body, others: Sequence[Body]) -> Rest:
    """Where a body comes to rest among others when it is released where it is.

    Args:
        body: what falls.
        others: all bodies that do not move.
    """
    landing = settle(body, others)
    slope_rad = landing.slope_rad
    legs, fell_off = [Leg(body.T_base_body, landing.drop_m)], list[str]()
    while (way := landing.overhang) is not None and len(legs) < MAX_TIPS:
        tipped = _beside_its_footing(landing, way)
        if any(_is_inside(tipped, other) for other in others):
            break
        fell_off += landing.supports
        landing = settle(tipped, others)
        legs.append(Leg(tipped.T_base_body, landing.drop_m))
    return Rest(
        T_base_body=landing.body.T_base_body,
        supports=landing.supports,
        fall_m=sum(leg.drop_m for leg in legs),
        legs=tuple(legs),
        fell_off=tuple(dict.fromkeys(fell_off)),
        beside_m=0.0 if way is None else float(np.linalg.norm(way)),
        tilt_rad=landing.tilt_rad,
        slope_rad=slope_rad,
    )


def _beside_its_footing(landing: Landing, way: FloatArray) -> Body:
    """The body moved sideways until nothing of it is above its footing."""
    along = way / np.linalg.norm(way)
    reach = max(float((area @ along).max()) for area in landing.areas)
    begin = landing.body.extent_m((along[0], along[1], 0.0))[0]
    step = (reach - begin + SIDESTEP_M) * along
    T = landing.body.T_base_body
    return landing.body.at(pin.SE3(T.rotation, T.translation + np.array([*step, 0.0])))


def _is_inside(body: Body, other: Body) -> bool:
    """Whether two bodies share more than a contact."""
    return any(
        gap_m(part, still) < -PRESSING_TOLERANCE_M
        for part in body.placed_parts
        for still in other.placed_parts
    )
