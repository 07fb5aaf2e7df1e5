"""Pairs of shapes: which are checked in a situation, and what each pair may do.

Pinocchio and coal work on one geometry model: the robot's shapes, the bodies of the scene, and the
body in the hand. A model is built for each situation and never changed afterwards, because adding
shapes to one in use corrupts its memory.
"""

from __future__ import annotations

from collections.abc import Mapping, Set
from functools import cached_property
from itertools import product
from typing import TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin import Arm
from baxter_kin.validation import FloatArray, Indices
from planner.clearance import Clearance
from planner.collision.covers import Covers
from planner.collision.distances import Distances, Enclosure
from planner.collision.robot.cluster_trees import ClusterTree, tree_of_part
from planner.collision.robot.link_shapes import LinkShape
from planner.collision.robot.robot_shapes import RobotShapes
from planner.scene.bodies import Body, Scene, Shape
from planner.scene.contact import (
    PRESSING_TOLERANCE_M,
    PartContact,
    coal_shape,
    convex_pieces,
    has_depth,
)

Supports: TypeAlias = Set[PartContact | str]
"""What a held or pushed body may touch: parts that touch, or bodies of which any part may."""


class ShapePairs:
    """The shapes of a situation, and the pairs of them that are checked, while it is built.

    Attributes:
        geometry: all shapes, without pairs; the robot's first, as `RobotShapes` numbers them.
        numbers: the shapes of every pair.
        made: all shapes, and what is known of each.
        needs_m: of the pairs that may be nearer than a margin because that is meant: the number of
            the pair -> the distance that it must exceed, negative for a contact that may press.
        wholes: for each shape, the number of the one that stands for all that it is a piece of.
        shapes: of parts of bodies, by the numbers that stand for them.
    """

    def __init__(self, shapes: RobotShapes, arm: Arm) -> None:
        """For an arm, its own pairs among them."""
        self._robot, self._arm = shapes, arm
        self.geometry: pin.GeometryModel = shapes.model.copy()
        self.numbers: list[tuple[int, int]] = list(shapes.pairs_of(arm))
        self.made: list[LinkShape] = list(shapes.made)
        self.needs_m: dict[int, float] = {}
        self._part_of: dict[int, int] = {}  # shape of a body -> number of its part
        self.wholes: list[int] = list(shapes.whole_of)
        self.shapes: dict[int, Shape] = {}

    def add_scene(
        self, scene: Scene, touchable: str | None, *, may_press: bool, supports: Supports
    ) -> dict[str, list[int]]:
        """Add bodies that stand still, and their pairs with the arm; gives the shapes of each.

        Args:
            scene: the bodies.
            touchable: name of the one that the hand may come near.
            may_press: whether its pads may touch it.
            supports: what another body may touch of them.
        """
        supporting = _names_of(supports)
        shapes, arm = self._robot, self._robot.of_arm(self._arm)
        hand, pads = shapes.of_hand(self._arm), shapes.of_pads(self._arm)
        added = {}
        for body in scene:
            is_near = body.name == touchable
            of_arm = sorted(arm & (shapes.details if is_near else shapes.wholes))
            in_pieces = is_near or body.name in supporting
            added[body.name] = self._add(body, 0, body.T_base_body, in_pieces=in_pieces)
            for index, other in product(added[body.name], of_arm):
                need_m = None
                if is_near and other in hand:
                    need_m = -PRESSING_TOLERANCE_M if may_press and other in pads else 0.0
                self.pair(other, index, need_m=need_m)
        return added

    def add_held(
        self, body: Body, T_tip_body: pin.SE3, bodies: Mapping[str, list[int]], supports: Supports
    ) -> None:
        """Add what is in the hand, and its pairs with the robot and with bodies by their shapes.

        Args:
            body: what is held.
            T_tip_body: its pose seen from the tip.
            bodies: the shapes of all others.
            supports: what it may touch of them.
        """
        robot = self._robot.robot.model
        tip = robot.frames[robot.getFrameId(self._arm.tip_frame)]
        in_pieces = not _names_of(supports).isdisjoint(bodies)
        T_joint_body = tip.placement * T_tip_body
        links = self._robot.wholes - self._robot.of_hand(self._arm)
        for index in self._add(body, tip.parentJoint, T_joint_body, in_pieces=in_pieces):
            self.pair_with_all(index, links, bodies, supports)

    def pair_with_all(
        self, index: int, links: Set[int], bodies: Mapping[str, list[int]], supports: Supports
    ) -> None:
        """Check a shape of a body against links and other bodies, some of which it may touch."""
        for link in sorted(links):
            self.pair(index, link)
        part = self._part_of[index]
        for name, others in bodies.items():
            for other in others:
                contact = PartContact(part, name, self._part_of[other])
                may_touch = name in supports or contact in supports
                self.pair(index, other, need_m=-PRESSING_TOLERANCE_M if may_touch else None)

    def _add(
        self, body: Body, joint: int, T_joint_body: pin.SE3, *, in_pieces: bool = False
    ) -> list[int]:
        """Add a body's shapes; in convex pieces where a depth must be known, as in contacts."""
        added = []
        for number, part in enumerate(body.parts):
            placement = T_joint_body * part.T_body_part
            shapes = convex_pieces(part.shape) if in_pieces else (coal_shape(part.shape),)
            whole = len(self.made)
            self.shapes[whole] = part.shape
            for shape in shapes:
                self.wholes.append(whole)
                name = f"{body.name}/{len(self.made)}"
                placed = pin.GeometryObject(name, joint, placement, shape)
                added.append(int(self.geometry.addGeometryObject(placed)))
                self._part_of[added[-1]] = number
                inside = None if has_depth(shape) else Enclosure.none()
                self.made.append(LinkShape(body.name, shape, inside))
        return added

    def pair(self, first: int, second: int, *, need_m: float | None = None) -> None:
        """Check a pair: against the margin, or against a distance of its own."""
        if need_m is not None:
            self.needs_m[len(self.numbers)] = need_m
        self.numbers.append((first, second))

    def built(self) -> CheckedPairs:
        """What is checked; nothing may be added any more."""
        return CheckedPairs(self, self._robot)


