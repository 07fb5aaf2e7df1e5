"""A plan of both arms: each arm by itself, then one against the other on the common clock.

Each arm's own steps are judged by `referee.checker`, in a world without the other arm and without
the bodies that the other arm handles. What is left are the links, fingers and bodies of one arm
against those of the other: every millisecond of the clock, on the original meshes. An arm rests
between its steps; fingers travel at their speed from when a gripper action begins, and what is
pushed or let go moves meanwhile.

Not covered: bodies that both arms handle, and fingers that begin late or travel slower.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from referee.checker import FINGER_SPEED_M_S, MAX_FALL_M, STEP_S, check_plan, closes, positions
from referee.pairs import Finding, Span, Track, When, broken, margin_rule
from referee.robot import Robot, arm_joints, load_robot
from referee.solids import Array
from referee.stage import Stage, Thing, closing, openings_m

LIMBS = ("left", "right")

GRAVITY_M_S2 = 9.81

SAME_TIME_S = 1e-9
"""Largest difference of times that is rounding."""


def check_two_arm_plan(plan: Any, *, margin_m: float = 0.0, apart_m: float = 0.0) -> list[Finding]:
    """Everything that contradicts a plan of both arms; nothing when it is right.

    Args:
        plan: `start`, `plans` and `begins_s` by the arm, and `grip_s`.
        margin_m: the distance that each arm was asked to keep by itself.
        apart_m: the distance that both arms are said to keep from each other.

    Raises:
        ValueError: when both arms handle the same body, which is not judged.
    """
    robot, handled = load_robot(), {side: _handled(plan, side) for side in LIMBS}
    both = handled["left"] & handled["right"]
    if both:
        raise ValueError(f"both arms handle {', '.join(sorted(both))}, which is not judged")
    findings = list(_clock_faults(plan))
    for side, other in (LIMBS, LIMBS[::-1]):
        alone, own = _without_arm(robot, other), plan.plans[side]
        found = check_plan(own, margin_m=margin_m, robot=alone, without=handled[other])
        findings += [replace(each, label=f"{side} arm, {each.label}") for each in found]
    if any(finding.kind == "jumps" for finding in findings):
        return findings
    return findings + list(_between(plan, robot, handled, apart_m))


def duration_s(plan: Any) -> float:
    """When the last step of both arms ends, s."""
    return max((end_s for side in LIMBS for _, end_s, _ in _steps(plan, side)), default=0.0)


def _handled(plan: Any, side: str) -> set[str]:
    """Names of the bodies that an arm holds at first, or grips."""
    grips = (step for step in plan.plans[side].steps if not hasattr(step, "trajectory"))
    held = (each.body for each in plan.start.attachments if each.side == side)
    return {*held, *(grip.body for grip in grips)} - {None}


def _without_arm(robot: Robot, side: str) -> Robot:
    gone = _links_of(robot, side)
    solids = {link: own for link, own in robot.solids.items() if link not in gone}
    return replace(robot, solids=solids)


def _links_of(robot: Robot, side: str) -> set[str]:
    """The links of an arm and its hand."""
    return robot.below({arm_joints(side)[0]})


def _steps(plan: Any, side: str) -> Iterator[tuple[float, float, Any]]:
    """When each step of an arm begins and ends on the clock, and the step."""
    for begin_s, step in zip(plan.begins_s[side], plan.plans[side].steps, strict=True):
        is_move = hasattr(step, "trajectory")
        took_s = float(step.trajectory.knots_s[-1]) if is_move else float(plan.grip_s)
        yield float(begin_s), float(begin_s) + took_s, step


def _clock_faults(plan: Any) -> Iterator[Finding]:
    """Steps that begin before the previous one of their arm has ended."""
    for side in LIMBS:
        before_s = 0.0
        for begin_s, end_s, step in _steps(plan, side):
            if begin_s < before_s - SAME_TIME_S:
                label = f"{side} arm, {step.label}"
                yield Finding("begins too early", label, f"{side} arm", amount=before_s - begin_s)
            before_s = end_s


# On the clock


@dataclass(frozen=True)
class _Motion:
    """One arm at all samples of the clock.

    Attributes:
        joints: of arm and fingers, shape (n,) each, by name.
        things: the bodies that it handles, with their poses, shape (n, 4, 4).
    """

    joints: Mapping[str, Array]
    things: tuple[tuple[Thing, Array], ...]


def _between(
    plan: Any, robot: Robot, handled: Mapping[str, set[str]], apart_m: float
) -> Iterator[Finding]:
    """One arm with its bodies against the other one with its own."""
    end_s = duration_s(plan)
    times_s = np.append(np.arange(0.0, end_s, STEP_S), end_s)
    joints: dict[str, Any] = {name: float(value) for name, value in plan.start.joints.items()}
    motions = {}
    for side in LIMBS:
        stage = Stage.of(plan.plans[side], plan.start, robot)
        motions[side] = _motion(stage, list(_steps(plan, side)), handled[side], times_s)
        joints |= motions[side].joints
    T = robot.poses(joints)
    tracks = {
        side: [
            *(
                Track(solid, T[link])
                for link in sorted(_links_of(robot, side))
                for solid in robot.solids[link]
            ),
            *(track for thing, poses in motions[side].things for track in thing.tracks(poses)),
        ]
        for side in LIMBS
    }
    spans = [Span(0, len(times_s), margin_rule(apart_m))]
    for left, right in product(tracks["left"], tracks["right"]):
        yield from broken([left], [right], spans, _when(plan, times_s))


def _when(plan: Any, times_s: Array) -> When:
    """What both arms do at a sample, and its time on the clock."""
    steps = {side: list(_steps(plan, side)) for side in LIMBS}

    def when(sample: int) -> tuple[str, float]:
        time_s = float(times_s[sample])
        begun = (
            f"{side} arm: {[step.label for begin_s, _, step in own if begin_s <= time_s][-1:]}"
            for side, own in steps.items()
        )
        return ", ".join(begun), time_s

    return when


def _motion(
    stage: Stage, steps: list[tuple[float, float, Any]], names: set[str], times_s: Array
) -> _Motion:
    """One arm on the clock, step after step; after each it rests."""
    q = np.tile([stage.joints[name] for name in arm_joints(stage.limb)], (len(times_s), 1))
    opening_m = np.full(len(times_s), stage.opening_m)
    held = {} if stage.in_hand is None else {stage.in_hand.name: stage.in_hand}
    things = {name: thing for name, thing in {**stage.things, **held}.items() if name in names}
    T = {name: np.tile(thing.T, (len(times_s), 1, 1)) for name, thing in things.items()}
    for begin_s, _, step in steps:
        first = int(np.searchsorted(times_s, begin_s))
        passed_s = times_s[first:] - begin_s
        if hasattr(step, "trajectory"):
            q[first:] = positions(step.trajectory, passed_s)
            if stage.held is not None and stage.T_tip_held is not None:
                T[stage.held.name][first:] = stage.tips(q[first:]) @ stage.T_tip_held
            stage = stage.moved(np.array(step.trajectory.q)[-1])
        elif closes(step):
            thing = None if step.body is None else stage.things[step.body]
            found = closing(stage, thing)
            at = _traveller(found.openings_m)
            opening_m[first:] = at(passed_s, found.openings_m)
            if thing is not None:
                for axis in range(3):
                    T[thing.name][first:, axis, 3] = at(passed_s, found.T_things[:, axis, 3])
            stage = stage.closed(thing, found)
        else:
            released, stage = stage.held, stage.released()
            openings = openings_m(stage.opening_m, stage.goal_of(step))
            opening_m[first:] = _traveller(openings)(passed_s, openings)
            stage = stage.opened(float(openings[-1]))
            if released is not None:
                thing = stage.things[released.name]
                drop_m = stage.drop_m(thing, MAX_FALL_M)
                T[released.name][first:] = thing.T
                T[released.name][first:, 2, 3] -= np.minimum(
                    0.5 * GRAVITY_M_S2 * passed_s**2, drop_m
                )
                stage = stage.with_thing(thing.raised(-drop_m))
    joints = {**stage.arm(q), **stage.fingers(opening_m)}
    return _Motion(joints, tuple((things[name], poses) for name, poses in T.items()))


def _traveller(openings: Array) -> Callable[[Array, Array], Array]:
    """Values at times since fingers began to travel through some positions."""
    passed_s = np.append(0.0, np.abs(np.diff(openings)).cumsum()) / FINGER_SPEED_M_S
    return lambda times_s, values: np.interp(times_s, passed_s, values)
