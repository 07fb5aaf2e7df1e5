"""Phases of a pick and place: the poses of bodies, what the hand holds, and what it may touch.

They follow from the task and the scene alone, independently of the arm's path, and are derived
once:

```
label              stands still           in the hand         may come near, or touch
pick: approach     everything             -                   -
pick: descend      everything             -                   the hand its body
pick: close        all but what is pushed (pushed)            the pads their body
pick: retract      all but the body       the body            the body what it stands on
place: approach    all but the body       the body            -
place: descend     all but the body       the body            the body what it will stand on
place: open        everything             -                   the pads their body
place: retract     everything             -                   the hand its body
```

The fingers open to the full stroke, or, where something blocks them at the pick or at the place, as
far as is free.

The hand and the held body move along a line in the same way for all IK solutions. So a collision
there with a body of the scene rules out every solution; it is checked once, when the first cycle
fails (`refuse_blocked_hand`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from baxter_kin.fields import FrozenMapping
from planner.clearance import Clearance, ContinuousContact
from planner.collision.context import CollisionContext
from planner.collision.distances import ACCURACY_M, RESOLUTION_M
from planner.grasping.finger_travel import FingerTravel, closing_travel, travel_check
from planner.grasping.grasp import Grasp, Miss
from planner.grasping.overhead import MIN_FINGER_CLEARANCE_M
from planner.motion.paths.straight_line import StraightLine
from planner.pick_place.plan_builder import NoSolutionError, blocked_fingers
from planner.pick_place.task import PICK_LINES, Leg, PickAndPlace, PlanRequest
from planner.plan import GripperAction, PlanFailure
from planner.scene.bodies import Attachment, Body, Scene
from planner.scene.contact import (
    PRESSING_TOLERANCE_M,
    PartContact,
    depth_m,
    part_contacts,
    touching,
)
from planner.scene.faces import UP
from planner.scene.support import MAX_TILT_RAD, Landing, fall_straight, settle

AWAY: Mapping[str, str] = FrozenMapping(
    {
        "pick: descend": "pick: approach",
        "pick: retract": "place: approach",
        "place: descend": "place: approach",
    }
)
"""The stage whose context is that of lines which do not touch the pick or place; after the place,
the open hand keeps clear of everything."""

MAX_DROP_M = 0.01
"""Maximum height above its support from which a body may be released."""

OPENING_STEP_M = 1e-4
"""Resolution of the search for the widest free opening."""

STEP_M = 0.005
"""Distance between samples of the hand; the proofs of the moves find thinner obstacles."""

_SAME_PLACE_M = 1e-9
"""Maximum difference of two poses at which a body is in the same place, m."""

_Opening: TypeAlias = tuple[float, tuple[FingerTravel, ...], tuple[PlanFailure, ...]]
"""A finger position, the fingers' travel from or to it, and what blocks any opening."""


@dataclass(frozen=True, slots=True, eq=False)
class Phases:
    """Finger travels and collision contexts of one pick and place.

    Attributes:
        opening_m: finger position with which the hand approaches the body.
        closing: the fingers' travel at the pick.
        releasing: the fingers' travel at the place.
        contexts: the collision context of every leg, by its label.
        refusals: why the task is impossible although each pose is free: the fingers are blocked at
            any opening, or the body would fall.
        taken: failure if another body stands at the place.
    """

    opening_m: float
    closing: tuple[FingerTravel, ...]
    releasing: tuple[FingerTravel, ...]
    contexts: Mapping[str, CollisionContext]
    refusals: tuple[PlanFailure, ...] = ()
    taken: PlanFailure | None = None

    def refuse_impossible(self) -> None:
        """Raise NoSolutionError for the first refusal."""
        for failure in self.refusals:
            raise NoSolutionError(failure)


