"""Gripper: fingers that move at a finite speed, grasp what is between them, or miss.

The electric gripper of Baxter takes position commands in per cent, 0 closed .. 100 open, and
reports its position, whether it is gripping, and whether it missed. So does this one.

A closing is simulated quasi-statically, in one dimension. Both fingers move alike, one along -y of
the tip and one along +y, while the arm stands still. All their shapes count:

- A movable body that a finger meets moves with it from then on, along the closing axis only,
  unturned (see `planner.grasping.grasp`), and so does what stands on it, and what it meets in turn.
- When the other finger meets the body that a finger pushes directly, the fingers stop. The body is
  held when the hand's own prediction, `Hand.close_on`, says so.
- When anything immovable is in the way, of a finger or of what one pushes, the fingers stop there.
  So they do when two bodies are between them, or one that a finger is inside already.

Contacts press in by up to `PRESSING_TOLERANCE_M`, so that what slides along a table, or under a
hand that is not quite level, is not stopped by it. Opening fingers push nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from baxter_kin.display import OneLine, millimetres, phrase
from baxter_kin.fields import array, frozen
from baxter_kin.validation import FloatArray, expect, finite_scalar
from planner import Body, Box, Part
from planner.grasping import Grasp
from planner.grasping.finger_travel import FINGER_SPEED_M_S
from planner.grasping.grasp import Miss, MissKind, extent
from planner.grasping.hand import CLOSING_AXIS
from planner.scene.contact import PRESSING_TOLERANCE_M, travel_to_contact
from planner.scene.faces import UP
from sim.errors import SimulationError
from sim.world.world import World


@frozen(error=SimulationError)
class Push:
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
        SimulationError: when a value has the wrong type.
    """

    body: str
    finger: str
    by: str
    begin_m: float
    end_m: float
    axis_base: FloatArray = array(3)
    T_base_begin: pin.SE3
    is_riding: bool = False

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


class Squeeze:
    """The fingers on their way, from contact to contact."""

    def __init__(self, world: World, side: str) -> None:
        """Start where the fingers of a hand are now.

        Args:
            world: the robot and the bodies.
            side: whose hand, "left" or "right".
        """
        self.world = world
        self.side = side
        self.hand = world.hands[side]
        self.T_base_tip = world.T_base_tip(side)
        self.begin_m = self.finger_m = world.finger_m(side)
        self._lift = PRESSING_TOLERANCE_M * (self.T_base_tip.rotation.T @ UP)
        self._known: dict[tuple[str, str], list[tuple[float, Part, Part]]] = {}
        self._movers = [*self._fingers(), *map(self._mover, world.scene)]

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


AGREEMENT_M = 1e-6
"""The pads stop on a body where the hand's prediction says, within this; contacts are found to
1e-8 m, and several add up."""


@frozen(error=SimulationError)
class Closing:
    """How a close will end.

    Attributes:
        finger_m: finger position at the end.
        body: the body between the pads; None for a miss.
        grasp: where it is then; None for a miss.
        miss: why nothing is held; None for a grasp.
        pushes: the bodies that are moved on the way.
    """

    finger_m: float
    body: str | None = None
    grasp: Grasp | None = None
    miss: Miss | None = None
    pushes: tuple[Push, ...] = ()

    def _facts(self) -> tuple[str, ...]:
        found = self.grasp or self.miss
        return f"fingers at {millimetres(self.finger_m)}", "" if found is None else repr(found)


def closing_of(world: World, side: str, wanted: str | None = None) -> Closing:
    """What happens when an empty hand closes where it is.

    Args:
        world: the robot and the bodies.
        side: whose hand.
        wanted: name of the body that it shall hold; a miss is told of that one, where it is there.
    """
    squeeze = Squeeze(world, side)
    stop = squeeze.run()
    if stop is None:
        return _closed_fully(squeeze, wanted)
    first, second = stop
    if first.is_held_by(second) or second.is_held_by(first):
        return _met(squeeze, first if second.is_finger else second)
    return _ended(squeeze, miss=_blocked(first, second, squeeze))


def _closed_fully(squeeze: Squeeze, wanted: str | None) -> Closing:
    """Nothing stopped the fingers."""
    hand, scene = squeeze.hand, squeeze.world.scene
    miss = Miss(MissKind.NOTHING, "nothing is between the finger pads")
    if wanted is not None and wanted in scene.bodies:
        found = hand.close_on(squeeze.T_base_tip, scene[wanted], squeeze.begin_m)
        miss = found if isinstance(found, Miss) else miss
    return _ended(squeeze, miss=miss)


def _met(squeeze: Squeeze, mover: Mover) -> Closing:
    """Both fingers are on a body: as the hand predicts, or not with the pads."""
    body = squeeze.world.body(mover.name)
    found = squeeze.hand.close_on(squeeze.T_base_tip, body, squeeze.begin_m)
    if isinstance(found, Grasp) and abs(found.finger_m - squeeze.finger_m) <= AGREEMENT_M:
        squeeze.agree(mover, found)
        return _ended(squeeze, body=mover.name, grasp=found)
    if not isinstance(found, Miss) or found.kind is MissKind.NOTHING:
        text = f"the fingers touch {mover.name} outside of their pads"
        found = Miss(MissKind.EDGE, text, mover.name, 0.0)
    return _ended(squeeze, miss=found)


