"""Whether the states and contacts that the steps of a plan state are those that follow.

The state before a step follows from the start and the steps before: where the arm has got to, what
its hand has taken and let go, by this package's own closing of fingers and its own fall of bodies.
The contacts follow from the steps before and after: on a straight line, a hand is near what it
closes on next or has let go, and a held body touches what carried it and what will.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from planner.grasping.finger_travel import FINGER_SPEED_M_S
from planner.plan import Grip, GripperAction, Move, Plan
from planner.scene.bodies import Body
from planner.scene.contact import Contact
from planner.state import State
from planner.verification.certificate import Check, Worst
from planner.verification.fingers import gaps_of_parts
from planner.verification.story import Run, Story
from planner.verification.tolerances import Tolerances
from planner.verification.urdf_robot import UrdfRobot

LEVELLED_RAD = 0.018
"""How far a body may turn as it comes down on what is not level: a degree, and rounding."""

LOOSE_M = 5e-4
"""How far a closed finger, and what it holds or has let go, may be from where it is stated: as deep
as contacts may press. The planner's fingers contain Rethink's meshes, which are used here; on odd
bodies both close to within 0.3 mm of each other, else to within 0.06 mm."""

SAME_RAD = 1e-6
"""Two poses that are turned by less from each other are not turned."""

SAME_S = 1e-6
"""How much longer than its move a contact may be stated."""

ABOUT_M = 1e-6
"""Two shapes whose gap is by so much more or less than a bound may be taken to be on either side.
"""

_Key: TypeAlias = tuple[str, str, int | None, int | None]


def statement_checks(
    plan: Plan, story: Story, robot: UrdfRobot, allowed: Tolerances
) -> Iterator[Check]:
    """That no stated state differs from what follows, and no stated contact; none where none is."""
    if all(step.state is None for step in plan):
        return
    judge = _Judge(plan, story, robot, allowed)
    for kind, differing in (("states", judge.state), ("contacts", judge.contacts)):
        found = [
            f"{step.label}: {difference}"
            for number, step in enumerate(plan)
            for difference in [next(differing(number), None)]
            if difference is not None
        ]
        worst = Worst(len(found), found[0] if found else "as they follow")
        yield worst.at_most(0.0, f"stated {kind} that differ")


class _Judge:
    """What follows of each step, and how what it states differs."""

    def __init__(self, plan: Plan, story: Story, robot: UrdfRobot, allowed: Tolerances) -> None:
        self._steps, self._story, self._robot, self._allowed = plan.steps, story, robot, allowed
        self._joints = plan.start.joints

    def state(self, number: int) -> Iterator[str]:
        """How the stated state differs."""
        state, run = self._steps[number].state, self._story.runs[number]
        if state is None:
            yield "no state is stated, although other steps have one"
            return
        yield from self._differing_joints(state, run)
        bodies = self._bodies(run)
        for name in sorted(bodies.keys() ^ state.scene.bodies.keys()):
            yield f"{name} is {'missing' if name in bodies else 'not there by then'}"
        for name, body in bodies.items():
            yield from self._differing_body(state.scene[name], body, name in self._fallen(number))
        yield from self._differing_hold(state, run)

    def contacts(self, number: int) -> Iterator[str]:
        """How the stated contacts differ."""
        step, expected = self._steps[number], self._contacts(number)
        most_s = self._duration_s(number) + SAME_S
        stated = {_key(each): each for each in step.contacts}
        if len(stated) < len(step.contacts):
            yield "a contact is stated twice"
        for key in expected.keys() - stated.keys():
            if expected[key]:
                yield f"contact of {_named(key)} is not stated"
        for key, contact in stated.items():
            least_m = -self._allowed.press_m if _may_press(contact) else 0.0
            if key not in expected:
                yield f"no contact of {contact.pair} is meant"
            elif contact.least_m < least_m:
                may, stated_mm = 1e3 * least_m, 1e3 * contact.least_m
                yield f"{contact.pair} may come as near as {may:g} mm, not {stated_mm:g} mm"
            elif contact.begin_s < 0.0 or contact.end_s > most_s:
                yield f"contact of {contact.pair} lasts longer than the step"

    def _duration_s(self, number: int) -> float:
        """How long a step takes; the fingers' way at the speed that is stated for them."""
        step, (run, end) = self._steps[number], self._story.runs[number : number + 2]
        if isinstance(step, Move):
            return step.trajectory.duration
        return (abs(end.finger_m - run.finger_m) + LOOSE_M) / FINGER_SPEED_M_S

    def _differing_joints(self, state: State, run: Run) -> Iterator[str]:
        robot = self._robot
        arm = dict(zip(robot.arm_names, run.q.tolist(), strict=True))
        fingers = robot.finger_values(run.finger_m)
        for name, stands in {**self._joints, **arm, **fingers}.items():
            slack = LOOSE_M if name in fingers else self._allowed.state
            off = abs(state.joints.get(name, np.inf) - stands)
            if off > slack:
                yield f"{name} is stated {off:.3g} off"
        for name in state.joints.keys() - self._joints.keys():
            yield f"there is no joint {name}"

    def _bodies(self, run: Run) -> dict[str, Body]:
        """All bodies where they are, those in the hands as well."""
        bodies = {body.name: body for body in (*run.scene, *self._story.elsewhere)}
        if run.carried is not None:
            T_base_tip = self._robot.T_base_tip(self._story.standing, run.q)
            body = run.carried.body
            bodies[body.name] = body.at(T_base_tip * run.carried.T_tip_body)
        return bodies

    def _fallen(self, number: int) -> set[str]:
        """Names of the bodies that were let go before a step."""
        return {each.body.name for each in self._story.releases if each.number < number}

    def _differing_body(self, stated: Body, expected: Body, has_fallen: bool) -> Iterator[str]:
        name = expected.name
        off_m, turned_rad = _apart(expected.T_base_body, stated.T_base_body)
        reach_m = max(np.linalg.norm(p.T_body_part.translation) for p in expected.parts) + 1.0
        loose_m = LOOSE_M + (turned_rad * reach_m if has_fallen else 0.0)
        if off_m > loose_m:
            yield f"{name} is stated {1e3 * off_m:.3g} mm from where it is by then"
        if turned_rad > (LEVELLED_RAD if has_fallen else SAME_RAD):
            yield f"{name} is stated turned by {turned_rad:.3g} rad"
        parts = zip(stated.parts, expected.parts, strict=False)
        is_same = all(
            one.shape == other.shape and one.T_body_part == other.T_body_part
            for one, other in parts
        )
        if not is_same or len(stated.parts) != len(expected.parts):
            yield f"{name} is stated with another shape"
        if stated.is_movable != expected.is_movable:
            yield f"{name} is {'movable' if expected.is_movable else 'fixed'}"

    def _differing_hold(self, state: State, run: Run) -> Iterator[str]:
        own = f"{self._robot.limb}_gripper"
        stated = {each.link: each for each in state.attachments}
        holds = {each.link: (each.body, each.T_link_body) for each in self._story.others_hold}
        if run.carried is not None:
            holds[own] = run.carried.body.name, run.carried.T_tip_body
        for link in holds.keys() | stated.keys():
            name = holds[link][0] if link in holds else "nothing"
            told = stated[link].body if link in stated else "nothing"
            if name != told:
                yield f"{link} holds {name}, and {told} is stated"
            elif link in holds:
                off_m, turned_rad = _apart(holds[link][1], stated[link].T_link_body)
                if off_m > LOOSE_M or turned_rad > SAME_RAD:
                    yield f"{name} is stated {1e3 * off_m:.3g} mm off in the hand"

    def _contacts(self, number: int) -> dict[_Key, bool]:
        """What may come near in a step, and whether it must be stated."""
        step, run = self._steps[number], self._story.runs[number]
        following = self._steps[number + 1] if number + 1 < len(self._steps) else None
        if isinstance(step, Grip):
            return self._of_grip(step, number)
        if run.carried is not None:
            found: dict[_Key, bool] = {}
            bodies, name = self._bodies(run), run.carried.body.name
            if not run.moves:
                found |= _of_supports(run.carried.body, bodies, self._allowed)
            if isinstance(following, Grip) and following.action is GripperAction.OPEN:
                end = self._bodies(self._story.runs[number + 1])
                found |= _of_supports(end[name], end, self._allowed)
            return found
        if not step.is_straight:
            return {}
        near = None if run.moves else run.released
        if isinstance(following, Grip) and following.action is GripperAction.CLOSE:
            near = following.body
        return {} if near is None else _of_hand(self._robot.limb, near)

    def _of_grip(self, grip: Grip, number: int) -> dict[_Key, bool]:
        if grip.body is None:
            return {}
        found = _of_hand(self._robot.limb, grip.body)
        before = self._bodies(self._story.runs[number])
        pushes = [g.closing.push_m for g in self._story.grasps if g.number == number]
        if pushes:
            is_pushed = abs(pushes[0]) > LOOSE_M
            supports = _of_supports(before[grip.body], before, self._allowed)
            found |= {key: must and is_pushed for key, must in supports.items()}
        return found