@dataclass(frozen=True, slots=True, eq=False)
class PhaseMaker:
    """Derives the phases of a task.

    Attributes:
        request: the arm, the scene, and the required distance.
        task: the task.
    """

    request: PlanRequest
    task: PickAndPlace

    def phases(self) -> Phases:
        """The phases.

        Raises NoSolutionError when something stands on the body, or the hand cannot grasp it.
        """
        body, task = self.request.scene[self.task.body], self.task
        refuse_loaded(body, self.request.scene, {held.body for held in self.request.held})
        self._refuse_wide(body)
        grasp = self._grasp(body)
        opening_m, closing, blocked_closing = self._at_pick(grasp)
        carried = self._carried(body, grasp)
        landing, no_rest = self._landing(body, grasp)
        after = self.request.scene.without(self.task.body).with_body(landing.body)
        leaving_m, releasing, blocked_opening = self._at_place(body, grasp, landing)
        contexts = {
            "pick: approach": self._context(self.request.scene, finger_m=opening_m),
            "pick: descend": self.reaching(opening_m),
            **carried,
            "place: retract": self._near(after, leaving_m, task.T_base_place),
        }
        for leg in task.legs:
            if leg.label not in contexts:
                contexts[leg.label] = (
                    contexts[AWAY[leg.stage]]
                    if leg.stage in AWAY
                    else self._context(after, finger_m=leaving_m)
                )
        return Phases(
            opening_m,
            closing,
            releasing,
            contexts,
            (*blocked_closing, *no_rest, *blocked_opening),
            self._taken(body, grasp),
        )

    def _taken(self, body: Body, grasp: Grasp) -> PlanFailure | None:
        """The failure if another body stands at the place.

        Of fixed bodies only those that reach as high count: with a lower one, the place is merely
        too low.
        """
        placed = body.at(self.task.T_base_place * grasp.T_tip_body)
        away = {body.name, *(held.body for held in self.request.held)}
        for other in self.request.scene:
            if other.name in away:
                continue
            inside_m = depth_m(placed, other)
            is_beside = other.is_movable or other.extent_m(UP)[1] >= placed.extent_m(UP)[1]
            if inside_m > PRESSING_TOLERANCE_M and is_beside:
                reason = (
                    f"{other.name} stands there: {body.name} would be {1e3 * inside_m:.1f} mm "
                    "inside it"
                )
                return PlanFailure("place: descend", reason, is_certain=True)
        return None

    def _refuse_wide(self, body: Body) -> None:
        """Raise an error when the open pads cannot come down on both sides of the body."""
        hand, T_base_pick = self.request.manipulator.hand, self.task.T_base_pick
        width = hand.width_across_m(T_base_pick, body)
        room_m = hand.room_m(T_base_pick, hand.stroke_m, body)
        is_between = 0.0 < width <= hand.open_gap_m
        if width <= hand.open_gap_m and (room_m >= -RESOLUTION_M or not is_between):
            return
        if is_between:
            fault = (
                f"which the {hand.side} hand opens for ({1e3 * hand.open_gap_m:.1f} mm), but off "
                f"its middle: a pad would come down {-1e3 * room_m:.1f} mm inside it"
            )
        else:
            fault = f"but the {hand.side} hand opens only {1e3 * hand.open_gap_m:.1f} mm"
        raise NoSolutionError.at(
            "pick: open",
            f"{body.name} measures {1e3 * _min_width_m(body):.1f} mm, "
            f"{1e3 * width:.1f} mm between the pads as it lies, {fault}",
            is_certain=True,
        )

    def _grasp(self, body: Body) -> Grasp:
        hand = self.request.manipulator.hand
        grasp = hand.close_on(self.task.T_base_pick, body, hand.stroke_m)
        if isinstance(grasp, Miss):
            reason = f"the fingers would miss: {grasp}"
            raise NoSolutionError.at("pick: close", reason, is_certain=True)
        return grasp

    def _at_pick(self, grasp: Grasp) -> _Opening:
        scene, name = self.request.scene, self.task.body
        return self._widest(
            lambda opening_m: closing_travel(scene, name, opening_m, grasp),
            self.task.T_base_pick,
            ("pick: close", GripperAction.CLOSE),
            grasp.finger_m + abs(grasp.push_m),
        )

    def _at_place(self, body: Body, grasp: Grasp, landing: Landing) -> _Opening:
        return self._widest(
            lambda opening_m: self._releasing(body, grasp, landing, opening_m),
            self.task.T_base_place,
            ("place: open", GripperAction.OPEN),
            grasp.finger_m,
        )

    def _widest(
        self,
        travels: Callable[[float], tuple[FingerTravel, ...]],
        T_base_tip: pin.SE3,
        step: tuple[str, GripperAction],
        min_m: float,
    ) -> _Opening:
        """The widest opening with a clear travel of the fingers; or the full one, with the failure.

        The failure is raised only when the pose itself is free: one obstacle may block both.
        """

        def contact(way: tuple[FingerTravel, ...]) -> ContinuousContact | None:
            checks = (travel_check(self.request.manipulator, travel) for travel in way)
            contacts = (check.contact_above(T_base_tip, self.request.margin_m) for check in checks)
            return next(filter(None, contacts), None)

        max_m, min_m = self.request.manipulator.hand.stroke_m, min_m + MIN_FINGER_CLEARANCE_M
        full_travel = travels(max_m)
        if contact(full_travel) is None:
            return max_m, full_travel, ()
        blocked = contact(travels(min(min_m, max_m)))
        if blocked is not None:
            return max_m, full_travel, (blocked_fingers(*step, blocked, is_certain=True),)
        while max_m - min_m > OPENING_STEP_M:
            middle_m = (min_m + max_m) / 2
            if contact(travels(middle_m)) is None:
                min_m = middle_m
            else:
                max_m = middle_m
        return min_m, travels(min_m), ()

    def _releasing(
        self, body: Body, grasp: Grasp, landing: Landing, opening_m: float
    ) -> tuple[FingerTravel, ...]:
        """The fingers open beside the body where it is released, and where it comes to rest."""
        let_go = body.at(self.task.T_base_place * grasp.T_tip_body)
        places = [let_go]
        if not landing.body.T_base_body.isApprox(let_go.T_base_body, _SAME_PLACE_M):
            places.append(landing.body)
        others = self.request.scene.without(self.task.body)
        return tuple(
            FingerTravel(
                others.with_body(place), grasp.finger_m, opening_m, touchable=self.task.body
            )
            for place in places
        )

    def _carried(self, body: Body, grasp: Grasp) -> dict[str, CollisionContext]:
        """Contexts with the body in the hand: on its supports, and free of them."""
        others = self.request.scene.without(self.task.body)
        placed = body.at(self.task.T_base_place * grasp.T_tip_body)
        stood, will_stand = part_contacts(body, self.request.scene), part_contacts(placed, others)
        held = Attachment(self.task.body, self.request.manipulator.arm.tip_frame, grasp.T_tip_body)
        lifted, free, lowered = (
            self._context(self.request.scene, finger_m=grasp.finger_m, held=held, supports=supports)
            for supports in (stood, frozenset[PartContact](), will_stand)
        )
        return {"pick: retract": lifted, "place: approach": free, "place: descend": lowered}

    def reaching(self, opening_m: float) -> CollisionContext:
        """Context on the line down to the pick, at an opening of the fingers."""
        return self._near(self.request.scene, opening_m, self.task.T_base_pick)

    def _landing(self, body: Body, grasp: Grasp) -> tuple[Landing, tuple[PlanFailure, ...]]:
        """Where the body comes to rest after its release; and why that is not allowed, if so."""
        let_go = body.at(self.task.T_base_place * grasp.T_tip_body)
        if self.request.gives:
            return Landing(let_go, 0.0, (), ()), ()
        landing = settle(let_go, list(self.request.scene.without(self.task.body)))
        refusal = no_rest(landing)
        return landing, () if refusal is None else (refusal,)

    def _near(self, scene: Scene, finger_m: float, T_base_tip: pin.SE3) -> CollisionContext:
        """The open hand around its body; the pads may touch it only where that is unavoidable."""
        hand, body = self.request.manipulator.hand, scene[self.task.body]
        room_m = hand.room_m(T_base_tip, finger_m, body)
        may_press = room_m <= RESOLUTION_M
        return self._context(
            scene, finger_m=finger_m, touchable=self.task.body, may_press=may_press
        )

    @property
    def _context(self) -> Callable[..., CollisionContext]:
        """Builds a context from a scene, the opening of the fingers and the allowed contacts."""
        request = self.request
        return partial(request.manipulator.context, margin_m=request.margin_m)


