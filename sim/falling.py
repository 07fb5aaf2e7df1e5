"""Falling: where a body comes to rest that nothing holds.

A body let go turns its most level face down and falls straight until it touches something. There it
stays when its centre is above the hull of what it touches. Otherwise it tips off: it goes sideways,
away from its footing, just so far that it is clear of it, and falls on, until it stands. It does
not turn over, does not roll or bounce, and what it falls on does not give way. Where something is
in the way of tipping off, it leans where it is.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from baxter_kin.arrays import Vector
from baxter_kin.frames import BASE_HEIGHT_M
from planner import Body, Part
from planner.contact import PRESSING_TOLERANCE_M, gap_m, travel_to_contact
from sim.footing import beside, bottom_area, touched_area

FLOOR_Z_M = -BASE_HEIGHT_M
FLOOR = "floor"
UP = np.array([0.0, 0.0, 1.0])
GRAVITY_M_S2 = 9.81

LEVEL_M = 1e-5
"""Supports whose heights differ by less carry a body together."""

SIDESTEP_M = 1e-3
"""How far a body that tipped off passes its former support."""

MOST_TIPS = 16
"""How often a body tips off on its way down; then it stays."""


@dataclass(frozen=True, slots=True, eq=False)
class Leg:
    """A straight fall.

    Attributes:
        T_base_body: where it begins.
        drop_m: how far it goes down, not negative.
    """

    T_base_body: pin.SE3
    drop_m: float

    @property
    def duration_s(self) -> float:
        """How long it takes from rest."""
        return math.sqrt(2 * self.drop_m / GRAVITY_M_S2)


@dataclass(frozen=True, slots=True, eq=False)
class Rest:
    """Where a body comes to rest.

    Attributes:
        T_base_body: its pose there.
        support: the body below, or the floor; of several the first.
        fall_m: how far it falls, not negative.
        legs: its falls one after the other.
        fell_off: names of what it tipped off from on its way.
        beside_m: how far its centre is beside its footing; 0 unless it leans.
    """

    T_base_body: pin.SE3
    support: str
    fall_m: float
    legs: tuple[Leg, ...] = ()
    fell_off: tuple[str, ...] = ()
    beside_m: float = 0.0

    @property
    def duration_s(self) -> float:
        """How long the fall takes."""
        return sum(leg.duration_s for leg in self.legs)

    def pose(self, time_s: float) -> pin.SE3:
        """Where the body is so long after it was let go."""
        for leg in self.legs:
            if time_s < leg.duration_s:
                return _raised(leg.T_base_body, -GRAVITY_M_S2 * time_s * time_s / 2)
            time_s -= leg.duration_s
        return self.T_base_body


@dataclass(frozen=True, slots=True, eq=False)
class _Landing:
    """The end of a straight fall: the body there, what it touches, and where."""

    body: Body
    drop_m: float
    supports: tuple[str, ...]
    areas: tuple[Vector, ...]

    @property
    def beside(self) -> Vector | None:
        return beside(self.body.centre_base[:2], self.areas)


def come_to_rest(body: Body, others: Sequence[Body]) -> Rest:
    """Where a body comes to rest among others, let go where it is.

    Args:
        body: what falls.
        others: all bodies that stand still.
    """
    landing = _landing(levelled(body), others)
    legs, fell_off = [Leg(body.T_base_body, landing.drop_m)], list[str]()
    while (way := landing.beside) is not None and len(legs) < MOST_TIPS:
        tipped = _beside_its_footing(landing, way)
        if any(_is_inside(tipped, other) for other in others):
            break
        fell_off += landing.supports
        landing = _landing(tipped, others)
        legs.append(Leg(tipped.T_base_body, landing.drop_m))
    return Rest(
        T_base_body=landing.body.T_base_body,
        support=landing.supports[0],
        fall_m=sum(leg.drop_m for leg in legs),
        legs=tuple(legs),
        fell_off=tuple(dict.fromkeys(fell_off)),
        beside_m=0.0 if way is None else float(np.linalg.norm(way)),
    )


def levelled(body: Body) -> Body:
    """The body turned about its centre, by the least angle that makes one of its axes vertical.

    A long one rises as much as its turning would otherwise push it down.
    """
    R = body.T_base_body.rotation
    axis = int(np.abs(R[2]).argmax())
    up = R[:, axis] * np.sign(R[2, axis])
    turn = pin.Quaternion.FromTwoVectors(up, UP).toRotationMatrix()
    centre = body.centre_base
    shifted = centre + turn @ (body.T_base_body.translation - centre)
    turned = body.at(pin.SE3(turn @ R, shifted))
    sunk_m = body.extent_m(UP)[0] - turned.extent_m(UP)[0]
    return turned.at(_raised(turned.T_base_body, max(0.0, sunk_m)))


def _landing(body: Body, others: Iterable[Body]) -> _Landing:
    """Where a level body lands that falls straight."""
    lifted = body.at(_raised(body.T_base_body, PRESSING_TOLERANCE_M))
    room_m = lifted.extent_m(UP)[0] - FLOOR_Z_M
    meetings = [
        (travel, part, below, other.name)
        for other in others
        for part in _parts(lifted)
        for below in _parts(other)
        if (travel := travel_to_contact(part, -UP, below, room_m)) is not None
    ]
    travel_m = min((room_m, *(travel for travel, *_ in meetings)))
    landed = lifted.at(_raised(lifted.T_base_body, -travel_m))
    met = [meeting for meeting in meetings if meeting[0] <= travel_m + LEVEL_M]
    met.sort(key=lambda meeting: meeting[0])
    names = [name for *_, name in met]
    areas = [
        touched_area(part.at(_raised(part.T_body_part, -travel)), below)
        for travel, part, below, _ in met
    ]
    if room_m <= travel_m + LEVEL_M:
        names.append(FLOOR)
        areas.append(bottom_area(_parts(landed)))
    drop_m = max(0.0, travel_m - PRESSING_TOLERANCE_M)
    return _Landing(landed, drop_m, tuple(dict.fromkeys(names)), tuple(areas))


def _beside_its_footing(landing: _Landing, way: Vector) -> Body:
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
        for part in _parts(body)
        for still in _parts(other)
    )


def _parts(body: Body) -> list[Part]:
    """A body's shapes, placed in base."""
    return [part.at(body.T_base_body * part.T_body_part) for part in body.parts]


def _raised(T_base_body: pin.SE3, height_m: float) -> pin.SE3:
    return pin.SE3(T_base_body.rotation, T_base_body.translation + height_m * UP)
