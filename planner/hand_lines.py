"""What stands in the way of the hand alone, on the straight lines of a pick and place.

Hand and what it holds go the same way along a line whichever solution the arm takes. So what they
run into there among the bodies of the scene speaks against every solution, and is found out once.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from planner.lines import Lines, raised
from planner.plan import PlanFailure
from planner.plan_builder import NoSolutionError
from planner.surroundings import Surroundings
from planner.swept_result import SweptContact

STEP_M = 0.005
"""Between two looks at the hand; the proofs of the moves find what is thinner."""


def refuse_blocked_hand(lines: Lines, around: Mapping[str, Surroundings]) -> None:
    """Stop when the hand cannot go along a line.

    Raises:
        NoSolutionError: then; names the stage, and how far from the pose the hand is there.
    """
    pick, place = lines.T_base_pick, lines.T_base_place
    for label, T_base_tip, rise_m in (
        ("pick: descend", pick, lines.clear_m),
        ("pick: retract", pick, lines.clear_m),
        ("place: descend", place, lines.clear_m),
        ("place: retract", place, lines.hover_m),
    ):
        _refuse_blocked_line(label, around[label], T_base_tip, rise_m)


def _refuse_blocked_line(
    label: str, around: Surroundings, T_base_tip: pin.SE3, rise_m: float
) -> None:
    heights_m = np.linspace(0.0, rise_m, 1 + int(np.ceil(rise_m / STEP_M))).tolist()
    looks = [(around.hand_contact(raised(T_base_tip, height)), height) for height in heights_m]
    found = [(contact, height) for contact, height in looks if contact is not None]
    if not found:
        return
    (near, needed_m), height_m = min(found, key=lambda each: each[0][0].distance_m)
    where = "at the pose" if height_m == 0.0 else f"{1e3 * height_m:.0f} mm above the pose"
    reason = f"for every IK solution, {near.text} {where}"
    if near.distance_m > 0.0:
        reason += f", and {1e3 * around.margin_m:.1f} mm are asked for"
    contact = SweptContact(near, needed_m, duration_s=0.0, intervals=0, evaluations=len(looks))
    raise NoSolutionError(PlanFailure(label, reason, is_certain=True, contact=contact))
