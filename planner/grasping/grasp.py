"""What comes of closing a hand on a body: a grasp, or a miss with its reason.

The model is quasi-static and knows no forces. The pad that touches first pushes the body along the
closing axis until the other pad touches. The body keeps its orientation: one that lies askew stays
askew, held at two edges and wider between the pads than its faces are apart, by
`cos(yaw) + sin(yaw)` for a cube, where real pads would turn a slightly askew one until its faces
are flush. It is placed with the same yaw. A closing axis that is not level lifts the pushed body,
or presses it down, by the sine of its slope: 14 um per mm with the demo's tool.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
import pinocchio as pin

from baxter_kin.errors import millimetres_hint
from baxter_kin.validation import Checked
from baxter_kin.value_objects import OneLine, millimetres, sentence
from planner.errors import SceneError
from planner.scene.bodies import Body, Part

LEAST_PAD_M = 0.002
"""With less of a pad on a body it slips off. Chosen: nobody published one for these pads."""

NEAR_EDGE_M = 0.010
"""A grasp with less of a pad on the body is near an edge: a quarter of the left hand's pads."""

_WHOLE_M = 1e-6
"""How much may be missing where a pad counts as wholly used, by rounding."""


class MissKind(str, Enum):
    """Why a hand holds nothing after closing."""

    NOTHING = "nothing between the pads"
    TOO_WIDE = "too wide"
    TOO_THIN = "too thin"
    NOT_BETWEEN = "reaches into a finger"
    EDGE = "only the edge of a pad"
    BLOCKED = "a finger is blocked"
    CROWDED = "several bodies between the pads"


@dataclass(frozen=True, slots=True, repr=False)
class Miss(Checked, OneLine, error=SceneError):
    """Why a hand holds nothing after closing; `str()` of it is a phrase.

    Attributes:
        kind: the reason.
        text: the same with names and numbers.
        body: the body that it is about; None when there is none.
        amount_m: the number in it: how wide, how deep in the finger, how much of a pad, or how far
            beside the tip; None when there is none.
    """

    kind: MissKind
    text: str
    body: str | None = None
    amount_m: float | None = None

    def __str__(self) -> str:
        return self.text

    def _facts(self) -> tuple[str, ...]:
        return (sentence(self.text),)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Grasp(Checked, OneLine, error=SceneError):
    """Both pads touch a body.

    Attributes:
        finger_m: finger position, 0 .. stroke.
        T_tip_body: the body's pose seen from the tip once both pads touch it.
        width_m: distance between the pads, where these are nearest to each other: Rethink's are
            hollow by up to 0.9 mm, so it may be less than the body is wide.
        push_m: how far the first pad pushed the body along the closing axis before the second
            touched; positive along y of the gripper.
        pad_m: how much of a pad is on the body, along the shorter side of where they overlap; the
            less of both pads.
        centre_off_m: how far the body's centre is beside the pads, seen along the closing axis; 0
            when it is between them.
        is_near_edge: whether less than `NEAR_EDGE_M` of a pad is on a body that has room for more.
    """

    finger_m: float
    T_tip_body: pin.SE3
    width_m: float
    push_m: float
    pad_m: float
    centre_off_m: float
    is_near_edge: bool

    def _facts(self) -> tuple[str, ...]:
        pushed = f"pushed {millimetres(self.push_m)}"
        near = "near the edge of a pad" if self.is_near_edge else ""
        return (
            f"{millimetres(self.width_m)} wide",
            f"fingers at {millimetres(self.finger_m)}",
            pushed,
            near,
        )


