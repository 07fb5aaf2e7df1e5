"""Closed loop: observe, pick, check by the fingers whether something is held, and retry if not.

One attempt observes every movable body, plans in the scene that results, and executes the plan up
to the closing of the fingers. Their position alone decides whether they hold the body, as on the
robot: pads that are more or less apart than the body is wide have missed it. After a miss the arm
opens its hand, rises, and observes again, once more often than before: it uses the mean of these
sightings. Those before the miss are discarded, as the miss may have moved the body. A held body is
placed, and observed once more.

A sighting is assumed to stand level on what is below it, which is better than any measured height.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from baxter_kin.display import OneLine, count, millimetres, phrase, position
from baxter_kin.fields import evolve, field, frozen
from baxter_kin.frames import checked_pose, raised
from baxter_kin.validation import FloatArray, expect
from planner import (
    Body,
    Grip,
    GripperAction,
    Manipulator,
    PickAndPlace,
    Plan,
    Scene,
    plan_pick_and_place,
    plan_retract,
)
from planner.completion import state_of
from planner.grasping import Grasp, Miss
from planner.pick_place.task import DEFAULT_CLEAR_M, DEFAULT_HOVER_M, checked_height_m
from sim.errors import SimulationError
from sim.perception.pose_source import PoseSource, checked_source
from sim.simulation import Simulation
from sim.world.falling import come_to_rest

Planner: TypeAlias = Callable[[PickAndPlace, Manipulator, Scene, FloatArray], Plan]
"""Plans a task in a scene, from where the arm stands; `plan_pick_and_place` is one."""

MAX_OBSERVATIONS = 10
"""Number of observations of a body that is not seen before it counts as lost."""

OBSERVATION_PERIOD_S = 0.1
"""Time between two such observations: a camera of 10 frames a second."""

WIDTH_TOLERANCE_M = 0.004
"""Maximum deviation of the pads from the expected distance that counts as a grasp: a 5 cm cube seen
with 4 deg of yaw error is wider by 3.5 mm, and open fingers stand 7.7 mm too far apart."""

LIFT_M = 0.02
"""Height by which a sighting is lifted before it is let down on what is below: more than any error
of its height, less than any block."""


@frozen(error=SimulationError)
class Transfer:
    """A body to move, by how it is grasped and where it is put.

    Attributes:
        body: its name.
        T_body_tip: pose of the tip seen from the body when the fingers close.
        T_base_goal: pose of the body when they open again.
        hover_m: height above the place where the arm ends.
        clear_m: height above pick and place from which it may move sideways.

    Raises:
        SimulationError: when `body` is no name, or a height not a number above zero.
        PoseError: when a pose is not a valid one.
    """

    body: str
    T_body_tip: pin.SE3 = field(converter=checked_pose)
    T_base_goal: pin.SE3 = field(converter=checked_pose)
    hover_m: float = DEFAULT_HOVER_M
    clear_m: float = DEFAULT_CLEAR_M

    def __attrs_post_init__(self) -> None:
        for name in ("hover_m", "clear_m"):
            checked_height_m(getattr(self, name), name, SimulationError)

    def _facts(self) -> tuple[str, ...]:
        return phrase(self.body), f"to {position(self.T_base_goal)}", f"hover {self.hover_m:g} m"


@frozen(error=SimulationError)
class Attempt:
    """One attempt of a transfer.

    Attributes:
        seen: the body where it was seen; None when it was not.
        plan: its plan; None when the body was not seen.
        failure: None when it ended as planned, else the reason, as one sentence.
    """

    seen: Body | None
    plan: Plan | None
    failure: str | None

    def _facts(self) -> tuple[str, ...]:
        seen = "not seen" if self.seen is None else f"seen at {position(self.seen.T_base_body)}"
        return seen, "done" if self.failure is None else f"failed: {phrase(self.failure)}"


@frozen(error=SimulationError)
class LoopResult:
    """How a transfer ended.

    Attributes:
        attempts: all attempts, in order.
        failure: None, or why the body is not where it should be, as one sentence.
        placed: the body where it was seen at the end; None when it was not placed, or not seen.
        off_m: horizontal distance of its centre from the goal, by that sighting; None likewise.
    """

    attempts: tuple[Attempt, ...]
    failure: str | None
    placed: Body | None = None
    off_m: float | None = None

    @property
    def is_success(self) -> bool:
        """Whether it was picked and placed."""
        return self.failure is None

    @property
    def plan(self) -> Plan | None:
        """The last plan; None when the body was never seen."""
        plans = [attempt.plan for attempt in self.attempts if attempt.plan is not None]
        return plans[-1] if plans else None

    def _facts(self) -> tuple[str, ...]:
        attempts = count(len(self.attempts), "attempt")
        if self.failure is not None:
            return attempts, f"failed: {self.failure}"
        return attempts, "success", "" if self.off_m is None else f"{millimetres(self.off_m)} off"


class ClosedLoop(OneLine):
    """Picks and places by observed poses, and retries after a miss."""

    def __init__(
        self,
        simulation: Simulation,
        manipulator: Manipulator,
        source: PoseSource,
        *,
        retries: int = 3,
        plan: Planner = plan_pick_and_place,
    ) -> None:
        """Work in a simulated world.

        Args:
            simulation: the world in time. Its immovable bodies, and what a hand holds, are known;
                all others must be observed.
            manipulator: the arm and its hand.
            source: observes the movable bodies.
            retries: maximum number of attempts after the first.
            plan: plans an attempt; with a margin, say, or with its time taken.

        Raises:
            SimulationError: when an argument has the wrong type, or `retries` is negative.
        """
        self._simulation = expect(simulation, Simulation, "simulation", SimulationError)
        self._manipulator = expect(manipulator, Manipulator, "manipulator", SimulationError)
        if isinstance(retries, bool) or expect(retries, int, "retries", SimulationError) < 0:
            raise SimulationError(f"retries must be a whole number, 0 or above, got {retries}")
        if not callable(plan):
            raise SimulationError(f"plan must be callable, got {type(plan).__name__}")
        self._source = checked_source(source)
        self._retries = retries
        self._plan = plan
        self._side = manipulator.arm.side

    def pick_and_place(self, transfer: Transfer, title: str = "") -> LoopResult:
        """Move a body; always returns a result.

        Args:
            transfer: what goes where.
            title: put before each caption.
        """
        expect(transfer, Transfer, "transfer", SimulationError)
        expect(title, str, "title", SimulationError)
        attempts: list[Attempt] = []
        while len(attempts) <= self._retries:
            if attempts:
                self._rise(transfer, title)
            attempts.append(self._attempt(transfer, title, sightings=len(attempts) + 1))
            if attempts[-1].failure is None:
                return self._placed(transfer, tuple(attempts))
        tried = f"{len(attempts)} attempts" if len(attempts) > 1 else "one attempt"
        failure = f"{transfer.body} was not placed in {tried}; the last: {attempts[-1].failure}"
        return LoopResult(tuple(attempts), failure)

    def _facts(self) -> tuple[str, ...]:
        return self._side, count(self._retries, "retry")

    def _attempt(self, transfer: Transfer, title: str, *, sightings: int) -> Attempt:
        """Observe, plan, pick, check the fingers, place."""
        name, world, hand = transfer.body, self._simulation.world, self._manipulator.hand
        scene = self._observed_scene(sightings)
        if name not in scene.bodies:
            return Attempt(None, None, f"{name} was not seen in {MAX_OBSERVATIONS} observations")
        seen = scene[name]
        T_base_pick = seen.T_base_body * transfer.T_body_tip
        expected = hand.close_on(T_base_pick, seen, hand.stroke_m)
        T_tip_body = (
            expected.T_tip_body  # the body slides between the pads
            if isinstance(expected, Grasp)
            else transfer.T_body_tip.inverse()
        )
        T_base_place = transfer.T_base_goal * T_tip_body.inverse()
        task = PickAndPlace(name, T_base_pick, T_base_place, transfer.hover_m, transfer.clear_m)
        plan = self._plan(task, self._manipulator, scene, world.arm_q(self._side))
        if plan.failure is not None:
            return Attempt(seen, plan, str(plan.failure))
        return Attempt(seen, plan, self._executed(plan, name, expected, title))

    def _executed(self, plan: Plan, body: str, expected: Grasp | Miss, title: str) -> str | None:
        """Execute a plan in two parts, and check the grasp between; returns why it failed."""
        picking, placing = split_at_close(plan)
        outcome = self._simulation.execute(picking, title, unverified=True)
        gap_m = self._simulation.grippers[self._side].gap_m
        is_held = isinstance(expected, Grasp) and abs(gap_m - expected.width_m) <= WIDTH_TOLERANCE_M
        if is_held:
            return self._simulation.execute(placing, title, unverified=True).failure
        apart = f"the finger pads are {1e3 * gap_m:.1f} mm apart, so they do not hold {body}"
        return apart if outcome.failure is None else f"{outcome.failure}; {apart}"

    def _rise(self, transfer: Transfer, title: str) -> None:
        """Leave a body alone that was missed, if there is a way up."""
        world = self._simulation.world
        scene = Scene.of(body for body in world.scene if body.name != transfer.body)
        q = world.arm_q(self._side)
        plan = plan_retract(self._manipulator, scene, q, transfer.clear_m)
        if plan.is_valid:
            self._simulation.execute(plan, f"{title}again, ", unverified=True)

    def _placed(self, transfer: Transfer, attempts: tuple[Attempt, ...]) -> LoopResult:
        """The result of a placed body, by one more observation."""
        seen = self._seen(transfer.body, 1)
        if seen is None:
            return LoopResult(attempts, None)
        goal = seen.at(transfer.T_base_goal)
        off_m = float(np.linalg.norm(seen.centre_base[:2] - goal.centre_base[:2]))
        return LoopResult(attempts, None, seen, off_m)

    def _observed_scene(self, sightings: int) -> Scene:
        """What is known of the scene, and of all other bodies the mean of some sightings."""
        world = self._simulation.world
        held = {each.body for each in world.held}
        scene = Scene.of(body for body in world.scene if not body.is_movable or body.name in held)
        names = [body.name for body in world.scene if body.name not in scene.bodies]
        seen = [body for name in names if (body := self._seen(name, sightings)) is not None]
        for body in sorted(seen, key=lambda each: float(each.centre_base[2])):
            scene = scene.with_body(_standing(body, scene))
        return scene

    def _seen(self, name: str, sightings: int) -> Body | None:
        """A body where it seems to be, by the mean of some sightings.

        Observes again for a while when it is not seen; of too few sightings, the mean of those.
        """
        found: list[Body] = []
        for index in range(MAX_OBSERVATIONS + sightings - 1):
            if index:
                self._simulation.wait(OBSERVATION_PERIOD_S)
            sighting = self._source.observe(name, self._simulation.time_s)
            if sighting is not None:
                found.append(sighting.body)
            if len(found) == sightings:
                break
        return mean_of(found) if found else None


def mean_of(bodies: Sequence[Body]) -> Body:
    """One body, with the mean centre and the mean orientation of at least one sighting.

    The mean of the orientations is taken on the tangent space at the first one, which is exact for
    turns about one axis.
    """
    first = bodies[0].T_base_body
    turns = [pin.log3(first.rotation.T @ body.T_base_body.rotation) for body in bodies]
    rotation = first.rotation @ pin.exp3(np.mean(turns, axis=0))
    turned = bodies[0].at(pin.SE3(rotation, first.translation))
    centre = np.mean([body.centre_base for body in bodies], axis=0)
    shift = centre - turned.centre_base
    return turned.at(pin.SE3(rotation, first.translation + shift))


def split_at_close(plan: Plan) -> tuple[Plan, Plan]:
    """A plan up to the end of its first closing of the fingers, and the rest of it."""
    steps = expect(plan, Plan, "plan", SimulationError).steps
    closes = [
        number
        for number, step in enumerate(steps, start=1)
        if isinstance(step, Grip) and step.action is GripperAction.CLOSE
    ]
    if not closes:
        raise SimulationError("the plan closes no fingers, so it cannot be split there")
    picking, rest = steps[: closes[0]], steps[closes[0] :]
    begun = state_of(rest[0]) if rest else plan.start
    return evolve(plan, steps=picking), evolve(plan, start=begun, steps=rest)


def _standing(body: Body, scene: Scene) -> Body:
    """A body let down on what is below where it was seen."""
    lifted = body.at(raised(body.T_base_body, LIFT_M))
    return body.at(come_to_rest(lifted, list(scene)).T_base_body)