def _blocked(first: Mover, second: Mover, squeeze: Squeeze) -> Miss:
    """Why the fingers stopped and hold nothing."""
    if first.sign and second.sign:
        names = [mover.name for mover in (first, second) if not mover.is_finger]
        names += [mover.by for mover in (first, second) if mover.by and mover.is_pushed_indirectly]
        text = f"{' and '.join(dict.fromkeys(names))} are between the fingers, which hold only one"
        return Miss(MissKind.CROWDED, text, names[0])
    if second.is_movable:  # a finger is inside it
        body = squeeze.world.body(second.name)
        found = squeeze.hand.close_on(squeeze.T_base_tip, body, squeeze.begin_m)
        if isinstance(found, Miss) and found.kind is not MissKind.NOTHING:
            return found
        text = f"{second.name} reaches into {first.title} before they close"
        return Miss(MissKind.NOT_BETWEEN, text, second.name)
    text = f"{first.title} met {second.name}, which does not give way"
    return Miss(MissKind.BLOCKED, text, second.name)


def _ended(
    squeeze: Squeeze,
    *,
    body: str | None = None,
    grasp: Grasp | None = None,
    miss: Miss | None = None,
) -> Closing:
    """The closing, ended where the fingers are."""
    return Closing(squeeze.finger_m, body, grasp, miss, squeeze.pushes)


@frozen(error=SimulationError, eq=True)
class GripperState:
    """What a gripper reports.

    Attributes:
        percent: position, 0 closed .. 100 open.
        is_gripping: whether both pads are on a body.
        has_missed: whether the last close found nothing.
    """

    percent: float
    is_gripping: bool
    has_missed: bool


NO_GRIPPER = GripperState(0.0, is_gripping=False, has_missed=False)
"""What a flange without a gripper counts as, where something must be said of it."""


class Gripper(OneLine):
    """The gripper of one hand in a world."""

    def __init__(self, world: World, side: str) -> None:
        """Take over the hand of that side.

        Raises:
            SimulationError: when it has no fingers.
        """
        self._world = expect(world, World, "world", SimulationError)
        self._side = world.robot.arm(side).side
        self._hand = world.hand(side)
        self._has_missed = False
        self._last: tuple[float, bool, bool] | None = None
        self._state = GripperState(100.0, is_gripping=False, has_missed=False)

    @property
    def state(self) -> GripperState:
        """What the gripper reports now."""
        is_gripping = self._world.holding(self._side) is not None
        now = self._world.finger_m(self._side), is_gripping, self._has_missed
        if now != self._last:  # it is asked at every tick, and mostly nothing has changed
            self._last = now
            self._state = GripperState(self._hand.percent(now[0]), *now[1:])
        return self._state

    @property
    def open_m(self) -> float:
        """Finger position of the open hand."""
        return self._hand.stroke_m

    @property
    def gap_m(self) -> float:
        """Distance between the pads now."""
        return self._hand.closed_gap_m + 2 * self._world.finger_m(self._side)

    def travel_time_s(self, finger_m: float) -> float:
        """How long the fingers take from where they are to a position.

        Raises:
            SimulationError: when the position is not a finite number.
        """
        finger_m = finite_scalar(finger_m, "finger position", SimulationError)
        return abs(finger_m - self._world.finger_m(self._side)) / FINGER_SPEED_M_S

    def closing(self, wanted: str | None = None) -> Closing:
        """What a close would do now. Nothing moves.

        Args:
            wanted: name of the body that it is about; a miss tells of that one.

        Raises:
            SimulationError: when the hand already holds something, or the name is not text.
        """
        if wanted is not None:
            expect(wanted, str, "the name of the wanted body", SimulationError)
        held = self._world.holding(self._side)
        if held is not None:
            raise SimulationError(
                f"the {self._side} hand is closed on {held.body!r}; open it first"
            )
        return closing_of(self._world, self._side, wanted)

    def close_to(self, closing: Closing, finger_m: float) -> None:
        """Put the fingers at a position on their way, and what they push where it is then.

        Raises:
            SimulationError: when the position is outside 0 .. stroke, or `closing` no `Closing`.
        """
        expect(closing, Closing, "closing", SimulationError)
        self._world.set_fingers(self._side, finger_m)
        for push in closing.pushes:
            self._world.slide(push.body, push.pose(finger_m))

    def finish(self, closing: Closing) -> None:
        """The fingers have arrived: hold the body, or report a miss.

        Raises:
            SimulationError: when `closing` has the wrong type.
        """
        expect(closing, Closing, "closing", SimulationError)
        self.close_to(closing, closing.finger_m)
        self._has_missed = closing.grasp is None
        if closing.body is not None and closing.grasp is not None:
            self._world.attach(self._side, closing.body, closing.grasp.T_tip_body)

    def release(self) -> str | None:
        """The fingers begin to open: name of the body that is free now, or None."""
        self._has_missed = False
        return self._world.detach(self._side)

    def _facts(self) -> tuple[str, ...]:
        state = (
            "gripping" if self.state.is_gripping else "missed" if self.state.has_missed else "empty"
        )
        return self._side, f"fingers at {millimetres(self.open_m)}", state
