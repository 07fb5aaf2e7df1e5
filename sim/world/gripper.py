"""Gripper: fingers that close on what is between them, and grasp it or miss.

The electric gripper of Baxter takes position commands in per cent, 0 closed .. 100 open, and
reports its position, whether it is gripping, and whether it missed. So does this one.

A closing is simulated quasi-statically, in one dimension. Both fingers move alike, one along -y of
the tip and one along +y, while the arm stands still. All their shapes count:

- A movable body that a finger meets moves with it from then on, along the closing axis only,
  unturned (see `planner.grasping.grasp`), and so does what stands on it, and what it meets in turn.
- When the other finger meets the body that a finger pushes directly, the fingers stop. The body is
  held if the hand's own prediction, `Hand.close_on`, says so.
- When anything immovable is in the way, of a finger or of what one pushes, the fingers stop there.
  So they do when two bodies are between them, or one that a finger is inside already.

Contacts press in by up to `PRESSING_TOLERANCE_M`, so that what slides along a table, or under a
hand that is not quite level, is not stopped by it. Opening fingers push nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import pinocchio as pin

from baxter_kin.display import OneLine, millimetres, phrase
from baxter_kin.fields import array, evolve, frozen
from baxter_kin.validation import FloatArray, expect, finite_scalar
from planner import Part
from planner.grasping import Grasp
from planner.grasping.grasp import Miss, MissKind
from planner.grasping.hand import CLOSING_AXIS
from planner.scene.contact import PRESSING_TOLERANCE_M, bounds_m, travel_to_contact
from planner.scene.faces import UP
from sim.errors import SimulationError
from sim.world.world import World

AGREEMENT_M = 1e-6
"""The pads stop on a body where the hand's prediction says, within this; contacts are found to
1e-8 m, and several add up."""


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
        """The pose of the body when the fingers are at a position."""
        finger_m = finite_scalar(finger_m, "finger position", SimulationError)
        moved_m = max(0.0, self.begin_m - max(finger_m, self.end_m))
        T = self.T_base_begin
        return pin.SE3(T.rotation, T.translation + moved_m * self.axis_base)

    def _facts(self) -> tuple[str, ...]:
        way = f"{millimetres(self.distance_m)} by the {self.finger} finger"
        return phrase(self.body), way


@frozen(error=SimulationError)
class Closing:
    """How a closing will end.

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


@frozen(error=SimulationError, eq=True)
class GripperState:
    """What a gripper reports.

    Attributes:
        percent: position, 0 closed .. 100 open.
        is_gripping: whether both pads are on a body.
        has_missed: whether the last closing ended without a grasp: nothing was between the pads, or
            the body was too wide, off the pads, crowded or blocked.
    """

    percent: float
    is_gripping: bool
    has_missed: bool


