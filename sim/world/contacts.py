"""Contacts: what an arm, its hand or what it holds runs into on a move; and so for both arms.

A move is checked every `CHECK_S`, at times of its own that do not depend on the tick, with the
shapes of the planner. What is at most `PRESSING_TOLERANCE_M` inside another only touches it: pads
on a block, a held block on its table. A collision with a movable body is reported once for as long
as it lasts; the body stays where it is and the arm goes on, as nothing here knows how it would be
pushed. A collision with anything immovable ends the move, at the last check before it. Between two
checks the tip moves by up to 2 cm at the arm's top speed, so something thinner can be missed. The
depth in a mesh that is not convex is not known; any contact with one counts.

A certified plan is not checked while the world is as its steps state (`is_as_stated`).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Container, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from itertools import product

import numpy as np
import pinocchio as pin

from baxter_kin.display import millimetres, phrase, seconds
from baxter_kin.fields import evolve, frozen
from baxter_kin.kinematics.arm import LIMBS, other_than
from baxter_kin.validation import FloatArray, expect
from planner import Body, Grip, Part, Scene, TwoArmPlan
from planner.collision import ClearanceChecker
from planner.collision.context import Touches
from planner.plan import Step
from planner.scene.bodies import Attachment
from planner.scene.contact import PRESSING_TOLERANCE_M, depth_m
from sim.errors import SimulationError
from sim.world.world import World

CHECK_S = 0.01
"""Time between two checks of a move."""

NEAR_M = 1e-3
"""Shapes that touch are nearer than this."""

STATED_TOLERANCE = 1e-6
"""Maximum distance of joints (rad, m) and bodies (m, and of rotation matrices) from where a plan
states them for its proofs to count; they keep far more distance than that."""


@frozen(error=SimulationError, eq=True)
class Contact:
    """Two things that run into each other.

    Attributes:
        time_s: when it is found, since the beginning of the motion that was checked.
        mover: the link of the arm, or the held body.
        other: the body, or the link of the robot, that is in the way.
        is_held: whether `mover` is a held body.
        depth_m: how far they are inside each other then.
        stops: whether it ends the move, because `other` does not give way.
        free_s: the last check at which neither touched more than it may.
    """

    time_s: float
    mover: str
    other: str
    is_held: bool
    depth_m: float
    stops: bool
    free_s: float

    def _facts(self) -> tuple[str, ...]:
        touch = f"{phrase(self.mover)} {millimetres(self.depth_m)} inside {phrase(self.other)}"
        return touch, f"at {seconds(self.time_s)}", "stops" if self.stops else ""


class ContactWatch:
    """Finds the contacts of moves, in a world in which all else stands still."""

    def __init__(self, world: World) -> None:
        self._world = expect(world, World, "world", SimulationError)
        self._lasting: dict[str, frozenset[str]] = dict.fromkeys(LIMBS, frozenset())
        self._known: dict[str, tuple[object, _Surroundings]] = {}

    def along(
        self, paths: Mapping[str, FloatArray], times_s: FloatArray, sides: Sequence[str]
    ) -> list[tuple[str, Contact]]:
        """The contacts of arms that move from now on, in order; one that stops them is the last.

        Args:
            paths: of each arm that moves, configurations, shape (n, 7), rad.
            times_s: their times, shape (n,), in steps of at most `CHECK_S`.
            sides: the arms whose contacts are sought: one, or both, which may move together.

        Returns:
            Each contact with its arm.
        """
        return self._contacts(sides, self._configurations(paths), times_s, moving=paths)

    def at(self, side: str, q: FloatArray) -> list[Contact]:
        """The contacts of an arm that goes to a configuration nearby, shape (7,), rad, likewise.

        Only that configuration is checked, so a path must be given in steps of `CHECK_S`. What the
        arm touched at the last step, and still does, is not reported again, unless it stops it.
        """
        path = self._configurations({side: q[None]})
        found = self._contacts((side,), path, np.zeros(1), self._lasting[side])
        return [contact for _, contact in found]

    def is_blocked(self, side: str, q: FloatArray) -> bool:
        """Whether an arm would be in what does not give way at a configuration, shape (7,), rad."""
        return self._surroundings(side, (side,)).blocks(self._configurations({side: q[None]})[0])

    def of_fingers(self, side: str, finger_m: float, speed_m_s: float) -> list[Contact]:
        """The contacts of fingers that go from where they are to a position, likewise.

        What is between the pads, or was just released, is left out.
        """
        world, hand = self._world, self._world.hands[side]
        T_base_tip, begin_m = world.T_base_tip(side), world.finger_m(side)
        count = max(1, math.ceil(abs(finger_m - begin_m) / (speed_m_s * CHECK_S)))
        positions_m = np.linspace(begin_m, finger_m, count + 1)
        path = np.tile(world.q, (count + 1, 1))
        where = list(world.robot.indices(hand.joint_names))
        path[:, where] = [list(hand.finger_joints(x).values()) for x in positions_m.tolist()]
        between_pads = [
            body.name
            for body in world.scene
            if body.is_movable and hand.room_m(T_base_tip, begin_m, body) <= PRESSING_TOLERANCE_M
        ]
        times_s = np.abs(positions_m - begin_m) / speed_m_s
        found = self._contacts((side,), path, times_s, between_pads)
        return [contact for _, contact in found]

    def _contacts(
        self,
        sides: Sequence[str],
        path: FloatArray,
        times_s: FloatArray,
        left_out: Iterable[str] = (),
        moving: Container[str] = LIMBS,
    ) -> list[tuple[str, Contact]]:
        """The contacts of arms along full configurations, shape (n, 19), at times, shape (n,).

        Of an arm of `sides` that does not move, only those with what does not give way count, such
        as the other arm: its fingers may press on what they are about to grasp, or have released.
        """
        around = {side: self._surroundings(side, sides) for side in sides}
        loads = _Loads(self._world, sides)
        passed, found = {side: set(left_out) for side in sides}, list[tuple[str, Contact]]()
        touching: dict[str, dict[str, list[int]]] = {}
        for index, q in enumerate(path):
            span_s = float(times_s[index]), float(times_s[max(index - 1, 0)])
            touching = {side: around[side].touching(q) for side in sides}
            new = [
                (side, around[side].deepest(q, pairs, *span_s))
                for side in sides
                for other, pairs in touching[side].items()
                if other not in passed[side]
                and (side in moving or not around[side].gives_way(other))
            ]
            if loads.are_two:
                new += [(sides[0], contact) for contact in loads.contacts(q, *span_s)]
            for side, contact in sorted(new, key=lambda each: -each[1].depth_m):
                if index > 0 or contact.other not in self._lasting[side]:
                    found.append((side, contact))
                if contact.stops:
                    return found
                passed[side].add(contact.other)
        for side in (side for side in sides if side in moving):
            self._lasting[side] = frozenset(passed[side].intersection(touching[side]))
        return found

    def _configurations(self, paths: Mapping[str, FloatArray]) -> FloatArray:
        """Full configurations, shape (n, 19), for those of arms, each of shape (n, 7)."""
        full = np.tile(self._world.q, (len(next(iter(paths.values()))), 1))
        robot = self._world.robot
        for side, qs in paths.items():
            full[:, list(robot.indices(robot.arm(side).joint_names))] = qs
        return full

    def _surroundings(self, side: str, sides: Sequence[str]) -> _Surroundings:
        """What is around an arm; made anew when something has moved, except with a hand.

        Bodies that other hands of `sides` hold are left out, as they may move along.
        """
        world = self._world
        carried = {each.body for each in world.held if each.side in sides}
        along = {name for each in world.held for name in (each.body, *world.riders(each.body))}
        poses = world.body_poses()
        bodies = [
            (name, world.parts(name), name not in along and poses[name].homogeneous.tobytes())
            for name in poses
            if name not in carried
        ]
        key = world.held, bodies
        if side not in self._known or self._known[side][0] != key:
            self._known[side] = key, _Surroundings(self._world, side, carried)
        return self._known[side][1]


class _Loads:
    """What both hands hold, where both arms may move; nothing otherwise.

    Hands that hold one body tear it apart where they would have it at different poses.
    """

    def __init__(self, world: World, sides: Sequence[str]) -> None:
        held = [each for each in map(world.holding, sides) if each is not None]
        self.are_two = len(held) == len(LIMBS)
        self._held = held if self.are_two else []
        self._bodies = [_laden(world, each.body) for each in self._held]
        self._robot = world.robot

    def contacts(self, q: FloatArray, time_s: float, free_s: float) -> Iterator[Contact]:
        """The contact of one with the other at a full configuration, if there is one."""
        poses = []
        for each in self._held:
            arm = self._robot.arm(each.side)
            q_arm = q[list(self._robot.indices(arm.joint_names))]
            poses.append(arm.T_base_tip(q_arm) * each.T_link_body)
        if not poses:
            return
        first, second = (body.at(T) for body, T in zip(self._bodies, poses, strict=True))
        if first.name == second.name:
            inside_m, other = _farthest_m(first, poses[1]), self._held[1].link
        else:
            inside_m, other = depth_m(first, second), second.name
        if inside_m > PRESSING_TOLERANCE_M:
            yield Contact(time_s, first.name, other, True, inside_m, True, free_s)


class _Surroundings:
    """Everything that one arm, and what it holds, may run into."""

    def __init__(self, world: World, side: str, carried: Collection[str]) -> None:
        """Build the geometry; `carried` are held bodies that may move."""
        held = world.holding(side)
        hands = [each for each in world.held if held is not None and each.body == held.body]
        away = {each for name in carried for each in (name, *world.riders(name))}
        self._scene = Scene.of(body for body in world.scene if body.name not in away)
        self._in_hands = {each.body for each in world.held}
        self._held, self._side = None if held is None else held.body, side
        scene = self._scene if held is None else self._scene.with_body(_laden(world, held.body))
        self._checker = ClearanceChecker(world.shapes, world.robot.arm(side), scene, held=hands)
        for each in world.held:
            if each.body not in carried and each not in hands:
                self._hang(world, each)
        self._touches = Touches(self._checker, -PRESSING_TOLERANCE_M)

    def _hang(self, world: World, held: Attachment) -> None:
        """Let what the other hand holds, and what stands on that, move with that hand."""
        model, geometry = world.robot.model, self._checker.geometry
        frame = model.frames[model.getFrameId(held.link)]
        T_joint_base = frame.placement * world.T_base_tip(held.side).inverse()
        names = {held.body, *world.riders(held.body)}
        for shape in geometry.geometryObjects:
            if shape.name.rpartition("/")[0] in names:
                shape.placement = T_joint_base * shape.placement
                shape.parentJoint = frame.parentJoint

    def touching(self, q: FloatArray) -> dict[str, list[int]]:
        """What is run into at a full configuration: its name, and the numbers of the pairs."""
        found: dict[str, list[int]] = {}
        for pair in self._touches.pairs(q) if self._touches(q) else ():
            found.setdefault(self._names(pair)[1], []).append(pair)
        return found

    def deepest(self, q: FloatArray, pairs: list[int], time_s: float, free_s: float) -> Contact:
        """The contact of the deepest of some pairs at a full configuration."""
        distances_m = self._checker.distances_m(q, pairs, NEAR_M)
        nearest = int(np.argmin(distances_m))
        mover, other = self._names(pairs[nearest])
        is_held, stops = mover == self._held, not self.gives_way(other)
        return Contact(time_s, mover, other, is_held, -distances_m[nearest], stops, free_s)

    @cached_property
    def blocks(self) -> Touches:
        """Whether the arm is in what does not give way at a full configuration."""
        pairs = range(len(self._checker.pairs))
        passed = [pair for pair in pairs if self.gives_way(self._names(pair)[1])]
        return Touches(self._checker, -PRESSING_TOLERANCE_M, left_out=passed)

    def _names(self, pair: int) -> tuple[str, str]:
        """The link of the arm, or the held body, and what it may run into."""
        near = self._checker.checked.clearance_of(pair, 0.0)
        if self._is_of_arm(near.second) and not self._is_of_arm(near.first):
            return near.second, near.first
        return near.first, near.second

    def _is_of_arm(self, name: str) -> bool:
        is_link = name.startswith((f"{self._side}_", f"{self._side[0]}_gripper"))
        return name == self._held or (is_link and name not in self._scene.bodies)

    def gives_way(self, name: str) -> bool:
        """Whether it is a movable body that no hand holds."""
        body = self._scene.bodies.get(name)
        return body is not None and body.is_movable and name not in self._in_hands


def _farthest_m(body: Body, T_base_moved: pin.SE3) -> float:
    """How far a point of the box around a body moves at most to another pose, m."""
    corners = np.array(list(product(*(body.extent_m(axis) for axis in np.eye(3)))))
    T = T_base_moved * body.T_base_body.inverse()
    moved = corners @ T.rotation.T + T.translation - corners
    return float(np.linalg.norm(moved, axis=1).max())


def _laden(world: World, name: str) -> Body:
    """A held body with what stands on it, as one body."""
    body = world.body(name)
    T_body_base = body.T_base_body.inverse()
    parts = [
        Part(part.shape, T_body_base * rider.T_base_body * part.T_body_part)
        for rider in map(world.body, world.riders(name))
        for part in rider.parts
    ]
    return evolve(body, parts=(*body.parts, *parts))


def left_out(plan: TwoArmPlan, side: str) -> list[frozenset[str]]:
    """The bodies of which each step of one arm's own plan says nothing, as the other handles them.

    A body that is handed over is the giver's until it is released, the taker's from its grasp on;
    one that both carry belongs to both.
    """
    names = {
        each: {step.body for step in plan.plans[each] if isinstance(step, Grip) and step.body}
        for each in LIMBS
    }
    other = other_than(side)
    received = {step.body for step in plan.plans[other] if isinstance(step, Grip) and step.receiver}
    mine, found = names[side] - received, list[frozenset[str]]()
    for step in plan.plans[side]:
        found.append(frozenset(names[other] - mine))
        if isinstance(step, Grip) and step.body:
            mine = mine - {step.body} if step.receiver else mine | {step.body}
    return found


def is_as_stated(world: World, step: Step, others: Collection[str] | None = None) -> bool:
    """Whether a world is as a step of a plan states it, so that the plan's proofs count.

    Nothing may stand on a held body, because a plan does not move that along.

    Args:
        world: the world as it is now.
        step: the step that begins.
        others: for a plan of both arms, bodies that are not compared (`left_out`); the other arm,
            its hand and what it holds are not, either. None for a plan of one arm.
    """
    now, stated = world.state, step.state
    if stated is None or any(world.riders(each.body) for each in now.attachments):
        return False
    apart, sides = set(others or ()), (step.limb,) if others is not None else LIMBS
    skipped = {name for side in LIMBS if side not in sides for name in _joint_names(world, side)}
    held, stated_held = (
        [each for each in state.attachments if each.side in sides] for state in (now, stated)
    )
    in_hands = {each.body for each in held}  # these are where hands and attachments say
    names, stated_names = (set(state.scene.bodies) - apart for state in (now, stated))
    return (
        _are_held_alike(held, stated_held)
        and now.joints.keys() == stated.joints.keys()
        and all(
            abs(q - stated.joints[name]) <= STATED_TOLERANCE
            for name, q in now.joints.items()
            if name not in skipped
        )
        and names == stated_names
        and all(_are_alike(now.scene[each], stated.scene[each], each in in_hands) for each in names)
    )


def _joint_names(world: World, side: str) -> tuple[str, ...]:
    """The joints of an arm and its hand."""
    hand = world.hands.get(side)
    return (*world.robot.arm(side).joint_names, *(hand.joint_names if hand else ()))


def _are_held_alike(held: Sequence[Attachment], stated: Sequence[Attachment]) -> bool:
    """Whether the hands hold the same bodies in the same places."""
    by_side = {each.side: each for each in stated}
    return len(held) == len(stated) and all(
        each.side in by_side
        and each.body == by_side[each.side].body
        and _is_near(each.T_link_body, by_side[each.side].T_link_body)
        for each in held
    )


def _are_alike(body: Body, stated: Body, is_held: bool) -> bool:
    """Whether two bodies have equal parts and, unless held, one pose; a mesh equals only itself."""
    return (
        len(body.parts) == len(stated.parts)
        and (is_held or _is_near(body.T_base_body, stated.T_base_body))
        and all(
            one.shape == two.shape and _is_near(one.T_body_part, two.T_body_part)
            for one, two in zip(body.parts, stated.parts, strict=True)
        )
    )


def _is_near(T: pin.SE3, stated: pin.SE3) -> bool:
    """Whether two poses are equal within `STATED_TOLERANCE`."""
    return bool(np.abs(T.homogeneous - stated.homogeneous).max() <= STATED_TOLERANCE)
