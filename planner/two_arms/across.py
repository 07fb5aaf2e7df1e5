"""Proof that both arms keep clear of each other, in successive windows of the common clock.

Each arm's own plan is proven in a world without the other arm and without the bodies that the other
arm handles. The remaining pairs are those of one arm, its hand and the bodies that it handles with
the other arm, its hand and its bodies. These pairs are proven here.

Which of these shapes exist, and what carries them, changes only when a hand grips. So an arm goes
through successive `HandState`s: before it closes on a body, while it closes, while it holds the
body, while it opens, and after that. The clock is cut where either arm changes its state. In each
window between, both states are constant, and the motion of all 14 joints is proven clear by rows of
separation along the walk from one hand to the other (`planner.collision.mover`).

A body that is handed over (`Grip.receiver`) belongs to the giver's shapes until the giver has
arrived where it hands the body over, and to the taker's from the taker's next move on. In between,
the body rests at that place. It also rests there in each arm's own world, so each arm's own plan
proves that its hand keeps clear of the body, except for intended contacts.

While a hand grips, its arm rests, but fingers and body move inside the hand, and the other arm
moves on. The shapes then stand at fixed poses and are thicker:

- fingers stand at the middle of their travel, and are thicker by half of it: no point of a finger
  moves farther than that from its position there;
- a body that is pushed by closing fingers, or settles after its release, stands at its initial
  pose, and is thicker by the maximum displacement of its points at the end. This assumes that no
  point is displaced farther in between, which holds for a straight push, and for a fall of a few
  millimetres.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from baxter_kin.fields import evolve
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray, Indices
from planner.clearance import ContinuousContact, ContinuousProof, ContinuousResult
from planner.collision.checker import ClearanceChecker
from planner.collision.context import CollisionContext
from planner.collision.obstacles import Obstacles
from planner.collision.proof import prove_clear
from planner.collision.robot.robot_shapes import RobotShapes
from planner.collision.shape_pairs import ShapePairsBuilder
from planner.completion import after, state_of
from planner.manipulator import Manipulator
from planner.plan import Grip, Plan
from planner.scene.bodies import Body
from planner.state import State
from planner.trajectory import between
from planner.two_arms.plan import SAME_TIME_S, TwoArmPlan, duration_of

SAME_M = 1e-9
"""Maximum travel of a finger, or difference of two poses, that counts as none."""


class Carried(NamedTuple):
    """A body that an arm handles, in one state of the hand.

    Attributes:
        body: the body, at its pose in base where it stands.
        T_tip_body: its pose seen from the tip that holds it; None where it stands.
        thicker_m: additional thickness.
    """

    body: Body
    T_tip_body: pin.SE3 | None
    thicker_m: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class HandState:
    """The fingers of an arm, and the bodies that it handles, between two changes.

    Attributes:
        finger_m: position of the fingers, m.
        thicker_m: additional thickness of the fingers, m.
        bodies: all bodies that the arm handles in its plan.
    """

    finger_m: float
    thicker_m: float
    bodies: tuple[Carried, ...]


class Episode(NamedTuple):
    """An interval of one arm's steps in which its hand's state is the same.

    Attributes:
        first: number of its first step.
        last: number of its last step.
        is_grip: whether it is a gripper action.
        state: of the hand.
        waits_before: whether the rest before its first step belongs to the previous episode.
    """

    first: int
    last: int
    is_grip: bool
    state: HandState
    waits_before: bool


def episodes_of(
    plan: Plan, manipulator: Manipulator, names: Iterable[str], received: Iterable[str] = ()
) -> tuple[Episode, ...]:
    """The states of a hand during a complete plan of its arm, in order.

    Args:
        plan: the plan.
        manipulator: the arm and its hand.
        names: of the bodies that the arm handles.
        received: of those that the other arm hands over to it.
    """
    episodes: list[Episode] = []
    mine, waiting = set(names).difference(received), set(received)
    has_received = False
    for number, step in enumerate(plan):
        gets, gives = set[str](), set[str]()
        if isinstance(step, Grip) and step.body is not None:
            gets = waiting.intersection({step.body})
            gives = {step.body} if step.receiver else gives
        mine -= gives
        begin = state_of(step)
        end = after(step, begin, manipulator) if isinstance(step, Grip) else begin
        state = _hand_state(sorted(mine), (begin, end), manipulator)
        is_grip = isinstance(step, Grip) and (step.body is not None or state.thicker_m > SAME_M)
        if episodes and not is_grip and not episodes[-1].is_grip:
            episodes[-1] = episodes[-1]._replace(last=number)
        else:
            waits_before = has_received or (is_grip and not gives)
            episodes.append(Episode(number, number, is_grip, state, waits_before))
        mine |= gets
        waiting -= gets
        has_received = bool(gets)
    return tuple(episodes)


def _hand_state(
    names: Sequence[str], ends: tuple[State, State], manipulator: Manipulator
) -> HandState:
    """The state of a hand between the beginning and the end of a step, in which its arm rests."""
    begin, end = ends
    finger = manipulator.hand.joint_names[0]
    first_m, last_m = begin.joints[finger], end.joints[finger]
    held, bodies = begin.holding(manipulator.arm.side), []
    for name in names:
        body, moved_m = begin.scene[name], 0.0
        if end is not begin:
            moved_m = _farthest_m(body, end.scene[name].T_base_body)
        T_tip_body = held.T_link_body if held is not None and held.body == name else None
        bodies.append(Carried(body, T_tip_body, moved_m if moved_m > SAME_M else 0.0))
    travel_m = abs(last_m - first_m)
    return HandState((first_m + last_m) / 2, travel_m / 2, tuple(bodies))


def _farthest_m(body: Body, T_base_moved: pin.SE3) -> float:
    """An upper bound on the distance that any point of a body moves to another pose, m."""
    if body.T_base_body.isApprox(T_base_moved, SAME_M):
        return 0.0
    T = body.T_base_body.inverse() * T_base_moved
    corners = np.array(list(product(*zip(*_box_of(body), strict=True))))
    moved = corners @ T.rotation.T + T.translation - corners
    return float(np.linalg.norm(moved, axis=1).max())  # convex in the point, so at a corner


def _box_of(body: Body) -> tuple[FloatArray, FloatArray]:
    """Corners of a box around a body, seen from the body, each of shape (3,), m."""
    spans = np.array([body.extent_m(axis) for axis in body.T_base_body.rotation.T])
    at = body.T_base_body.rotation.T @ body.T_base_body.translation
    return spans[:, 0] - at, spans[:, 1] - at


class BetweenArms(ClearanceChecker):
    """The distances of both arms, with their hands and bodies, from each other.

    Pairs within an arm, and those with anything else, are not checked; each arm's own plan is
    proven for them.
    """

    def __init__(
        self,
        shapes: RobotShapes,
        manipulators: Mapping[str, Manipulator],
        states: tuple[HandState, HandState],
    ) -> None:
        """Build the geometry.

        Args:
            shapes: the robot's shapes, no arm left out.
            manipulators: of both arms.
            states: of the left and the right hand.
        """
        arms = tuple(manipulators[side].arm for side in LIMBS)
        self._both = shapes, manipulators, states
        self.arms, self.shapes, self.contacts = arms, shapes, ()
        self.robot = shapes.robot.model
        self._hulls = {}
        builder = ShapePairsBuilder(shapes, arms[0])
        of = [shapes.of_arm(arm) for arm in arms]
        builder.pairs = [
            pair
            for pair in shapes.pairs
            if not of[0].isdisjoint(pair) and not of[1].isdisjoint(pair)
        ]
        carried = [
            list(_added(builder, arm.tip_frame, state))
            for arm, state in zip(arms, states, strict=True)
        ]
        for side, other in ((0, 1), (1, 0)):
            for indices, _ in carried[side]:
                for pair in product(sorted(of[other] & shapes.wholes), indices):
                    builder.pair(*pair)
        self._in_hands = [
            {
                body.body.name: set(indices)
                for body, (indices, is_held) in zip(state.bodies, own, strict=True)
                if is_held
            }
            for state, own in zip(states, carried, strict=True)
        ]
        for (first, is_held), (second, other_held) in product(*carried):
            if is_held or other_held:
                for pair in product(first, second):
                    builder.pair(*pair)
        for arm, state in zip(arms, states, strict=True):
            for index in (i for finger in shapes.of_fingers(arm) for i in finger):
                builder.thicken(index, state.thicker_m)
        self.checked = builder.build()
        self.geometry = self.checked.geometry

    def __reduce__(self):  # type: ignore[no-untyped-def]
        return BetweenArms, self._both

    def in_exchange(self, name: str) -> Indices:
        """Indices of the pairs of a body in one hand with the other hand and the bodies it holds.

        A hand comprises all shapes that move with the last joint of its arm.
        """
        are_in = np.zeros(len(self.checked.pairs), dtype=np.bool_)
        for side, other in ((0, 1), (1, 0)):
            body = self._in_hands[side].get(name, set[int]())
            hand = self.shapes.of_hand(self.arms[other]).union(*self._in_hands[other].values())
            is_body, is_hand = (np.isin(self.checked.pairs, sorted(each)) for each in (body, hand))
            are_in |= (is_body & is_hand[:, ::-1]).any(axis=1)
        return np.flatnonzero(are_in)


def _added(
    builder: ShapePairsBuilder, tip_frame: str, state: HandState
) -> Iterator[tuple[list[int], bool]]:
    """Add the bodies of an arm: the numbers of each one's shapes, and whether it is held."""
    for body, T_tip_body, thicker_m in state.bodies:
        if T_tip_body is None:
            indices = builder.add_standing(body)
        else:
            indices = builder.add_to(tip_frame, body, T_tip_body)
        for index in indices:
            builder.thicken(index, thicker_m)
        yield indices, T_tip_body is not None


