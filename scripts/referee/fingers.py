"""Fingers that close and open, and what they push.

Quasi-static: the pad that touches first pushes the body along the closing axis, y of the tip,
until the other one touches; the body does not turn. Pads are the finger tips, all triangles of
them. The rest of a finger does not push: where it meets the body before the pads do, it will be
found inside it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from referee.solids import Array
from referee.stage import Stage, Thing, travel_m

PAD = "_finger_tip"
"""How the names of the links end that are pads."""

SPEED_M_S = 0.05
STEP_M = 5e-5
"""How fast fingers move, and how far at most from one sample to the next."""


@dataclass(frozen=True)
class Travel:
    """Finger positions during a gripper action, shape (n,), m."""

    label: str
    openings_m: Array

    def when(self, sample: int) -> tuple[str, float]:
        """Step and time of a sample."""
        way = float(np.abs(np.diff(self.openings_m[: sample + 1])).sum())
        return self.label, way / SPEED_M_S


@dataclass(frozen=True)
class Closing:
    """How a hand closes.

    Attributes:
        openings_m: finger positions on the way, shape (n,).
        T_things: where the body is meanwhile, shape (n, 4, 4), or (4, 4) when it is not pushed;
            None without a body.
        holds: whether both pads meet the body.
    """

    openings_m: Array
    T_things: Array
    holds: bool

    @property
    def opening_m(self) -> float:
        """How far the hand is open in the end."""
        return float(self.openings_m[-1])

    def travel(self, label: str) -> Travel:
        """The way of the fingers."""
        return Travel(label, self.openings_m)


def line_travel(label: str, begin_m: float, end_m: float) -> Travel:
    """From one finger position to another."""
    return Travel(label, _steps(begin_m, end_m))


def closing(stage: Stage, thing: Thing | None) -> Closing:
    """The hand closes from where its fingers are, around a body or nothing."""
    begin_m, axis = stage.opening_m, stage.tip(stage.limb)[:3, 1]
    if thing is None:
        return Closing(_steps(begin_m, 0.0), np.eye(4)[None], holds=False)
    links = stage.links({})
    ways = []
    for name, sign in zip(stage.finger_names, (-1.0, 1.0), strict=True):
        tips = {link for link in stage.robot.below({name}) if link.endswith(PAD)}
        pad = [track for link in tips for track in links[link]]
        x, y, z = sign * axis
        ways.append(travel_m(pad, thing.tracks(), (x, y, z), 2 * begin_m))
    first, second = ways
    way = (first + second) / 2
    if way > begin_m or max(ways) >= 2 * begin_m:
        openings = _steps(begin_m, 0.0)
        return Closing(openings, np.broadcast_to(thing.T, (len(openings), 4, 4)), holds=False)
    openings = _steps(begin_m, begin_m - way)
    closed = begin_m - openings
    pushed = np.maximum(closed - second, 0.0) - np.maximum(closed - first, 0.0)
    T = np.tile(thing.T, (len(openings), 1, 1))
    T[:, :3, 3] += pushed[:, None] * axis
    return Closing(openings, T, holds=True)


def _steps(begin_m: float, end_m: float) -> Array:
    count = 1 + int(np.ceil(abs(end_m - begin_m) / STEP_M))
    return np.linspace(begin_m, end_m, max(count, 2))
