"""Pairs of shapes: which are checked in a context, and the distance that each must keep.

Pinocchio and coal use one geometry model: the robot's shapes, the bodies of the scene, and the
body in the hand. `ShapePairsBuilder` builds the model; `CheckedPairs` is the result. The builder
must not be used afterwards, because adding shapes to a model in use corrupts its memory.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import replace
from functools import cached_property
from itertools import product
from typing import TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin import Arm
from baxter_kin.validation import FloatArray, Indices
from planner.clearance import Clearance
from planner.collision.distances import Covers, Distances, Enclosure
from planner.collision.robot.cluster_trees import ClusterTree, tree_of_part
from planner.collision.robot.robot_shapes import LinkShape, RobotShapes
from planner.scene.bodies import Body, Scene, Shape
from planner.scene.coal_shapes import convex_pieces, surface_of
from planner.scene.contact import PRESSING_TOLERANCE_M, PartContact
from planner.scene.mesh import Mesh

Supports: TypeAlias = Set[PartContact | str]
"""What a held or pushed body may touch: pairs of parts, or any part of the named bodies."""


class ShapePairsBuilder:
    """Builds the shapes of a context, and the pairs of them that are checked.

    Attributes:
        geometry: all shapes, without pairs; the robot's come first, as `RobotShapes` numbers them.
        pairs: indices of the two shapes of every pair.
        link_shapes: all shapes with their properties.
        min_distances_m: for pairs that need not keep the margin: index of the pair -> the distance
            that it must exceed, negative for a contact that may press.
        wholes: for each shape, the index of the shape of its whole link or part, as of
            `RobotShapes.wholes`.
        shapes: number of a whole part of a body -> its shape.
    """

    def __init__(self, shapes: RobotShapes, *arms: Arm) -> None:
        """Begin with the pairs of one arm or more and their robot.

        Args:
            shapes: the robot's shapes.
            arms: the arms that move.
        """
        self._robot, self._arms = shapes, arms
        self.geometry: pin.GeometryModel = shapes.model.copy()
        own = dict.fromkeys(pair for arm in arms for pair in shapes.pairs_of(arm))
        self.pairs: list[tuple[int, int]] = list(own)
        self.link_shapes: list[LinkShape] = list(shapes.made)
        self.min_distances_m: dict[int, float] = {}
        self._part_of: dict[int, int] = {}  # number of a body's shape -> number of its part
        self.wholes: list[int] = list(shapes.whole_of)
        self.shapes: dict[int, Shape] = {}

    def add_scene(
        self, scene: Scene, touchable: str | None, *, may_press: bool, supports: Supports
    ) -> dict[str, list[int]]:
        """Add bodies that do not move, and their pairs with the arms.

        Args:
            scene: the bodies.
            touchable: name of the body that the hands may come near.
            may_press: whether the pads may touch it.
            supports: what a held or pushed body may touch.

        Returns:
            The numbers of each body's shapes.
        """
        supporting = _names_of(supports)
        shapes, none = self._robot, frozenset[int]()
        moving, hand, pads = (
            none.union(*map(of, self._arms))
            for of in (shapes.of_arm, shapes.of_hand, shapes.of_pads)
        )
        added = {}
        for body in scene:
            is_near = body.name == touchable
            of_arms = sorted(moving & (shapes.details if is_near else shapes.wholes))
            in_pieces = is_near or body.name in supporting
            added[body.name] = self._add(body, 0, body.T_base_body, in_pieces=in_pieces)
            for index, other in product(added[body.name], of_arms):
                min_distance_m = None
                if is_near and other in hand:
                    min_distance_m = -PRESSING_TOLERANCE_M if may_press and other in pads else 0.0
                self.pair(other, index, min_distance_m=min_distance_m)
        return added

    def add_held(
        self,
        body: Body,
        T_tip_body: pin.SE3,
        bodies: Mapping[str, list[int]],
        supports: Supports,
        hands: Sequence[Arm] = (),
    ) -> list[int]:
        """Add a held body, and its pairs with the robot and with other bodies.

        Args:
            body: the body.
            T_tip_body: its pose seen from the tip of the first hand that holds it.
            bodies: the numbers of the other bodies' shapes.
            supports: what it may touch.
            hands: the arms whose hands hold it; by default, the only arm.

        Returns:
            The numbers of its shapes.
        """
        hands = hands or self._arms
        in_pieces = not _names_of(supports).isdisjoint(bodies)
        links = self._robot.wholes.difference(*map(self._robot.of_hand, hands))
        added = self.add_to(hands[0].tip_frame, body, T_tip_body, in_pieces=in_pieces)
        for index in added:
            self.pair_with_all(index, links, bodies, supports)
        return added

    def add_to(
        self, link: str, body: Body, T_link_body: pin.SE3, *, in_pieces: bool = False
    ) -> list[int]:
        """Add a body that moves with a link, without pairs; the numbers of its shapes."""
        robot = self._robot.robot.model
        frame = robot.frames[robot.getFrameId(link)]
        T_joint_body = frame.placement * T_link_body
        return self._add(body, frame.parentJoint, T_joint_body, in_pieces=in_pieces)

    def add_standing(self, body: Body) -> list[int]:
        """Add a body that stands at its pose in base, without pairs; the numbers of its shapes."""
        return self._add(body, 0, body.T_base_body)

    def thicken(self, index: int, thicker_m: float) -> None:
        """Make a shape thicker in pairs that must keep the margin."""
        made = self.link_shapes[index]
        self.link_shapes[index] = replace(made, padding_m=made.padding_m + thicker_m)

    def pair_with_all(
        self, index: int, links: Set[int], bodies: Mapping[str, list[int]], supports: Supports
    ) -> None:
        """Add the pairs of a body's shape with links and bodies, some of which it may touch."""
        for link in sorted(links):
            self.pair(index, link)
        part = self._part_of[index]
        for name, others in bodies.items():
            for other in others:
                contact = PartContact(part, name, self._part_of[other])
                may_touch = name in supports or contact in supports
                self.pair(index, other, min_distance_m=-PRESSING_TOLERANCE_M if may_touch else None)

    def _add(
        self, body: Body, joint: int, T_joint_body: pin.SE3, *, in_pieces: bool = False
    ) -> list[int]:
        """Add a body's shapes, in convex pieces where depths must be known, as in contacts."""
        added = []
        for number, part in enumerate(body.parts):
            placement = T_joint_body * part.T_body_part
            is_surface = not in_pieces and isinstance(part.shape, Mesh) and not part.shape.is_convex
            surface = surface_of(part.shape) if is_surface else None
            shapes = (surface.for_contacts,) if surface else convex_pieces(part.shape)
            whole = len(self.link_shapes)
            self.shapes[whole] = part.shape
            for shape in shapes:
                self.wholes.append(whole)
                name = f"{body.name}/{len(self.link_shapes)}"
                placed = pin.GeometryObject(name, joint, placement, shape)
                added.append(int(self.geometry.addGeometryObject(placed)))
                self._part_of[added[-1]] = number
                inside = None if surface is None else Enclosure.none()
                self.link_shapes.append(LinkShape(body.name, shape, inside, surface))
        return added

    def pair(self, first: int, second: int, *, min_distance_m: float | None = None) -> None:
        """Add a pair that must keep the margin, or a distance of its own."""
        if min_distance_m is not None:
            self.min_distances_m[len(self.pairs)] = min_distance_m
        self.pairs.append((first, second))

    def build(self) -> CheckedPairs:
        """The pairs; nothing may be added afterwards."""
        return CheckedPairs(self, self._robot)


