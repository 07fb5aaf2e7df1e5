"""The nearest two of all pairs of shapes that count, in a scene whose bodies may be anywhere.

The shapes are those that plans are made with. Of the robot these are its links, of which arms that
move are measured against all others, as the planner does (`RobotShapes`); of bodies, those that
stand still against the arms that move, and those in a hand against everything but that hand.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin.validation import FloatArray, Indices
from planner import Body, Scene
from planner.collision.distances import UNKNOWN_DEPTH_M
from planner.collision.robot.robot_shapes import RobotShapes
from planner.collision.shape_pairs import ShapePairs


@dataclass(frozen=True, slots=True, eq=False)
class Nearest:
    """The two that are nearest to each other.

    Attributes:
        distance_m: negative when they are inside each other, as `Clearance` has it.
        first: link or body; what moves, where the other does not.
        second: link or body.
        points_base: where they are nearest, on the first and on the second, shape (2, 3), m; so far
            apart, unless they touch.
    """

    distance_m: float
    first: str
    second: str
    points_base: FloatArray


@dataclass(frozen=True, slots=True)
class Contacts:
    """What holds what, and what may touch at some time.

    Attributes:
        held: body by side of the hand that holds it.
        by_hand: (side, body): the hand grasps it, is about to, or has just let it go.
        by_body: (held body, body): it stood on it, will stand on it, or carries it.
    """

    held: Mapping[str, str] = field(default_factory=dict)
    by_hand: frozenset[tuple[str, str]] = frozenset()
    by_body: frozenset[tuple[str, str]] = frozenset()

    @property
    def key(self) -> tuple[object, ...]:
        """Equal where all of it is."""
        return tuple(sorted(self.held.items())), self.by_hand, self.by_body


class NearestPairs:
    """Measures them for a robot and some bodies; not for several threads at once.

    Attributes:
        bodies: those that count, by name.
        sides: of the arms that move.
    """

    def __init__(
        self, shapes: RobotShapes, sides: Collection[str], bodies: Mapping[str, Body]
    ) -> None:
        """Collect all pairs that may ever count.

        Args:
            shapes: the robot's.
            sides: of the arms that move, at least one.
            bodies: by name.

        Raises:
            SceneError: when the robot lacks links that its shapes have.
        """
        self.bodies, self.sides = dict(bodies), tuple(sides)
        self._shapes, self._model = shapes, shapes.robot.model
        self._data, self._robot_count = self._model.createData(), len(shapes.made)
        arms = [shapes.robot.arm(side) for side in self.sides]
        pairs = ShapePairs(shapes, arms[0])
        self._of_bodies = pairs.add_scene(
            Scene(self.bodies), None, may_press=False, supports=frozenset()
        )
        self._moved = frozenset().union(*(shapes.of_arm(arm) for arm in arms))
        self._hands = {side: shapes.of_hand(arm) for side, arm in shapes.robot.arms.items()}
        known = set(pairs.numbers)
        for first, second in self._further_pairs():
            if (first, second) not in known:
                known.add((first, second))
                pairs.pair(first, second)
        self._checked = pairs.built()
        placed = [shape.placement.homogeneous for shape in pairs.geometry.geometryObjects]
        self._T_joint_shapes = np.array(placed)
        self._T_body_parts = np.array(
            [part.T_body_part.homogeneous for body in self.bodies.values() for part in body.parts]
        ).reshape(-1, 4, 4)
        joints = [shape.parentJoint for shape in pairs.geometry.geometryObjects]
        self._joints = np.array(joints[: self._robot_count])
        self._thickness_m = [made.margin_m + made.padding_m for made in pairs.made]
        self._owners = self._named_owners()
        self._counting: dict[tuple[object, ...], Indices] = {}
        self._last = 0

    def at(
        self, q: FloatArray, T_base_bodies: Mapping[str, FloatArray], contacts: Contacts
    ) -> Nearest | None:
        """The nearest two; None where nothing counts.

        Args:
            q: a full configuration, shape (19,), rad and m.
            T_base_bodies: of the bodies that are there, by name, shape (4, 4); others than `bodies`
                are passed over.
            contacts: what may touch.
        """
        there = frozenset(name for name in self.bodies if name in T_base_bodies)
        pairs = self._pairs_that_count(there, contacts)
        if not len(pairs):
            return None
        poses = self._placed(q, T_base_bodies)
        distances = self._checked.distances
        distances.place(poses)
        pair, distance_m = self._least(poses, pairs)
        near = self._checked.between(pair, distance_m)
        points = self._on_skins(pair, distances.points(pair, distance_m))
        if distance_m > 0.0:
            distance_m = float(np.linalg.norm(points[1] - points[0]))
        first, second = self._checked.numbers[pair].tolist()
        if self._moves(second, contacts) and not self._moves(first, contacts):
            return Nearest(distance_m, near.second, near.first, points[::-1])
        return Nearest(distance_m, near.first, near.second, points)

    def _moves(self, shape: int, contacts: Contacts) -> bool:
        """Whether a shape is of an arm that moves, or in a hand."""
        owner = int(self._owners[shape])
        held = contacts.held.values()
        return list(self.bodies)[owner] in held if owner >= 0 else shape in self._moved

    def _further_pairs(self) -> set[tuple[int, int]]:
        """Those of the other arms that move, and of bodies that can be carried."""
        shapes, wholes = self._shapes, self._shapes.wholes
        found: set[tuple[int, int]] = set()
        for side in self.sides[1:]:
            arm = shapes.robot.arm(side)
            found.update(shapes.pairs_of(arm))
            of_arm = shapes.of_arm(arm) & wholes
            every = [index for own in self._of_bodies.values() for index in own]
            found.update((link, index) for index in every for link in of_arm)
        for name, own in self._of_bodies.items():
            if not self.bodies[name].is_movable:
                continue
            others = [i for other, its in self._of_bodies.items() if other != name for i in its]
            found.update((link, index) for index in own for link in wholes - self._moved)
            found.update((min(index, i), max(index, i)) for index in own for i in others)
        return found

    def _named_owners(self) -> NDArray[np.intp]:
        """For each shape the number of its body, from 0; -1 for those of the robot."""
        owners = np.full(len(self._thickness_m), -1)
        for number, own in enumerate(self._of_bodies.values()):
            owners[own] = number
        return owners

    def _pairs_that_count(self, there: frozenset[str], contacts: Contacts) -> Indices:
        key = (there, *contacts.key)
        if key not in self._counting:
            if len(self._counting) > MOST_KEPT:
                self._counting.clear()
            self._counting[key] = np.flatnonzero(self._counts(there, contacts))
        return self._counting[key]

    def _counts(self, there: frozenset[str], contacts: Contacts) -> NDArray[np.bool_]:
        """Whether each pair counts: robot and robot, robot and body, body and body."""
        names = list(self.bodies)
        held = {body: side for side, body in contacts.held.items()}
        counts = np.zeros(len(self._checked.numbers), dtype=np.bool_)
        for number, (first, second) in enumerate(self._checked.numbers.tolist()):
            owners = self._owners[first], self._owners[second]
            of = [names[owner] for owner in owners if owner >= 0]
            if not there.issuperset(of):
                continue
            if len(of) == 1:
                link = first if owners[0] < 0 else second
                counts[number] = self._link_counts(link, of[0], held, contacts)
            elif len(of) == 2:
                is_carried = not held.keys().isdisjoint(of)
                may_touch = contacts.by_body.isdisjoint([(of[0], of[1]), (of[1], of[0])])
                counts[number] = is_carried and may_touch
            else:
                counts[number] = True
        return counts

    def _link_counts(
        self, link: int, body: str, held: Mapping[str, str], contacts: Contacts
    ) -> bool:
        if body in held:
            return link not in self._hands[held[body]]
        return link in self._moved and not any(
            link in self._hands[side] for side, name in contacts.by_hand if name == body
        )

    def _placed(self, q: FloatArray, T_base_bodies: Mapping[str, FloatArray]) -> FloatArray:
        """Poses of all shapes in base, shape (n, 4, 4); those of absent bodies anywhere."""
        pin.forwardKinematics(self._model, self._data, q)
        joints = np.array([T.homogeneous for T in self._data.oMi])
        count, bodies = self._robot_count, self.bodies.items()
        links = joints[self._joints] @ self._T_joint_shapes[:count]
        away = np.eye(4)
        of_parts = [T_base_bodies.get(name, away) for name, body in bodies for _ in body.parts]
        parts = np.array(of_parts).reshape(-1, 4, 4) @ self._T_body_parts
        placed: FloatArray = np.concatenate([links, parts])
        return placed

    def _least(self, poses: FloatArray, pairs: Indices) -> tuple[int, float]:
        """The nearest of some pairs, the one of last time looked at first."""
        distances = self._checked.distances
        bounds = self._checked.gaps_m(poses[None], np.zeros_like(pairs), pairs)
        nearest, least_m = int(pairs[0]), np.inf
        limits = dict(zip(pairs.tolist(), bounds.tolist(), strict=True))
        order = pairs[np.argsort(bounds)].tolist()
        if self._last in limits:
            order.remove(self._last)
            order.insert(0, self._last)
        for pair in order:
            if limits[pair] >= max(least_m, 0.0):
                break
            distance_m = distances.measure(pair, max(least_m, 0.0))
            if distance_m > 0.0 and distances.is_within(pair):
                distance_m = UNKNOWN_DEPTH_M
            if distance_m < least_m:
                nearest, least_m = pair, distance_m
        self._last = nearest
        return nearest, least_m

    def _on_skins(self, pair: int, points: FloatArray) -> FloatArray:
        """Points of two shapes moved towards each other by what these count as thicker."""
        between = points[1] - points[0]
        apart_m = float(np.linalg.norm(between))
        first_m, second_m = (self._thickness_m[i] for i in self._checked.numbers[pair].tolist())
        if apart_m <= first_m + second_m:
            return points
        along = between / apart_m
        return np.array([points[0] + first_m * along, points[1] - second_m * along])


MOST_KEPT = 200
"""So many situations are remembered with their pairs."""
