"""Electric gripper: how the fingers of one hand act, what it does with commands, what it reports.

Fingers close and open step by step while the arm may move. What they meet, push and hold is
predicted as in a simulation (`sim.world.gripper`), anew when the hand has moved since. A body that
they release falls meanwhile.

A command is acknowledged at once by its name, sender and sequence number in the state. Clients
repeat it until it has worked, up to a hundred times a second: a repeated command restarts nothing,
and neither does a position that the fingers have or go to.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import chain

from baxter_kin.display import quoted
from baxter_kin.fields import FrozenMapping, evolve
from planner.grasping.finger_travel import FINGER_SPEED_M_S
from planner.scene.coal_shapes import convex_pieces
from sim.ros1.robot.arm_motion import BadOrderError
from sim.timeline import Timeline
from sim.world.contacts import ContactWatch
from sim.world.falling import Rest
from sim.world.gripper import Closing, Gripper
from sim.world.world import World

SAME_POSE, NEAR_POSE = 1e-9, 1e-3
"""How far the tip, relative to its distance from base and of its rotation matrix, may have moved
for a prediction to hold: where the fingers end, and on their way there. A prediction takes longer
than a tick, and an arm that lags still moves by less and less when its fingers close."""

SQUEEZE_M = 2e-5
"""How much wider than a body fingers may be sent and still hold it, 0.1 % of their stroke. An
opening that was recorded while they held it went through a float of 32 bits."""

SHORT_FALL_S = 0.05
"""A fall that takes at most so long, from 12 mm, happens at once: while a body falls, what is
around the arms is built anew at each tick, which takes longer than one."""

BUSY_S = 1.0
"""How long calibrating and rebooting take; the original clients wait up to 5 s."""

PARAMETERS: Mapping[str, float] = FrozenMapping(
    {"velocity": 50.0, "moving_force": 40.0, "holding_force": 30.0, "dead_zone": 5.0}
)
"""What can be configured, with the RSDK's defaults, per cent."""

OPEN, CLOSED = 100.0, 0.0

ABOVE_MOVING = 1.0
"""How much a grasp's force exceeds that of moving at least, per cent."""


@dataclass(slots=True)
class _Fall:
    """A falling body."""

    name: str
    rest: Rest
    time_s: float = 0.0


