"""The nearest two of all pairs of shapes that count, in a scene whose bodies may be anywhere.

The shapes are those that plans are made with. Of the robot these are its links, of which arms that
move are measured against all others, as the planner does (`RobotShapes`); of bodies, those that
stand still against the arms that move, and those in a hand against everything but that hand.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin.validation import FloatArray, Indices
from planner import Body, Scene
from planner.collision.distances import UNKNOWN_DEPTH_M
from planner.collision.robot.robot_shapes import RobotShapes
from planner.collision.shape_pairs import ShapePairsBuilder
from sim.view.telemetry.stated_contacts import Contacts

TIE_M = 1e-4
"""Pairs whose distances differ by no more than this count as equally near. Among these, a pair of
the moving hand is reported: 0.1 mm is the last digit that the page shows."""


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
        """
        self.bodies, self.sides = dict(bodies), tuple(sides)
        self._shapes, self._model = shapes, shapes.robot.model
        self._data, self._robot_count = self._model.createData(), len(shapes.made)
        arms = [shapes.robot.arm(side) for side in self.sides]
        pairs = ShapePairsBuilder(shapes, arms[0])
        self._of_bodies = pairs.add_scene(
            Scene(self.bodies), None, may_press=False, supports=frozenset()
        )
        self._arms = {arm.side: frozenset(shapes.of_arm(arm)) for arm in arms}
        self._moved = frozenset().union(*self._arms.values())
        self._hands = {side: shapes.of_hand(arm) for side, arm in shapes.robot.arms.items()}
        known = set(pairs.pairs)
        for first, second in self._further_pairs():
            if (first, second) not in known:
                known.add((first, second))
                pairs.pair(first, second)
        self._checked = pairs.build()
        placed = [shape.placement.homogeneous for shape in pairs.geometry.geometryObjects]
        self._T_joint_shapes = np.array(placed)
        self._T_body_parts = np.array(
            [part.T_body_part.homogeneous for body in self.bodies.values() for part in body.parts]
        ).reshape(-1, 4, 4)
        joints = [shape.parentJoint for shape in pairs.geometry.geometryObjects]
        self._joints = np.array(joints[: self._robot_count])
        self._thickness_m = [shape.overshoot_m + shape.padding_m for shape in pairs.link_shapes]
        self._owners, self._parts = self._numbered_parts()
        self._counting: dict[tuple[object, ...], tuple[Indices, Indices]] = {}
        self._last = 0

    def at(
        self,
        q: FloatArray,
        T_base_bodies: Mapping[str, FloatArray],
        contacts: Contacts,
        moving: Collection[str] = (),
    ) -> Nearest | None:
        """The nearest two; None where nothing counts.

        Pairs of an arm that stands are left out while the other arm moves: their distances do not
        change, and were measured when that arm came there.

        Args:
            q: a full configuration, shape (19,), rad and m.
            T_base_bodies: of the bodies that are there, by name, shape (4, 4); others than `bodies`
                are passed over.
            contacts: what may touch.
            moving: the sides of the arms that move at this time; all of `sides` when empty.
        """
        there = frozenset(name for name in self.bodies if name in T_base_bodies)
        now = frozenset(moving) or frozenset(self.sides)
        pairs, of_hands = self._pairs_that_count(there, contacts, now)
        if not len(pairs):
            return None
        poses = self._placed(q, T_base_bodies)
        distances = self._checked.distances
        distances.place(poses)
        pair, distance_m = self._least(poses, pairs)
        if len(of_hands) and pair not in of_hands:
            of_hand, its_m = self._least(poses, of_hands, below_m=distance_m + TIE_M)
            if its_m < distance_m + TIE_M:
                pair, distance_m = of_hand, its_m
        near = self._checked.clearance_of(pair, distance_m)
        points = self._on_skins(pair, distances.points(pair, distance_m))
        if distance_m > 0.0:
            distance_m = float(np.linalg.norm(points[1] - points[0]))
        first, second = self._checked.pairs[pair].tolist()
        if self._moves(second, contacts, now) and not self._moves(first, contacts, now):
            return Nearest(distance_m, near.second, near.first, points[::-1])
        return Nearest(distance_m, near.first, near.second, points)

    def _moves(self, shape: int, contacts: Contacts, moving: Collection[str]) -> bool:
        """Whether a shape is of an arm that moves now, or in its hand."""
        owner = int(self._owners[shape])
        if owner < 0:
            return any(shape in self._arms[side] for side in moving)
        return contacts.holder(list(self.bodies)[owner]) in moving

    def _is_of_hand(self, shape: int, contacts: Contacts, moving: Collection[str]) -> bool:
        """Whether a shape is a moving hand, or what it holds."""
        if int(self._owners[shape]) < 0:
            return any(shape in self._hands[side] for side in moving)
        return self._moves(shape, contacts, moving)

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

    def _numbered_parts(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """For each shape the number of its body, -1 for those of the robot, and of its part."""
        owners, parts = np.full((2, len(self._thickness_m)), -1)
        for number, own in enumerate(self._of_bodies.values()):
            owners[own], parts[own] = number, np.arange(len(own))
        return owners, parts

    def _pairs_that_count(
        self, there: frozenset[str], contacts: Contacts, moving: frozenset[str]
    ) -> tuple[Indices, Indices]:
        """The pairs of what moves now, and those of them that are of a moving hand."""
        key = (there, moving, contacts)
        if key not in self._counting:
            if len(self._counting) > MOST_KEPT:
                self._counting.clear()
            counted = np.flatnonzero(self._counts(there, contacts))
            numbers = self._checked.pairs
            moved, of_hands = (
                [p for p in counted if any(test(s, contacts, moving) for s in numbers[p].tolist())]
                for test in (self._moves, self._is_of_hand)
            )
            self._counting[key] = np.array(moved, np.intp), np.array(of_hands, np.intp)
        return self._counting[key]

    def _counts(self, there: frozenset[str], contacts: Contacts) -> NDArray[np.bool_]:
        """Whether each pair counts: robot and robot, robot and body, body and body."""
        names = list(self.bodies)
        counts = np.ones(len(self._checked.pairs), dtype=np.bool_)
        for number, pair in enumerate(self._checked.pairs.tolist()):
            links = [shape for shape in pair if self._owners[shape] < 0]
            parts = [
                (names[self._owners[shape]], int(self._parts[shape]))
                for shape in pair
                if self._owners[shape] >= 0
            ]
            if not there.issuperset(name for name, _ in parts):
                counts[number] = False
            elif len(parts) == 1:
                counts[number] = self._link_counts(links[0], parts[0][0], contacts)
            elif len(parts) == 2:
                is_carried = any(contacts.holder(name) is not None for name, _ in parts)
                counts[number] = is_carried and not contacts.of_bodies(*parts)
        return counts

    def _link_counts(self, link: int, name: str, contacts: Contacts) -> bool:
        holder = contacts.holder(name)
        if holder is not None:
            return link not in self._hands[holder]
        may_touch = self.bodies[name].is_movable and any(
            link in self._hands[side] and contacts.of_hand(side, name) for side in self._hands
        )
        return link in self._moved and not may_touch

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

    def _least(
        self, poses: FloatArray, pairs: Indices, below_m: float = np.inf
    ) -> tuple[int, float]:
        """The nearest of some pairs, the one of the last call measured first.

        The distance is `below_m` where no pair is nearer than that.
        """
        distances = self._checked.distances
        bounds = self._checked.gaps_m(poses[None], np.zeros_like(pairs), pairs)
        nearest, least_m = int(pairs[0]), below_m
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
        first_m, second_m = (self._thickness_m[i] for i in self._checked.pairs[pair].tolist())
        if apart_m <= first_m + second_m:
            return points
        along = between / apart_m
        return np.array([points[0] + first_m * along, points[1] - second_m * along])


MOST_KEPT = 200
"""So many situations are remembered with their pairs."""