def context_between(
    shapes: RobotShapes,
    manipulators: Mapping[str, Manipulator],
    states: tuple[HandState, HandState],
    q_others: FloatArray,
    margin_m: float,
) -> CollisionContext:
    """The context of all 14 joints, of both arms and hands against each other.

    Args:
        shapes: the robot's shapes, no arm left out.
        manipulators: of both arms.
        states: of the left and the right hand.
        q_others: a full configuration, shape (19,), for the joints of neither arm.
        margin_m: distance that both arms keep.
    """
    full = np.array(q_others)
    for side, state in zip(LIMBS, states, strict=True):
        manipulator = manipulators[side]
        fingers = manipulator.hand.finger_joints(state.finger_m)
        full[list(manipulator.robot.indices(tuple(fingers)))] = list(fingers.values())
    return CollisionContext(BetweenArms(shapes, manipulators, states), full, margin_m=margin_m)


class Window(NamedTuple):
    """An interval of the clock in which the states of both hands are the same.

    Attributes:
        begin_s: when it begins.
        end_s: when it ends.
        episodes: numbers of the left and the right arm's episode.
    """

    begin_s: float
    end_s: float
    episodes: tuple[int, int]


class Across:
    """Both arms against each other, for all combinations of the states of their hands."""

    def __init__(
        self,
        manipulators: Mapping[str, Manipulator],
        episodes: Mapping[str, Sequence[Episode]],
        q_others: FloatArray,
        margin_m: float,
    ) -> None:
        """Store the states.

        Args:
            manipulators: of both arms, whose shapes leave out no arm.
            episodes: of both arms, in order.
            q_others: a full configuration, shape (19,), for the joints of neither arm.
            margin_m: distance that both arms keep.
        """
        self.manipulators, self.episodes = manipulators, episodes
        self.margin_m = margin_m
        self._q_others = q_others
        self._shapes = manipulators[LIMBS[0]].shapes
        self._contexts: dict[tuple[int, int], CollisionContext] = {}
        self._obstacles: dict[tuple[tuple[int, int], float], Obstacles] = {}

    def context(self, at: tuple[int, int]) -> CollisionContext:
        """The context of all 14 joints, by the numbers of the left and the right episode."""
        if at not in self._contexts:
            left, right = (self.episodes[s][k].state for s, k in zip(LIMBS, at, strict=True))
            self._contexts[at] = context_between(
                self._shapes, self.manipulators, (left, right), self._q_others, self.margin_m
            )
        return self._contexts[at]

    def obstacles(self, at: tuple[int, int], extra_m: float) -> Obstacles:
        """The obstacles of a context, with a distance in addition to the margin."""
        if (at, extra_m) not in self._obstacles:
            none = np.zeros((0, 14))
            found = self.context(at).obstacles(self.margin_m + extra_m, none)
            self._obstacles[at, extra_m] = found
        return self._obstacles[at, extra_m]

    def first_hit_s(self, plan: TwoArmPlan, step_s: float, room_m: float) -> float | None:
        """The first sampled time at which the arms are too close, s; None if there is none.

        Args:
            plan: the plan.
            step_s: time between samples.
            room_m: distance to keep in addition to the margin.
        """
        motion = plan.trajectory
        for window in windows_of(plan, self.episodes):
            context = self.context(window.episodes).with_margin(self.margin_m + room_m)
            count = 2 + int((window.end_s - window.begin_s) / step_s)
            times_s = np.linspace(window.begin_s, window.end_s, count)
            for time_s, q in zip(times_s.tolist(), motion.sample(times_s).q, strict=True):
                if not context.is_free(q):
                    return float(time_s)
        return None

    def prove(self, plan: TwoArmPlan) -> ContinuousResult:
        """A proof that both arms keep clear in a plan, or the contact that prevents it.

        Times are those of the common clock.
        """
        motion, proofs = plan.trajectory, []
        for window in windows_of(plan, self.episodes):
            context = self.context(window.episodes)
            part = between(motion, window.begin_s, window.end_s)
            result = prove_clear(context.checker, part, context.q_others, margin_m=self.margin_m)
            near = result.nearest
            if near.time_s is not None:
                near = evolve(near, time_s=near.time_s + window.begin_s)
            if isinstance(result, ContinuousContact):
                return evolve(result, nearest=near, duration_s=motion.duration)
            proofs.append((result, near))
        return ContinuousProof(
            min(proof.proven_m for proof, _ in proofs),
            min((near for _, near in proofs), key=lambda near: near.distance_m),
            self.margin_m,
            sum(proof.intervals for proof, _ in proofs),
            sum(proof.evaluations for proof, _ in proofs),
        )


