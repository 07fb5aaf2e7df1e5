"""Closed loop: observe, pick, check by the fingers whether the body is held, and retry if not.

An attempt observes all movable bodies, plans in the resulting scene, and executes the plan up to
and including the closing of the fingers. As on the robot, the finger position alone then decides
whether the body is held: the distance between the pads must equal its width. After a miss the arm
opens its hand and rises. Each retry uses the mean of one sighting more than the attempt before;
earlier sightings are discarded, since the miss may have moved the body. A held body is placed and
observed once more. When placing fails, the loop ends and the hand stays closed.

Bodies are assumed to stand level on what is below them, so the observed height is not used.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum, auto
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
    Line,
    Manipulator,
    PickAndPlace,
    Plan,
    Scene,
    plan_pick_and_place,
    plan_retract,
)
from planner.completion import state_of
from planner.grasping import Grasp, Miss
from planner.pick_place.task import (
    DEFAULT_CLEAR_M,
    DEFAULT_HOVER_M,
    DOWN,
    Lines,
    back_along,
    checked_height_m,
    checked_lines,
)
from sim.errors import SimulationError
from sim.perception.pose_source import PoseSource, checked_source
from sim.simulation import Simulation
from sim.world.falling import come_to_rest

Planner: TypeAlias = Callable[[PickAndPlace, Manipulator, Scene, FloatArray], Plan]
"""Function that plans a task in a scene from the current configuration of the arm, such as
`plan_pick_and_place`."""

MAX_OBSERVATIONS = 10
"""Maximum number of observations of a body when one sighting is wanted; each further sighting adds
one."""

OBSERVATION_PERIOD_S = 0.1
"""Time between two observations, that of a camera with 10 frames per second."""

WIDTH_TOLERANCE_M = 0.004
"""Maximum difference between the distance of the closed pads and the expected width of a held body.
A 5 cm cube with 4 deg of yaw error is expected 3.5 mm too wide."""

LIFT_M = 0.02
"""Height by which a body is lifted before it is lowered on what is below: more than the error of
its observed height, less than the height of a block."""


class _Failure(Enum):
    """Stage at which an attempt failed."""

    NOT_SEEN = auto()
    NO_PLAN = auto()
    MISSED = auto()
    NOT_PLACED = auto()


@frozen(error=SimulationError)
class Transfer:
    """Grasp and goal of a body to be moved.

    Attributes:
        body: name of the body.
        T_body_tip: pose of the tip in the frame of the body when the fingers close.
        T_base_goal: pose of the body in base when the fingers open.
        hover_m: height above the place at which the arm ends.
        clear_m: height above pick and place from which the arm may move sideways.
        approach: lines to the pick, as of `PickAndPlace`; likewise the next three.
        retreat: lines away from the pick.
        place_approach: lines to the place.
        place_retreat: lines away from the place.

    Raises:
        SimulationError: when `body` is not text, or a height is not a positive number.
        TaskError: when lines are not of type `Line`.
        PoseError: when a pose is not valid.
    """

    body: str
    T_body_tip: pin.SE3 = field(converter=checked_pose)
    T_base_goal: pin.SE3 = field(converter=checked_pose)
    hover_m: float = DEFAULT_HOVER_M
    clear_m: float = DEFAULT_CLEAR_M
    approach: Lines = field(default=(), converter=checked_lines, kw_only=True)
    retreat: Lines = field(default=(), converter=checked_lines, kw_only=True)
    place_approach: Lines = field(default=(), converter=checked_lines, kw_only=True)
    place_retreat: Lines = field(default=(), converter=checked_lines, kw_only=True)

    def __attrs_post_init__(self) -> None:
        for name in ("hover_m", "clear_m"):
            checked_height_m(getattr(self, name), name, SimulationError)

    def _facts(self) -> tuple[str, ...]:
        return phrase(self.body), f"to {position(self.T_base_goal)}", f"hover {self.hover_m:g} m"


@frozen(error=SimulationError)
class Attempt:
    """One attempt of a transfer.

    Attributes:
        seen: the body at its observed pose; None when it was not seen.
        plan: plan of the attempt; None when the body was not seen.
        failure: reason of the failure, as one sentence; None when the body was placed.
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
        failure: reason why the body was not placed, as one sentence; None when it was.
        placed: the body at its pose observed at the end; None when it was not placed or not seen.
        off_m: horizontal distance of the centre of `placed` from the goal; None without `placed`.
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
        on_attempt: Callable[[int], None] | None = None,
    ) -> None:
        """Work in a simulated world.

        Args:
            simulation: the world in time. Its immovable bodies, and what a hand holds, are known;
                all others must be observed.
            manipulator: the arm and its hand.
            source: observes the movable bodies.
            retries: maximum number of attempts after the first.
            plan: plans an attempt, for example with a margin.
            on_attempt: called with the number of each attempt, from 1, when it begins.

        Raises:
            SimulationError: when an argument has the wrong type, or `retries` is negative.
        """
        self._simulation = expect(simulation, Simulation, "simulation", SimulationError)
        self._manipulator = expect(manipulator, Manipulator, "manipulator", SimulationError)
        if isinstance(retries, bool) or expect(retries, int, "retries", SimulationError) < 0:
            raise SimulationError(f"retries must be a whole number, 0 or above, got {retries}")
        if not callable(plan):
            raise SimulationError(f"plan must be callable, got {type(plan).__name__}")
        if on_attempt is not None and not callable(on_attempt):
            raise SimulationError(f"on_attempt must be callable, got {type(on_attempt).__name__}")
        self._source = checked_source(source)
        self._retries = retries
        self._plan = plan
        self._on_attempt = on_attempt
        self._side = manipulator.arm.side

    def pick_and_place(self, transfer: Transfer, title: str = "") -> LoopResult:
        """Move a body, and return how it ended; a failed attempt is part of the result.

        Nothing is released above its support: when placing fails, there is no further attempt.

        Args:
            transfer: the body and its goal.
            title: put before each caption.

        Raises:
            TaskError: when the body cannot be planned for, such as an immovable one.
        """
        expect(transfer, Transfer, "transfer", SimulationError)
        expect(title, str, "title", SimulationError)
        attempts: list[Attempt] = []
        failed: _Failure | None = None
        while len(attempts) <= self._retries and failed is not _Failure.NOT_PLACED:
            if failed is _Failure.MISSED:
                self._rise(transfer, title)
            number = len(attempts) + 1
            if self._on_attempt is not None:
                self._on_attempt(number)
            attempt, failed = self._attempt(transfer, title, sightings=number)
            attempts.append(attempt)
            if failed is None:
                return self._placed(transfer, tuple(attempts))
        tried = f"{len(attempts)} attempts" if len(attempts) > 1 else "one attempt"
        failure = f"{transfer.body} was not placed in {tried}; the last: {attempts[-1].failure}"
        return LoopResult(tuple(attempts), failure)

    def _facts(self) -> tuple[str, ...]:
        return self._side, count(self._retries, "retry")

    def _attempt(
        self, transfer: Transfer, title: str, *, sightings: int
    ) -> tuple[Attempt, _Failure | None]:
        """Observe, plan, pick, check the fingers, place."""
        name, world, hand = transfer.body, self._simulation.world, self._manipulator.hand
        scene = self._observed_scene(sightings)
        if name not in scene.bodies:
            text = f"{name} was not seen in {_max_observations(sightings)} observations"
            return Attempt(None, None, text), _Failure.NOT_SEEN
        seen = scene[name]
        T_base_pick = seen.T_base_body * transfer.T_body_tip
        expected = hand.close_on(T_base_pick, seen, hand.stroke_m)
        T_tip_body = (
            expected.T_tip_body  # the body slides between the pads
            if isinstance(expected, Grasp)
            else transfer.T_body_tip.inverse()
        )
        T_base_place = transfer.T_base_goal * T_tip_body.inverse()
        task = PickAndPlace(
            name,
            T_base_pick,
            T_base_place,
            transfer.hover_m,
            transfer.clear_m,
            approach=transfer.approach,
            retreat=transfer.retreat,
            place_approach=transfer.place_approach,
            place_retreat=transfer.place_retreat,
        )
        plan = self._plan(task, self._manipulator, scene, world.arm_q(self._side))
        if plan.failure is not None:
            return Attempt(seen, plan, str(plan.failure)), _Failure.NO_PLAN
        picking, placing = split_at_close(plan)
        failure = self._pick(picking, name, expected, title)
        if failure is not None:
            return Attempt(seen, plan, failure), _Failure.MISSED
        failure = self._simulation.execute(placing, title, unverified=True).failure
        return Attempt(seen, plan, failure), None if failure is None else _Failure.NOT_PLACED

    def _pick(self, picking: Plan, body: str, expected: Grasp | Miss, title: str) -> str | None:
        """Approach, close, and compare the width; returns why the body is not held, or None."""
        close = picking.steps[-1]
        approach = evolve(picking, steps=picking.steps[:-1])
        failure = self._simulation.execute(approach, title, unverified=True).failure
        if failure is not None:
            return failure  # the fingers are still open, so their position says nothing
        closing = evolve(picking, start=state_of(close), steps=(close,))
        failure = self._simulation.execute(closing, title, unverified=True).failure
        gap_m = self._simulation.grippers[self._side].gap_m
        if isinstance(expected, Grasp) and abs(gap_m - expected.width_m) <= WIDTH_TOLERANCE_M:
            return None
        apart = f"the finger pads are {1e3 * gap_m:.1f} mm apart, so they do not hold {body}"
        return apart if failure is None else f"{failure}; {apart}"

    def _rise(self, transfer: Transfer, title: str) -> None:
        """Open the hand and leave a missed body as it was approached, if a valid plan is found."""
        world = self._simulation.world
        scene = Scene.of(body for body in world.scene if body.name != transfer.body)
        q = world.arm_q(self._side)
        held = tuple(each for each in world.held if each.side != self._side)
        back = back_along(checked_lines(transfer.approach) or [Line(DOWN, transfer.clear_m)])
        plan = plan_retract(self._manipulator, scene, q, held=held, retreat=back)
        if plan.is_valid:
            self._simulation.execute(plan, f"{title}again, ", unverified=True)

    def _placed(self, transfer: Transfer, attempts: tuple[Attempt, ...]) -> LoopResult:
        """Result for a placed body, which is observed once more."""
        seen = self._seen(transfer.body, 1)
        if seen is None:
            return LoopResult(attempts, None)
        goal = seen.at(transfer.T_base_goal)
        off_m = float(np.linalg.norm(seen.centre_base[:2] - goal.centre_base[:2]))
        return LoopResult(attempts, None, seen, off_m)

    def _observed_scene(self, sightings: int) -> Scene:
        """Known bodies, and each other body at the mean of its sightings."""
        world = self._simulation.world
        held = {each.body for each in world.held}
        scene = Scene.of(body for body in world.scene if not body.is_movable or body.name in held)
        names = [body.name for body in world.scene if body.name not in scene.bodies]
        seen = [body for name in names if (body := self._seen(name, sightings)) is not None]
        for body in sorted(seen, key=lambda each: float(each.centre_base[2])):
            scene = scene.with_body(_standing(body, scene))
        return scene

    def _seen(self, name: str, sightings: int) -> Body | None:
        """The body at the mean pose of up to `sightings` sightings; None without any.

        Observes it at most `_max_observations(sightings)` times.
        """
        found: list[Body] = []
        for index in range(_max_observations(sightings)):
            if index:
                self._simulation.wait(OBSERVATION_PERIOD_S)
            sighting = self._source.observe(name, self._simulation.time_s)
            if sighting is not None:
                found.append(sighting.body)
            if len(found) == sightings:
                break
        return mean_of(found) if found else None


def _max_observations(sightings: int) -> int:
    """Maximum number of observations to obtain a number of sightings of a body."""
    return MAX_OBSERVATIONS + sightings - 1


def mean_of(bodies: Sequence[Body]) -> Body:
    """Return the body at the mean centre and mean orientation of one or more sightings.

    The mean orientation is taken in the tangent space of the first, which is exact for rotations
    about one axis.
    """
    first = bodies[0].T_base_body
    turns = [pin.log3(first.rotation.T @ body.T_base_body.rotation) for body in bodies]
    rotation = first.rotation @ pin.exp3(np.mean(turns, axis=0))
    turned = bodies[0].at(pin.SE3(rotation, first.translation))
    centre = np.mean([body.centre_base for body in bodies], axis=0)
    shift = centre - turned.centre_base
    return turned.at(pin.SE3(rotation, first.translation + shift))


def split_at_close(plan: Plan) -> tuple[Plan, Plan]:
    """Return a plan up to and including its first closing of the fingers, and the rest of it."""
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
    """Return an observed body, lowered on what is below it."""
    lifted = body.at(raised(body.T_base_body, LIFT_M))
    return body.at(come_to_rest(lifted, list(scene)).T_base_body)
