"""Closed loop: look, pick, feel whether something is held, and try again if not.

One attempt looks at every movable body, plans in the scene that it believes in, and executes the
plan up to the closing of the fingers. Whether they hold the body is told by their position alone,
as on the robot: less or more apart than the body is wide means a miss. After a miss the arm opens
its hand, rises, and looks again, once more often than before: it believes in the mean of what it
then sees. What was seen before a miss is forgotten, as the miss may have moved the body. What is
held is placed, and looked at once more.

What is seen is taken to stand level on what is below it, which is better than any measured height.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from baxter_kin.display import OneLine, count
from baxter_kin.fields import evolve
from baxter_kin.frames import raised
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
from sim.errors import SimulationError
from sim.perception.pose_source import PoseSource, checked_source
from sim.perception.transfer import Attempt, LoopResult, Transfer
from sim.simulation import Simulation
from sim.world.falling import come_to_rest

Planner: TypeAlias = Callable[[PickAndPlace, Manipulator, Scene, FloatArray], Plan]
"""Plans a task in a scene, from where the arm stands; `plan_pick_and_place` is one."""

LOOKS = 10
"""How often it looks for a body that is not seen before it is lost."""

LOOK_AGAIN_S = 0.1
"""Time between two such looks: a camera of 10 frames a second."""

WIDTH_TOLERANCE_M = 0.004
"""How far the pads may be from the expected distance and still hold the body: a 5 cm cube seen
with 4 deg of yaw error is wider by 3.5 mm, and open fingers stand 7.7 mm too far apart."""

LIFT_M = 0.02
"""How far what is seen is lifted before it is let down on what is below: more than any error of its
height, less than any block."""


class ClosedLoop(OneLine):
    """Picks and places by what it sees, and tries again after a miss."""

    def __init__(
        self,
        simulation: Simulation,
        manipulator: Manipulator,
        eyes: PoseSource,
        *,
        retries: int = 3,
        plan: Planner = plan_pick_and_place,
    ) -> None:
        """Work in a simulated world.

        Args:
            simulation: the world in time. Of its bodies, the immovable ones are known, and what a
                hand holds is felt; where the others are is only believed.
            manipulator: the arm and its hand.
            eyes: sees the movable bodies.
            retries: how many attempts may follow the first.
            plan: plans an attempt; with a margin, say, or with its time taken.

        Raises:
            SimulationError: when one has the wrong type, or `retries` no whole number from 0 on.
        """
        self._simulation = expect(simulation, Simulation, "simulation", SimulationError)
        self._manipulator = expect(manipulator, Manipulator, "manipulator", SimulationError)
        if isinstance(retries, bool) or expect(retries, int, "retries", SimulationError) < 0:
            raise SimulationError(f"retries must be a whole number, 0 or above, got {retries}")
        if not callable(plan):
            raise SimulationError(f"plan must be callable, got {type(plan).__name__}")
        self._eyes = checked_source(eyes, "eyes")
        self._retries = retries
        self._plan = plan
        self._side = manipulator.arm.side

    def pick_and_place(self, transfer: Transfer, title: str = "") -> LoopResult:
        """Move a body; an answer comes whatever happens.

        Args:
            transfer: what goes where.
            title: put before each caption.

        Raises:
            SimulationError: when `transfer` has the wrong type.
        """
        expect(transfer, Transfer, "transfer", SimulationError)
        expect(title, str, "title", SimulationError)
        attempts: list[Attempt] = []
        while len(attempts) <= self._retries:
            if attempts:
                self._rise(transfer, title)
            attempts.append(self._attempt(transfer, title, looks=len(attempts) + 1))
            if attempts[-1].failure is None:
                return self._looked_after(transfer, tuple(attempts))
        tried = f"{len(attempts)} attempts" if len(attempts) > 1 else "one attempt"
        failure = f"{transfer.body} was not placed in {tried}; the last: {attempts[-1].failure}"
        return LoopResult(tuple(attempts), failure)

    def _facts(self) -> tuple[str, ...]:
        return self._side, count(self._retries, "retry")

    def _attempt(self, transfer: Transfer, title: str, *, looks: int) -> Attempt:
        """Look, plan, pick, feel, place."""
        scene = self._believed(transfer.body, looks)
        if scene is None:
            return Attempt(None, None, f"{transfer.body} was not seen in {LOOKS} looks")
        seen = scene[transfer.body]
        T_base_pick, hand = seen.T_base_body * transfer.T_body_tip, self._manipulator.hand
        expected = hand.close_on(T_base_pick, seen, hand.stroke_m)
        task = _task(transfer, T_base_pick, expected)
        q = self._simulation.world.arm_q(self._side)
        plan = self._plan(task, self._manipulator, scene, q)
        if plan.failure is not None:
            return Attempt(seen, plan, str(plan.failure))
        return Attempt(seen, plan, self._executed(plan, transfer.body, expected, title))

    def _executed(self, plan: Plan, body: str, expected: Grasp | Miss, title: str) -> str | None:
        """Execute a plan in two parts, and feel between them; returns why it failed, or None."""
        picking, placing = split_at_close(plan)
        outcome = self._simulation.execute(picking, title, unverified=True)
        if not self._holds(expected):
            gap_m = self._simulation.grippers[self._side].gap_m
            felt = f"the finger pads are {1e3 * gap_m:.1f} mm apart, so they do not hold {body}"
            return felt if outcome.failure is None else f"{outcome.failure}; {felt}"
        return self._simulation.execute(placing, title, unverified=True).failure

    def _holds(self, expected: Grasp | Miss) -> bool:
        """Whether the finger pads are as far apart as they should be on the body."""
        if not isinstance(expected, Grasp):
            return False
        gap_m = self._simulation.grippers[self._side].gap_m
        return abs(gap_m - expected.width_m) <= WIDTH_TOLERANCE_M

    def _rise(self, transfer: Transfer, title: str) -> None:
        """Leave a body alone that was missed, if there is a way up."""
        world = self._simulation.world
        scene = Scene.of(body for body in world.scene if body.name != transfer.body)
        q = world.arm_q(self._side)
        plan = plan_retract(self._manipulator, scene, q, transfer.clear_m)
        if plan.is_valid:
            self._simulation.execute(plan, f"{title}again, ", unverified=True)

    def _looked_after(self, transfer: Transfer, attempts: tuple[Attempt, ...]) -> LoopResult:
        """The result of a placed body, by one more look."""
        seen = self._seen(transfer.body, 1)
        if seen is None:
            return LoopResult(attempts, None)
        goal = seen.at(transfer.T_base_goal)
        off_m = float(np.linalg.norm(seen.centre_base[:2] - goal.centre_base[:2]))
        return LoopResult(attempts, None, seen, off_m)

    def _believed(self, wanted: str, looks: int) -> Scene | None:
        """The scene as so many looks have it; None when the wanted body is not seen."""
        world = self._simulation.world
        held = {holding.body for side in world.hands if (holding := world.holding(side))}
        known = [body for body in world.scene if not body.is_movable or body.name in held]
        scene = Scene.of(known)
        names = [body.name for body in world.scene if body.name not in scene.bodies]
        seen = [body for name in names if (body := self._seen(name, looks)) is not None]
        for body in sorted(seen, key=lambda each: float(each.centre_base[2])):
            scene = scene.with_body(_standing(body, scene))
        return scene if wanted in scene.bodies else None

    def _seen(self, name: str, looks: int) -> Body | None:
        """A body where it seems to be, by the mean of so many sightings.

        Looks again for a while when it is not seen; of too few sightings, the mean of those.
        """
        found: list[Body] = []
        for look in range(LOOKS + looks - 1):
            if look:
                self._simulation.wait(LOOK_AGAIN_S)
            sighting = self._eyes.look(name, self._simulation.time_s)
            if sighting is not None:
                found.append(sighting.body)
            if len(found) == looks:
                break
        return mean_of(found) if found else None


def _task(transfer: Transfer, T_base_pick: pin.SE3, expected: Grasp | Miss) -> PickAndPlace:
    """The tip poses for a body, its sliding between the pads allowed for."""
    T_tip_body = (
        expected.T_tip_body if isinstance(expected, Grasp) else transfer.T_body_tip.inverse()
    )
    T_base_place = transfer.T_base_goal * T_tip_body.inverse()
    return PickAndPlace(
        transfer.body, T_base_pick, T_base_place, transfer.hover_m, transfer.clear_m
    )


def mean_of(bodies: Sequence[Body]) -> Body:
    """One body, where the mean of several sightings has its centre and its orientation.

    The mean of the orientations is taken on the tangent space at the first one, which is exact for
    turns about one axis.
    """
    if not bodies:
        raise SimulationError("the mean of no sightings is nowhere; give at least one")
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
