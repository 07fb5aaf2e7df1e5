"""Checks of the hand: what it closes on fits, is held by both fingers, and is put on something."""

from __future__ import annotations

import math
from collections.abc import Iterator

from baxter_kin.arrays import Vector
from planner.verification.certificate import Check, Worst, greatest
from planner.verification.fingers import Fingers, drop_m
from planner.verification.story import GraspEvent, ReleaseEvent, Story
from planner.verification.tolerances import Tolerances
from planner.verification.urdf_robot import UrdfRobot

ROOM_FACTOR = 2.0
"""How far below a body that is let go a support is looked for, in allowed drops."""


def start_checks(
    robot: UrdfRobot, q_standing: Vector, story: Story, allowed: Tolerances
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
