"""A plan of both arms: each arm by itself, then one against the other on the common clock.

Each arm's own steps are judged by `referee.checker`, in a world without the other arm and without
the bodies that only the other arm handles. What is left are the links, fingers and bodies of one
arm against those of the other: every millisecond of the clock, on the original meshes.

A body that both arms handle, because it is handed over or carried by both hands, is in the worlds
of both. On the clock is judged

- that each hand closes on it where the arm's own plan has it,
- that both hands agree where it is while both hold it: how far the second hand is from where it
  took the body, seen from the first hand,
- that it is held at every instant, or stands. A hand holds from the end of its closing to the
  beginning of its opening, so that slow fingers do no harm,
- that it keeps clear of the links of both arms. A hand may press on it from the beginning of its
  closing to the end of its opening, and be near it in the steps that are stated to touch it, of
  which `referee.checker` asks a reason; but not while the other arm alone has it.

Not covered: more than one body that both arms handle, and fingers that begin late or travel slower
against the other arm.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import pairwise, product
from typing import Any

import numpy as np

from referee.checker import MAX_DROP_M, MAX_FALL_M, check_plan
from referee.clock import LIMBS, SAME_TIME_S, Clock, Hold, is_move, links_of, timed
from referee.pairs import (
    BRUSHING,
    CONTACT_M,
    FORBIDDEN,
    PRESSING,
    Finding,
    Rule,
    Span,
    Track,
    broken,
    margin_rule,
)
from referee.robot import Robot, load_robot
from referee.solids import Array
from referee.stage import DOWN_M, Stage

HANDED_M, HANDED_RAD = 1e-5, 1e-5
"""How far two hands may differ in where a body is that one hands over to the other, and how far a
hand may be from where it is said to take a body."""

TOGETHER_M, TOGETHER_RAD = 1e-4, float(np.radians(0.02))
"""How far they may differ where both carry it."""


def check_two_arm_plan(plan: Any, *, margin_m: float = 0.0, apart_m: float = 0.0) -> list[Finding]:
    """Everything that contradicts a plan of both arms; nothing when it is right.

    Args:
        plan: `start`, `plans` and `begins_s` by the arm, and `grip_s`.
        margin_m: the distance that each arm was asked to keep by itself.
        apart_m: the distance that both arms are said to keep from each other.

    Raises:
        ValueError: when both arms handle several bodies, or one that a hand does not close on and
            release just once, which is not judged.
    """
    robot, handled = load_robot(), {side: _handled(plan, side) for side in LIMBS}
    both = handled["left"] & handled["right"]
    if len(both) > 1:
        raise ValueError(f"both arms handle {', '.join(sorted(both))}; only one body is judged")
    shared = next(iter(both), None)
    clock = Clock.of(plan, robot, handled, shared)
    findings = list(_clock_faults(plan))
    for side, other in (LIMBS, LIMBS[::-1]):
        alone, own = _without_arm(robot, other), plan.plans[side]
        found = check_plan(own, margin_m=margin_m, robot=alone, without=handled[other] - both)
        findings += [replace(each, label=f"{side} arm, {each.label}") for each in found]
    if any(finding.kind == "jumps" for finding in findings):
        return findings
    findings += _between(clock, apart_m)
    if shared is not None:
        rules = {"rest": margin_rule(margin_m), "apart": margin_rule(apart_m)}
        findings += _shared(clock, shared, rules)
    return findings


def _handled(plan: Any, side: str) -> set[str]:
    """Names of the bodies that an arm holds at first, or grips."""
    grips = (step for step in plan.plans[side].steps if not is_move(step))
    held = (each.body for each in plan.start.attachments if each.side == side)
    return {*held, *(grip.body for grip in grips)} - {None}


def _without_arm(robot: Robot, side: str) -> Robot:
    gone = links_of(robot, side)
    solids = {link: own for link, own in robot.solids.items() if link not in gone}
    return replace(robot, solids=solids)


def _clock_faults(plan: Any) -> Iterator[Finding]:
    """Steps that begin before the previous one of their arm has ended."""
    for side in LIMBS:
        before_s = 0.0
        for begin_s, end_s, step in timed(plan, side):
            if begin_s < before_s - SAME_TIME_S:
                label = f"{side} arm, {step.label}"
                yield Finding("begins too early", label, f"{side} arm", amount=before_s - begin_s)
            before_s = end_s


def _between(clock: Clock, apart_m: float) -> Iterator[Finding]:
    """One arm with its bodies against the other one with its own."""
    tracks = {
        side: [
            *(track for own in clock.links[side].values() for track in own),
            *(track for own in _own_bodies(clock, side) for track in own),
        ]
        for side in LIMBS
    }
    spans = [Span(0, len(clock.times_s), margin_rule(apart_m))]
    for left, right in product(tracks["left"], tracks["right"]):
        yield from broken([left], [right], spans, clock.when)


def _own_bodies(clock: Clock, side: str) -> Iterator[list[Track]]:
    """The bodies that only one arm handles."""
    for name, T in clock.motions[side].poses.items():
        if name != clock.shared:
            yield clock.things[name].tracks(T)


# A body that both arms handle


def _shared(clock: Clock, name: str, rules: Mapping[str, Rule]) -> Iterator[Finding]:
    """All that is wrong with a body that both arms handle.

    Args:
        clock: both arms.
        name: of the body.
        rules: "apart", for an arm while only the other arm has the body, and "rest".
    """
    first, second = clock.holds
    T_first, T_second = (clock.motions[hold.side].poses[name] for hold in clock.holds)
    is_second = (clock.times_s >= first.opens_s) & (second.open_s > first.open_s + SAME_TIME_S)
    T = np.where(is_second[:, None, None], T_second, T_first)
    for hold in clock.holds:
        yield from _taken_elsewhere(clock, name, hold)
    yield from _held_at_two_poses(clock, name, T_first, T_second)
    yield from _not_held(clock, name, T)
    for hold in clock.holds:
        yield from _met(clock, clock.things[name].tracks(T), hold, rules)


def _taken_elsewhere(clock: Clock, name: str, hold: Hold) -> Iterator[Finding]:
    """A hand that misses the body, or takes it elsewhere than its arm's own plan has it."""
    motion, at = clock.motions[hold.side], clock.sample(hold.closes_s)
    label, time_s = clock.when(at)
    if name in motion.missed:
        yield Finding("missed by the fingers", label, name, f"{hold.side} hand", time_s=time_s)
    T = np.array(clock.plan.plans[hold.side].start.scene[name].T_base_body.homogeneous)
    off_m, off_rad = _differences(motion.poses[name][at], T)
    if off_m > HANDED_M or off_rad > HANDED_RAD:
        text, names = f"turned by {off_rad:.2g} rad", (name, f"{hold.side} hand")
        yield Finding("is taken elsewhere than planned", label, *names, off_m, time_s, text)


