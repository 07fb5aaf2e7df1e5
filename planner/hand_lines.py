"""What stands in the way of the hand alone, on the straight lines of a pick and place.

Hand and what it holds go the same way along a line whichever solution the arm takes. So what they
run into there among the bodies of the scene speaks against every solution, and is found out once.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from baxter_kin.frames import raised
from planner.clearance import Clearance, SweptContact
from planner.context import CollisionContext
from planner.continuous import ACCURACY_M
from planner.plan import PlanFailure
from planner.plan_builder import NoSolutionError
from planner.task import PickAndPlace

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
    heights_m, hand = np.linspace(0.0, rise_m, 1 + int(np.ceil(rise_m / STEP_M))), _Hand(context)
    looks = [(hand.contact(raised(T_base_tip, height)), height) for height in heights_m.tolist()]
    found = [(contact, height) for contact, height in looks if contact is not None]
    if not found:
        return
    (near, needed_m), height_m = min(found, key=lambda each: each[0][0].distance_m)
    where = "at the pose" if height_m == 0.0 else f"{1e3 * height_m:.0f} mm above the pose"
    reason = f"for every IK solution, {near.text} {where}"
    if near.distance_m > 0.0:
        reason += f", and {1e3 * context.margin_m:.1f} mm are asked for"
    contact = SweptContact(near, needed_m, duration_s=0.0, intervals=0, evaluations=len(looks))
    raise NoSolutionError(PlanFailure(label, reason, is_certain=True, contact=contact))


class _Hand:
    """The hand, and what it holds, among the bodies of the scene, without the arm."""

    def __init__(self, context: CollisionContext) -> None:
        self._margin_m, checker = context.margin_m, context.checker
        self._checked, arm, robot = checker.checked, checker.arm, checker.robot
        joints = np.array([shape.parentJoint for shape in checker.geometry.geometryObjects])
        wrist = robot.getJointId(arm.joint_names[-1])
        self._moves = np.isin(joints, robot.subtrees[wrist].tolist())
        stands = (joints == 0) & (np.arange(len(joints)) >= len(checker.shapes.links))
        first, second = self._checked.numbers.T
        self._pairs = np.flatnonzero(
            (self._moves[first] & stands[second]) | (stands[first] & self._moves[second])
        )
        self._poses = checker.motion_bounds.place(context.q_others, arm.neutral[None]).shapes[0]
        T_tip_base = arm.T_base_tip(arm.neutral).inverse().homogeneous
        self._T_tip_shapes = T_tip_base @ self._poses[self._moves]

    def contact(self, T_base_tip: pin.SE3) -> tuple[Clearance, float] | None:
        """What it is too close to with the tip at a pose: the nearest, and how near it may be, m.

        None when there is none.
        """
        checked, pairs = self._checked, self._pairs
        self._poses[self._moves] = T_base_tip.homogeneous @ self._T_tip_shapes
        checked.distances.place(self._poses)
        needs = checked.needed_m(self._margin_m)[pairs]
        is_near = checked.gaps_m(self._poses[None], np.zeros_like(pairs), pairs) <= needs
        found = []
        for pair, need_m in zip(pairs[is_near].tolist(), needs[is_near].tolist(), strict=True):
            distance_m = checked.distances.measure(pair, max(need_m, 0.0) + ACCURACY_M)
            if distance_m <= need_m:
                found.append((checked.between(pair, distance_m), need_m))
        return min(found, key=lambda near: near[0].distance_m, default=None)
