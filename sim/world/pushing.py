"""Squeeze: two fingers on their way from contact to contact.

The model is told in `sim.world.finger_closing`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from baxter_kin.validation import FloatArray, check_fields, finite_array, finite_scalar
from baxter_kin.value_objects import Frozen, OneLine, millimetres, phrase
from planner import Body, Box, Hand, Part
from planner.grasping import Grasp
from planner.grasping.grasp import extent
from planner.grasping.hand import CLOSING_AXIS
from planner.scene.contact import PRESSING_TOLERANCE_M, travel_to_contact
from planner.scene.support import UP
from sim.errors import SimulationError
from sim.world.world import World


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Push(Frozen, OneLine):
    """A body that a closing finger moves.

    Attributes:
        body: its name.
        finger: which finger of the hand, "left" (+y of the tip) or "right".
        by: what it is pushed by: that finger, or a body that the finger pushes, or stands on one.
        begin_m: finger position from which on it moves.
        end_m: finger position where the fingers stop.
        axis_base: unit vector of its motion, shape (3,).
        T_base_begin: where it is before.
        is_riding: whether it is only carried along by what it stands on.

    Raises:
        SimulationError: when a value is of another class.
    """

    body: str
    finger: str
    by: str
    begin_m: float
    end_m: float
    axis_base: FloatArray
    T_base_begin: pin.SE3
    is_riding: bool = False

    def __post_init__(self) -> None:
        check_fields(self, SimulationError)
        axis = finite_array(self.axis_base, (3,), "axis_base", SimulationError)
        object.__setattr__(self, "axis_base", axis)

    @property
    def distance_m(self) -> float:
        """How far it is moved."""
        return max(0.0, self.begin_m - self.end_m)

    def pose(self, finger_m: float) -> pin.SE3:
        """Where the body is when the fingers are at a position.

        Raises:
            SimulationError: when the position is not a finite number.
        """
        finger_m = finite_scalar(finger_m, "finger position", SimulationError)
        moved_m = max(0.0, self.begin_m - max(finger_m, self.end_m))
        T = self.T_base_begin
        return pin.SE3(T.rotation, T.translation + moved_m * self.axis_base)

    def _facts(self) -> tuple[str, ...]:
        way = f"{millimetres(self.distance_m)} by the {self.finger} finger"
        return phrase(self.body), way


@dataclass(slots=True, eq=False)
class Mover:
    """A finger or a body. `parts` are its shapes seen from the tip, of a finger with it closed."""

    name: str
    parts: list[Part]
    is_finger: bool = False
    is_movable: bool = False
    sign: int = 0
    begin_m: float = 0.0
    finger: str = ""
    by: str = ""
    is_riding: bool = False

    @property
    def title(self) -> str:
        """What it is called in a sentence."""
        return f"the {self.name}" if self.is_finger else self.name

    @property
    def is_pushed_indirectly(self) -> bool:
        """Whether it is a body that no finger touches, but what a finger pushes."""
        return not self.is_finger and self.by != f"{self.finger} finger"

    def is_held_by(self, other: Mover) -> bool:
        """Whether it is a body that one finger pushes directly and the other has met."""
        opposite = self.sign * other.sign < 0
        return opposite and other.is_finger and not self.is_pushed_indirectly

    def offset_m(self, finger_m: float) -> float:
        """How far it is along y from where its parts are, when the fingers are at a position."""
        if not self.sign:
            return 0.0
        moved_m = -finger_m if self.is_finger else self.begin_m - finger_m
        return self.sign * moved_m


@dataclass(slots=True, eq=False)
class Squeeze:
    """The fingers on their way, from contact to contact."""

    world: World
    side: str
    hand: Hand = field(init=False)
    T_base_tip: pin.SE3 = field(init=False)
    begin_m: float = field(init=False)
    finger_m: float = field(init=False)
    _movers: list[Mover] = field(init=False)
    _lift: FloatArray = field(init=False)
    _known: dict[tuple[str, str], list[tuple[float, Part, Part]]] = field(
        init=False, default_factory=dict
    )

    def __post_init__(self) -> None:
        self.hand = self.world.hands[self.side]
        self.T_base_tip = self.world.T_base_tip(self.side)
        self.begin_m = self.finger_m = self.world.finger_m(self.side)
        self._lift = PRESSING_TOLERANCE_M * (self.T_base_tip.rotation.T @ UP)
        self._movers = [*self._fingers(), *map(self._mover, self.world.scene)]

    def run(self) -> tuple[Mover, Mover] | None:
        """Close until something stops the fingers: what met what; None when they close fully."""
        while (meeting := self._next()) is not None:
            travel_m, first, second = meeting
            self.finger_m = max(0.0, self.finger_m - max(0.0, travel_m))
            is_inside = first.is_finger and travel_m <= -PRESSING_TOLERANCE_M
            if second.sign or not second.is_movable or is_inside:
                return first, second
            self._take_along(first, second, max(0.0, -travel_m))
        self.finger_m = 0.0
        return None

    def agree(self, mover: Mover, grasp: Grasp) -> None:
        """Let a body and its riders end exactly where the hand's prediction puts it."""
        self.finger_m = grasp.finger_m
        for follower in self._with_riders(mover):
            follower.begin_m = grasp.finger_m + abs(grasp.push_m)

    @property
    def pushes(self) -> tuple[Push, ...]:
        """The bodies that were moved until now."""
        return tuple(self._push(m) for m in self._movers if m.sign and not m.is_finger)

    def _fingers(self) -> Iterator[Mover]:
        for finger, sign, parts in zip(("left", "right"), (-1, 1), self.hand.fingers, strict=True):
            yield Mover(f"{finger} finger", list(parts), True, sign=sign, finger=finger)

    def _mover(self, body: Body) -> Mover:
        T_tip_body = self.T_base_tip.inverse() * body.T_base_body
        parts = [part.at(T_tip_body * part.T_body_part) for part in body.parts]
        is_held = any(
            held is not None and held.body == body.name
            for held in map(self.world.holding, self.world.hands)
        )
        return Mover(body.name, parts, is_movable=body.is_movable and not is_held)

    def _next(self) -> tuple[float, Mover, Mover] | None:
        """The next contact: after how much finger travel, what meets what."""
        meetings = []
        for first in self._movers:
            for second in self._movers:
                if first.sign and first.sign != second.sign and _is_worth_it(first, second):
                    travel_m = self._travel(first, second)
                    if travel_m is not None and travel_m <= self.finger_m:
                        meetings.append((travel_m, first, second))
        return min(meetings, key=lambda meeting: meeting[0], default=None)

    def _travel(self, first: Mover, second: Mover) -> float | None:
        """How far the fingers travel until one thing meets another; None if they do not meet."""
        rate = abs(first.sign - second.sign)
        along = first.sign * CLOSING_AXIS
        start_m = first.offset_m(self.finger_m) - first.sign * PRESSING_TOLERANCE_M
        still_m = second.offset_m(self.finger_m)
        passed_m = first.sign * (start_m - still_m)
        found, room_m = None, rate * self.finger_m + PRESSING_TOLERANCE_M
        for gap_m, part, other in self._pairs(first, second):
            if gap_m - passed_m > room_m:
                break  # all others are farther apart
            moving, still = (
                _moved(part, start_m * CLOSING_AXIS),
                _moved(other, still_m * CLOSING_AXIS),
            )
            travel_m = self._part_travel(moving, along, still, room_m, first)
            if travel_m is not None:
                found = room_m = travel_m
        return None if found is None else (found - PRESSING_TOLERANCE_M) / rate

    def _part_travel(
        self, part: Part, along: FloatArray, other: Part, room_m: float, mover: Mover
    ) -> float | None:
        """The same for two shapes; the first lifted, so that it passes over what it stands on."""
        travel = travel_to_contact(_moved(part, self._lift), along, other, room_m)
        if travel is None or not mover.is_finger:
            return travel
        exact = travel_to_contact(part, along, other, room_m)
        return travel if exact is None else exact

    def _pairs(self, first: Mover, second: Mover) -> list[tuple[float, Part, Part]]:
        """The shapes of two things that may meet, and how far apart they begin along y.

        The nearest first. As all move along y, they stay the same.
        """
        key = first.name, second.name
        if key not in self._known:
            lifted = [(part, _extents(_moved(part, self._lift))) for part in first.parts]
            others = [(part, _extents(part)) for part in second.parts]
            pairs = [
                (_gap_along_y(one, two, first.sign), part, other)
                for part, one in lifted
                for other, two in others
                if all(one[k][0] <= two[k][1] and two[k][0] <= one[k][1] for k in (0, 2))
            ]
            self._known[key] = sorted(pairs, key=lambda pair: pair[0])
        return self._known[key]

    def _take_along(self, first: Mover, second: Mover, pressed_m: float) -> None:
        """From now on a body moves with what has met it, and its riders with it.

        It leaves what presses into it at once.
        """
        for follower in self._with_riders(second):
            if follower.sign == 0:
                follower.sign, follower.begin_m = first.sign, self.finger_m + pressed_m
                follower.finger = first.finger
                follower.by = first.name if follower is second else second.name
                follower.is_riding = follower is not second

    def _with_riders(self, mover: Mover) -> list[Mover]:
        names = {mover.name, *self.world.riders(mover.name)}
        followers = [m for m in self._movers if m.name in names and not m.is_finger]
        return [m for m in followers if m is mover or m.sign in (0, mover.sign)]

    def _push(self, mover: Mover) -> Push:
        return Push(
            body=mover.name,
            finger=mover.finger,
            by=mover.by,
            begin_m=mover.begin_m,
            end_m=self.finger_m,
            axis_base=mover.sign * self.T_base_tip.rotation[:, 1],
            T_base_begin=self.world.body(mover.name).T_base_body,
            is_riding=mover.is_riding,
        )


def _is_worth_it(first: Mover, second: Mover) -> bool:
    """Whether a pair is to be looked at: fingers meet no fingers, and of two that move, once."""
    if first.is_finger or second.is_finger:
        return first.is_finger and not second.is_finger
    return second.sign == 0 or first.sign < second.sign


def _extents(part: Part) -> list[tuple[float, float]]:
    """Where a shape begins and ends along x, y and z of the tip, m."""
    if not isinstance(part.shape, Box):
        return [extent(part, axis) for axis in range(3)]
    T, half = part.T_body_part, np.array(part.shape.size_m) / 2
    middle, reach = T.translation, np.abs(T.rotation) @ half
    return list(zip((middle - reach).tolist(), (middle + reach).tolist(), strict=True))


def _gap_along_y(
    moving: list[tuple[float, float]], still: list[tuple[float, float]], sign: int
) -> float:
    """How far a shape may move along y, or -y, before its extent meets another's."""
    return still[1][0] - moving[1][1] if sign > 0 else moving[1][0] - still[1][1]


def _moved(part: Part, way: FloatArray) -> Part:
    T = part.T_body_part
    return part.at(pin.SE3(T.rotation, T.translation + way))