def refuse_loaded(body: Body, scene: Scene, in_hands: Set[str] = frozenset()) -> None:
    """Raise NoSolutionError when another body stands on the one to be lifted."""
    for name in sorted(touching(body, scene) - in_hands):
        if not scene[name].is_movable:
            continue
        landing = fall_straight(scene[name], scene.without(name))
        if body.name in landing.supports and landing.drop_m <= PRESSING_TOLERANCE_M:
            too = ", too" if len(landing.supports) > 1 else ""
            raise NoSolutionError.at(
                "pick: retract",
                f"{name} stands on {body.name}{too}; carry that away first",
                is_certain=True,
            )


def no_rest(landing: Landing) -> PlanFailure | None:
    """The failure if a body must not be released, because it would fall, not stand, or tip."""
    name, on, way = landing.body.name, " and ".join(landing.supports), landing.overhang
    if landing.drop_m > MAX_DROP_M:
        reason = (
            f"{name} would fall: nothing is within {1e3 * MAX_DROP_M:.0f} mm below it, and {on} is "
            f"{1e3 * landing.drop_m:.0f} mm below"
        )
    elif landing.slope_rad > 0.0:
        reason = (
            f"{name} would not stand: {on} slopes by {math.degrees(landing.slope_rad):.1f} deg "
            f"there, and at most {math.degrees(MAX_TILT_RAD):g} deg counts as level"
        )
    elif way is not None:
        beside_mm = 1e3 * float(np.linalg.norm(way))
        reason = f"{name} would tip: its centre is {beside_mm:.1f} mm beyond the edge of {on}"
    else:
        return None
    return PlanFailure("place: open", reason, is_certain=True)


