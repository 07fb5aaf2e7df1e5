"""Simulation: steps plans through a world and tells observers.

Time is exact: moves and finger travels take what they take, and snapshots are given at whole
ticks, so nothing is rounded to the tick and the same plans give the same snapshots every time.
There are no blind waits: after a grasp the next step begins as soon as the pads are on the body,
plus the dwell that was asked for.

Moves and opening fingers are looked at for contacts (`sim.world.contacts`), whatever a plan says of
itself, unless a certificate of this very plan is at hand (`planner.verify`) and the world is as the
plan has it: as its `situation` says before the first step, and changed since then only by grasps
that went as planned. A release may let a body fall a little, so certificates count until then.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from baxter_kin.errors import expect, expect_all
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import finite_scalar
from baxter_kin.value_objects import OneLine, seconds
from planner import Body, Certificate, Grip, GripperAction, Move, Plan
from planner.collision.robot.robot_body import identity_of
from planner.plan import Step
from sim import event_text
from sim.clock import DEFAULT_TICK_S, SHORTEST_TICK_S, Clock
from sim.errors import SimulationError
from sim.events import Detail, Event, EventKind, Observer, Snapshot
from sim.outcome import Dwell, Outcome
from sim.world.contacts import Contact, ContactWatch, falls_as_planned, is_as_planned
from sim.world.falling import GRAVITY_M_S2, Rest
from sim.world.finger_closing import Closing
from sim.world.gripper import FINGER_SPEED_M_S, NO_GRIPPER, Gripper
from sim.world.world import World

__all__ = ["DEFAULT_TICK_S", "GRAVITY_M_S2", "SHORTEST_TICK_S", "Dwell", "Outcome", "Simulation"]

LONGEST_WAIT_S = 86_400.0

START_TOLERANCE_RAD = 1e-6
"""How far an arm may stand from where a plan starts."""

MOVED_M = 1e-6
"""A body pushed or fallen by less was not; contacts are found to 1e-8 m."""


class Simulation(OneLine):
    """A world in time.

    Attributes:
        world: what is moved.
        grippers: left and right gripper by side; a side without fingers has none.
    """

    def __init__(
        self,
        world: World,
        observers: Iterable[Observer] = (),
        *,
        tick_s: float = DEFAULT_TICK_S,
        dwell: Dwell | None = None,
        check_contacts: bool = True,
    ) -> None:
        """At time zero.

        Args:
            world: what is moved.
            observers: who is told, in this order.
            tick_s: time between snapshots, at least `SHORTEST_TICK_S`.
            dwell: pauses after gripper actions.
            check_contacts: whether moves without a certificate are looked at; without, the arm
                passes through everything.

        Raises:
            SimulationError: when `tick_s` is not such a number, or another argument is of another
                class.
        """
        self.world = expect(world, World, "world", SimulationError)
        self.grippers = {side: Gripper(world, side) for side in world.hands}
        self._observers = expect_all(observers, Observer, "the observers", SimulationError)
        self._clock = Clock(tick_s)
        self._dwell = Dwell() if dwell is None else expect(dwell, Dwell, "dwell", SimulationError)
        self._checks = expect(check_contacts, bool, "check_contacts", SimulationError)
        self._watch = ContactWatch(world)
        self._is_as_planned = False
        self._caption = ""

    @property
    def time_s(self) -> float:
        """Simulated time since the start."""
        return self._clock.time_s

    def enable(self) -> None:
        """Switch the robot on, as the original does before it moves."""
        self._tell(EventKind.ENABLED, "robot enabled")

    def spawn(self, body: Body) -> None:
        """Add a body; a movable one falls on what is below it.

        Raises:
            SceneError: when the name is taken.
        """
        support = self.world.spawn(body)
        on = f", at rest on {support}" if body.is_movable else ""
        settled = self.world.body(body.name)
        self._tell(EventKind.SPAWNED, f"{body.name} spawned{on}", body=settled)

    def delete(self, name: str) -> None:
        """Remove a body.

        Raises:
            SceneError: when it is not there.
        """
        body = self.world.body(name)
        self.world.delete(name)
        self._tell(EventKind.DELETED, f"{name} deleted", body=body)

    def wait(self, duration_s: float) -> None:
        """Let time pass.

        Raises:
            SimulationError: when the duration is negative or no number.
        """
        if finite_scalar(duration_s, "duration_s", SimulationError) < 0.0:
            raise SimulationError(f"time only goes forward; cannot wait {duration_s} s")
        if duration_s > LONGEST_WAIT_S:
            raise SimulationError(f"wait at most {LONGEST_WAIT_S:g} s at once, got {duration_s:g}")
        self._advance(duration_s, lambda _: None)

    def execute(
        self, plan: Plan, title: str = "", *, certificate: Certificate | None = None
    ) -> Outcome:
        """Do every step of a plan, or stop at the first that fails.

        Args:
            plan: a valid plan that starts where the arm stands.
            title: put before each caption.
            certificate: what `verify` made of this very plan; while the world is as the plan has
                it, moves are then not looked at for contacts.

        Raises:
            SimulationError: when the plan is invalid, is for another robot or starts elsewhere;
                nothing has moved then.
        """
        expect(title, str, "title", SimulationError)
        self._check_start(expect(plan, Plan, "plan", SimulationError))
        if certificate is not None:
            expect(certificate, Certificate, "certificate", SimulationError)
        started = self.time_s
        failure = None
        is_certified = certificate is not None and certificate.is_valid and certificate.is_of(plan)
        self._is_as_planned = is_certified and is_as_planned(self.world, plan)
        for step in plan:
            self._caption = f"{title}{step.label}"
            failure = self._do(plan.limb, step)
            if failure is not None:
                break
        return Outcome(failure, self.time_s - started)

    def finish(self) -> None:
        """Show the world as it is now, unless the last tick did; a run ends between two ticks."""
        if self._clock.is_past_tick:
            self._show()

    def _facts(self) -> tuple[str, ...]:
        return seconds(self.time_s), repr(self.world)

    def _check_start(self, plan: Plan) -> None:
        if plan.failure is not None:
            raise SimulationError(f"an invalid plan cannot be executed: {plan.failure}")
        self._check_robot(plan)
        offset = float(np.abs(self.world.arm_q(plan.limb) - plan.q_start).max())
        if offset > START_TOLERANCE_RAD:
            raise SimulationError(
                f"the plan starts {offset:.3g} rad from where the {plan.limb} arm stands; plan "
                "from there"
            )

    def _check_robot(self, plan: Plan) -> None:
        """The plan must be for this very robot, as far as it says for which it is."""
        own = identity_of(self.world.robot, self.world.shapes.body)
        difference = "" if plan.robot is None else own.difference(plan.robot)
        if difference:
            raise SimulationError(f"the plan is for another robot: {difference}; plan for this one")
        if any(isinstance(step, Grip) for step in plan):
            self.world.hand(plan.limb)

    def _do(self, limb: str, step: Step) -> str | None:
        """One step; returns why it failed, or None."""
        if isinstance(step, Move):
            return self._move(limb, step)
        if step.action is GripperAction.CLOSE:
            return self._close(limb, step)
        return self._open(limb, step)

    def _move(self, limb: str, move: Move) -> str | None:
        self._tell(EventKind.MOVE_STARTED, self._caption, limb, move=move)
        begin_s, end_s = self.time_s, move.trajectory.duration
        for contact in self._contacts(limb, move):
            end_s = contact.free_s if contact.stops else contact.time_s
            self._follow(limb, move, begin_s, end_s)
            self._tell(EventKind.HIT, event_text.of_contact(contact, limb), limb, detail=contact)
            if contact.stops:
                return f"{move.label}: {event_text.of_stop(contact, limb)}"
        self._follow(limb, move, begin_s, move.trajectory.duration)
        return None

    def _contacts(self, limb: str, move: Move) -> list[Contact]:
        if self._is_as_planned or not self._checks:
            return []
        return self._watch.along(limb, move.trajectory)

    def _follow(self, limb: str, move: Move, begin_s: float, end_s: float) -> None:
        """Follow a move that began at a time, until so long after."""
        duration_s = begin_s + end_s - self.time_s
        ticks = self._clock.ticks_until(self.time_s + duration_s)
        times = np.clip(np.append(ticks - begin_s, end_s), 0.0, end_s)
        path = iter(move.trajectory.sample(times).q)
        self._advance(duration_s, lambda _: self.world.move_arm(limb, next(path)))

    def _close(self, limb: str, grip: Grip) -> str | None:
        gripper = self.grippers[limb]
        closing = gripper.closing(grip.body)
        self._slide(limb, closing.finger_m, lambda _: self._push(limb, closing))
        gripper.finish(closing)
        self._pushed(limb, closing)
        if closing.grasp is None:
            return self._missed(limb, grip, closing)
        self._grasped(limb, closing, gripper.state.percent)
        self.wait(self._dwell.after_grasp_s)
        if grip.body is not None and closing.body != grip.body:
            return f"{grip.label}: grasped {closing.body} instead of {grip.body}"
        return None

    def _push(self, limb: str, closing: Closing) -> None:
        self.grippers[limb].close_to(closing, self.world.finger_m(limb))

    def _pushed(self, limb: str, closing: Closing) -> None:
        """Tell what was pushed; what is not held comes to rest."""
        for push in closing.pushes:
            if push.distance_m > MOVED_M and not push.is_riding:
                text, body = event_text.of_push(push, limb), self.world.body(push.body)
                self._tell(EventKind.PUSHED, text, limb, body=body, detail=push)
            if push.body != closing.body and not push.is_riding:
                self._is_as_planned = False
                self._settle(push.body)

    def _settle(self, name: str) -> None:
        """Let a body come to rest at once, and tell when that moved it."""
        rest = self.world.settle(name)
        if rest.fall_m > MOVED_M:
            self._settled(name, rest)

    def _settled(self, name: str, rest: Rest) -> None:
        body = self.world.body(name)
        self._tell(EventKind.SETTLED, event_text.of_rest(name, rest), body=body, detail=rest)

    def _grasped(self, limb: str, closing: Closing, percent: float) -> None:
        if closing.body is not None and closing.grasp is not None:
            self._is_as_planned &= not self.world.riders(closing.body)
            text = event_text.of_grasp(closing.body, closing.grasp, percent)
            body = self.world.body(closing.body)
            self._tell(EventKind.GRASPED, text, limb, body=body, detail=closing.grasp)

    def _missed(self, limb: str, grip: Grip, closing: Closing) -> str:
        gap_m, is_closed = self.grippers[limb].gap_m, closing.finger_m == 0.0
        text = event_text.of_miss(closing.miss, grip.body, gap_m, is_closed=is_closed)
        body = None if grip.body is None else self.world.scene.bodies.get(grip.body)
        self._tell(EventKind.MISSED, text, limb, body=body, detail=closing.miss)
        return f"{grip.label}: {text}"

    def _open(self, limb: str, grip: Grip) -> str | None:
        gripper = self.grippers[limb]
        name = gripper.release()
        finger_m, failure = self._free_opening(limb, grip)
        if name is None:
            self._slide(limb, finger_m)
            self._tell(EventKind.OPENED, event_text.of_opening(limb, gripper.state.percent), limb)
        else:
            body = self.world.body(name)
            self._tell(EventKind.RELEASED, f"{name} released", limb, body=body)
            self._let_go(limb, name, finger_m)
        self.wait(self._dwell.after_release_s)
        return failure

    def _free_opening(self, limb: str, grip: Grip) -> tuple[float, str | None]:
        """How far the fingers open, and why no farther."""
        begin_m = self.world.finger_m(limb)
        end_m = self.grippers[limb].open_m if grip.opening_m is None else grip.opening_m
        if self._is_as_planned or not self._checks:
            return end_m, None
        for contact in self._watch.of_fingers(limb, end_m, FINGER_SPEED_M_S):
            self._tell(EventKind.HIT, event_text.of_contact(contact, limb), limb, detail=contact)
            if contact.stops:
                way = contact.free_s * FINGER_SPEED_M_S
                stop_m = begin_m + way if end_m > begin_m else begin_m - way
                return stop_m, f"{grip.label}: {event_text.of_stop(contact, limb)}"
        return end_m, None

    def _let_go(self, limb: str, name: str, finger_m: float) -> None:
        """Open the fingers while the body falls to its rest."""
        rest = self.world.rest(name)
        self._is_as_planned &= falls_as_planned(self.world, name, rest)
        self._slide(
            limb,
            finger_m,
            lambda t: self.world.carry(name, rest.pose(t)),
            at_least_s=rest.duration_s,
        )
        self.world.put_to_rest(name, rest)
        self._settled(name, rest)

    def _slide(
        self,
        limb: str,
        finger_m: float,
        meanwhile: Callable[[float], None] = lambda _: None,
        *,
        at_least_s: float = 0.0,
    ) -> None:
        """Move the fingers to a position at their speed."""
        begin = self.world.finger_m(limb)
        travel_s = self.grippers[limb].travel_time_s(finger_m)

        def update(t: float) -> None:
            share = 1.0 if t >= travel_s else t / travel_s
            self.world.set_fingers(limb, begin + share * (finger_m - begin))
            meanwhile(t)

        self._advance(max(travel_s, at_least_s), update)

    def _advance(self, duration_s: float, update: Callable[[float], None]) -> None:
        """Let time pass: bring the world to each tick, show it, and end exactly at the end."""
        self._clock.advance(duration_s, update, self._show)

    def _show(self) -> None:
        snapshot = Snapshot(
            time_s=self.time_s,
            q=self.world.q,
            T_base_bodies=self.world.body_poses(),
            grippers=dict.fromkeys(LIMBS, NO_GRIPPER)
            | {side: gripper.state for side, gripper in self.grippers.items()},
            caption=self._caption,
        )
        for observer in self._observers:
            observer.on_snapshot(snapshot)

    def _tell(
        self,
        kind: EventKind,
        text: str,
        side: str | None = None,
        *,
        move: Move | None = None,
        body: Body | None = None,
        detail: Detail | None = None,
    ) -> None:
        event = Event(self.time_s, kind, text, side, move, body, detail)
        for observer in self._observers:
            observer.on_event(event)
