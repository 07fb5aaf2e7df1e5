"""What stands in the way of the hand alone, on the straight lines of a pick and place.

Hand and what it holds go the same way along a line whichever solution the arm takes. So what they
run into there among the bodies of the scene speaks against every solution, and is found out once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pinocchio as pin

from baxter_kin.frames import raised
from planner.clearance import Clearance, ContinuousContact
from planner.collision.context import CollisionContext
from planner.collision.distances import ACCURACY_M
from planner.pick_place.plan_builder import NoSolutionError
from planner.pick_place.task import PickAndPlace
from planner.plan import PlanFailure

STEP_M = 0.005
"""Between two looks at the hand; the proofs of the moves find what is thinner."""


def refuse_blocked_hand(task: PickAndPlace, contexts: Mapping[str, CollisionContext]) -> None:
    """Stop when the hand cannot go along a line.

    Raises:
        NoSolutionError: then; names the stage, and how far from the pose the hand is there.
    """
    pick, place = task.T_base_pick, task.T_base_place
    for label, T_base_tip, rise_m in (
        ("pick: descend", pick, task.lift_m),
        ("pick: retract", pick, task.lift_m),
        ("place: descend", place, task.lift_m),
        ("place: retract", place, task.hover_m),
    ):
        _refuse_blocked_line(label, contexts[label], T_base_tip, rise_m)


def _refuse_blocked_line(
    label: str, context: CollisionContext, T_base_tip: pin.SE3, rise_m: float
) -> None:
    heights_m = np.linspace(0.0, rise_m, 1 + int(np.ceil(rise_m / STEP_M)))
    found = _contacts(context, [raised(T_base_tip, height) for height in heights_m.tolist()])
    if not found:
        return
    near, needed_m, look = min(found, key=lambda each: each[0].distance_m)
    height_m = float(heights_m[look])
    where = "at the pose" if height_m == 0.0 else f"{1e3 * height_m:.0f} mm above the pose"
    reason = f"for every IK solution, {near.text} {where}"
    if near.distance_m > 0.0:
        reason += f", and {1e3 * context.margin_m:.1f} mm are asked for"
    contact = ContinuousContact(
        near, needed_m, duration_s=0.0, intervals=0, evaluations=len(heights_m)
    )
    raise NoSolutionError(PlanFailure(label, reason, is_certain=True, contact=contact))


def _contacts(
    context: CollisionContext, T_base_tips: Sequence[pin.SE3]
) -> list[tuple[Clearance, float, int]]:
    """What hand, and what it holds, are too close to in the scene with the tip at some poses.

    Without the arm; each with how near it may be, m, and the number of the pose.
    """
    checked, arm = context.checker.checked, context.checker.arm
    bounds, of_robot = context.checker.motion_bounds, len(context.checker.shapes.links)
    moves = bounds.moves[:, -1]
    stands = ~bounds.moves.any(axis=1) & (np.arange(len(bounds.moves)) >= of_robot)
    first, second = checked.numbers.T
    pairs = np.flatnonzero((moves[first] & stands[second]) | (stands[first] & moves[second]))
    standing = bounds.place(context.q_others, arm.neutral[None]).shapes
    T_tip_shapes = arm.T_base_tip(arm.neutral).inverse().homogeneous @ standing[0, moves]
    poses = np.tile(standing, (len(T_base_tips), 1, 1, 1))
    poses[:, moves] = np.array([T.homogeneous for T in T_base_tips])[:, None] @ T_tip_shapes
    looks, pair = (each.ravel() for each in np.indices((len(poses), len(pairs))))
    needs = checked.needed_m(context.margin_m)[pairs[pair]]
    found = []
    for near in np.flatnonzero(checked.gaps_m(poses, looks, pairs[pair]) <= needs).tolist():
        number, need_m = int(pairs[pair[near]]), float(needs[near])
        checked.distances.place(poses[looks[near]])
        distance_m = checked.distances.measure(number, max(need_m, 0.0) + ACCURACY_M)
        if distance_m <= need_m:
            found.append((checked.between(number, distance_m), need_m, int(looks[near])))
    return found