def _names_of(supports: Supports) -> frozenset[str]:
    """Names of the bodies that may be touched."""
    return frozenset(each if isinstance(each, str) else each.other for each in supports)


class CheckedPairs:
    """Pairs of shapes whose distances count in one situation.

    Attributes:
        geometry: all shapes, without pairs.
        covers: simple shapes around them.
        numbers: the shapes of every pair, shape (n, 2).
        needs_m: what the distance of a pair must exceed where that is not the margin, shape (n,);
            NaN for all others.
        padding_m: what is subtracted from the distance of a pair, shape (n,), because its shapes
            count as thicker than they are.
        distances: of the pairs, less the padding.
        outside_m: how far outside each shape what it stands for may be, shape (shapes,).
        thicker_m: by how much each shape counts as thicker than it is where it must not touch
            anything, shape (shapes,).
    """

    def __init__(self, built: ShapePairs, robot: RobotShapes) -> None:
        self.geometry, self._made = built.geometry, tuple(built.made)
        self._wholes, self._shapes, self._robot = built.wholes, built.shapes, robot
        added = [shape.geometry for shape in built.made[len(robot.made) :]]
        self.covers: Covers = robot.covers.with_those_of(added)
        self.numbers: Indices = np.array(built.numbers, dtype=np.intp).reshape(-1, 2)
        self.needs_m: FloatArray = np.full(len(self.numbers), np.nan)
        self.needs_m[list(built.needs_m)] = list(built.needs_m.values())
        self.outside_m: FloatArray = np.array([each.margin_m for each in built.made])
        self.thicker_m: FloatArray = np.array([each.padding_m for each in built.made])
        outside, thicker = (
            each[self.numbers].sum(axis=1) for each in (self.outside_m, self.thicker_m)
        )
        self.padding_m: FloatArray = outside + np.where(self.is_contact, 0.0, thicker)
        self.distances = Distances(
            self.geometry,
            [each.enclosure for each in built.made],
            robot.pieces,
            built.numbers,
            self.padding_m.tolist(),
        )

    @cached_property
    def alike(self) -> Indices:
        """For each pair, the number of the first between the same wholes, shape (n,).

        Pairs with different needs are not alike.
        """
        whole = np.array(self._wholes, dtype=np.intp)[self.numbers]
        columns = [*whole.T, np.nan_to_num(self.needs_m, nan=np.inf)]
        _, first, kind = np.unique(columns, axis=1, return_index=True, return_inverse=True)
        found: Indices = first[kind.reshape(-1)]
        return found

    def tree(self, index: int) -> ClusterTree:
        """The clusters of the whole link or part that a shape is, or is a piece of."""
        whole = self._wholes[index]
        shape = self._shapes.get(whole)
        return self._robot.trees[whole] if shape is None else tree_of_part(shape)

    @property
    def is_contact(self) -> NDArray[np.bool_]:
        """Whether a pair need not keep a margin, shape (n,)."""
        return ~np.isnan(self.needs_m)

    def needed_m(self, margin_m: float) -> FloatArray:
        """What the distance of every pair must exceed when a margin is asked for, shape (n,)."""
        return np.where(self.is_contact, self.needs_m, margin_m)

    def gaps_m(self, poses: FloatArray, number: Indices, pair: Indices) -> FloatArray:
        """Lower bounds on distances, less the padding, shape (k,), m.

        Args:
            poses: of all shapes in base, shape (m, n, 4, 4).
            number: which of the m, shape (k,).
            pair: which pair there, shape (k,).
        """
        return self.covers.gaps_m(poses, number, *self.numbers[pair].T) - self.padding_m[pair]

    def between(self, pair: int, distance_m: float, time_s: float | None = None) -> Clearance:
        """A distance of a pair, by its names."""
        first, second = (self._made[number].link for number in self.numbers[pair])
        return Clearance(float(distance_m), first, second, time_s)