def _apart(T: pin.SE3, other: pin.SE3) -> tuple[float, float]:
    """How far two poses are from each other, m and rad."""
    between = T.inverse() * other
    return float(np.linalg.norm(between.translation)), float(
        np.linalg.norm(pin.log3(between.rotation))
    )


def _key(contact: Contact) -> _Key:
    return contact.body, contact.other, contact.part, contact.other_part


def _named(key: _Key) -> str:
    return Contact(*key).pair


def _may_press(contact: Contact) -> bool:
    return not contact.other.endswith(" hand")


def _of_hand(side: str, body: str) -> dict[_Key, bool]:
    """The hand must be stated; its pads may be, as their shapes differ from the planner's."""
    return {(body, f"{side} hand", None, None): True, (body, f"{side} pads", None, None): False}


def _of_supports(body: Body, bodies: dict[str, Body], allowed: Tolerances) -> dict[_Key, bool]:
    """Parts that touch another's must be stated; about as far as counts as touching, they may."""
    found: dict[_Key, bool] = {}
    for other in bodies.values():
        if other.name != body.name:
            for (part, other_part), gap_m in gaps_of_parts(body, other, allowed.press_m + ABOUT_M):
                key = body.name, other.name, part, other_part
                found[key] = gap_m < allowed.press_m - ABOUT_M
    return found
