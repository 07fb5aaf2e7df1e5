"""The start of a plan and its steps: moves, fingers that close or open, and motions of others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from planner.certificate.body import Body
from planner.certificate.clusters import Clusters, stated_pose
from planner.certificate.errors import NotCertifiedError, require
from planner.certificate.intervals import Array, Pose, norm_bound
from planner.certificate.motion import LIMIT_RATIO, MAX_JUMP, Polynomials, stated_limits
from planner.certificate.robot import ARM_JOINTS, Robot
from planner.certificate.rows import Step
from planner.certificate.timeline import contact, pairs, path, tip
from planner.certificate.timeline.bodies import (
    MAX_BODIES,
    PRESS_M,
    STATE_TOLERANCE,
    Bodies,
    Situation,
)
from planner.certificate.timeline.statements import StatedStates, require_contacts

A_MAX_RAD_S2, J_MAX_RAD_S3 = 2.0, 20.0
"""Rethink published no limits of acceleration and jerk; these are the presets of the toolkit,
measured as what real arms follow (`baxter_kin.kinematics.limits`). The caller may pass others."""

MAX_STEPS = 1000

MIN_RELEASE_M = 2.0 * PRESS_M
"""Minimum travel of each finger that lets a body go: fingers may press into it by half of this."""

MOTION = "Motion"
"""The type of a step that something else planned or recorded."""


@dataclass(frozen=True)
class StepWitness:
    """What a certificate says of one step; nothing of it is trusted.

    Attributes:
        margin_m: the distance that is to be proven.
        closing: of a hand that closes on a body: how far it is open when the first finger touches,
            and at the end, and how far the body is pushed along y of the tip.
        contacts: from when to when a held body may touch another, by the name of the latter.
    """

    margin_m: float = 0.0
    closing: tuple[float, float, float] | None = None
    contacts: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Limits:
    """Maximum acceleration and jerk, of every joint or of each, rad/s^2 and rad/s^3."""

    a_max: float | Array = A_MAX_RAD_S2
    j_max: float | Array = J_MAX_RAD_S3


class Timeline:
    """The steps of a plan, with all pairs that must keep apart in each.

    Attributes:
        robot: the robot.
        bodies: its links and the bodies of the scene.
        plan_steps: the steps of the plan, as its file has them.
        steps: what rows must prove, in the order of the certificate.
        numbers: which step of the plan each belongs to, None for what stands still.
        situations: where everything is before each step, and at the end.
        motions: of the steps that move the arm, by their numbers.
        worst: upper bounds that rules other than rows give, by name, each with where it occurs.
        assumed: what is taken from the caller of a motion, in phrases.
        not_judged: limits that were not judged, in phrases.
    """

    def __init__(
        self,
        plan: Mapping[str, Any],
        states: Sequence[Mapping[str, Any]],
        robot: Robot,
        body: Body,
        witnesses: Sequence[StepWitness],
        *,
        limits: Limits | None = None,
        is_alone: bool = False,
    ) -> None:
        """Follow a plan to its end.

        Args:
            plan: as its file has it, and `states` likewise.
            states: what of each state differs from the one before; empty where none is stated.
            robot: the robot that it is for.
            body: its body.
            witnesses: one for each step.
            limits: maximum acceleration and jerk.
            is_alone: whether the other arm is left out, with its hand.

        Raises:
            NotCertifiedError: when the plan breaks a rule that is not about rows.
        """
        self.robot = robot
        self.steps: list[Step] = []
        self.numbers: list[int | None] = []
        self.worst: dict[str, tuple[float, str]] = {}
        self.assumed: list[str] = []
        self.not_judged: list[str] = []
        self._plan, self._witnesses, self._is_alone = plan, witnesses, is_alone
        self._limits = limits or Limits()
        require(plan["failure"] is None, "the plan says itself that it failed")
        self.plan_steps = plan["steps"]
        self._is_motion = any(step["type"] == MOTION for step in self.plan_steps)
        require(len(self.plan_steps) <= MAX_STEPS, f"the plan has more than {MAX_STEPS} steps")
        require(len(witnesses) == len(self.plan_steps), "the certificate is of other steps")
        start = plan["start"]
        joints = {str(name): float(value) for name, value in start["joints"].items()}
        require(np.isfinite(list(joints.values())), "a joint is not finite")
        scene = start["scene"]["bodies"]
        require(len(scene) <= MAX_BODIES, f"the scene has more than {MAX_BODIES} bodies")
        self.bodies = Bodies(robot, body, scene, joints, is_alone=is_alone)
        self.motions: dict[int, Polynomials] = {}
        now = self._begin(start, joints)
        self.situations = [now]
        stated = StatedStates(start, states, self.bodies)
        self.numbers += [None] * len(self.steps)
        for number, step in enumerate(self.plan_steps):
            stated.compare(number, now)
            now = self._followed(number, step, now)
            self.situations.append(now)
            self.numbers += [number] * (len(self.steps) - len(self.numbers))
        if not self._is_motion:
            _require_rest(now, "the arm does not rest at the end")

    @property
    def clusters(self) -> Clusters:
        """All trees."""
        return self.bodies.clusters

    # The start

    def _begin(self, start: Mapping[str, Any], joints: Mapping[str, float]) -> Situation:
        robot = self.robot
        missing = [name for name in robot.names if name not in joints]
        require(not missing, f"the state lacks {', '.join(missing)}")
        q = np.array([joints[name] for name in robot.names])
        openings = [
            sign * joints.get(robot.finger_joints[finger], np.nan)
            for finger, sign in robot.fingers.items()
        ]
        is_equal = np.abs(np.diff(openings)) <= STATE_TOLERANCE
        require(is_equal, "the fingers are not equally open")
        opening_m = float(openings[0])
        is_within = -STATE_TOLERANCE <= opening_m <= robot.stroke_m + STATE_TOLERANCE
        require(is_within, "the fingers start outside their stroke")
        at = {
            name: stated_pose(data["T_base_body"], name)
            for name, data in start["scene"]["bodies"].items()
        }
        held, others, hands = None, {}, {}
        for each in start["attachments"]:
            name, link = each["body"], each["link"]
            require(name in at, f"the scene lacks {name}, which {link} holds")
            T_link_body = stated_pose(each["T_link_body"], name)
            where = robot.attached(link, self.bodies.places)
            T = where.T * T_link_body
            if where.level:
                is_of_hand = where.level == ARM_JOINTS and where.finger is None
                require(is_of_hand, f"{name} hangs on {link}, which is no hand")
                require(held is None, "the hand holds two bodies")
                held = name, T
            else:
                others[name], hands[name] = T, link
            seen = self.bodies.joint_pose(q) * T if where.level else T
            self._require_in_hand(name, at.pop(name), seen)
        still = np.zeros(ARM_JOINTS)
        arm = np.array([q, still, still])
        now = Situation(arm, opening_m, at, others, held, taken=held is not None)
        apart = list(pairs.resting_pairs(self.bodies, now, hands))
        if held is not None:
            self._require_hold_at_first(*held, opening_m)
        if apart:
            self.steps.append(Step("what stands still", apart, None, q))
        return now

    def _require_in_hand(self, name: str, stated: Pose, T: Pose) -> None:
        """A body in a hand stands in the scene where the hand has it."""
        off_m = float(norm_bound((T.p - stated.p).magnitude))
        turned = float(norm_bound((T.R - stated.R).magnitude.reshape(9)))
        self._note("held bodies off their hands", name, max(off_m, turned))
        is_there = off_m <= PRESS_M and turned <= PRESS_M
        require(is_there, f"{name} stands {1e3 * off_m:.2f} mm off the hand that holds it")

    def _require_hold_at_first(self, name: str, T_joint_body: Pose, opening_m: float) -> None:
        if self._is_motion:
            self.assumed.append(f"the {self.robot.limb} hand holds {name} firmly")
            return
        contact.pad_gaps_m(
            self.bodies,
            "at first",
            name,
            T_joint_body,
            opening_m,
            fingers=self.bodies.fingers,
            within_m=contact.HELD_M,
        )

    # Moves

    def _followed(self, number: int, step: Mapping[str, Any], now: Situation) -> Situation:
        kind = step["type"]
        if kind == "Move":
            return self._moved(number, step, now)
        if kind == MOTION:
            return self._moved_by_others(number, step, now)
        require(kind == "Grip", f"a step of unknown kind {kind!r}")
        _require_rest(now, f"{step['label']}: the arm does not rest")
        if step["action"] == "CLOSE":
            return self._closed(number, step, now)
        require(step["action"] == "OPEN", f"{step['label']}: an unknown action")
        return self._opened(number, step, now)

    def _moved(self, number: int, step: Mapping[str, Any], now: Situation) -> Situation:
        label, robot = step["label"], self.robot
        limits = step["trajectory"]["limits"]
        own = tuple(limits["names"]) == robot.names
        require(own, f"{label}: it moves other joints than the {robot.limb} arm's")
        given = step["trajectory"]
        # files write arrays without rows by their shape
        given = {**given, "j": [] if isinstance(given["j"], dict) else given["j"]}
        motion = Polynomials.of_plan(given, label)
        is_there = np.abs(motion.start - now.arm) <= STATE_TOLERANCE
        require(is_there, f"{label}: it does not begin where the arm is")
        a_max, j_max = (np.full(ARM_JOINTS, x) for x in (self._limits.a_max, self._limits.j_max))
        motion.require_limits(*stated_limits(robot, limits, a_max, j_max, label))
        self.motions[number] = motion
        self._require_tip(step, motion)
        for claim in step.get("claims", ()):
            self._require_claim(claim, motion, now, label)
        following = self._grip_after(number)
        near: set[str] = set()
        if step["is_straight"] and now.held is None:
            wanted = following["body"] if following and following["action"] == "CLOSE" else None
            near = {name for name in (wanted, now.released) if name is not None}
        puts_down = following is not None and following["action"] == "OPEN"
        witness = self._witness(number, now, motion, puts_down)
        self._require_windows(label, witness, motion, now, puts_down)
        touched = witness.contacts
        require_contacts(self.bodies, step, now, motion.duration_s, touched, of_hand=near)
        if motion.duration_s > 0.0:
            self._add_move(label, motion, now, near, witness)
        asked = step["T_base_tip"] is not None
        return replace(now, arm=motion.end, released=None, taken=False, asked=asked)

    def _moved_by_others(self, number: int, step: Mapping[str, Any], now: Situation) -> Situation:
        """A motion without a requested pose, and with contacts as its caller states them."""
        label, robot = step["label"], self.robot
        motion = Polynomials.of_pieces(step["trajectory"], label)
        is_there = np.abs(motion.start[0] - now.arm[0]) <= STATE_TOLERANCE
        require(is_there, f"{label}: it does not begin where the arm is")
        judged = {
            "velocity": robot.v_max if step["is_timed"] else None,
            "acceleration": step["a_max"],
            "jerk": step["j_max"],
        }
        is_path = not step["is_timed"]
        has_limits = step["a_max"] is not None or step["j_max"] is not None
        require(not (is_path and has_limits), f"{label}: limits of a path that has no times")
        self.not_judged += [name for name, limit in judged.items() if limit is None]
        bounds = (None if limit is None else _within(limit) for limit in judged.values())
        motion.require_limits((robot.q_min - MAX_JUMP, robot.q_max + MAX_JUMP), *bounds)
        near, touched = set[str](), dict[str, tuple[float, float]]()
        for each in step["contacts"]:
            body, other = each["body"], each["other"]
            if other in (f"{robot.limb} hand", f"{robot.limb} pads"):
                require(body in now.at, f"{label}: the hand cannot touch {body}")
                near.add(body)
                self.assumed.append(f"the {other} may touch {body}")
            else:
                is_held = now.held is not None and now.held[0] == body and other in now.at
                require(is_held, f"{label}: {body} and {other} cannot touch by this motion")
                touched[other] = 0.0, motion.duration_s
                self.assumed.append(f"{body} may touch {other}")
        witness = replace(self._witnesses[number], contacts=touched)
        self._add_move(label, motion, now, near, witness)
        return replace(now, arm=motion.end, released=None, taken=False, asked=False)

    def _add_move(
        self, label: str, motion: Polynomials, now: Situation, near: set[str], witness: StepWitness
    ) -> None:
        apart = pairs.moving_pairs(
            self.bodies,
            now,
            near,
            witness.contacts,
            margin_m=witness.margin_m,
            end_s=motion.duration_s,
        )
        self.steps.append(Step(label, list(apart), motion, motion.start[0]))

    def _grip_after(self, number: int) -> Mapping[str, Any] | None:
        """The step after another, where that is a gripper action."""
        if number + 1 == len(self.plan_steps):
            return None
        following: Mapping[str, Any] = self.plan_steps[number + 1]
        return following if following["type"] == "Grip" else None

    def _require_tip(self, step: Mapping[str, Any], motion: Polynomials) -> None:
        label = step["label"]
        tip.require_goal(self.robot, motion, step["T_base_tip"], label)
        if step["is_straight"] and motion.duration_s > 0.0:
            self._note_line(self.robot, motion, label)
        if step.get("path") is not None:
            off_m, turn = path.path_deviation(self.robot, motion, step["path"], label)
            self._note("distance from path", label, off_m)
            self._note("turn from path", label, turn)

    def _note_line(self, robot: Robot, motion: Polynomials, label: str) -> None:
        """Refuse a tip, or a body as a tip, that leaves its straight line."""
        off_m, turn = path.line_deviation(robot, motion, self._plan["line_tolerance"], label)
        self._note("distance from line", label, off_m)
        self._note("turn from line", label, turn)

    def _require_claim(
        self, claim: Mapping[str, Any], motion: Polynomials, now: Situation, label: str
    ) -> None:
        kind, values = claim["kind"], claim["values"]
        require(kind in ("upright", "straight"), f"{label}: a claim that is not known")
        if now.held is None:
            raise NotCertifiedError(f"{label}: what stays {kind} is not in the hand")
        _, T_joint_body = now.held
        if kind == "upright":
            tilt = tip.require_upright(self.robot, motion, T_joint_body, values, label)
            self._note("tilt of held body", label, tilt)
            return
        require(not values, f"{label}: a straight line of a body is stated in another way")
        if motion.duration_s > 0.0:
            self._note_line(self.robot.with_tip(T_joint_body), motion, label)

    def _require_windows(
        self,
        label: str,
        witness: StepWitness,
        motion: Polynomials,
        now: Situation,
        puts_down: bool,
    ) -> None:
        """Contacts of a held body begin or end the step, after a grasp or before a release."""
        for name, (begin_s, end_s) in witness.contacts.items():
            require(now.held is not None and name in now.at, f"{label}: no contact of {name}")
            is_first = begin_s == 0.0 and now.taken
            is_last = end_s == motion.duration_s and puts_down
            is_window = 0.0 <= begin_s < end_s <= motion.duration_s
            require((is_first or is_last) and is_window, f"{label}: a contact out of turn")
            if now.held is not None:
                held, T_joint_body = now.held
                q = motion.start[0] if is_first else motion.end[0]
                T = self.bodies.joint_pose(q) * T_joint_body
                contact.require_support(self.bodies, label, held, T, name, at=now.at)
                slide_m = contact.slide_m(self.bodies, motion, (begin_s, end_s), now.held)
                self._note("slide in contact", motion.label, slide_m)

    # Fingers

    def _closed(self, number: int, step: Mapping[str, Any], now: Situation) -> Situation:
        label, name, bodies = step["label"], step["body"], self.bodies
        require(now.held is None, f"{label}: the hand is full")
        witness = self._witness(number, now)
        if name is None:
            require_contacts(bodies, step, now, np.inf, witness.contacts)
            self._travel(label, now, (now.opening_m, 0.0), None, witness)
            return replace(now, opening_m=0.0, released=None, taken=True)
        is_there = name in now.at and bodies.scene[name].is_movable
        require(is_there, f"{label}: there is no movable body {name!r}")
        require(now.asked, f"{label}: no pose of the tip was asked for")
        if witness.closing is None:
            raise NotCertifiedError(f"{label}: the certificate does not say how the fingers close")
        require_contacts(bodies, step, now, np.inf, witness.contacts, of_hand=(name,))
        touch_m, end_m, push_m = witness.closing
        is_way = 0.0 <= end_m <= touch_m <= now.opening_m + STATE_TOLERANCE
        is_way &= abs(push_m) <= 2.0 * now.opening_m
        require(is_way, f"{label}: the fingers do not close so")
        T_joint_base = bodies.joint_pose(now.arm[0]).inverse()
        T = T_joint_base * now.at[name]
        pushed = Pose(T.R, T.p + self.robot.along * push_m)
        for other in witness.contacts:
            contact.require_support(bodies, label, name, now.at[name], other, at=now.at)
        self._require_pads(label, name, pushed, end_m, list(bodies.fingers))
        if push_m:
            pushing = [f for f, sign in self.robot.fingers.items() if sign * push_m < 0.0]
            self._require_pads(label, name, T, touch_m, pushing)
        around = replace(now, at={n: P for n, P in now.at.items() if n != name})
        self._travel(label, around, (now.opening_m, touch_m), (name, T, 0.0, 0.0), witness)
        self._travel(label, around, (touch_m, end_m), (name, T, 0.0, push_m), witness)
        return replace(around, opening_m=end_m, held=(name, pushed), released=None, taken=True)

    def _require_pads(
        self, label: str, name: str, T_joint_body: Pose, opening_m: float, fingers: Sequence[str]
    ) -> None:
        """Refuse fingers that do not touch a body, whose pose is seen from the last joint."""
        gaps_m = contact.pad_gaps_m(
            self.bodies, label, name, T_joint_body, opening_m, fingers=fingers
        )
        for finger, gap_m in gaps_m.items():
            self._note("gap of closed pads", f"{label}, {finger} and {name}", gap_m)

    def _opened(self, number: int, step: Mapping[str, Any], now: Situation) -> Situation:
        label, robot, witness = step["label"], self.robot, self._witness(number, now)
        name = None if now.held is None else now.held[0]
        require(step["body"] == name, f"{label}: the hand holds {name or 'nothing'}")
        of_hand = () if name is None else (name,)
        require_contacts(self.bodies, step, now, np.inf, witness.contacts, of_hand=of_hand)
        asked = step["opening_m"]
        end_m = robot.stroke_m if asked is None else float(asked)
        is_way = 0.0 <= end_m <= robot.stroke_m + STATE_TOLERANCE
        is_way &= name is None or end_m >= now.opening_m + MIN_RELEASE_M
        require(is_way, f"{label}: the fingers do not open so")
        if now.held is None:
            self._travel(label, now, (now.opening_m, end_m), None, witness)
            return replace(now, opening_m=end_m, released=None, taken=False)
        held, T_joint_body = now.held
        require(now.asked, f"{label}: no pose of the tip was asked for")
        self._travel(label, now, (now.opening_m, end_m), (held, T_joint_body, 0.0, 0.0), witness)
        T, fall_m = self.bodies.joint_pose(now.arm[0]) * T_joint_body, 0.0
        if step.get("receiver"):
            require(self._is_alone, f"{label}: a plan of one arm hands nothing over")
        else:
            fall_m = contact.fall_m(self.bodies, label, held, T, now)
            self._note("drop at release", f"{label}, {held}", fall_m)
        landed = Pose(T.R, T.p - np.array([0.0, 0.0, fall_m]))
        apart = list(pairs.standing_pairs(self.bodies, self.bodies.mover(held, landed, 0)))
        self.steps.append(Step(f"{label}: {held} stands", apart, None, now.arm[0]))
        return replace(
            now, opening_m=end_m, at={**now.at, held: landed}, held=None, released=held, taken=False
        )

    def _travel(
        self,
        label: str,
        now: Situation,
        way_m: tuple[float, float],
        between: tuple[str, Pose, float, float] | None,
        witness: StepWitness,
    ) -> None:
        apart = pairs.finger_pairs(
            self.bodies, now, way_m, between, witness.contacts, margin_m=witness.margin_m
        )
        self.steps.append(Step(label, list(apart), None, now.arm[0]))

    def _witness(
        self,
        number: int,
        _now: Situation,
        _motion: Polynomials | None = None,
        _puts_down: bool = False,
    ) -> StepWitness:
        """What the certificate says of a step; the prover's subclass finds it here instead.

        Its arguments are the number of the step, the situation before it, and of a move its motion
        and whether the hand opens right after it.
        """
        return self._witnesses[number]

    def _note(self, name: str, where: str, value: float) -> None:
        if value > self.worst.get(name, (-np.inf, ""))[0]:
            self.worst[name] = value, where


def _require_rest(now: Situation, reason: str) -> None:
    require(np.abs(now.arm[1:]) <= STATE_TOLERANCE, reason)


def _within(limit: ArrayLike) -> tuple[Array, Array]:
    """Bounds on what may be as great as a limit, of each joint, in both directions."""
    greatest = np.array(limit, np.float64).reshape(ARM_JOINTS) * (1.0 + LIMIT_RATIO)
    return -greatest, greatest
