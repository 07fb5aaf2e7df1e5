"""RobotShapes: the shapes of a robot's links, and the pairs of them that are checked.

A link is one surface of triangles, or one convex shape. In contacts with a body that the hand
grasps, fingers and their tips are the convex pieces that contain their triangles, because depths in
these are known.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache, partial

import coal
import numpy as np
import pinocchio as pin

from baxter_kin import Arm, Baxter
from baxter_kin.description.hands import finger_joints
from baxter_kin.display import OneLine
from baxter_kin.validation import expect, whole_scalar
from planner.collision.distances import Covers, Enclosure
from planner.collision.robot.cluster_trees import ClusterTree, trees_of
from planner.collision.robot.known_pairs import KnownPairs
from planner.collision.robot.robot_body import LinkBody, RobotBody, fitted
from planner.errors import SceneError
from planner.scene.bodies import Part, Shape
from planner.scene.coal_shapes import (
    Surface,
    convex,
    hull,
    shape_of,
)

GRIPPER = "_gripper_"
"""Part of the names of links that a robot with a bare flange lacks."""

MAX_KEPT = 64
"""Maximum number of different links whose shapes are cached; a robot has about twenty."""


@dataclass(frozen=True, slots=True, eq=False)
class LinkShape:
    """A shape of a link, or of a body, in its frame.

    Attributes:
        link: the link or body that it belongs to.
        geometry: of coal.
        enclosure: the volume that its triangles enclose; None for a convex shape.
        surface: its triangles; None for a convex shape.
        overshoot_m: maximum distance of the link's mesh outside the shape.
        padding_m: additional thickness in pairs that must keep a margin.
        is_whole: whether it is checked against things that must not be touched.
        is_detail: whether it is checked against a body that the hand grasps.
    """

    link: str
    geometry: coal.CollisionGeometry
    enclosure: Enclosure | None = None
    surface: Surface | None = None
    overshoot_m: float = 0.0
    padding_m: float = 0.0
    is_whole: bool = True
    is_detail: bool = True


class RobotShapes(OneLine):
    """The shapes of a robot, made when they are first used.

    Attributes:
        robot: the robot.
        body: the bodies of its links.
        left_out: "left" or "right" for an arm whose shapes, with those of its hand, are not checked
            against anything, as if the robot did not have it; "" for none.
    """

    def __init__(self, robot: Baxter, body: RobotBody | None = None, *, left_out: str = "") -> None:
        """Store a robot and its body.

        Args:
            robot: the robot.
            body: by default `RobotBody.load()`.
            left_out: an arm whose shapes are not checked. What is proven with these shapes says
                nothing about that arm; `planner.two_arms` proves separately that the arms keep
                clear of each other.

        Raises:
            SceneError: when an argument is of another class.
            BodyFileError: when the body that comes with the package cannot be read.
        """
        self.robot = expect(robot, Baxter, "robot", SceneError)
        given = RobotBody.load() if body is None else body
        self.body = expect(given, RobotBody, "body", SceneError)
        self.left_out = left_out and self.robot.arm(left_out).side  # refuses an unknown one
        self._hulls: dict[int, coal.CollisionGeometry] = {}
        self._pairs_of: dict[str, tuple[tuple[int, int], ...]] = {}
        self._without: dict[str, RobotShapes] = {}

    def __reduce__(self) -> tuple[partial[RobotShapes], tuple[()]]:
        return partial(RobotShapes, self.robot, self.body, left_out=self.left_out), ()

    def without(self, side: str) -> RobotShapes:
        """The shapes with those of an arm left out; made once for each arm."""
        if side not in self._without:
            self._without[side] = RobotShapes(self.robot, self.body, left_out=side)
        return self._without[side]

    @cached_property
    def model(self) -> pin.GeometryModel:
        """A geometry model of all shapes, without pairs."""
        shapes, frames = pin.GeometryModel(), self.robot.model.frames
        for made in self.made:
            frame = frames[self.robot.model.getFrameId(made.link)]
            name, joint = f"{made.link}/{shapes.ngeoms}", frame.parentJoint
            placed = pin.GeometryObject(name, joint, frame.placement, made.geometry)
            shapes.addGeometryObject(placed)
        return shapes

    @cached_property
    def made(self) -> tuple[LinkShape, ...]:
        """The shapes of all links."""
        return link_shapes(self.fitted_body, self._names)

    @cached_property
    def links(self) -> tuple[str, ...]:
        """The name of the link of each shape."""
        return tuple(made.link for made in self.made)

    @cached_property
    def wholes(self) -> frozenset[int]:
        """The shapes that are checked against things that must not be touched, one a link."""
        wholes = frozenset(i for i, made in enumerate(self.made) if made.is_whole)
        return wholes - self.of_arm(self.robot.arm(self.left_out)) if self.left_out else wholes

    @cached_property
    def details(self) -> frozenset[int]:
        """The shapes that are checked against a body that the hand grasps."""
        return frozenset(i for i, made in enumerate(self.made) if made.is_detail)

    @cached_property
    def pieces(self) -> Mapping[int, tuple[int, ...]]:
        """For fingers and their tips: number of the surface -> numbers of its pieces."""
        found: dict[int, tuple[int, ...]] = {}
        for number, made in enumerate(self.made):
            if made.is_whole:
                whole = number
            else:
                found[whole] = (*found.get(whole, ()), number)
        return found

    @cached_property
    def whole_of(self) -> tuple[int, ...]:
        """For each shape, the number of the shape of the whole link."""
        whole = {made.link: number for number, made in enumerate(self.made) if made.is_whole}
        return tuple(whole[made.link] for made in self.made)

    @cached_property
    def trees(self) -> Mapping[int, ClusterTree]:
        """The tree of clusters of each whole link, for proofs."""
        text = self.robot.description.text
        trees = trees_of(self.body, self.fitted_body, self._names, text)
        return {number: trees[self.links[number]] for number in self.wholes}

    @cached_property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """The pairs of shapes of the robot that may meet.

        The body's skipped pairs are excluded, unless several joints are between the two and the
        proof for the reference robot does not hold for this one.
        """
        known = KnownPairs(self.robot, self.body.skipped_pairs.keys())
        links, shapes, wholes = self.links, self.model.geometryObjects, sorted(self.wholes)
        return tuple(
            (first, second)
            for second in wholes
            for first in wholes
            if first < second
            and shapes[first].parentJoint != shapes[second].parentJoint
            and not known.has(links[first], links[second])
        )

    def pairs_of(self, arm: Arm) -> tuple[tuple[int, int], ...]:
        """The pairs that an arm moves, excluding those within its hand; found once for each arm."""
        if _checked(arm).side not in self._pairs_of:
            moving, hand = self.of_arm(arm), self.of_hand(arm)
            self._pairs_of[arm.side] = tuple(
                pair
                for pair in self.pairs
                if not moving.isdisjoint(pair) and not hand.issuperset(pair)
            )
        return self._pairs_of[arm.side]

    @cached_property
    def fitted_body(self) -> RobotBody:
        """The body with the robot's own hands: other fingers, tips and tools."""
        return fitted(self.body, self.robot.description)

    @cached_property
    def covers(self) -> Covers:
        """Simple shapes around all shapes."""
        return Covers.of([made.geometry for made in self.made])

    def hull(self, index: int) -> coal.CollisionGeometry:
        """The convex hull of a shape, made when it is first used."""
        shape = self._shape(index)
        if index not in self._hulls:
            self._hulls[index] = hull(shape.geometry)
        return self._hulls[index]

    def of_arm(self, arm: Arm) -> frozenset[int]:
        """The shapes that an arm moves, including those of its hand."""
        return self._below[_checked(arm).joint_names[0]]

    def of_hand(self, arm: Arm) -> frozenset[int]:
        """The shapes that move with the last joint of an arm, including its wrist."""
        return self._below[_checked(arm).joint_names[-1]]

    def of_fingers(self, arm: Arm) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """The shapes of both fingers; the finger that opens along +y of the tip comes first."""
        first, second = finger_joints(_checked(arm).side)
        return tuple(sorted(self._below[first])), tuple(sorted(self._below[second]))

    def finger_pieces(self, arm: Arm) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """The shapes of both fingers that are checked against a body that the hand grasps."""
        first, second = (
            tuple(i for i in finger if i in self.details) for finger in self.of_fingers(arm)
        )
        return first, second

    def of_palm(self, arm: Arm) -> frozenset[int]:
        """The shapes of the hand, excluding its fingers."""
        return self.of_hand(arm).difference(*self.of_fingers(arm))

    def of_pads(self, arm: Arm) -> frozenset[int]:
        """The shapes of both finger tips, which may press on a grasped body."""
        fingers = {index for finger in self.finger_pieces(arm) for index in finger}
        return frozenset(index for index in fingers if self.links[index].endswith("_tip"))

    def part_at_tip(self, index: int, arm: Arm) -> Part:
        """A convex shape of the hand, seen from the tip with the fingers closed."""
        T_tip_shape = self.T_tip_shape(index, arm)
        return Part(_scene_shape(self.made[index]), T_tip_shape)

    def T_tip_shape(self, index: int, arm: Arm) -> pin.SE3:
        """Pose of a shape of the hand seen from the tip, with the fingers closed."""
        shape = self._shape(index)
        model, data = self.robot.model, self.robot.model.createData()
        pin.framesForwardKinematics(model, data, np.zeros(model.nq))
        T_base_tip = data.oMf[model.getFrameId(_checked(arm).tip_frame)]
        return T_base_tip.inverse() * data.oMi[shape.parentJoint] * shape.placement

    def highest_at_tip_m(self, index: int, arm: Arm) -> float:
        """Extent along z of the tip of the box around a shape of the hand."""
        geometry = self._shape(index).geometry
        geometry.computeLocalAABB()
        middle = (geometry.aabb_local.max_ + geometry.aabb_local.min_) / 2
        T_tip_shape = self.T_tip_shape(index, arm)
        reach = np.abs(T_tip_shape.rotation[2]) @ (geometry.aabb_local.max_ - middle)
        return float(T_tip_shape.act(middle)[2] + reach)

    def _facts(self) -> tuple[str, ...]:
        left_out = f"without the {self.left_out} arm" if self.left_out else ""
        return repr(self.robot), repr(self.body), left_out

    @cached_property
    def _names(self) -> frozenset[str]:
        """The links of the body that the robot has; it may lack those of grippers only."""
        model = self.robot.model
        links = self.fitted_body.links
        names = frozenset(n for n in links if model.existFrame(n, pin.FrameType.BODY))
        lost = sorted(n for n in self.body.links.keys() - names if GRIPPER not in n)
        if lost:
            raise SceneError(f"the robot lacks links of its body: {', '.join(lost)}")
        return names

    def _shape(self, index: int) -> pin.GeometryObject:
        most = self.model.ngeoms - 1
        number = whole_scalar(index, "index of a shape", SceneError, least=0, most=most)
        return self.model.geometryObjects[number]

    @cached_property
    def _below(self) -> Mapping[str, frozenset[int]]:
        """The shapes that each joint moves; empty for joints that the robot lacks."""
        model, shapes = self.robot.model, list(self.model.geometryObjects)
        found: defaultdict[str, frozenset[int]] = defaultdict(frozenset)
        for joint, name in enumerate(model.names):
            moved = set(model.subtrees[joint].tolist())
            found[name] = frozenset(i for i, s in enumerate(shapes) if s.parentJoint in moved)
        return found