def _held_at_two_poses(
    clock: Clock, name: str, T_first: Array, T_second: Array
) -> Iterator[Finding]:
    """Hands that do not agree where the body is, as long as both may hold it."""
    first, second = clock.holds
    rows = np.flatnonzero(clock.during(second.closes_s, min(first.open_s, second.open_s)))
    if not len(rows):
        return
    T_first, T_second, T_tip = T_first[rows], T_second[rows], clock.T_tips[second.side][rows]
    off_m, off_rad = _differences(T_first @ np.linalg.inv(T_second) @ T_tip, T_tip)
    is_handed = first.receiver == second.side
    max_m, max_rad = (HANDED_M, HANDED_RAD) if is_handed else (TOGETHER_M, TOGETHER_RAD)
    if (off_m > max_m).any() or (off_rad > max_rad).any():
        worst = int(np.maximum(off_m / max_m, off_rad / max_rad).argmax())
        label, time_s = clock.when(int(rows[worst]))
        text = f"turned by {np.degrees(off_rad[worst]):.2g} deg"
        off = float(off_m[worst])
        yield Finding("is held at two poses", label, name, "both hands", off, time_s, text)


def _differences(T: Array, T_other: Array) -> tuple[Any, Any]:
    """Distances and turns between poses, shape (..., 4, 4); m, rad."""
    off = T - T_other
    turns = np.linalg.norm(off[..., :3, :3], axis=(-2, -1)) / np.sqrt(2.0)
    return np.linalg.norm(off[..., :3, 3], axis=-1), turns


def _not_held(clock: Clock, name: str, T: Array) -> Iterator[Finding]:
    """Times at which no hand surely holds the body, and it does not stand on anything."""
    stage = Stage.of(clock.plan.plans["left"], clock.plan.start, load_robot())
    free_s, max_drop_m = 0.0, DOWN_M
    for hold in (*sorted(clock.holds, key=lambda hold: hold.closed_s), None):
        until_s = np.inf if hold is None else hold.closed_s
        if until_s > free_s + SAME_TIME_S:
            at = clock.sample(free_s)
            drop_m = stage.drop_m(clock.things[name].at(T[at]), MAX_FALL_M)
            if drop_m > max_drop_m + CONTACT_M:
                label, time_s = clock.when(at)
                text = f"until {min(until_s, clock.times_s[-1]):.3f} s"
                yield Finding("is held by nothing", label, name, "", drop_m, time_s, text)
        if hold is not None:
            free_s, max_drop_m = max(free_s, hold.opens_s), MAX_DROP_M


def _met(
    clock: Clock, tracks: list[Track], hold: Hold, rules: Mapping[str, Rule]
) -> Iterator[Finding]:
    """An arm and its other bodies, against the body that both arms handle."""
    stage, rest = clock.motions[hold.side].stage, rules["rest"]
    what = np.full(len(clock.times_s), "rest", dtype="U5")
    for begin_s, end_s in hold.near:
        what[clock.during(begin_s, end_s)] = "near"
    what[_is_others(clock, hold)] = "apart"
    what[clock.during(hold.closes_s, hold.open_s)] = "held"
    of_arm = {**rules, "near": rest, "held": rest}
    of_hand = {**rules, "near": FORBIDDEN, "held": FORBIDDEN}
    of_fingers = {**rules, "near": BRUSHING, "held": PRESSING}
    for link, solids in clock.links[hold.side].items():
        own = of_hand if link in stage.hand_links else of_arm
        spans = _spans(what, of_fingers if link in stage.finger_links else own)
        yield from broken(tracks, solids, spans, clock.when)
    for solids in _own_bodies(clock, hold.side):
        yield from broken(tracks, solids, _spans(what, {"apart": rules["apart"]}), clock.when)


def _is_others(clock: Clock, hold: Hold) -> Any:
    """Whether only the other arm has the body: until it rests to hand it over, or since it left."""
    first, second = clock.holds
    if first.receiver != second.side:
        return np.zeros(len(clock.times_s), dtype=bool)
    if hold is first:
        return clock.times_s >= second.moves_s
    return clock.times_s <= first.rests_s


def _spans(what: Array, rules: Mapping[str, Rule]) -> list[Span]:
    """Rules one after the other."""
    cuts = [0, *(1 + np.flatnonzero(what[1:] != what[:-1])).tolist(), len(what)]
    ends = ((first, last, str(what[first])) for first, last in pairwise(cuts))
    return [Span(first, last, rules[word]) for first, last, word in ends if word in rules]