NO_GRIPPER = GripperState(0.0, is_gripping=False, has_missed=False)
"""What a flange without a gripper counts as, where a state is needed."""


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
        if now != self._last:  # it is read at every tick, and mostly nothing has changed
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
        return self._hand.gap_m(self._world.finger_m(self._side))

    def closing(self, wanted: str | None = None) -> Closing:
        """Predict how closing from here would end. Nothing moves.

        Args:
            wanted: name of the body to be grasped; the reason of a miss is about that one.

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
        """Put the fingers at a position on their way, and what they push where it is then."""
        expect(closing, Closing, "closing", SimulationError)
        self._world.set_fingers(self._side, finger_m)
        for push in closing.pushes:
            if not self._world.is_held(push.body):  # else the other hand has closed on it meanwhile
                self._world.slide(push.body, push.pose(finger_m))

    def finish(self, closing: Closing) -> None:
        """End a closing where it ends: hold the body, or report a miss from then on."""
        expect(closing, Closing, "closing", SimulationError)
        self.close_to(closing, closing.finger_m)
        self._has_missed = closing.grasp is None
        if closing.body is not None and closing.grasp is not None:
            self._world.attach(self._side, closing.body, closing.grasp.T_tip_body)

    def release(self) -> str | None:
        """Detach the held body and clear the miss; returns its name, or None."""
        self._has_missed = False
        return self._world.detach(self._side)

    def _facts(self) -> tuple[str, ...]:
        state = (
            "gripping" if self.state.is_gripping else "missed" if self.state.has_missed else "empty"
        )
        return self._side, f"fingers at {millimetres(self._world.finger_m(self._side))}", state


def closing_of(world: World, side: str, wanted: str | None = None) -> Closing:
    """Predict how an empty hand closes from where it is.

    Args:
        world: the robot and the bodies.
        side: of the hand.
        wanted: name of the body to be grasped; the reason of a miss is about that one, if present.
    """
    squeeze = Squeeze(world, side)
    stop = squeeze.run()
    if stop is None:
        return squeeze.missed(_nothing(squeeze, wanted))
    first, second = stop
    if first.is_finger and world.is_held(second.name):
        return _on_held(second, squeeze)
    if first.is_held_by(second) or second.is_held_by(first):
        return _between(first if second.is_finger else second, squeeze)
    return squeeze.missed(_blocked(first, second, squeeze))


def _nothing(squeeze: Squeeze, wanted: str | None) -> Miss:
    """The miss of fingers that nothing stopped."""
    if wanted is not None and wanted in squeeze.world.scene.bodies:
        found = squeeze.close_on(wanted)
        if isinstance(found, Miss):
            return found
    return Miss(MissKind.NOTHING, "nothing is between the finger pads")


def _between(slider: Slider, squeeze: Squeeze) -> Closing:
    """The closing of fingers that are both on a body: with their pads as predicted, or not."""
    found = squeeze.close_on(slider.name)
    if isinstance(found, Grasp) and abs(found.finger_m - squeeze.finger_m) <= AGREEMENT_M:
        return squeeze.grasped(slider, found)
    if not isinstance(found, Miss) or found.kind is MissKind.NOTHING:
        text = f"the fingers touch {slider.name} outside of their pads"
        found = Miss(MissKind.EDGE, text, slider.name, 0.0)
    return squeeze.missed(found)


def _on_held(slider: Slider, squeeze: Squeeze) -> Closing:
    """The closing on a body in the other hand, which does not give way; both then hold it."""
    found = squeeze.close_on(slider.name)
    if isinstance(found, Grasp) and abs(found.push_m) <= PRESSING_TOLERANCE_M:
        squeeze.finger_m = found.finger_m
        T_tip_body = squeeze.T_base_tip.inverse() * squeeze.world.body(slider.name).T_base_body
        grasp = evolve(found, T_tip_body=T_tip_body)
        return Closing(found.finger_m, slider.name, grasp, pushes=squeeze.pushes)
    if not isinstance(found, Miss):
        text = (
            f"one finger would push {slider.name} by {1e3 * abs(found.push_m):.1f} mm, and the "
            "other hand holds it"
        )
        found = Miss(MissKind.BLOCKED, text, slider.name)
    return squeeze.missed(found)


def _blocked(first: Slider, second: Slider, squeeze: Squeeze) -> Miss:
    """The miss of fingers that stopped and hold nothing."""
    if first.sign and second.sign:
        names = [slider.name for slider in (first, second) if not slider.is_finger]
        names += [
            slider.by for slider in (first, second) if slider.by and slider.is_pushed_indirectly
        ]
        text = f"{' and '.join(dict.fromkeys(names))} are between the fingers, which hold only one"
        return Miss(MissKind.CROWDED, text, names[0])
    if second.is_movable:  # a finger is inside it
        found = squeeze.close_on(second.name)
        if isinstance(found, Miss) and found.kind is not MissKind.NOTHING:
            return found
        text = f"{second.name} reaches into {first.title} before they close"
        return Miss(MissKind.NOT_BETWEEN, text, second.name)
    text = f"{first.title} met {second.name}, which does not give way"
    return Miss(MissKind.BLOCKED, text, second.name)


@dataclass(slots=True, eq=False)
class Slider:
    """A finger or a body, while the fingers close.

    Attributes:
        name: "left finger", "right finger", or that of the body.
        parts: its shapes seen from the tip, of a finger with it closed.
        is_finger: whether it is a finger.
        is_movable: whether it is a body that gives way.
        sign: direction of its motion along y of the tip; 0 while it stands still.
        begin_m: finger position from which on a body moves.
        finger: the finger that moves it, "left" or "right".
        by: name of what pushes it.
        is_riding: whether it is only carried along by what it stands on.
    """

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
        """Its name in a sentence."""
        return f"the {self.name}" if self.is_finger else self.name

    @property
    def is_pushed_indirectly(self) -> bool:
        """Whether it is a body that no finger touches, but what a finger pushes."""
        return not self.is_finger and self.by != f"{self.finger} finger"

    def is_held_by(self, other: Slider) -> bool:
        """Whether it is a body that one finger pushes directly and the other has met."""
        opposite = self.sign * other.sign < 0
        return opposite and other.is_finger and not self.is_pushed_indirectly

    def offset_m(self, finger_m: float) -> float:
        """Its distance along y from where its parts are, when the fingers are at a position."""
        if not self.sign:
            return 0.0
        return self.sign * ((0.0 if self.is_finger else self.begin_m) - finger_m)


class Squeeze:
    """The fingers on their way, from contact to contact.

    Attributes:
        world: the robot and the bodies.
        finger_m: where the fingers are.
        T_base_tip: pose of the hand.
    """

    def __init__(self, world: World, side: str) -> None:
        """Start where the fingers of a hand are now."""
        self.world, self.finger_m = world, world.finger_m(side)
        self._hand, self.T_base_tip = world.hands[side], world.T_base_tip(side)
        self._begin_m = self.finger_m
        self._lift = PRESSING_TOLERANCE_M * (self.T_base_tip.rotation.T @ UP)
        self._known: dict[tuple[str, str], list[tuple[float, Part, Part]]] = {}
        self._extents: dict[
            tuple[str, float, float, float], list[tuple[Part, list[tuple[float, float]]]]
        ] = {}
        self._sliders = [
            Slider(f"{finger} finger", list(parts), is_finger=True, sign=sign, finger=finger)
            for finger, sign, parts in zip(
                ("left", "right"), (-1, 1), self._hand.fingers, strict=True
            )
        ]
        for body in world.scene:
            T_tip_body = self.T_base_tip.inverse() * body.T_base_body
            parts = [part.at(T_tip_body * part.T_body_part) for part in body.parts]
            is_movable = body.is_movable and not world.is_held(body.name)
            self._sliders.append(Slider(body.name, parts, is_movable=is_movable))

    def run(self) -> tuple[Slider, Slider] | None:
        """Close until something stops the fingers.

        Returns:
            What met what there; None when they close fully.
        """
        while (meeting := self._next()) is not None:
            travel_m, first, second = meeting
            self.finger_m = max(0.0, self.finger_m - max(0.0, travel_m))
            is_inside = first.is_finger and travel_m <= -PRESSING_TOLERANCE_M
            if second.sign or not second.is_movable or is_inside:
                return first, second
            self._take_along(first, second, max(0.0, -travel_m))
        self.finger_m = 0.0
        return None

    def close_on(self, name: str) -> Grasp | Miss:
        """The hand's own prediction for one body, from where the fingers began."""
        return self._hand.close_on(self.T_base_tip, self.world.body(name), self._begin_m)

    def missed(self, miss: Miss) -> Closing:
        """The closing that ends here with a miss."""
        return Closing(self.finger_m, miss=miss, pushes=self.pushes)

    def grasped(self, slider: Slider, grasp: Grasp) -> Closing:
        """The closing that ends with a grasp; the body and its riders end as predicted."""
        self.finger_m = grasp.finger_m
        for follower in self._with_riders(slider):
            follower.begin_m = grasp.finger_m + abs(grasp.push_m)
        return Closing(self.finger_m, slider.name, grasp, pushes=self.pushes)

    @property
    def pushes(self) -> tuple[Push, ...]:
        """The bodies that were moved until now."""
        return tuple(
            Push(
                body=slider.name,
                finger=slider.finger,
                by=slider.by,
                begin_m=slider.begin_m,
                end_m=self.finger_m,
                axis_base=slider.sign * self.T_base_tip.rotation[:, 1],
                T_base_begin=self.world.body(slider.name).T_base_body,
                is_riding=slider.is_riding,
            )
            for slider in self._sliders
            if slider.sign and not slider.is_finger
        )

    def _next(self) -> tuple[float, Slider, Slider] | None:
        """The next contact: after how much finger travel, what meets what."""
        meetings = []
        for first in self._sliders:
            for second in self._sliders:
                if first.sign and first.sign != second.sign and _may_meet(first, second):
                    travel_m = self._travel(first, second)
                    if travel_m is not None and travel_m <= self.finger_m:
                        meetings.append((travel_m, first, second))
        return min(meetings, key=lambda meeting: meeting[0], default=None)

    def _travel(self, first: Slider, second: Slider) -> float | None:
        """The travel of the fingers until one thing meets another; None if they do not meet."""
        rate = abs(first.sign - second.sign)
        along = first.sign * CLOSING_AXIS
        start_m = first.offset_m(self.finger_m) - first.sign * PRESSING_TOLERANCE_M
        still_m = second.offset_m(self.finger_m)
        passed_m = first.sign * (start_m - still_m)
        found, max_m = None, rate * self.finger_m + PRESSING_TOLERANCE_M
        for gap_m, part, other in self._pairs(first, second):
            if gap_m - passed_m > max_m:
                break  # all others are farther apart
            moving, lift = _moved(part, start_m * CLOSING_AXIS), self._lift_of(first)
            still = _moved(other, still_m * CLOSING_AXIS)
            travel_m = travel_to_contact(_moved(moving, lift), along, still, max_m)
            if travel_m is not None and first.is_finger:  # the lift lets it pass over a support
                exact_m = travel_to_contact(moving, along, still, max_m)
                travel_m = travel_m if exact_m is None else exact_m
            if travel_m is not None:
                found = max_m = travel_m
        return None if found is None else (found - PRESSING_TOLERANCE_M) / rate

    def _lift_of(self, slider: Slider) -> FloatArray:
        """How far something is lifted to pass over its support; fingers never along their way."""
        along = float(self._lift @ CLOSING_AXIS) if slider.is_finger else 0.0
        lift: FloatArray = self._lift - along * CLOSING_AXIS
        return lift

    def _pairs(self, first: Slider, second: Slider) -> list[tuple[float, Part, Part]]:
        """The shapes of two things that may meet, and their first distance along y.

        The nearest come first. As all move along y, the pairs stay the same.
        """
        key = first.name, second.name
        if key not in self._known:
            lift = self._lift_of(first)
            pairs = [
                (_gap_along_y(one, two, first.sign), part, other)
                for part, one in self._extents_of(first, lift)
                for other, two in self._extents_of(second, 0.0 * lift)
                if all(one[k][0] <= two[k][1] and two[k][0] <= one[k][1] for k in (0, 2))
            ]
            self._known[key] = sorted(pairs, key=lambda pair: pair[0])
        return self._known[key]

    def _extents_of(
        self, slider: Slider, way: FloatArray
    ) -> list[tuple[Part, list[tuple[float, float]]]]:
        """The shapes of a thing, and their extents when it is moved; measured once."""
        key = slider.name, *way.tolist()
        if key not in self._extents:
            self._extents[key] = [(part, _extents(_moved(part, way))) for part in slider.parts]
        return self._extents[key]

    def _take_along(self, first: Slider, second: Slider, pressed_m: float) -> None:
        """Let a body, and its riders, move with what has met it from now on.

        It leaves what presses into it at once.
        """
        for follower in self._with_riders(second):
            if follower.sign == 0:
                follower.sign, follower.begin_m = first.sign, self.finger_m + pressed_m
                follower.finger = first.finger
                follower.by = first.name if follower is second else second.name
                follower.is_riding = follower is not second

    def _with_riders(self, slider: Slider) -> list[Slider]:
        names = {slider.name, *self.world.riders(slider.name)}
        followers = [each for each in self._sliders if each.name in names and not each.is_finger]
        return [each for each in followers if each is slider or each.sign in (0, slider.sign)]


def _may_meet(first: Slider, second: Slider) -> bool:
    """Whether a pair must be checked: fingers meet no fingers, and of two that move, once."""
    if first.is_finger or second.is_finger:
        return first.is_finger and not second.is_finger
    return second.sign == 0 or first.sign < second.sign


def _extents(part: Part) -> list[tuple[float, float]]:
    """The interval of a shape along x, y and z of the tip, m."""
    least, most = bounds_m(part).tolist()
    return list(zip(least, most, strict=True))


def _gap_along_y(
    moving: list[tuple[float, float]], still: list[tuple[float, float]], sign: int
) -> float:
    """The distance that a shape moves along y, or -y, before its extent meets another's."""
    return still[1][0] - moving[1][1] if sign > 0 else moving[1][0] - still[1][1]


def _moved(part: Part, way: FloatArray) -> Part:
    T = part.T_body_part
    return part.at(pin.SE3(T.rotation, T.translation + way))