def changes_of(
    plan: Plan, begins_s: Sequence[float], grip_s: float, episodes: Sequence[Episode]
) -> FloatArray:
    """When each episode but the first begins on the clock, shape (episodes - 1,), s.

    A rest before a gripper action belongs to the moves before it, one after it to those after,
    except beside a handover (`Episode.waits_before`).
    """
    times = []
    for before, episode in pairwise(episodes):
        if episode.waits_before:
            times.append(begins_s[episode.first])
        else:
            times.append(begins_s[before.last] + duration_of(plan.steps[before.last], grip_s))
    return np.array(times)


def windows_of(plan: TwoArmPlan, episodes: Mapping[str, Sequence[Episode]]) -> list[Window]:
    """The clock of a plan, cut where either hand changes its state."""
    changes = [
        changes_of(plan.plans[side], plan.begins_s[side], plan.grip_s, episodes[side])
        for side in LIMBS
    ]
    cuts = np.unique(np.concatenate([[0.0, plan.duration_s], *changes]))
    windows = []
    for begin_s, end_s in zip(cuts[:-1].tolist(), cuts[1:].tolist(), strict=True):
        if end_s - begin_s > SAME_TIME_S:
            middle_s = (begin_s + end_s) / 2
            left, right = (int((times < middle_s).sum()) for times in changes)
            windows.append(Window(begin_s, end_s, (left, right)))
    return windows
