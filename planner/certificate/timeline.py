"""A plan followed step by step: what stands where, what is held, and which pairs must keep apart.

Everything is derived from the start and the steps before; what the plan states of its states is
compared with that. A witness adds numbers that are checked here: how far fingers close and push,
and how long a held body may touch what it stands on.

Beside the moves and grips of a plan there is a third kind of step, a motion that something else
planned or recorded. The contacts that are intended in it are its caller's assumption.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from planner.certificate.body import Body
from planner.certificate.clusters import Clusters, Shape, stated_pose
from planner.certificate.errors import NotCertifiedError, require
from planner.certificate.intervals import (
    Array,
    Interval,
    Pose,
    axis_angle,
    norm_bound,
    turns_about,
)
from planner.certificate.motion import LIMIT_RATIO, MAX_JUMP, Polynomials, carried, stated_limits
from planner.certificate.robot import ARM_JOINTS, BASE, Robot
from planner.certificate.rows import Kinematics, Mover, Pair, Step
from planner.certificate.touching import DistanceBounds

PRESS_M = 5e-4
"""How deep an intended contact may press, and how far a stated state may be from the derived."""

HELD_M = 1e-3
"""How far a pad may be at first from what its hand holds: grippers measure no better."""

SLIDE_M = 1e-3
"""How far a held body may move sideways while it touches its support."""

TOUCH_M = 1e-5
"""Shapes as near as this touch."""

MAX_SKEW_M = 0.5 * PRESS_M
"""How far fingers may slide off y of the last joint; where they do, they are widened by that."""

DROP_M = 0.01
"""From how high a body may be let go."""

TIP = 1e-6
"""How far a tip may be from its goal, m, and entries of its rotation matrix."""

SAME_S = 1e-6
"""How much longer than its step a contact may be stated."""

STATE = 1e-8
"""How far joints, velocities and accelerations of successive steps may differ."""

NEIGHBOURS = 2
"""Links with so many movable joints between them must not touch, but keep no margin, as the robot
is built so; those with fewer are mounted on each other and are not compared."""

A_MAX_RAD_S2, J_MAX_RAD_S3 = 2.0, 20.0
"""Rethink published no limits of acceleration and jerk; these are the presets of the toolkit,
measured as what real arms follow (`baxter_kin.limits`). The caller may pass others."""

MIN_LINE_M = 1e-6
"""On a shorter line, how far the hand has turned tells the share of the way."""

LINE_CELLS = tuple(2**power for power in range(6, 15))
"""Into how many cells a straight move is cut, until what may happen between is small."""

MAX_STEPS, MAX_BODIES = 1000, 500

MOTION = "Motion"
"""The type of a step that is a motion of something else's."""


@dataclass(frozen=True)
class StepWitness:
    """What a certificate says of one step; nothing of it is trusted.

    Attributes:
        margin_m: the distance that is to be proven.
        closing: of a hand that closes on a body: how far it is open when the first finger touches,
            and at the end, and how far the body is pushed along y of the tip.
        contacts: from when to when a held body may touch another, by the name of that.
    """

    margin_m: float = 0.0
    closing: tuple[float, float, float] | None = None
    contacts: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Limits:
    """Greatest acceleration and jerk, of every joint or of each, rad/s^2 and rad/s^3."""

    a_max: float | Array = A_MAX_RAD_S2
    j_max: float | Array = J_MAX_RAD_S3


@dataclass(frozen=True, eq=False)
class _Thing:
    """A body of the scene: its parts, seen from it."""

    name: str
    parts: tuple[tuple[Shape, Pose], ...]
    is_movable: bool


@dataclass(frozen=True, eq=False)
class _Now:
    """Where everything is between two steps.

    Attributes:
        arm: positions, velocities and accelerations of the arm, shape (3, 7).
        opening_m: how far its fingers are open.
        at: poses of the bodies that stand, seen from base.
        held: the body in the hand, and its pose seen from the last joint.
        released: the body that was let go right before.
        taken: whether the hand has closed right before, or holds something at first.
        asked: whether the arm stands where a pose of the tip was asked for.
    """

    arm: Array
    opening_m: float
    at: Mapping[str, Pose]
    held: tuple[str, Pose] | None = None
    released: str | None = None
    taken: bool = False
    asked: bool = False