def _names_of(supports: Supports) -> frozenset[str]:
    """Names of the bodies that may be touched."""
    return frozenset(each if isinstance(each, str) else each.other for each in supports)


class CheckedPairs:
    """The pairs of shapes that are checked in one context.

    Attributes:
        geometry: all shapes, without pairs.
        covers: simple shapes around them.
        pairs: indices of the two shapes of every pair, shape (n, 2).
        min_distances_m: distance that each pair must exceed where that is not the margin, shape
            (n,); NaN for all others.
        thickness_m: amount subtracted from the distance of each pair for the thickness of its
            shapes, shape (n,).
        distances: of the pairs, less the thickness.
        overshoot_m: maximum distance of a link's mesh outside each shape, shape (shapes,).
        shape_padding_m: additional thickness of each shape where it must not touch anything, shape
            (shapes,).
    """

    def __init__(self, built: ShapePairsBuilder, robot: RobotShapes) -> None:
        self.geometry, self._link_shapes = built.geometry, tuple(built.link_shapes)
        self._wholes, self._shapes, self._robot = built.wholes, built.shapes, robot
        added = [shape.geometry for shape in built.link_shapes[len(robot.made) :]]
        self.covers: Covers = robot.covers.with_those_of(added)
        self.pairs: Indices = np.array(built.pairs, dtype=np.intp).reshape(-1, 2)
        self.min_distances_m: FloatArray = np.full(len(self.pairs), np.nan)
        self.min_distances_m[list(built.min_distances_m)] = list(built.min_distances_m.values())
        self.overshoot_m: FloatArray = np.array([each.overshoot_m for each in built.link_shapes])
        self.shape_padding_m: FloatArray = np.array([each.padding_m for each in built.link_shapes])
        outside, thicker = (
            each[self.pairs].sum(axis=1) for each in (self.overshoot_m, self.shape_padding_m)
        )
        self.thickness_m: FloatArray = outside + np.where(self.is_contact, 0.0, thicker)
        self.distances = Distances(
            self.geometry,
            [each.enclosure for each in built.link_shapes],
            robot.pieces,
            built.pairs,
            self.thickness_m.tolist(),
            surfaces={i: each.surface for i, each in enumerate(built.link_shapes) if each.surface},
        )

    @cached_property
    def representatives(self) -> Indices:
        """For each pair, the number of the first pair of the same wholes and need, shape (n,)."""
        whole = np.array(self._wholes, dtype=np.intp)[self.pairs]
        columns = [*whole.T, np.nan_to_num(self.min_distances_m, nan=np.inf)]
        _, first, kind = np.unique(columns, axis=1, return_index=True, return_inverse=True)
        found: Indices = first[kind.reshape(-1)]
        return found

    def tree(self, index: int) -> ClusterTree:
        """The tree of clusters of the whole link or part that a shape belongs to."""
        whole = self._wholes[index]
        shape = self._shapes.get(whole)
        return self._robot.trees[whole] if shape is None else tree_of_part(shape)

    @property
    def is_contact(self) -> NDArray[np.bool_]:
        """Whether a pair need not keep a margin, shape (n,)."""
        return ~np.isnan(self.min_distances_m)

    def required_m(self, margin_m: float) -> FloatArray:
        """The distance that every pair must exceed when others keep a margin, shape (n,), m."""
        return np.where(self.is_contact, self.min_distances_m, margin_m)

    def gaps_m(
        self, poses: FloatArray, number: Indices, pair: Indices, within_m: float = np.inf
    ) -> FloatArray:
        """Lower bounds on distances, less the thickness, shape (k,), m.

        Args:
            poses: of all shapes in base, shape (m, n, 4, 4).
            number: number of the poses that each pair is at, shape (k,).
            pair: number of each pair, shape (k,).
            within_m: no larger bound matters.
        """
        thickness_m = self.thickness_m[pair]
        within_m += float(thickness_m.max(initial=0.0))
        return self.covers.gaps_m(poses, number, self.pairs[pair], within_m) - thickness_m

    def clearance_of(self, pair: int, distance_m: float, time_s: float | None = None) -> Clearance:
        """The `Clearance` that reports a distance of a pair."""
        first, second = (self._link_shapes[number].link for number in self.pairs[pair])
        return Clearance(float(distance_m), first, second, time_s)
