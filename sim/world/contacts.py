"""Contacts: what an arm, its hand or what it holds runs into on a move.

The move is looked at every `CHECK_S`, at times of its own that no tick shifts, with the shapes of
the planner. What is at most `PRESSING_TOLERANCE_M` inside another only touches it: pads on a block,
a held block on its table. Contact with a movable body is reported, once for as long as it lasts;
the body stays where it is and the arm goes on, as nothing here knows how it would be pushed.
Contact with anything immovable ends the move, at the last look before it. What passes through
something between two looks goes unseen: at the arm's top speed the tip moves 2 cm meanwhile. How
deep something is in a mesh that is not convex is not known; any contact with one counts.
"""

from __future__ import annotations

import math

import numpy as np

from baxter_kin.display import millimetres, phrase, seconds
from baxter_kin.fields import evolve, frozen
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray, expect
from planner import Body, Part, Plan, Scene, Trajectory
from planner.collision import ClearanceChecker
from planner.collision.context import Touches
from planner.pick_place.phases import MAX_DROP_M
from planner.scene.bodies import Attachment
from planner.scene.contact import PRESSING_TOLERANCE_M, gap_m
from sim.errors import SimulationError
from sim.world.falling import Rest
from sim.world.world import World

CHECK_S = 0.01
"""Time between two looks at a move."""

NEAR_M = 1e-3
"""Shapes that touch are nearer than this."""


