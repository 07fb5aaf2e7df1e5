"""What a plan states of its steps: refused where it differs from what is derived."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from planner.certificate.clusters import stated_pose
from planner.certificate.errors import require
from planner.certificate.intervals import Pose, norm_bound
from planner.certificate.timeline.bodies import PRESS_M, STATE_TOLERANCE, Bodies, Situation

MAX_EXCESS_S = 1e-6
"""How much longer than its step a contact may be stated to be."""

MAX_TURN = 0.03
"""Maximum turn of a body that a hand has moved from where the plan states it."""


def require_contacts(
    bodies: Bodies,
    step: Mapping[str, Any],
    now: Situation,
    end_s: float,
    touched: Collection[str],
    *,
    of_hand: Collection[str] = (),
) -> None:
    """Refuse a stated contact that is not intended, presses too deep or lasts too long.

    Whoever executes a plan permits the stated contacts.

    Args:
        bodies: all trees.
        step: the step as a plan file states it.
        now: the situation before it.
        end_s: its duration.
        touched: bodies that the carried body may touch.
        of_hand: bodies that the hand may touch.
    """
    hand, pads = f"{bodies.robot.limb} hand", f"{bodies.robot.limb} pads"
    carried = of_hand if now.held is None else (now.held[0],)
    for contact in step["contacts"]:
        body, other = contact["body"], contact["other"]
        numbered = [(body, contact["part"]), (other, contact["other_part"])]
        is_meant = body in of_hand and other in (hand, pads)
        is_meant |= body in carried and other in touched
        is_meant &= all(
            i is None or 0 <= i < len(bodies.scene[name].parts)
            for name, i in numbered
            if name in bodies.scene
        )
        what = f"{step['label']}: a contact of {body} and {other}"
        require(is_meant, f"{what} is not meant")
        least_m = 0.0 if other == hand else -PRESS_M
        require(contact["least_m"] >= least_m, f"{what} is stated to press too deep")
        is_while = 0.0 <= contact["begin_s"] <= contact["end_s"] <= end_s + MAX_EXCESS_S
        require(is_while, f"{what} is stated to be longer than the step")


class StatedStates:
    """The states that a plan states, step by step."""

    def __init__(
        self, start: Mapping[str, Any], changes: Sequence[Mapping[str, Any]], bodies: Bodies
    ) -> None:
        """Begin at the start.

        Args:
            start: the first state as a plan file states it.
            changes: for each step, what of its state differs from the one before; empty where no
                states are stated.
            bodies: all trees.
        """
        self._changes, self._bodies = changes, bodies
        self._joints = {name: float(value) for name, value in start["joints"].items()}
        self._poses = {name: data["T_base_body"] for name, data in start["scene"]["bodies"].items()}
        robot = bodies.robot
        own = {*robot.names, *robot.finger_joints.values()}
        self._still = {name: at for name, at in self._joints.items() if name not in own}
        self._first: Mapping[str, Pose] = {}
        self._others = self._holds(start["attachments"])[1]

    def compare(self, number: int, now: Situation) -> None:
        """Refuse the stated state before a step where it differs from the derived situation."""
        if not self._changes:
            return
        require(number < len(self._changes), "not every step states its state")
        change = self._changes[number]
        self._joints |= {name: float(value) for name, value in change["joints"].items()}
        self._poses |= change["T_base_bodies"]
        robot = self._bodies.robot
        label = f"step {number + 1}"
        q = np.array([self._joints.get(name, np.nan) for name in robot.names])
        is_there = np.abs(q - now.arm[0]) <= STATE_TOLERANCE
        require(is_there, f"{label}: the arm is stated elsewhere")
        for finger, sign in robot.fingers.items():
            off_m = abs(sign * self._joints[robot.finger_joints[finger]] - now.opening_m)
            require(off_m <= PRESS_M, f"{label}: the fingers are stated {1e3 * off_m:.2f} mm off")
        for name, at in self._still.items():
            require(self._joints[name] == at, f"{label}: {name} is stated to move")
        own = len(robot.names) + len(robot.finger_joints)
        has_all = len(self._joints) == len(self._still) + own
        require(has_all, f"{label}: joints that are not there")
        self._compare_bodies(label, now)
        held, others = self._holds(change["attachments"])
        expected = [] if now.held is None else [now.held[0]]
        is_same = [name for name, _ in held] == expected and others == self._others
        require(is_same, f"{label}: the hand is stated to hold something else")
        for name, stated in held:
            if now.held is not None:
                T = robot.tip * stated_pose(stated, name)
                self._require_there(label, name, now.held[1], T, is_moved=True)

    def _compare_bodies(self, label: str, now: Situation) -> None:
        derived = {**now.at, **now.others}
        self._first = self._first or dict(derived)
        if now.held is not None:
            T_base_joint = self._bodies.joint_pose(now.arm[0])
            derived[now.held[0]] = T_base_joint * now.held[1]
        require(self._poses.keys() == derived.keys(), f"{label}: other bodies are stated")
        for name, T in derived.items():
            is_moved = T is not self._first.get(name)
            stated = stated_pose(self._poses[name], name)
            self._require_there(label, name, T, stated, is_moved=is_moved)

    def _holds(
        self, attachments: Sequence[Mapping[str, Any]]
    ) -> tuple[list[tuple[str, Any]], list[tuple[str, str, Any]]]:
        """The bodies in the hand that moves, and those in others."""
        own = f"{self._bodies.robot.limb}_gripper"
        found = [(each["body"], each["link"], each["T_link_body"]) for each in attachments]
        held = [(body, T) for body, link, T in found if link == own]
        return held, [each for each in found if each[1] != own]

    def _require_there(
        self, label: str, name: str, derived: Pose, stated: Pose, *, is_moved: bool
    ) -> None:
        """A body that a hand has moved may be stated a little off, as its fingers are."""
        off_m = float(norm_bound((derived.p - stated.p).magnitude))
        turned = float(norm_bound((derived.R - stated.R).magnitude.reshape(9)))
        tolerances = (2.0 * PRESS_M, MAX_TURN) if is_moved else (STATE_TOLERANCE, STATE_TOLERANCE)
        is_there = off_m <= tolerances[0] and turned <= tolerances[1]
        require(is_there, f"{label}: {name} is stated {1e3 * off_m:.2f} mm off")