@dataclass(frozen=True, slots=True)
class Overlap:
    """Where a pad and a body overlap, seen along the closing axis.

    Both are taken as the rectangles of their extents along x and z of the gripper, which is exact
    for boxes that lie straight in the hand and too much for round or askew ones.

    Attributes:
        least_m: its shorter side; not positive when they do not overlap.
        possible_m: what the shorter side would be with one wholly on the other.
    """

    least_m: float
    possible_m: float

    @property
    def is_enough(self) -> bool:
        """Whether the pad holds."""
        return self.least_m >= LEAST_PAD_M or self._is_whole

    @property
    def is_near_edge(self) -> bool:
        """Whether the pad holds barely."""
        return self.least_m < NEAR_EDGE_M and not self._is_whole

    @property
    def _is_whole(self) -> bool:
        return self.least_m >= self.possible_m - _WHOLE_M

    @classmethod
    def of(cls, pad: Sequence[Part], parts: Sequence[Part]) -> Overlap:
        """The best of the touching shapes of a pad with any that touch it, seen from the tip."""
        spans = [_span(pad, axis) for axis in (0, 2)]
        return max((_overlap(spans, part) for part in parts), key=lambda found: found.least_m)


def extent(part: Part, axis: int) -> tuple[float, float]:
    """The interval that a shape covers along an axis of the frame it is placed in, m."""
    along = np.eye(3)[axis]
    T = part.T_body_part
    middle, along_part = float(T.translation[axis]), T.rotation.T @ along
    return middle - part.shape.support_m(-along_part), middle + part.shape.support_m(along_part)


def centre_off_m(pads: Sequence[Sequence[Part]], body: Body) -> float:
    """How far a body's centre is beside the pads, seen along y; all placed seen from the tip."""
    beside = []
    for axis in (0, 2):
        centre = sum(body.extent_m(np.eye(3)[axis])) / 2
        spans = [_span(pad, axis) for pad in pads]
        low, high = min(low for low, _ in spans), max(high for _, high in spans)
        beside.append(max(low - centre, centre - high, 0.0))
    return math.hypot(*beside)


def _span(pad: Sequence[Part], axis: int) -> tuple[float, float]:
    """The interval that some shapes cover together along an axis."""
    spans = [extent(part, axis) for part in pad]
    return min(low for low, _ in spans), max(high for _, high in spans)


def _overlap(spans: Sequence[tuple[float, float]], part: Part) -> Overlap:
    shared, possible = [], []
    for axis, (low, high) in zip((0, 2), spans, strict=True):
        begin, end = extent(part, axis)
        shared.append(min(high, end) - max(low, begin))
        possible.append(min(high - low, end - begin))
    tightest = int(np.argmin(shared))
    return Overlap(shared[tightest], possible[tightest])


def misfit(kind: MissKind, name: str, width_m: float, gap_m: float) -> Miss:
    """Of what is too wide for the open hand, or too thin for the closed one."""
    pads = "whose closed finger pads" if kind is MissKind.TOO_THIN else "whose finger pads"
    text = (
        f"{name} measures {1e3 * width_m:.1f} mm across the hand, {pads} are {1e3 * gap_m:.1f} mm "
        "apart"
    )
    return Miss(kind, text, name, width_m)


def beside(seen: Body) -> Miss:
    """Of what is not between the pads."""
    x, y, z = seen.centre_base
    across = float(np.hypot(x, y))
    is_hinted = millimetres_hint(x, y, z) != ""
    hint = "; was its place given in millimetres? Lengths are in metres" if is_hinted else ""
    text = (
        f"{seen.name} is {1e3 * across:.0f} mm to the side of the tip and {1e3 * abs(z):.0f} mm "
        f"{'ahead of' if z >= 0.0 else 'behind'} it, not between the finger pads{hint}"
    )
    return Miss(MissKind.NOTHING, text, seen.name, across)


def slips(name: str, pad_m: float) -> Miss:
    """Of what has too little of a pad on it."""
    text = (
        f"only {1e3 * pad_m:.1f} mm of a finger pad on {name}; less than "
        f"{1e3 * LEAST_PAD_M:.1f} mm slip off"
    )
    return Miss(MissKind.EDGE, text, name, pad_m)
