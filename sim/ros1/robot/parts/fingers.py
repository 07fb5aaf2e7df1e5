"""Fingers: those of one hand, which close and open step by step while the arm may move.

What they meet, push and hold is found as in a simulation (`sim.world.gripper`), anew
whenever the hand has moved since. What they let go of falls meanwhile.
"""

from __future__ import annotations

from dataclasses import dataclass

from baxter_kin.display import OneLine, millimetres
from baxter_kin.fields import evolve
from planner.grasping.finger_travel import FINGER_SPEED_M_S
from sim.timeline import Timeline
from sim.world.contacts import ContactWatch
from sim.world.falling import Rest
from sim.world.gripper import Closing, Gripper
from sim.world.world import World

AS_BEFORE = 1e-9
"""How far the tip (m, and of its rotation matrix) may be from where it was for a prediction to be
the same."""

SQUEEZE_M = 2e-5
"""How much wider than a body fingers may be told to be and still hold it, 0.1 % of their stroke. An
opening that was recorded while they held it went through a float of 32 bits."""


@dataclass(slots=True)
class _Fall:
    """A body on its way to rest."""

    name: str
    rest: Rest
    time_s: float = 0.0


class Fingers(OneLine):
    """The fingers of one hand.

    Attributes:
        has_missed: whether they closed last on nothing that they hold.
    """

    def __init__(
        self, world: World, side: str, gripper: Gripper, events: Timeline, watch: ContactWatch
    ) -> None:
        """The fingers of a hand in a world.

        Args:
            world: where they are.
            side: "left" or "right".
            gripper: what holds for them.
            events: reports what they do.
            watch: looks at what opening fingers run into.
        """
        self._world, self._side, self._gripper = world, side, gripper
        self._events, self._watch = events, watch
        self._hand = world.hand(side)
        self.has_missed = False
        self._goal_m: float | None = None
        self._closing: Closing | None = None
        self._T_base_tip, self._begin_m = world.T_base_tip(side), 0.0
        self._fall: _Fall | None = None
        self._holds_nothing = True

    @property
    def percent(self) -> float:
        """How far they are open, 0 .. 100."""
        return self._gripper.state.percent

    @property
    def is_moving(self) -> bool:
        """Whether they are on their way."""
        return self._goal_m is not None

    @property
    def is_gripping(self) -> bool:
        """Whether they hold something."""
        return self._world.holding(self._side) is not None

    def go(self, percent: float) -> None:
        """Begin to go to a position, 0 closed .. 100 open.

        Told to close farther, fingers that hold something keep holding it.
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
        """Stay where they are; what they pushed comes to rest."""
        if self._goal_m is not None and self._closing is not None:
            self._push_ends(self._closing)
        self._goal_m = self._closing = None

    def look_again(self) -> None:
        """Bodies have come or gone: nothing holds that was predicted."""
        self._closing = None
        if self._fall is not None and self._fall.name not in self._world.scene.bodies:
            self._fall = None
        self._land()

    def step(self, dt_s: float, speed_m_s: float) -> None:
        """Let time pass.

        Args:
            dt_s: how much.
            speed_m_s: how fast each finger goes.
        """
        self._fall_on(dt_s)
        if self._goal_m is None:
            return
        now_m, way_m = self._world.finger_m(self._side), speed_m_s * dt_s
        if self._goal_m < now_m:
            self._close(now_m, way_m, self._goal_m)
        else:
            self._open(now_m, way_m, self._goal_m)

    def _close(self, now_m: float, way_m: float, goal_m: float) -> None:
        closing = self._prediction()
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
        """The fingers are on something, or closed."""
        self._gripper.finish(closing)
        self._events.pushed(self._side, closing)
        self.has_missed = closing.grasp is None
        if self.has_missed:
            self._events.missed(self._side, closing)
        else:
            self._events.grasped(self._side, closing)

    def _push_ends(self, closing: Closing) -> None:
        """The fingers stop on their way; what they pushed stays there."""
        finger_m = self._world.finger_m(self._side)
        pushes = tuple(
            evolve(push, end_m=max(push.end_m, finger_m))
            for push in closing.pushes
            if push.begin_m > finger_m
        )
        self._events.pushed(self._side, Closing(finger_m, pushes=pushes))

    def _prediction(self) -> Closing:
        """How closing will end, from where the hand is now."""
        T_base_tip = self._world.T_base_tip(self._side)
        if self._closing is None or not T_base_tip.isApprox(self._T_base_tip, AS_BEFORE):
            self._closing, self._T_base_tip = self._looked_ahead(), T_base_tip
        return self._closing

    def _looked_ahead(self) -> Closing:
        """How closing will end; on the way already, as if it began here from the former opening.

        The hand's own prediction wants to see a body fit between the pads first, which one that a
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
        """Let go of what is held, and see how far the fingers get."""
        name = self._gripper.release()
        self._holds_nothing = name is None
        if name is not None:
            self._events.released(self._side, name)
            self._fall = _Fall(name, self._world.rest(name))
        now_m = self._world.finger_m(self._side)
        for contact in self._watch.of_fingers(self._side, goal_m, FINGER_SPEED_M_S):
            self._events.hit(self._side, contact)
            if contact.stops:
                return now_m + contact.free_s * FINGER_SPEED_M_S
        return goal_m

    def _open(self, now_m: float, way_m: float, goal_m: float) -> None:
        finger_m = min(now_m + way_m, goal_m)
        self._world.set_fingers(self._side, finger_m)
        if finger_m == goal_m:
            self._goal_m = None
            if self._holds_nothing:
                self._events.opened(self._side)

    def _fall_on(self, dt_s: float) -> None:
        fall = self._fall
        if fall is None:
            return
        fall.time_s += dt_s
        if self._is_held(fall.name):
            self._fall = None
        elif fall.time_s >= fall.rest.duration_s:
            self._world.put_to_rest(fall.name, fall.rest)
            self._events.settled(fall.name, fall.rest)
            self._fall = None
        else:
            self._world.carry(fall.name, fall.rest.pose(fall.time_s))

    def _land(self) -> None:
        """What falls is at rest at once, wherever that is now."""
        fall, self._fall = self._fall, None
        if fall is not None and not self._is_held(fall.name):
            rest = self._world.settle(fall.name)
            self._events.settled(fall.name, rest)

    def _is_held(self, name: str) -> bool:
        return any(held.body == name for held in self._world.held)

    def _facts(self) -> tuple[str, ...]:
        opening = millimetres(self._world.finger_m(self._side))
        return self._side, f"at {opening}", "moving" if self.is_moving else ""