def _checked(arm: Arm) -> Arm:
    return expect(arm, Arm, "arm", SceneError)


@dataclass(frozen=True, slots=True)
class _Content:
    """The content of a link's shapes, by which links with equal shapes share them.

    Attributes:
        parts: the bytes of vertices and triangles of all its parts.
        is_touching: as in `LinkBody`.
        margin_m: as in `LinkBody`.
        link: one of the links with this content.
    """

    parts: tuple[tuple[bytes, bytes], ...]
    is_touching: bool
    margin_m: float
    link: LinkBody = field(compare=False)

    @classmethod
    def of(cls, link: LinkBody) -> _Content:
        """The content of a link."""
        parts = (link.surface, link.enclosure, *link.pieces)
        read = tuple((p.vertices.tobytes(), p.triangles.tobytes()) for p in parts)
        return cls(read, link.is_touching, link.margin_m, link)


@lru_cache(maxsize=4)
def link_shapes(body: RobotBody, names: frozenset[str]) -> tuple[LinkShape, ...]:
    """The shapes of some links of a body; links with equal content share them."""
    return tuple(
        replace(made, link=link.name, padding_m=link.padding_m)
        for name, link in body.links.items()
        if name in names
        for made in _shapes_by(_Content.of(link))
    )


@lru_cache(maxsize=512)
def _scene_shape(made: LinkShape) -> Shape:
    """The scene's shape for a convex shape of a link."""
    return shape_of(made.geometry)


@lru_cache(maxsize=MAX_KEPT)
def _shapes_by(content: _Content) -> tuple[LinkShape, ...]:
    return tuple(_of_link(content.link))


def _of_link(link: LinkBody) -> Iterator[LinkShape]:
    pieces = [convex(*piece) for piece in link.pieces] if link.is_in_pieces else []
    if len(pieces) == 1 and not link.has_surface:
        yield LinkShape(link.name, pieces[0], overshoot_m=link.margin_m)
        return
    whole = link.whole
    inside = link.enclosure if link.has_surface else whole
    surface = Surface(*whole)
    yield LinkShape(
        link.name,
        surface.for_contacts,
        Enclosure(*inside),
        surface,
        overshoot_m=link.margin_m,
        is_detail=not pieces,
    )
    yield from (LinkShape(link.name, piece, is_whole=False) for piece in pieces)