class Timeline:
    """The steps of a plan, with all that must keep apart in each.

    Attributes:
        robot: the robot.
        clusters: all trees.
        steps: what rows must prove, in the order of the certificate.
        numbers: which step of the plan each belongs to, None for what stands still.
        worst: upper bounds on what rules that are not about rows bound, by name, each with where.
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
    ) -> None:
        """Follow a plan to its end.

        Args:
            plan: as its file has it, and `states` likewise.
            states: what each state has that the one before has not; empty where none is stated.
            robot: the robot that it is for.
            body: its body.
            witnesses: one a step.
            limits: what accelerations and jerks are judged by.

        Raises:
            NotCertifiedError: when the plan breaks a rule that is not about rows.
        """
        self.robot, self.clusters = robot, Clusters()
        self.steps: list[Step] = []
        self.assumed: list[str] = []
        self.not_judged: list[str] = []
        self._plan, self._witnesses = plan, witnesses
        self._distances = DistanceBounds(self.clusters)
        self._limits = limits or Limits()
        self.worst: dict[str, tuple[float, str]] = {}
        require(plan["failure"] is None, "the plan says itself that it failed")
        self._plan_steps = plan["steps"]
        self._is_motion = any(step["type"] == MOTION for step in self._plan_steps)
        require(len(self._plan_steps) <= MAX_STEPS, f"the plan has more than {MAX_STEPS} steps")
        require(len(witnesses) == len(self._plan_steps), "the certificate is of other steps")
        start = plan["start"]
        joints = {str(name): float(value) for name, value in start["joints"].items()}
        require(np.isfinite(list(joints.values())), "a joint is not finite")
        bodies = start["scene"]["bodies"]
        require(len(bodies) <= MAX_BODIES, f"the scene has more than {MAX_BODIES} bodies")
        self._things = {name: _thing(name, data) for name, data in bodies.items()}
        places = robot.places(joints)
        self._place_links(body, places)
        now = self._begin(start, joints, places)
        stated = _Stated(start, states, self)
        self.numbers: list[int | None] = [None] * len(self.steps)
        for number, step in enumerate(self._plan_steps):
            stated.compare(number, now)
            now = self._followed(number, step, now)
            self.numbers += [number] * (len(self.steps) - len(self.numbers))
        if not self._is_motion:
            self._require_rest(now, "the arm does not rest at the end")

    # The robot

    def _place_links(self, body: Body, places: Mapping[str, Pose]) -> None:
        """Movers of all links: of the arm by joint, of fingers, and of the rest by carrier."""
        roots: dict[int | str, list[int]] = {}
        self._pads: dict[str, list[int]] = {finger: [] for finger in self.robot.fingers}
        filled: dict[int | str, list[int]] = {}
        skew_m = self.robot.skew * self.robot.stroke_m
        require(skew_m <= MAX_SKEW_M, "the fingers slide askew")
        for each in body.shapes:
            where = self.robot.attached(each.link, places)
            key = where.finger or where.level or self.robot.carrier(each.link)
            shape = each.shape
            if where.finger is not None and skew_m > 0.0:
                shape = replace(shape, ball_m=shape.ball_m + skew_m)
            root = self.clusters.add(shape, where.T * each.T_link_shape)
            roots.setdefault(key, []).append(root)
            if where.finger is None and each.shape.size > 1:
                solid = self.clusters.add(each.shape, where.T * each.T_link_shape, is_filled=True)
                filled.setdefault(key, []).append(solid)
            if where.finger is not None and each.link.endswith("_finger_tip"):
                self._pads[where.finger].append(root)
        joined = {key: self.clusters.joined(found) for key, found in roots.items()}
        self._arm = {
            k: Mover(f"links of {self.robot.names[k - 1]}", joined[k], k)
            for k in range(1, ARM_JOINTS + 1)
            if k in joined
        }
        self._filled = {
            key: Mover(
                "the inside of a link",
                self.clusters.joined(found),
                key if isinstance(key, int) else 0,
            )
            for key, found in filled.items()
        }
        self._fingers = {f: joined[f] for f in self.robot.fingers if f in joined}
        require(len(self._fingers) == len(self.robot.fingers), "a finger has no shape")
        self._rest = {
            str(key): Mover(f"links on {key}", root, 0)
            for key, root in joined.items()
            if isinstance(key, str) and key not in self.robot.fingers
        }

    def _finger(self, name: str, begin_m: float, end_m: float) -> Mover:
        sign = self.robot.fingers[name]
        return Mover(name, self._fingers[name], ARM_JOINTS, (sign * begin_m, sign * end_m))

    @property
    def _hand_names(self) -> set[str]:
        """What contacts call parts of the arm's hand."""
        return {f"{self.robot.limb} hand", f"{self.robot.limb} pads"}

    def _link(self, level: int) -> str:
        return self.robot.chain[level - 1]

    # The start

    def _begin(
        self, start: Mapping[str, Any], joints: Mapping[str, float], places: Mapping[str, Pose]
    ) -> _Now:
        robot = self.robot
        missing = [name for name in robot.names if name not in joints]
        require(not missing, f"the state lacks {', '.join(missing)}")
        q = np.array([joints[name] for name in robot.names])
        openings = [
            sign * joints.get(robot.finger_joints[finger], np.nan)
            for finger, sign in robot.fingers.items()
        ]
        require(np.abs(np.diff(openings)) <= STATE, "the fingers are not equally open")
        opening = float(openings[0])
        is_within = -STATE <= opening <= robot.stroke_m + STATE
        require(is_within, "the fingers start outside their stroke")
        at = {
            name: stated_pose(data["T_base_body"], name)
            for name, data in start["scene"]["bodies"].items()
        }
        held, others = None, {}
        for each in start["attachments"]:
            name, link = each["body"], each["link"]
            require(name in at, f"the scene lacks {name}, which {link} holds")
            T_link_body = stated_pose(each["T_link_body"], name)
            where = robot.attached(link, places)
            T = where.T * T_link_body
            if where.level:
                is_of_hand = where.level == ARM_JOINTS and where.finger is None
                require(is_of_hand, f"{name} hangs on {link}, which is no hand")
                require(held is None, "the hand holds two bodies")
                held = name, T
            else:
                others[name] = T, link
            seen = self._joint_pose(q) * T if where.level else T
            self._require_in_hand(name, at.pop(name), seen)
        still = np.zeros(ARM_JOINTS)
        self._others = {name: T for name, (T, _) in others.items()}
        now = _Now(np.array([q, still, still]), opening, at, held, taken=held is not None)
        self._stand_at_first(now, {name: link for name, (_, link) in others.items()})
        return now

    def _require_in_hand(self, name: str, stated: Pose, T: Pose) -> None:
        """What a hand holds stands in the scene where the hand has it."""
        off_m = float(norm_bound((T.p - stated.p).magnitude))
        turned = float(norm_bound((T.R - stated.R).magnitude.reshape(9)))
        self._note("held bodies off their hands", name, max(off_m, turned))
        is_there = off_m <= PRESS_M and turned <= PRESS_M
        require(is_there, f"{name} stands {1e3 * off_m:.2f} mm off the hand that holds it")

    def _stand_at_first(self, now: _Now, others: Mapping[str, str]) -> None:
        """One instant of all that the arm does not move, and of what it holds.

        What is fixed may meet the fixed base, as a floor around its foot does: neither ever moves.
        Then no body is inside a link either; later it could get there only through its surface.
        """
        pairs, seen = [], self._frames(now.arm[0])
        rest = list(self._rest.items())
        for number, (carrier, one) in enumerate(rest):
            for other_carrier, other in rest[:number]:
                is_one_hand = {carrier, other_carrier} <= self.robot.sliding  # or apart anyhow
                joints = self.robot.joints_between(carrier, other_carrier)
                if joints > NEIGHBOURS or (joints == NEIGHBOURS and not is_one_hand):
                    counts = joints > NEIGHBOURS
                    pairs.append(_pair(one, other, 0.0, counts=counts))
        for name, T in now.at.items():
            body, is_fixed = self._mover(name, T, 0), not self._things[name].is_movable
            pairs += self._standing_pairs(body, with_base=not is_fixed)
            links = [key for key in self._filled if not (is_fixed and key == BASE)]
            pairs += [self._outside(key, name, T, 0, seen) for key in links]
        for name, link in others.items():
            held = self._mover(name, self._others[name], 0)
            hand = self.robot.carrier(link)
            for carrier, mover in self._rest.items():
                if self.robot.joints_between(carrier, hand) > 1:
                    pairs.append(_pair(held, mover, 0.0))
            for key in self._filled:
                if isinstance(key, int) or self.robot.joints_between(key, hand) > 1:
                    pairs.append(self._outside(key, name, self._others[name], 0, seen))
            pairs += [_pair(held, self._mover(n, T, 0), 0.0) for n, T in now.at.items()]
        if now.held is not None:
            name, T = now.held
            body = self._mover(name, T, ARM_JOINTS)
            links = [key for key, link in self._filled.items() if link.level < ARM_JOINTS]
            pairs += [self._outside(key, name, T, ARM_JOINTS, seen) for key in links]
            fingers = [self._finger(f, now.opening_m, now.opening_m) for f in self._fingers]
            pairs += self._between_pairs(body, fingers)
            self._require_hold_at_first(name, T, now.opening_m)
        if pairs:
            self.steps.append(Step("what stands still", pairs, None, now.arm[0]))

    def _require_hold_at_first(self, name: str, T_joint_body: Pose, opening_m: float) -> None:
        if self._is_motion:
            self.assumed.append(f"the {self.robot.limb} hand holds {name} firmly")
            return
        fingers = self._fingers
        self._require_hold(
            "at first", name, T_joint_body, opening_m, fingers=fingers, within_m=HELD_M
        )

    def _outside(
        self, link: int | str, name: str, T: Pose, level: int, seen: tuple[Array, Array]
    ) -> Pair:
        """The pair that shows that a body is not inside a link, given that it does not touch it.

        A convex part is outside if one of its points is; take the one farthest from the link.
        """
        solid, roots = self._filled[link], []
        R, p = seen
        middle = self.clusters.middles(np.array([solid.root]))[0]
        middle = R[solid.level] @ middle + p[solid.level]
        for shape, placed in self._things[name].parts:
            own = T * placed
            points = shape.points_of(0)
            at = points @ own.R.centred()[0].T + own.p.centred()[0]
            away = np.linalg.norm(at @ R[level].T + p[level] - middle, axis=1)
            farthest = Shape.of_points(points[[int(away.argmax())]])
            roots.append(self.clusters.add(farthest if shape.size == 1 else shape, own))
        body = Mover(name, self.clusters.joined(roots), level)
        first, second = (solid, body) if solid.level >= level else (body, solid)
        return _pair(first, second, 0.0, counts=False)

    def _frames(self, q: Array) -> tuple[Array, Array]:
        """Rotations and translations of the arm's joints in base, in doubles, to choose points."""
        still, levels = Step("", (), None, q), np.arange(ARM_JOINTS + 1)
        wanted = {(0, k) for k in range(1, ARM_JOINTS + 1)}
        seen = Kinematics(self.robot, still, np.zeros(1), wanted)
        return seen.at(0 * levels, levels, np.zeros(len(levels)))

    def _standing_pairs(self, body: Mover, *, with_base: bool = True) -> Iterator[Pair]:
        for carrier, mover in self._rest.items():
            if with_base or carrier != BASE:
                yield _pair(body, mover, 0.0)

    # Steps

    def _followed(self, number: int, step: Mapping[str, Any], now: _Now) -> _Now:
        kind = step["type"]
        if kind == "Move":
            return self._moved(number, step, now)
        if kind == MOTION:
            return self._moved_by_others(number, step, now)
        require(kind == "Grip", f"a step of unknown kind {kind!r}")
        self._require_rest(now, f"{step['label']}: the arm does not rest")
        if step["action"] == "CLOSE":
            return self._closed(number, step, now)
        require(step["action"] == "OPEN", f"{step['label']}: an unknown action")
        return self._opened(number, step, now)

    def _moved(self, number: int, step: Mapping[str, Any], now: _Now) -> _Now:
        label = step["label"]
        require(not step.get("claims"), f"{label}: a claim that is not known")
        limits = step["trajectory"]["limits"]
        own = tuple(limits["names"]) == self.robot.names
        require(own, f"{label}: it moves other joints than the {self.robot.limb} arm's")
        given = step["trajectory"]
        # files write arrays without rows by their shape
        given = {**given, "j": [] if isinstance(given["j"], dict) else given["j"]}
        motion = Polynomials.of_plan(given, label)
        is_there = np.abs(motion.start - now.arm) <= STATE
        require(is_there, f"{label}: it does not begin where the arm is")
        a_max, j_max = (np.full(ARM_JOINTS, x) for x in (self._limits.a_max, self._limits.j_max))
        motion.require_limits(*stated_limits(self.robot, limits, a_max, j_max, label))
        self._require_tip(step, motion)
        following = self._grip_after(number)
        near: set[str] = set()
        if step["is_straight"] and now.held is None:
            wanted = following["body"] if following and following["action"] == "CLOSE" else None
            near = {name for name in (wanted, now.released) if name is not None}
        puts_down = following is not None and following["action"] == "OPEN"
        witness = self._witness(number, now, motion, puts_down)
        self._require_windows(label, witness, motion, now, puts_down)
        self._require_stated(step, witness, now, motion.duration_s, of_hand=near)
        if motion.duration_s > 0.0:
            pairs = list(self._move_pairs(witness, now, near, motion.duration_s))
            self.steps.append(Step(label, pairs, motion, motion.start[0]))
        asked = step["T_base_tip"] is not None
        return replace(now, arm=motion.end, released=None, taken=False, asked=asked)

    def _moved_by_others(self, number: int, step: Mapping[str, Any], now: _Now) -> _Now:
        """A motion with no pose that was asked for, and contacts as its caller states them."""
        label, robot = step["label"], self.robot
        motion = Polynomials.of_pieces(step["trajectory"], label)
        is_there = np.abs(motion.start[0] - now.arm[0]) <= STATE
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
        for contact in step["contacts"]:
            body, other = contact["body"], contact["other"]
            if other in self._hand_names:
                require(body in now.at, f"{label}: the hand cannot touch {body}")
                near.add(body)
                self.assumed.append(f"the {other} may touch {body}")
            else:
                is_held = now.held is not None and now.held[0] == body and other in now.at
                require(is_held, f"{label}: {body} and {other} cannot touch by this motion")
                touched[other] = 0.0, motion.duration_s
                self.assumed.append(f"{body} may touch {other}")
        witness = replace(self._witnesses[number], contacts=touched)
        pairs = list(self._move_pairs(witness, now, near, motion.duration_s))
        self.steps.append(Step(label, pairs, motion, motion.start[0]))
        return replace(now, arm=motion.end, released=None, taken=False, asked=False)

    def _grip_after(self, number: int) -> Mapping[str, Any] | None:
        """The step after another, where that is a gripper action."""
        if number + 1 == len(self._plan_steps):
            return None
        following: Mapping[str, Any] = self._plan_steps[number + 1]
        return following if following["type"] == "Grip" else None

    def _move_pairs(
        self, witness: StepWitness, now: _Now, near: set[str], end_s: float
    ) -> Iterator[Pair]:
        margin_m = witness.margin_m
        solids, others = self._around(now)
        for k, arm in self._arm.items():
            yield from self._link_pairs(arm, k, margin_m, end_s)
            for name, solid in solids.items():
                is_palm = k == ARM_JOINTS and name in near
                yield _pair(arm, solid, 0.0 if is_palm else margin_m, end_s, counts=not is_palm)
            yield from (_pair(arm, other, margin_m, end_s) for other in others)
        for name in self._fingers:
            finger = self._finger(name, now.opening_m, now.opening_m)
            yield from self._link_pairs(finger, ARM_JOINTS + 1, margin_m, end_s)
            for of, solid in solids.items():
                least_m = -PRESS_M if of in near else margin_m
                yield _pair(finger, solid, least_m, end_s, counts=of not in near)
            yield from (_pair(finger, other, margin_m, end_s) for other in others)
        if now.held is not None:
            body = self._mover(*now.held, ARM_JOINTS)
            yield from self._held_pairs(body, witness, solids, others, end_s)

    def _link_pairs(self, mover: Mover, level: int, least_m: float, end_s: float) -> Iterator[Pair]:
        """Of a link that moves with others of the robot; fingers count as level 8."""
        link = mover.name if level > ARM_JOINTS else self._link(level)
        others = [
            (self.robot.joints_between(link, carrier), rest) for carrier, rest in self._rest.items()
        ]
        others += [(level - m, arm) for m, arm in self._arm.items()]
        for joints, other in others:
            if joints > NEIGHBOURS:
                yield _pair(mover, other, least_m, end_s)
            elif joints == NEIGHBOURS:
                yield _pair(mover, other, 0.0, end_s, counts=False)

    def _between_pairs(self, body: Mover, fingers: Sequence[Mover]) -> Iterator[Pair]:
        """Of a body between the fingers with these and with the palm, all carried by one joint."""
        yield from (_pair(finger, body, -PRESS_M, counts=False) for finger in fingers)
        palm = self._arm.get(ARM_JOINTS)
        if palm is not None:
            yield _pair(body, palm, 0.0, counts=False)

    def _held_pairs(
        self,
        body: Mover,
        witness: StepWitness,
        solids: Mapping[str, Mover],
        others: Sequence[Mover],
        end_s: float,
    ) -> Iterator[Pair]:
        margin_m = witness.margin_m
        for rest in self._rest.values():
            yield _pair(body, rest, margin_m, end_s)
        for m, arm in self._arm.items():
            if m < ARM_JOINTS:
                yield _pair(body, arm, margin_m, end_s)
        for other in others:
            yield _pair(body, other, margin_m, end_s)
        for name, solid in solids.items():
            if name not in witness.contacts:
                yield _pair(body, solid, margin_m, end_s)
                continue
            begin_s, until_s = witness.contacts[name]
            yield Pair(body, solid, -PRESS_M, begin_s, until_s, is_counted=False)
            if begin_s > 0.0:
                yield Pair(body, solid, 0.0, 0.0, begin_s, is_counted=False)
            if until_s < end_s:
                yield Pair(body, solid, 0.0, until_s, end_s, is_counted=False)

    def _closed(self, number: int, step: Mapping[str, Any], now: _Now) -> _Now:
        label, name = step["label"], step["body"]
        require(now.held is None, f"{label}: the hand is full")
        witness = self._witness(number, now)
        if name is None:
            self._require_stated(step, witness, now, np.inf)
            self._travel(label, now, (now.opening_m, 0.0), None, witness)
            return replace(now, opening_m=0.0, released=None, taken=True)
        is_there = name in now.at and self._things[name].is_movable
        require(is_there, f"{label}: there is no movable body {name!r}")
        require(now.asked, f"{label}: no pose of the tip was asked for")
        if witness.closing is None:
            raise NotCertifiedError(f"{label}: the certificate does not say how the fingers close")
        self._require_stated(step, witness, now, np.inf, of_hand=(name,))
        touch_m, end_m, push_m = witness.closing
        is_way = 0.0 <= end_m <= touch_m <= now.opening_m + STATE
        is_way &= abs(push_m) <= 2.0 * now.opening_m
        require(is_way, f"{label}: the fingers do not close so")
        T_joint_base = self._joint_pose(now.arm[0]).inverse()
        T = T_joint_base * now.at[name]
        pushed = Pose(T.R, T.p + self.robot.along * push_m)
        for other in witness.contacts:
            self._require_near(label, name, now.at[name], other, now.at)
        self._require_hold(label, name, pushed, end_m, fingers=self._fingers)
        if push_m:
            pushing = [f for f, sign in self.robot.fingers.items() if sign * push_m < 0.0]
            self._require_hold(label, name, T, touch_m, fingers=pushing)
        around = replace(now, at={n: P for n, P in now.at.items() if n != name})
        self._travel(label, around, (now.opening_m, touch_m), (name, T, 0.0, 0.0), witness)
        self._travel(label, around, (touch_m, end_m), (name, T, 0.0, push_m), witness)
        return replace(around, opening_m=end_m, held=(name, pushed), released=None, taken=True)

    def _opened(self, number: int, step: Mapping[str, Any], now: _Now) -> _Now:
        label, robot, witness = step["label"], self.robot, self._witness(number, now)
        name = None if now.held is None else now.held[0]
        require(step["body"] == name, f"{label}: the hand holds {name or 'nothing'}")
        self._require_stated(step, witness, now, np.inf, of_hand=() if name is None else (name,))
        asked = step["opening_m"]
        end_m = robot.stroke_m if asked is None else float(asked)
        is_way = 0.0 <= end_m <= robot.stroke_m + STATE and (name is None or end_m > now.opening_m)
        require(is_way, f"{label}: the fingers do not open so")
        if now.held is None:
            self._travel(label, now, (now.opening_m, end_m), None, witness)
            return replace(now, opening_m=end_m, released=None, taken=False)
        held, T_joint_body = now.held
        require(now.asked, f"{label}: no pose of the tip was asked for")
        self._travel(label, now, (now.opening_m, end_m), (held, T_joint_body, 0.0, 0.0), witness)
        T = self._joint_pose(now.arm[0]) * T_joint_body
        fall_m = self._fall_m(label, held, T, now.at)
        landed = Pose(T.R, T.p - np.array([0.0, 0.0, fall_m]))
        pairs = list(self._standing_pairs(self._mover(held, landed, 0)))
        self.steps.append(Step(f"{label}: {held} stands", pairs, None, now.arm[0]))
        return replace(
            now, opening_m=end_m, at={**now.at, held: landed}, held=None, released=held, taken=False
        )

    def _travel(
        self,
        label: str,
        now: _Now,
        way_m: tuple[float, float],
        between: tuple[str, Pose, float, float] | None,
        witness: StepWitness,
    ) -> None:
        """Fingers travel, and a body between them is pushed, evenly; all ends are exact."""
        pairs: list[Pair] = []
        fingers = [self._finger(name, *way_m) for name in self._fingers]
        solids, others = self._around(now)
        for finger in fingers:
            pairs += self._link_pairs(finger, ARM_JOINTS + 1, witness.margin_m, 1.0)
            pairs += [_pair(finger, s, witness.margin_m) for s in (*solids.values(), *others)]
        if between is not None:
            name, T, begin_m, end_m = between
            skew_m = self.robot.skew * abs(end_m - begin_m)
            body = self._mover(name, T, ARM_JOINTS, (begin_m, end_m), skew_m)
            pairs += self._between_pairs(body, fingers)
            if end_m != begin_m:
                pushed = replace(witness, contacts=dict.fromkeys(witness.contacts, (0.0, 1.0)))
                pairs += self._held_pairs(body, pushed, solids, others, 1.0)
        self.steps.append(Step(label, pairs, None, now.arm[0]))

    def _witness(
        self,
        number: int,
        _now: _Now,
        _motion: Polynomials | None = None,
        _puts_down: bool = False,
    ) -> StepWitness:
        """What the certificate says of a step; the class that makes certificates finds it here.

        It gets the number of the step, where everything is before it, and of a move its motion and
        whether the hand opens right after it.
        """
        return self._witnesses[number]

    # Rules that are not about pairs

    def _note(self, name: str, where: str, value: float) -> None:
        if value > self.worst.get(name, (-np.inf, ""))[0]:
            self.worst[name] = value, where

    def _require_stated(
        self,
        step: Mapping[str, Any],
        witness: StepWitness,
        now: _Now,
        end_s: float,
        *,
        of_hand: Collection[str] = (),
    ) -> None:
        """Refuse a stated contact that is not meant, goes deeper or lasts longer than it may.

        Who executes a plan lets what is stated touch.
        """
        hand, pads = f"{self.robot.limb} hand", f"{self.robot.limb} pads"
        carried = of_hand if now.held is None else (now.held[0],)
        for contact in step["contacts"]:
            body, other = contact["body"], contact["other"]
            numbered = [(body, contact["part"]), (other, contact["other_part"])]
            is_meant = body in of_hand and other in (hand, pads)
            is_meant |= body in carried and other in witness.contacts
            is_meant &= all(
                i is None or 0 <= i < len(self._things[name].parts)
                for name, i in numbered
                if name in self._things
            )
            what = f"{step['label']}: a contact of {body} and {other}"
            require(is_meant, f"{what} is not meant")
            least_m = 0.0 if other == hand else -PRESS_M
            require(contact["least_m"] >= least_m, f"{what} is stated to press too deep")
            is_while = 0.0 <= contact["begin_s"] <= contact["end_s"] <= end_s + SAME_S
            require(is_while, f"{what} is stated to be longer than the step")

    def _require_near(
        self, label: str, name: str, T: Pose, other: str, at: Mapping[str, Pose]
    ) -> None:
        """A body that is taken or put down touches only what it stands on."""
        require(other in at, f"{label}: no contact of {other}")
        is_near = self._distance_m(name, T, other, at[other], 2.0 * PRESS_M) <= 2.0 * PRESS_M
        require(is_near, f"{label}: {name} does not stand on {other}")

    def _distance_m(self, name: str, T: Pose, other: str, T_other: Pose, enough_m: float) -> float:
        """An upper bound on the distance of two bodies; nothing nearer than enough is sought."""
        roots = [self._mover(*each, 0).root for each in ((name, T), (other, T_other))]
        return self._distances.bound_m(roots[0], roots[1], np.zeros(3), enough_m)

    def _require_rest(self, now: _Now, reason: str) -> None:
        require(np.abs(now.arm[1:]) <= STATE, reason)

    def _require_tip(self, step: Mapping[str, Any], motion: Polynomials) -> None:
        label = step["label"]
        reached = self.robot.tips(motion.at(np.array([motion.duration_s])))
        if step["T_base_tip"] is not None:
            asked = stated_pose(step["T_base_tip"], label)
            off = norm_bound((reached.p - asked.p).magnitude)
            turned = norm_bound((reached.R - asked.R).magnitude.reshape(-1, 9))
            require((off <= TIP) & (turned <= 2.0 * TIP), f"{label}: the tip ends elsewhere")
        if step["is_straight"] and motion.duration_s > 0.0:
            self._require_line(label, motion)

    def _require_line(self, label: str, motion: Polynomials) -> None:
        """The tip stays near the line from where it starts to where it ends, and turns evenly.

        To each end of a cell belongs a share of the way, whichever; in between it changes evenly.
        Away from the point at that share, the tip is on the chord of a cell no farther than at the
        ends, as lengths are convex, and off the chord by at most M h^2 / 8. So is the rotation from
        the one that belongs to the share, entry by entry; the chord of that one is off by at most
        the square of its turn, times sqrt(2) / 8.
        """
        tolerance = self._plan["line_tolerance"]
        allowed_m, allowed_rad = float(tolerance["position_m"]), float(tolerance["rotation_rad"])
        ends = self.robot.tips(motion.at(np.array([0.0, motion.duration_s]))).R.centred()[0]
        axis, angle = axis_angle(ends[0].T @ ends[1])
        for count in LINE_CELLS:
            times_s = np.linspace(0.0, motion.duration_s, count + 1)
            bend_m, bend = self._bends(motion, times_s)
            turning = 0.18 * (3.0 * angle / count) ** 2  # of a cell at three times the mean speed
            is_last = count == LINE_CELLS[-1]
            if not is_last and (bend_m > 0.1 * allowed_m or bend + turning > 0.1 * allowed_rad):
                continue
            at_ends_m, (at_ends, bent) = self._off_line(label, motion, times_s, (axis, angle))
            off_m, turn = at_ends_m + bend_m, 0.7079 * (at_ends + bent + bend)
            is_within = off_m <= allowed_m and turn <= allowed_rad
            if is_within or at_ends_m > allowed_m or 0.7 * at_ends > allowed_rad:
                break  # else smaller cells tell
        self._note("distance from line", label, off_m)
        self._note("turn from line", label, turn)
        require(off_m <= allowed_m, f"{label}: the tip is up to {1e3 * off_m:.4f} mm off its line")
        require(
            turn <= min(allowed_rad, 0.07),
            f"{label}: the hand is turned by up to {turn:.6f} rad from its line",
        )

    def _off_line(
        self, label: str, motion: Polynomials, times_s: Array, turn: tuple[Array, float]
    ) -> tuple[float, tuple[float, float]]:
        """How far the tip is off its line at some times, in metres, and how far it is turned.

        The turn is the Frobenius norm of a difference of rotations, which is at least 1 / 0.7079 of
        the angle where that is below 0.1 rad, and how far chords of the asked rotation are off.
        """
        axis, angle = turn
        T = self.robot.tips(motion.at(times_s))
        (p, error_p), (R, error_R) = T.p.centred(), T.R.centred()
        way = p[-1] - p[0]
        length_m = float(np.linalg.norm(way))
        if length_m > MIN_LINE_M:
            share = np.clip((p - p[0]) @ way / length_m**2, 0.0, 1.0)
        else:
            turns = (axis_angle(R[0].T @ each) for each in R)
            share = np.array([(own @ axis) * turn for own, turn in turns]) / max(angle, 1e-9)
            share = share.clip(0.0, 1.0)
        off_m = float(norm_bound(p - p[0] - share[:, None] * way).max()) + 8.0 * error_p + 1e-12
        to_goal = R[0] @ turns_about(axis, Interval([angle])).centred()[0][0] - R[-1]
        require(np.abs(to_goal) <= STATE, f"{label}: the hand turns in a way that is not known")
        evenly, error_Q = turns_about(axis, Interval(angle * share)).centred()
        error = 18.0 * error_R + 9.0 * error_Q + STATE + 1e-12
        turned = float(norm_bound((R - R[0] @ evenly).reshape(-1, 9)).max()) + error
        return off_m, (turned, 0.18 * float(np.abs(np.diff(angle * share)).max()) ** 2)

    def _bends(self, motion: Polynomials, times_s: Array) -> tuple[float, float]:
        """How far the tip, and entries of its rotation together, may be off chords of cells."""
        starts, ends = times_s[:-1], times_s[1:]
        v, a, _ = motion.peaks(starts, ends)  # plans have no kinks
        eighth = (ends - starts) ** 2 / 8.0 * (1.0 + 1e-9)
        lever = np.full(len(starts), float(norm_bound(self.robot.tip.p.magnitude)))
        _, of_tip = carried(v, a, lever, self.robot.offsets)
        _, of_unit = carried(v, a, np.ones(len(starts)), np.zeros(ARM_JOINTS))
        slack = motion.slack_m(float(self.robot.offsets.sum()) + 1.0)
        bend_m = float((of_tip * eighth).max()) + slack
        return bend_m, 1.7321 * (float((of_unit * eighth).max()) + slack)

    def _require_windows(
        self, label: str, witness: StepWitness, motion: Polynomials, now: _Now, puts_down: bool
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
                T = self._joint_pose(motion.start[0] if is_first else motion.end[0]) * T_joint_body
                self._require_near(label, held, T, name, now.at)
                self._require_slide(motion, begin_s, end_s, now.held)

    def _require_slide(
        self, motion: Polynomials, begin_s: float, end_s: float, held: tuple[str, Pose]
    ) -> None:
        times_s = np.linspace(begin_s, end_s, 129)
        T = self.robot.tips(motion.at(times_s))
        (p, error_p), (R, error_R) = T.p.centred(), T.R.centred()
        bend_m, bend = self._bends(motion, times_s)
        reach_m = float(norm_bound(held[1].p.magnitude)) + max(
            shape.reach_m + float(norm_bound(T.p.magnitude))
            for shape, T in self._things[held[0]].parts
        )
        turned = float(norm_bound((R - R[0]).reshape(-1, 9)).max()) + 18.0 * error_R + bend
        moved = float(norm_bound(np.ptp(p[:, :2], axis=0))) + 4.0 * error_p + 2.0 * bend_m
        slide_m = moved + 2.0 * turned * reach_m
        self._note("slide in contact", motion.label, slide_m)
        require(slide_m <= SLIDE_M, f"{motion.label}: it slides {1e3 * slide_m:.3f} mm in contact")

    def _require_hold(
        self,
        label: str,
        name: str,
        T_joint_body: Pose,
        opening_m: float,
        *,
        fingers: Iterable[str],
        within_m: float = TOUCH_M,
    ) -> None:
        """A pad of each of some fingers touches a body, or is that near."""
        body = self._mover(name, T_joint_body, ARM_JOINTS)
        for finger in fingers:
            shift = np.array([0.0, self.robot.fingers[finger] * opening_m, 0.0])
            away_m = min(
                (
                    self._distances.bound_m(pad, body.root, shift, within_m)
                    for pad in self._pads[finger]
                ),
                default=np.inf,
            )
            if within_m == TOUCH_M:
                self._note("gap of closed pads", f"{label}, {finger} and {name}", away_m)
            require(away_m <= within_m, f"{label}: {finger} is {1e3 * away_m:.3f} mm from {name}")

    def _fall_m(self, label: str, name: str, T: Pose, at: Mapping[str, Pose]) -> float:
        """How far a body falls until it touches something, to `TOUCH_M`."""
        body, falls = self._mover(name, T, 0), []
        for other, T_other in (*at.items(), *self._others.items()):
            below, fallen_m = self._mover(other, T_other, 0), 0.0
            while fallen_m <= DROP_M:
                shift = np.array([0.0, 0.0, -fallen_m])
                away_m = self._distances.bound_m(body.root, below.root, shift, TOUCH_M)
                if away_m <= TOUCH_M:
                    falls.append(fallen_m)
                    break
                fallen_m += max(away_m - 0.5 * TOUCH_M, 0.5 * TOUCH_M)
        require(len(falls) > 0, f"{label}: {name} would fall farther than {1e3 * DROP_M:g} mm")
        self._note("drop at release", f"{label}, {name}", min(falls))
        return min(falls)

    def _joint_pose(self, q: Array) -> Pose:
        T = self.robot.tips(Interval(q[None])) * self.robot.tip.inverse()
        return Pose(T.R[0], T.p[0])

    def _around(self, now: _Now) -> tuple[dict[str, Mover], list[Mover]]:
        """The bodies that stand by themselves, by name, and those in the other hand."""
        solids = {name: self._mover(name, T, 0) for name, T in now.at.items()}
        return solids, [self._mover(name, T, 0) for name, T in self._others.items()]

    def _mover(
        self,
        name: str,
        T: Pose,
        level: int,
        slide_m: tuple[float, float] = (0.0, 0.0),
        wider_m: float = 0.0,
    ) -> Mover:
        """A body of the scene at a pose seen from the frame that carries it."""
        roots = []
        for shape, placed in self._things[name].parts:
            own = replace(shape, ball_m=shape.ball_m + wider_m) if wider_m else shape
            roots.append(self.clusters.add(own, T * placed))
        return Mover(name, self.clusters.joined(roots), level, slide_m)


class _Stated:
    """The states that a plan states, step by step."""

    def __init__(
        self, start: Mapping[str, Any], changes: Sequence[Mapping[str, Any]], timeline: Timeline
    ) -> None:
        self._changes, self._timeline = changes, timeline
        self._joints = {name: float(value) for name, value in start["joints"].items()}
        self._poses = {name: data["T_base_body"] for name, data in start["scene"]["bodies"].items()}
        robot = timeline.robot
        own = {*robot.names, *robot.finger_joints.values()}
        self._still = {name: at for name, at in self._joints.items() if name not in own}
        self._first: Mapping[str, Pose] = {}
        self._others = self._holds(start["attachments"])[1]

    def compare(self, number: int, now: _Now) -> None:
        """Refuse a stated state that differs from the derived one."""
        if not self._changes:
            return
        require(number < len(self._changes), "not every step states its state")
        change = self._changes[number]
        self._joints |= {name: float(value) for name, value in change["joints"].items()}
        self._poses |= change["T_base_bodies"]
        robot = self._timeline.robot
        label = f"step {number + 1}"
        q = np.array([self._joints.get(name, np.nan) for name in robot.names])
        require(np.abs(q - now.arm[0]) <= STATE, f"{label}: the arm is stated elsewhere")
        for finger, sign in robot.fingers.items():
            off_m = abs(sign * self._joints[robot.finger_joints[finger]] - now.opening_m)
            require(off_m <= PRESS_M, f"{label}: the fingers are stated {1e3 * off_m:.2f} mm off")
        for name, at in self._still.items():
            require(self._joints[name] == at, f"{label}: {name} is stated to move")
        own = len(robot.names) + len(robot.finger_joints)
        require(len(self._joints) == len(self._still) + own, f"{label}: joints that are not there")
        self._compare_bodies(label, now)
        held, others = self._holds(change["attachments"])
        expected = [] if now.held is None else [now.held[0]]
        is_same = [name for name, _ in held] == expected and others == self._others
        require(is_same, f"{label}: the hand is stated to hold something else")
        for name, stated in held:
            if now.held is not None:
                T = robot.tip * stated_pose(stated, name)
                self._require_there(label, name, now.held[1], T, loose=True)

    def _compare_bodies(self, label: str, now: _Now) -> None:
        derived = {**now.at, **self._timeline._others}
        self._first = self._first or dict(derived)
        if now.held is not None:
            T_base_joint = self._timeline._joint_pose(now.arm[0])
            derived[now.held[0]] = T_base_joint * now.held[1]
        require(self._poses.keys() == derived.keys(), f"{label}: other bodies are stated")
        for name, T in derived.items():
            is_moved = T is not self._first.get(name)
            stated = stated_pose(self._poses[name], name)
            self._require_there(label, name, T, stated, loose=is_moved)

    def _holds(
        self, attachments: Sequence[Mapping[str, Any]]
    ) -> tuple[list[tuple[str, Any]], list[tuple[str, str, Any]]]:
        """What the hand that moves holds, and what others do."""
        own = f"{self._timeline.robot.limb}_gripper"
        found = [(each["body"], each["link"], each["T_link_body"]) for each in attachments]
        held = [(body, T) for body, link, T in found if link == own]
        return held, [each for each in found if each[1] != own]

    def _require_there(
        self, label: str, name: str, derived: Pose, stated: Pose, *, loose: bool
    ) -> None:
        """What a hand has moved may be stated a little beside, as its fingers are."""
        off_m = float(norm_bound((derived.p - stated.p).magnitude))
        turned = float(norm_bound((derived.R - stated.R).magnitude.reshape(9)))
        within_m, within = (2.0 * PRESS_M, 0.03) if loose else (STATE, STATE)
        is_there = off_m <= within_m and turned <= within
        require(is_there, f"{label}: {name} is stated {1e3 * off_m:.2f} mm off")


def _thing(name: str, data: Mapping[str, Any]) -> _Thing:
    parts = data["parts"]
    require(0 < len(parts) <= MAX_BODIES, f"{name} has no parts, or too many")
    return _Thing(
        name,
        tuple(
            (Shape.of_file(part["shape"], name), stated_pose(part["T_body_part"], name))
            for part in parts
        ),
        bool(data["is_movable"]),
    )


def _within(limit: ArrayLike) -> tuple[Array, Array]:
    """Bounds on what may be as great as a limit, of each joint, in both directions."""
    greatest = np.array(limit, np.float64).reshape(ARM_JOINTS) * (1.0 + LIMIT_RATIO)
    return -greatest, greatest


def _pair(
    first: Mover, second: Mover, least_m: float, end_s: float = 1.0, *, counts: bool = True
) -> Pair:
    """A pair over a whole step."""
    return Pair(first, second, least_m, 0.0, end_s, is_counted=counts)
