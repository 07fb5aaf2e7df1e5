"""Checks of what the arm and the hand come near, and of what a plan states of it.

The hand closes on what fits, holds it with both fingers and puts it on something; all else stays
clear; and nothing that a plan states of its own clearance is believed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

from baxter_kin.validation import FloatArray
from planner.plan import Move
from planner.verification.certificate import Check, Worst, greatest, least
from planner.verification.clearance import FoundDistance, StepFound, least_of
from planner.verification.fingers import Fingers, drop_m
from planner.verification.motion.motion_checks import NO_MOVES
from planner.verification.story import GraspEvent, ReleaseEvent, Story
from planner.verification.tolerances import Tolerances
from planner.verification.urdf_robot import UrdfRobot

ROOM_FACTOR = 2.0
"""How far below a body that is let go a support is looked for, in allowed drops."""

STATED_M = 2e-5
"""How much of a stated distance is the accuracy of who measured it."""

NO_TRAVEL, NO_PROOFS = "no gripper action", "nothing is stated"


def start_checks(
    robot: UrdfRobot, q_standing: FloatArray, story: Story, allowed: Tolerances
) -> Iterator[Check]:
    """The fingers of both hands start within their stroke; those of the hand that moves, as one.

    What is held stands where the hand is.
    """
    fingers = robot.finger_positions(q_standing)
    outside = greatest(
        (Worst(out_m, f"{name} at {1e3 * at_m:.3f} mm") for name, at_m, out_m in fingers),
        "no fingers",
        -math.inf,
    )
    yield outside.at_most(allowed.finger_start_m, "finger start outside the stroke", "m")
    skew = Worst(robot.finger_skew_m(q_standing), f"{robot.limb} hand")
    yield skew.at_most(allowed.finger_start_m, "fingers unequally open", "m")
    held = (Worst(apart_m, name) for name, apart_m in story.apart_m.items())
    apart = greatest(held, "nothing is held at first")
    yield apart.at_most(allowed.press_m, "held bodies off their hands", "m")


def finger_checks(story: Story, fingers: Fingers, allowed: Tolerances) -> Iterator[Check]:
    """Everything about grasps and releases."""
    faults = Worst(len(story.faults), story.faults[0] if story.faults else "in order")
    yield faults.at_most(0.0, "gripper actions out of order")
    overlap = greatest((_overlap(grasp, fingers) for grasp in story.grasps), "no grasp")
    yield overlap.negated.at_least(-allowed.press_m, "room in the open hand", "m")
    gap = greatest((_gap(grasp, fingers) for grasp in story.grasps), "no grasp")
    yield gap.at_most(allowed.finger_m, "gap of closed pads", "m")
    drop = greatest((_drop(release, allowed) for release in story.releases), "no release")
    yield drop.at_most(allowed.drop_m, "drop at release", "m")


def clearance_checks(
    found: list[FoundDistance], rest: tuple[Worst, Worst], allowed: Tolerances
) -> Iterator[Check]:
    """Moves, travels of the fingers, what the arm does not move, and contacts on purpose."""
    bound, steps = allowed.clearance_m, [step for stage in found for step in stage.steps]
    standing, standing_inside = rest
    yield standing.above(bound, "clearance of the rest", "m")
    moves = [step for step in steps if isinstance(step.step, Move)]
    travels = [step for step in steps if not isinstance(step.step, Move)]
    for kind, some, none in (("", moves, NO_MOVES), (" of fingers", travels, NO_TRAVEL)):
        nearest, proven = least_of(some, none)
        yield nearest.above(bound, f"clearance{kind}", "m")
        yield proven.above(bound, f"clearance{kind} between samples", "m")
    inside = greatest([standing_inside, *(f.enclosed for f in found)], NO_MOVES)
    yield inside.at_most(0.0, "bodies inside a link")
    press = greatest((f.press for f in found), NO_MOVES)
    yield press.at_most(allowed.press_m, "press of contacts", "m")
    slide = greatest((f.slide for f in found), NO_MOVES)
    yield slide.at_most(allowed.slide_m, "slide in contact", "m")
    astray = greatest((f.astray for f in found), NO_MOVES)
    yield astray.at_most(0.0, "contacts out of turn")


def proof_checks(found: Iterable[StepFound]) -> Iterator[Check]:
    """What each step states, against the least distance measured of the pairs that it counts.

    The distance that it says it measured is compared at the moment that it says; it may be more
    than the least, which need not lie at a moment that was looked at.
    """
    steps = list(found)
    beyond = greatest(_beyond(steps), NO_PROOFS, -math.inf)
    yield beyond.at_most(STATED_M, "stated proofs beyond what is measured", "m")
    order = greatest(_out_of_order(steps), NO_PROOFS, -math.inf)
    yield order.at_most(STATED_M, "stated proofs that contradict themselves", "m")
    kept = least(_kept(steps), NO_PROOFS)
    yield kept.at_least(-STATED_M, "clearance beyond the stated margin", "m")


def _beyond(steps: list[StepFound]) -> Iterator[Worst]:
    for step in steps:
        proof = step.step.proof
        if proof is not None:
            yield _excess(step, proof.proven_m)
        if step.stated is not None:
            yield step.stated


def _excess(step: StepFound, stated_m: float) -> Worst:
    text = f"{1e3 * stated_m:.3f} mm proven, {1e3 * step.counted.value:.3f} mm measured"
    return Worst(stated_m - step.counted.value, f"{step.step.label}: {text}: {step.counted.where}")


def _out_of_order(steps: list[StepFound]) -> Iterator[Worst]:
    """A margin is at most what is proven, and that at most the nearest that was met."""
    for step in steps:
        proof = step.step.proof
        if proof is None:
            continue
        near = proof.nearest.distance_m
        yield Worst(proof.margin_m - proof.proven_m, f"{step.step.label}: margin above proof")
        yield Worst(proof.proven_m - near, f"{step.step.label}: proof above nearest")


def _kept(steps: list[StepFound]) -> Iterator[Worst]:
    for step in steps:
        proof = step.step.proof
        if proof is not None:
            text = f"{1e3 * proof.margin_m:.3f} mm asked for, {step.counted.where}"
            yield Worst(step.counted.value - proof.margin_m, text)


def _overlap(grasp: GraspEvent, fingers: Fingers) -> Worst:
    """How deep an open finger is inside the body; negative outside."""
    T_tip_body = grasp.T_base_tip.inverse() * grasp.body.T_base_body
    gaps = fingers.gaps_m(grasp.body, T_tip_body, grasp.opening_m)
    where = f"{grasp.label}, {grasp.body.name}, each finger {1e3 * grasp.opening_m:.3f} mm open"
    return Worst(-min(gaps), where)


def _gap(grasp: GraspEvent, fingers: Fingers) -> Worst:
    """How far a pad of the closed hand is from the body, or inside it.

    Where another shape of a finger meets the body first, the pads do not hold it.
    """
    closing = grasp.closing
    gaps = fingers.gaps_m(grasp.body, closing.T_tip_body, closing.finger_m, of_pads=True)
    where = f"{grasp.label}, {grasp.body.name}, each finger {1e3 * closing.finger_m:.3f} mm open"
    return Worst(max(abs(gap) for gap in gaps), where)


def _drop(release: ReleaseEvent, allowed: Tolerances) -> Worst:
    room = ROOM_FACTOR * allowed.drop_m
    drops = [(drop_m(release.body, below, room), below.name) for below in release.scene]
    drop, support = min(drops, default=(math.inf, "nothing"))
    onto = support if math.isfinite(drop) else "nothing"
    return Worst(drop, f"{release.label}, {release.body.name} onto {onto}")