def _min_width_m(body: Body) -> float:
    """The smallest of the body's extents along its own axes."""
    spans = [body.extent_m(axis) for axis in body.T_base_body.rotation.T]
    return min(high - low for low, high in spans)


def refuse_blocked_hand(task: PickAndPlace, contexts: Mapping[str, CollisionContext]) -> None:
    """Raise NoSolutionError when the hand cannot move along a line; names stage and height."""
    for leg in task.legs:
        if leg.line is not None:
            T_base_tip = task.T_base_pick if leg.stage in PICK_LINES else task.T_base_place
            _refuse_blocked_line(leg, leg.line, contexts[leg.label], T_base_tip)


def _refuse_blocked_line(
    leg: Leg, line: StraightLine, context: CollisionContext, T_base_pose: pin.SE3
) -> None:
    fractions = np.linspace(0.0, 1.0, 1 + int(np.ceil(line.length_m / STEP_M)))
    contacts = _contacts(context, [line.at(s) for s in fractions.tolist()])
    if not contacts:
        return
    near, needed_m, sample = min(contacts, key=lambda each: each[0].distance_m)
    T_base_tip = line.at(float(fractions[sample]))
    away_m = float(np.linalg.norm(T_base_tip.translation - T_base_pose.translation))
    away = f"{1e3 * away_m:.0f} mm {'above' if leg.is_vertical else 'away from'} the pose"
    reason = f"for every IK solution, {near.text} {away if away_m > 0.0 else 'at the pose'}"
    if near.distance_m > 0.0:
        reason += f", and {1e3 * context.margin_m:.1f} mm are required"
    contact = ContinuousContact(
        near, needed_m, duration_s=0.0, intervals=0, evaluations=len(fractions)
    )
    raise NoSolutionError(PlanFailure(leg.stage, reason, is_certain=True, contact=contact))


def _contacts(
    context: CollisionContext, T_base_tips: Sequence[pin.SE3]
) -> list[tuple[Clearance, float, int]]:
    """Bodies that are too close to the hand or what it holds, with the tip at some poses.

    Without the arm; each with the required distance, m, and the number of the pose.
    """
    checked, arm = context.checker.checked, context.checker.arm
    bounds, of_robot = context.checker.motion_bounds, len(context.checker.shapes.links)
    moves = bounds.moves[:, -1]
    stands = ~bounds.moves.any(axis=1) & (np.arange(len(bounds.moves)) >= of_robot)
    first, second = checked.pairs.T
    pairs = np.flatnonzero((moves[first] & stands[second]) | (stands[first] & moves[second]))
    standing = bounds.place(context.q_others, arm.neutral[None]).shapes
    T_tip_shapes = arm.T_base_tip(arm.neutral).inverse().homogeneous @ standing[0, moves]
    poses = np.tile(standing, (len(T_base_tips), 1, 1, 1))
    poses[:, moves] = np.array([T.homogeneous for T in T_base_tips])[:, None] @ T_tip_shapes
    samples, pair = (each.ravel() for each in np.indices((len(poses), len(pairs))))
    needs = checked.required_m(context.margin_m)[pairs[pair]]
    contacts = []
    for near in np.flatnonzero(checked.gaps_m(poses, samples, pairs[pair]) <= needs).tolist():
        number, need_m = int(pairs[pair[near]]), float(needs[near])
        checked.distances.place(poses[samples[near]])
        distance_m = checked.distances.measure(number, max(need_m, 0.0) + ACCURACY_M)
        if distance_m <= need_m:
            contacts.append((checked.clearance_of(number, distance_m), need_m, int(samples[near])))
    return contacts