class Fingers:
    """The fingers of one hand.

    Attributes:
        has_missed: whether they have closed last and hold nothing.
    """

    def __init__(
        self, world: World, side: str, gripper: Gripper, timeline: Timeline, watch: ContactWatch
    ) -> None:
        """Move the fingers of a hand; `watch` finds what opening ones run into."""
        self._world, self._side, self._gripper = world, side, gripper
        self._timeline, self._watch = timeline, watch
        self._hand = world.hand(side)
        for part in chain(*self._hand.fingers):
            convex_pieces(part.shape)  # takes long at first, but not in a tick
        self.has_missed = False
        self._goal_m: float | None = None
        self._closing: Closing | None = None
        self._T_base_tip, self._begin_m = world.T_base_tip(side), 0.0
        self._fall: _Fall | None = None
        self._holds_nothing = True

    @property
    def percent(self) -> float:
        """Their opening, 0 .. 100."""
        return self._gripper.state.percent

    @property
    def is_moving(self) -> bool:
        """Whether they move."""
        return self._goal_m is not None

    @property
    def is_gripping(self) -> bool:
        """Whether they hold something."""
        return self._world.holding(self._side) is not None

    def go(self, percent: float) -> None:
        """Start to move to a position, 0 closed .. 100 open.

        Fingers that hold something keep holding it when they are to close farther.
        """
        self.stop()
        goal_m, now_m = percent / 100.0 * self._hand.stroke_m, self._world.finger_m(self._side)
        if self.is_gripping and goal_m <= now_m + SQUEEZE_M:
            return
        self.has_missed = False
        if goal_m < now_m:
            self._land()
            self._goal_m, self._begin_m = goal_m, now_m
        elif goal_m > now_m:
            self._goal_m = self._opening(goal_m)

    def stop(self) -> None:
        """Stop where they are; what they pushed comes to rest."""
        if self._goal_m is not None and self._closing is not None:
            self._push_ends(self._closing)
        self._goal_m = self._closing = None

    def refresh(self) -> None:
        """Forget predictions, as bodies have come or gone."""
        self._closing = None
        if self._fall is not None and self._fall.name not in self._world.scene.bodies:
            self._fall = None
        self._land()

    def step(self, dt_s: float, speed_m_s: float) -> None:
        """Let time pass; each finger goes at that speed."""
        self._fall_on(dt_s)
        if self._goal_m is None:
            return
        now_m, way_m = self._world.finger_m(self._side), speed_m_s * dt_s
        if self._goal_m < now_m:
            self._close(now_m, way_m, self._goal_m)
        else:
            self._open(now_m, way_m, self._goal_m)

    def _close(self, now_m: float, way_m: float, goal_m: float) -> None:
        closing = self._prediction(NEAR_POSE)
        if now_m - way_m <= max(closing.finger_m, goal_m):
            closing = self._prediction(SAME_POSE)
        end_m = max(min(closing.finger_m, now_m), goal_m)
        finger_m = max(now_m - way_m, end_m)
        self._gripper.close_to(closing, finger_m)
        if finger_m > end_m:
            return
        squeeze_m = 0.0 if closing.grasp is None else SQUEEZE_M
        if closing.finger_m >= goal_m - squeeze_m:
            self._arrive(closing)
        else:
            self._push_ends(closing)
        self._goal_m = self._closing = None

    def _arrive(self, closing: Closing) -> None:
        """End a closing: the fingers hold something, or are closed."""
        self._gripper.finish(closing)
        self._timeline.pushed(self._side, closing)
        self.has_missed = closing.grasp is None
        if self.has_missed:
            self._timeline.missed(self._side, closing)
        else:
            self._timeline.grasped(self._side, closing)

    def _push_ends(self, closing: Closing) -> None:
        """Report what the fingers have pushed so far, and let it settle."""
        finger_m = self._world.finger_m(self._side)
        pushes = tuple(
            evolve(push, end_m=max(push.end_m, finger_m))
            for push in closing.pushes
            if push.begin_m > finger_m
        )
        self._timeline.pushed(self._side, Closing(finger_m, pushes=pushes))

    def _prediction(self, tolerance: float) -> Closing:
        """How closing will end, from where the hand is now, within a tolerance."""
        T_base_tip = self._world.T_base_tip(self._side)
        if self._closing is None or not T_base_tip.isApprox(self._T_base_tip, tolerance):
            self._closing, self._T_base_tip = self._predicted(), T_base_tip
        return self._closing

    def _predicted(self) -> Closing:
        """How closing will end; while it goes on, as if it began here from its first opening.

        The hand's own prediction requires that a body fits between the pads first, which one that a
        finger pushes already does not quite.
        """
        closing, now_m = self._gripper.closing(), self._world.finger_m(self._side)
        if closing.grasp is not None or self._begin_m == now_m:
            return closing
        self._world.set_fingers(self._side, self._begin_m)
        from_begin = self._gripper.closing()
        self._world.set_fingers(self._side, now_m)
        return closing if from_begin.grasp is None else from_begin

    def _opening(self, goal_m: float) -> float:
        """Release what is held; returns how far the fingers can open."""
        name = self._gripper.release()
        self._holds_nothing = name is None
        if name is not None:
            self._timeline.released(self._side, name)
            self._fall = _Fall(name, self._world.rest(name))
            self._fall_on(0.0)
        now_m = self._world.finger_m(self._side)
        for contact in self._watch.of_fingers(self._side, goal_m, FINGER_SPEED_M_S):
            self._timeline.hit(self._side, contact)
            if contact.stops:
                return now_m + contact.free_s * FINGER_SPEED_M_S
        return goal_m

    def _open(self, now_m: float, way_m: float, goal_m: float) -> None:
        finger_m = min(now_m + way_m, goal_m)
        self._world.set_fingers(self._side, finger_m)
        if finger_m == goal_m:
            self._goal_m = None
            if self._holds_nothing:
                self._timeline.opened(self._side)

    def _fall_on(self, dt_s: float) -> None:
        fall = self._fall
        if fall is None:
            return
        fall.time_s += dt_s
        if self._world.is_held(fall.name):
            self._fall = None
        elif fall.rest.duration_s <= max(fall.time_s, SHORT_FALL_S):
            self._world.put_to_rest(fall.name, fall.rest)
            self._timeline.settled(fall.name, fall.rest)
            self._fall = None
        else:
            self._world.carry(fall.name, fall.rest.pose(fall.time_s))

    def _land(self) -> None:
        """Put a falling body to rest at once, wherever that is now."""
        fall, self._fall = self._fall, None
        if fall is not None and not self._world.is_held(fall.name):
            rest = self._world.settle(fall.name)
            self._timeline.settled(fall.name, rest)


@dataclass(frozen=True, slots=True)
class GripperOrder:
    """A command to a gripper.

    Attributes:
        command: its name.
        args: its arguments, as JSON.
        sender: as stated in the message.
        sequence: its number, likewise; 0 where the sender does not count.
    """

    command: str
    args: str = ""
    sender: str = ""
    sequence: int = 0