@frozen(error=SimulationError, eq=True)
class Contact:
    """Two things that run into each other.

    Attributes:
        time_s: when it is seen, from the start of the move.
        mover: the link of the arm, or the held body.
        other: the body, or the link of the robot, that is in the way.
        is_held: whether `mover` is a held body.
        depth_m: how far they are inside each other then.
        stops: whether it ends the move, because `other` does not give way.
        free_s: the last look at which neither touched more than it may.
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
    """Looks ahead along moves for contacts, in a world that stands still but for one arm.

    Attributes:
        is_trusted: whether a plan's own proofs count; nothing is looked at then.
    """

    def __init__(self, world: World, *, looks: bool = True) -> None:
        """Look at a world, or never at anything."""
        self._world = expect(world, World, "world", SimulationError)
        self.is_trusted, self._looks = False, looks
        self._lasting: dict[str, frozenset[str]] = dict.fromkeys(LIMBS, frozenset())
        self._known: tuple[object, _Surroundings] | None = None

    def along(self, side: str, trajectory: Trajectory) -> list[Contact]:
        """The contacts of a move that begins now, in order; one that stops it is the last."""
        if self.is_trusted or not self._looks:
            return []
        steps = max(1, math.ceil(trajectory.duration / CHECK_S))
        times = np.linspace(0.0, trajectory.duration, steps + 1)
        path = self._configurations(side, trajectory.sample(times).q)
        return self._found(side, path, times, self._surroundings(side))

    def at(self, side: str, q: FloatArray) -> list[Contact]:
        """The contacts of an arm that goes to a configuration nearby, shape (7,), rad, likewise.

        It is looked at there alone, so a way is to be asked for in steps of `CHECK_S`. What the arm
        touched at the last step, and still does, is not told again, unless it stops the arm.
        """
        if self.is_trusted or not self._looks:
            return []
        around = self._surroundings(side)
        for name in self._lasting[side]:
            around = around.less(name)
        return self._found(side, self._configurations(side, q[None]), np.zeros(1), around)

    def is_blocked(self, side: str, q: FloatArray) -> bool:
        """Whether an arm would be in what does not give way at a configuration, shape (7,), rad."""
        if self.is_trusted or not self._looks:
            return False
        around = self._surroundings(side)
        for name in around.movable:
            around = around.less(name)
        return around.is_touched(self._configurations(side, q[None])[0])

    def of_fingers(self, side: str, finger_m: float, speed_m_s: float) -> list[Contact]:
        """The contacts of fingers that go from where they are to a position, likewise.

        What lies between the pads, or was just let go, is theirs to touch: it is left out.
        """
        if self.is_trusted or not self._looks:
            return []
        begin_m = self._world.finger_m(side)
        count = max(1, math.ceil(abs(finger_m - begin_m) / (speed_m_s * CHECK_S)))
        positions = np.linspace(begin_m, finger_m, count + 1)
        full = np.tile(self._world.q, (len(positions), 1))
        hand = self._world.hands[side]
        names = list(hand.finger_joints(0.0))
        where = list(self._world.robot.indices(tuple(names)))
        for row, position in zip(full, positions.tolist(), strict=True):
            row[where] = list(hand.finger_joints(position).values())
        around = self._surroundings(side)
        for name in around.touched_by_pads():
            around = around.less(name)
        return self._found(side, full, np.abs(positions - begin_m) / speed_m_s, around)

    def _found(
        self, side: str, path: FloatArray, times: FloatArray, around: _Surroundings
    ) -> list[Contact]:
        lasting = self._lasting[side]
        found: list[Contact] = []
        for index, q in enumerate(path):
            while around.is_touched(q):
                contact = around.deepest(q, times[index], times[max(index - 1, 0)])
                if index > 0 or contact.other not in lasting:
                    found.append(contact)
                if contact.stops:
                    return found
                around = around.less(contact.other)
        self._lasting[side] = around.touched_at(path[-1])
        return found

    def _configurations(self, side: str, qs: FloatArray) -> FloatArray:
        """Full configurations, shape (n, 19), for those of an arm, shape (n, 7)."""
        full = np.tile(self._world.q, (len(qs), 1))
        full[:, list(self._world.robot.indices(self._world.robot.arm(side).joint_names))] = qs
        return full

    def _surroundings(self, side: str) -> _Surroundings:
        """What is around an arm; made anew when something has moved since the last time."""
        held = self._world.holding(side)
        bodies = [(b.name, b.parts, b.T_base_body.homogeneous.tobytes()) for b in self._world.scene]
        key = side, held, [entry for entry in bodies if held is None or entry[0] != held.body]
        if self._known is None or self._known[0] != key:
            self._known = key, _Surroundings(self._world, side)
        return self._known[1]


class _Surroundings:
    """What one arm may run into, some bodies left out."""

    def __init__(
        self, world: World, side: str, left_out: frozenset[str] = frozenset(), only: str = ""
    ) -> None:
        self._world, self._side, self._left_out = world, side, left_out
        held = world.holding(side)
        along = set() if held is None else {held.body, *world.riders(held.body)}
        away = along | left_out
        self._scene = Scene.of(
            body
            for body in world.scene
            if body.name not in away and (not only or body.name == only)
        )
        arm = world.robot.arm(side)
        carried = self._scene if held is None else self._scene.with_body(_laden(world, held.body))
        self._checker = ClearanceChecker(world.shapes, arm, carried, held=held)
        self._touches = Touches(self._checker, -PRESSING_TOLERANCE_M)
        self._held = None if held is None else held.body
        self._fewer: dict[str, _Surroundings] = {}
        self._alone: dict[str, _Surroundings] = {}

    def is_touched(self, q: FloatArray) -> bool:
        """Whether anything is run into at a full configuration."""
        return self._touches(q)

    @property
    def movable(self) -> list[str]:
        """The bodies that give way."""
        return [body.name for body in self._scene if self._gives_way(body.name)]

    def less(self, name: str) -> _Surroundings:
        """The same without one more body."""
        if name not in self._fewer:
            less = _Surroundings(self._world, self._side, self._left_out | {name})
            self._fewer[name] = less
        return self._fewer[name]

    def touched_by_pads(self) -> list[str]:
        """Movable bodies that a pad touches now: what the hand holds, or has just let go."""
        hand = self._world.hands.get(self._side)
        if hand is None:
            return []
        tip, finger_m = self._world.T_base_tip(self._side), self._world.finger_m(self._side)
        pads = hand.pads_at(tip, finger_m)
        return [
            body.name
            for body in self._scene
            if body.is_movable
            and min(gap_m(pad, part) for pad in pads for part in body.placed_parts)
            <= PRESSING_TOLERANCE_M
        ]

    def touched_at(self, q: FloatArray) -> frozenset[str]:
        """Which of the bodies left out are run into at a full configuration."""
        for name in self._left_out - self._alone.keys():
            self._alone[name] = _Surroundings(self._world, self._side, only=name)
        return frozenset(n for n in self._left_out if self._alone[n].is_touched(q))

    def deepest(self, q: FloatArray, time_s: float, free_s: float) -> Contact:
        """The worst contact at a full configuration."""
        pairs = range(len(self._checker.may_touch))
        distances = self._checker.distances_m(q, pairs, NEAR_M)  # the others are not measured
        pair = int(np.argmin(distances))
        near = self._checker.checked.clearance_of(pair, distances[pair])
        mover, other = near.first, near.second
        if self._is_of_arm(other) and not self._is_of_arm(mover):
            mover, other = other, mover
        return Contact(
            time_s=float(time_s),
            mover=mover,
            other=other,
            is_held=mover == self._held,
            depth_m=-near.distance_m,
            stops=not self._gives_way(other),
            free_s=float(free_s),
        )

    def _is_of_arm(self, name: str) -> bool:
        is_link = name.startswith((f"{self._side}_", f"{self._side[0]}_gripper"))
        return name == self._held or (is_link and name not in self._scene.bodies)

    def _gives_way(self, name: str) -> bool:
        """Whether it is a movable body that no hand holds."""
        holdings = map(self._world.holding, self._world.hands)
        is_held = any(holding is not None and holding.body == name for holding in holdings)
        return name in self._scene.bodies and self._scene[name].is_movable and not is_held


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


AS_PLANNED = 1e-6
"""How far joints (rad, m) and bodies (m, and of rotation matrices) may be from where a plan has
them for its proofs to count; they keep far more distance than that."""


def is_as_planned(world: World, plan: Plan) -> bool:
    """Whether a world is as a plan has it before its first step, so that its proofs count."""
    state = plan.start
    if not _is_held_alike(world.held, state.attachments):
        return False
    own = world.robot.arm(plan.limb).joint_names
    joints, planned = world.state.joints, state.joints
    return (
        joints.keys() == planned.keys()
        and all(name in own or abs(joints[name] - planned[name]) <= AS_PLANNED for name in joints)
        and state.scene.bodies.keys() == world.scene.bodies.keys()
        and all(_is_same(world.body(body.name), body) for body in state.scene)
    )


def falls_as_planned(world: World, name: str, rest: Rest) -> bool:
    """Whether a body that is let go rests as a plan expects: level, on what is just below it."""
    stands = len(rest.legs) == 1 and rest.beside_m == 0.0
    return stands and rest.fall_m <= MAX_DROP_M and not world.riders(name)


def _is_held_alike(held: tuple[Attachment, ...], planned: tuple[Attachment, ...]) -> bool:
    """Whether the hands hold the same bodies in the same places."""
    expected = {holding.side: holding for holding in planned}
    return len(held) == len(planned) and all(
        holding.side in expected
        and holding.body == expected[holding.side].body
        and holding.T_link_body.isApprox(expected[holding.side].T_link_body, AS_PLANNED)
        for holding in held
    )


def _is_same(body: Body, planned: Body) -> bool:
    """Whether two bodies have equal parts and the same place; a mesh equals only itself."""
    return (
        len(body.parts) == len(planned.parts)
        and bool(body.T_base_body.isApprox(planned.T_base_body, AS_PLANNED))
        and all(
            one.shape == two.shape and one.T_body_part.isApprox(two.T_body_part, AS_PLANNED)
            for one, two in zip(body.parts, planned.parts, strict=True)
        )
    )
