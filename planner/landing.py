"""Landing: where a body that falls straight meets what is below, and whether it stands there."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from baxter_kin.arrays import Vector
from baxter_kin.frames import BASE_HEIGHT_M, raised
from planner.contact import PRESSING_TOLERANCE_M, travel_to_contact
from planner.footing import beside, bottom_area, touched_area
from planner.scene import Body

FLOOR_Z_M = -BASE_HEIGHT_M
FLOOR = "floor"
UP = np.array([0.0, 0.0, 1.0])

LEVEL_M = 1e-5
"""Supports whose heights differ by less carry a body together."""


@dataclass(frozen=True, slots=True, eq=False)
class Landing:
    """The end of a straight fall.

    Attributes:
        body: the body there.
        drop_m: how far it fell, not negative.
        supports: names of what it touches; the floor is one.
        areas: where it touches each, corners seen from above, shape (n, 2), m.
    """

    body: Body
    drop_m: float
    supports: tuple[str, ...]
    areas: tuple[Vector, ...]

    @property
    def beside(self) -> Vector | None:
        """The way from what it stands on to its centre, shape (2,), m; None when it stands."""
        return beside(self.body.centre_base[:2], self.areas)


def land(body: Body, others: Iterable[Body]) -> Landing:
    """Where a body lands that falls straight, as it is, onto others or the floor.

    What it touches within `PRESSING_TOLERANCE_M` already carries it where it is.
    """
    lifted = body.at(raised(body.T_base_body, PRESSING_TOLERANCE_M))
    room_m = lifted.extent_m(UP)[0] - FLOOR_Z_M
    meetings = [
        (travel, part, below, other.name)
        for other in others
        for part in lifted.placed_parts
        for below in other.placed_parts
        if (travel := travel_to_contact(part, -UP, below, room_m)) is not None
    ]
    travel_m = min((room_m, *(travel for travel, *_ in meetings)))
    landed = lifted.at(raised(lifted.T_base_body, -travel_m))
    met = [meeting for meeting in meetings if meeting[0] <= travel_m + LEVEL_M]
    met.sort(key=lambda meeting: meeting[0])
    names = [name for *_, name in met]
    areas = [
        touched_area(part.at(raised(part.T_body_part, -travel)), below)
        for travel, part, below, _ in met
    ]
    if room_m <= travel_m + LEVEL_M:
        names.append(FLOOR)
        areas.append(bottom_area(landed.placed_parts))
    drop_m = max(0.0, travel_m - PRESSING_TOLERANCE_M)
    return Landing(landed, drop_m, tuple(dict.fromkeys(names)), tuple(areas))


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
    return turned.at(raised(turned.T_base_body, max(0.0, sunk_m)))