class ElectricGripper:
    """The gripper of one hand.

    Attributes:
        fingers: its fingers.
        is_calibrated: whether it accepts positions.
        last: the last command.
        parameters: as configured, per cent.
    """

    def __init__(self, fingers: Fingers, *, is_calibrated: bool = True) -> None:
        """Switch it on."""
        self.fingers = fingers
        self.is_calibrated = is_calibrated
        self.last = GripperOrder("")
        self.parameters = dict(PARAMETERS)
        self._busy_s, self._is_calibrating = 0.0, False
        self._goal: float | None = None

    @property
    def is_ready(self) -> bool:
        """Whether it neither moves, nor calibrates or reboots."""
        return not self.fingers.is_moving and self._busy_s <= 0.0

    @property
    def force(self) -> float:
        """Its force as configured, per cent, as nothing here is elastic.

        Clients wait for a force above that of moving, by which they know a grasp.
        """
        holding, moving = self.parameters["holding_force"], self.parameters["moving_force"]
        return max(holding, min(moving + ABOVE_MOVING, 100.0)) if self.fingers.is_gripping else 0.0

    def order(self, order: GripperOrder, *, is_enabled: bool) -> None:
        """Execute a command.

        Raises:
            BadOrderError: when it is ignored: there is no such command, its arguments make no
                sense, the robot is disabled, or the gripper is not calibrated, or busy.
        """
        if order == self.last and order.sequence:
            return
        if order.command in ("go", "grip", "release", "prepare_to_grip"):
            self._go(order, is_enabled)
        elif order.command == "calibrate":
            self._calibrate(is_enabled)
        else:
            self._manage(order)
        self.last = order

    def _manage(self, order: GripperOrder) -> None:
        """Execute a command that a disabled robot's gripper accepts too."""
        if order.command == "configure":
            self.parameters.update(_parameters(order.args))
        elif order.command == "clear_calibration":
            self.stop()
            self.is_calibrated, self._busy_s = False, 0.0
        elif order.command == "reset":
            self.stop()
            self.fingers.has_missed = False
        elif order.command == "reboot":
            self._reboot()
        elif order.command == "stop":
            self.stop()
        elif order.command != "no_op":
            raise BadOrderError(
                f"no command {quoted(order.command)}; an electric gripper knows go, grip, release, "
                "prepare_to_grip, configure, calibrate, clear_calibration, reset, reboot, stop"
            )

    def _go(self, order: GripperOrder, is_enabled: bool) -> None:
        percent = CLOSED if order.command == "grip" else OPEN
        if order.command == "go":
            percent = _position(order.args)
        if not is_enabled:
            raise BadOrderError("the robot is disabled; enable it first")
        if not self.is_calibrated or self._busy_s > 0.0:
            raise BadOrderError("the gripper is not calibrated, or busy; calibrate it first")
        if percent != self._goal:
            self._goal = percent
            self.fingers.go(percent)

    def _calibrate(self, is_enabled: bool) -> None:
        if not is_enabled:
            raise BadOrderError("the robot is disabled; enable it first")
        if self._busy_s > 0.0:
            return
        self._goal, self.is_calibrated = None, False
        self._busy_s, self._is_calibrating = BUSY_S, True
        self.fingers.go(OPEN)

    def _reboot(self) -> None:
        if self._busy_s > 0.0:
            return
        self.stop()
        self.is_calibrated = False
        self._busy_s, self._is_calibrating = BUSY_S, False
        self.parameters = dict(PARAMETERS)

    def stop(self) -> None:
        """Stop the fingers; what they hold stays held."""
        self.fingers.stop()
        self._goal = None

    def refresh(self) -> None:
        """Forget predictions, as bodies have come or gone."""
        self.fingers.refresh()

    def step(self, dt_s: float) -> None:
        """Let time pass."""
        share = self.parameters["velocity"] / PARAMETERS["velocity"]
        self.fingers.step(dt_s, share * FINGER_SPEED_M_S)
        if self._busy_s > 0.0:
            self._busy_s -= dt_s
            if self._busy_s <= 0.0 and self._is_calibrating:
                self.is_calibrated = True


def _position(args: str) -> float:
    """The commanded position, per cent, clipped as clients clip it."""
    given = _object(args)
    if "position" not in given:
        raise BadOrderError(f'go needs {{"position": 0 .. 100}}, got {quoted(args)}')
    return min(max(_number(given["position"], "position"), CLOSED), OPEN)


def _parameters(args: str) -> dict[str, float]:
    given = _object(args) if args else {}
    unknown = [name for name in given if name not in PARAMETERS]
    if unknown:
        raise BadOrderError(f"no parameter {quoted(unknown[0])}; there are {', '.join(PARAMETERS)}")
    return {name: min(max(_number(value, name), 0.0), 100.0) for name, value in given.items()}


def _object(args: str) -> dict[str, object]:
    try:
        given = json.loads(args)
    except (ValueError, RecursionError):
        raise BadOrderError(f"arguments are a JSON object, got {quoted(args)}") from None
    if not isinstance(given, dict):
        raise BadOrderError(f"arguments are a JSON object, got {quoted(args)}")
    return given


def _number(value: object, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or abs(value) > 1e300:
        raise BadOrderError(f"{name} is a number of per cent, got {quoted(value)}")
    if not math.isfinite(value):
        raise BadOrderError(f"{name} is a finite number of per cent, got {value}")
    return float(value)
