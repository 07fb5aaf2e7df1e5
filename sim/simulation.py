"""Simulation: steps plans through a world and tells observers.

Time is exact: moves and finger travels take what they take, and snapshots are given at whole
ticks, so nothing is rounded to the tick and the same plans give the same snapshots every time.
There are no blind waits: after a grasp the next step begins as soon as the pads are on the body,
plus the dwell that was asked for.

Moves and opening fingers are looked at for contacts (`sim.world.contacts`), whatever a plan says of
itself, unless a certificate of this very plan is at hand (`planner.verify`) and the world is as the
plan has it: as its `state` says before the first step, and changed since then only by grasps
that went as planned. A release may let a body fall a little, so certificates count until then.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable

import numpy as np

from baxter_kin.display import OneLine, seconds
from baxter_kin.validation import expect, finite_scalar
from planner import Body, Certificate, Grip, GripperAction, Move, Plan
from planner.collision.robot.robot_body import identity_of
from planner.plan import Step
from sim.errors import SimulationError
from sim.events import EventKind, Observer, contact_text, stop_text
from sim.grip_steps import GripSteps
from sim.outcome import Dwell, Outcome
from sim.timeline import DEFAULT_TICK_S, Timeline
from sim.world.contacts import ContactWatch, is_as_planned
from sim.world.gripper import Gripper
from sim.world.world import World

LONGEST_WAIT_S = 86_400.0

START_TOLERANCE_RAD = 1e-6
"""How far an arm may stand from where a plan starts."""

_LOG = logging.getLogger(__name__)


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
            observers: who is told, in this order; first of the bodies that are there.
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
        self._timeline = Timeline(world, self.grippers, observers, tick_s)
        looks = expect(check_contacts, bool, "check_contacts", SimulationError)
        self._watch = ContactWatch(world, looks=looks)
        pauses = Dwell() if dwell is None else expect(dwell, Dwell, "dwell", SimulationError)
        self._grips = GripSteps(world, self.grippers, self._timeline, self._watch, pauses)
        self._timeline.begin()

    @property
    def time_s(self) -> float:
        """Simulated time since the start."""
        return self._timeline.time_s

    def enable(self) -> None:
        """Switch the robot on, as the original does before it moves."""
        self._timeline.tell(EventKind.ENABLED, "robot enabled")

    def spawn(self, body: Body) -> None:
        """Add a body; a movable one falls on what is below it.

        Raises:
            SceneError: when the name is taken; of a movable body also when it would be inside
                another, or what is below it is too steep.
        """
        self._timeline.spawn(body)

    def delete(self, name: str) -> None:
        """Remove a body.

        Raises:
            SceneError: when it is not there.
        """
        self._timeline.delete(name)

    def wait(self, duration_s: float) -> None:
        """Let time pass.

        Raises:
            SimulationError: when the duration is negative or no number.
        """
        if finite_scalar(duration_s, "duration_s", SimulationError) < 0.0:
            raise SimulationError(f"time only goes forward; cannot wait {duration_s} s")
        if duration_s > LONGEST_WAIT_S:
            raise SimulationError(f"wait at most {LONGEST_WAIT_S:g} s at once, got {duration_s:g}")
        self._timeline.pass_s(duration_s)

    def execute(
        self,
        plan: Plan,
        title: str = "",
        *,
        certificate: Certificate | None = None,
        unverified: bool = False,
    ) -> Outcome:
        """Do every step of a plan, or stop at the first that fails.

        A plan without a certificate, or with one that is not valid or of another plan, is executed
        after a warning in the log; its moves are looked at for contacts then.

        Args:
            plan: a valid plan that starts where the arm stands.
            title: put before each caption.
            certificate: what `verify` made of this very plan; while the world is as the plan has
                it, moves are then not looked at for contacts.
            unverified: whether the certificate is missing on purpose, so that nothing is warned of.

        Raises:
            SimulationError: when the plan is invalid, is for another robot or starts elsewhere;
                nothing has moved then.
        """
        expect(title, str, "title", SimulationError)
        self._check_start(expect(plan, Plan, "plan", SimulationError))
        if certificate is not None:
            expect(certificate, Certificate, "certificate", SimulationError)
        if not expect(unverified, bool, "unverified", SimulationError):
            _warn_without_certificate(plan, certificate)
        started, hits_before = self.time_s, len(self._timeline.hits)
        failure = None
        is_certified = certificate is not None and certificate.is_valid and certificate.is_of(plan)
        self._watch.is_trusted = is_certified and is_as_planned(self.world, plan)
        for step in plan:
            self._timeline.caption = f"{title}{step.label}"
            failure = self._do(plan.limb, step)
            if failure is not None:
                break
        hits = tuple(self._timeline.hits[hits_before:])
        return Outcome(failure, self.time_s - started, hits=hits)

    def finish(self) -> None:
        """Show the world as it is now, unless that was done; a run ends between two ticks."""
        self._timeline.finish()

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
            return self._grips.close(limb, step)
        return self._grips.open(limb, step)

    def _move(self, limb: str, move: Move) -> str | None:
        self._timeline.tell(EventKind.MOVE_STARTED, self._timeline.caption, limb, move=move)
        begin_s, end_s = self.time_s, move.trajectory.duration
        for contact in self._watch.along(limb, move.trajectory):
            end_s = contact.free_s if contact.stops else contact.time_s
            self._follow(limb, move, begin_s, end_s)
            self._timeline.tell(EventKind.HIT, contact_text(contact, limb), limb, detail=contact)
            if contact.stops:
                return f"{move.label}: {stop_text(contact, limb)}"
        self._follow(limb, move, begin_s, move.trajectory.duration)
        return None

    def _follow(self, limb: str, move: Move, begin_s: float, end_s: float) -> None:
        """Follow a move that began at a time, until so long after."""
        duration_s = begin_s + end_s - self.time_s
        ticks = self._timeline.ticks_until(self.time_s + duration_s)
        times = np.clip(np.append(ticks - begin_s, end_s), 0.0, end_s)
        path = iter(move.trajectory.sample(times).q)
        self._timeline.pass_s(duration_s, lambda _: self.world.move_arm(limb, next(path)))


def _warn_without_certificate(plan: Plan, certificate: Certificate | None) -> None:
    """Log why the certificate of a plan that is about to be executed does not count."""
    if certificate is None:
        _LOG.warning(
            "the plan for the %s arm is executed without a certificate; give "
            "certificate=verify(plan), or unverified=True if that is meant",
            plan.limb,
        )
    elif not certificate.is_valid:
        _LOG.warning("the plan is executed although its certificate is %s", certificate.verdict)
    elif not certificate.is_of(plan):
        _LOG.warning(
            "the plan is executed with the certificate of another plan, world or tolerances, which "
            "does not count; give certificate=verify(plan)"
        )
