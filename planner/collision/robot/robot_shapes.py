"""RobotShapes: the robot's shapes, and the pairs of them worth checking."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from functools import cached_property

import coal
import numpy as np
import pinocchio as pin

from baxter_kin import Arm, Baxter
from baxter_kin.display import OneLine
from baxter_kin.validation import expect, whole_scalar
from planner.collision.covers import Covers
from planner.collision.robot.cluster_trees import ClusterTree, trees_of
from planner.collision.robot.hand_body import fitted
from planner.collision.robot.known_pairs import KnownPairs
from planner.collision.robot.link_shapes import LinkShape, for_contacts, of_scene, shapes_of
from planner.collision.robot.robot_body import RobotBody
from planner.errors import SceneError
from planner.scene.bodies import Part
from planner.scene.contact import hull

GRIPPER = "_gripper_"
"""In names of links that a robot with a bare flange lacks."""


class RobotShapes(OneLine):
    """The shapes of a robot, of the body that it is taken to be.

    A link is one surface of triangles, or one convex shape. Against what the hand grasps, fingers
    count as their convex pieces, because how deep something is inside of these is known.

    Attributes:
        robot: the robot.
        body: what it is taken to be.
    """

    def __init__(self, robot: Baxter, body: RobotBody | None = None) -> None:
        """No shape is made before it is asked for.

        Args:
            robot: the robot.
            body: `RobotBody.load()` when not given.

        Raises:
            SceneError: when one is of another class.
            BodyFileError: when the body that comes with the package cannot be read.
        """
        self.robot = expect(robot, Baxter, "robot", SceneError)
        given = RobotBody.load() if body is None else body
        self.body = expect(given, RobotBody, "body", SceneError)
        self._hulls: dict[int, coal.CollisionGeometry] = {}
        self._pairs_of: dict[str, tuple[tuple[int, int], ...]] = {}

    def __reduce__(self) -> tuple[type[RobotShapes], tuple[Baxter, RobotBody]]:
        return type(self), (self.robot, self.body)

    @cached_property
    def model(self) -> pin.GeometryModel:
        """Every shape, without pairs."""
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
        return shapes_of(self.fitted_body, self._there)

    @property
    def for_contacts(self) -> Mapping[int, coal.BVHModelOBB]:
        """The surfaces among them once more, as contacts are found in them fastest."""
        return for_contacts(self.fitted_body, self._there)

    @cached_property
    def links(self) -> tuple[str, ...]:
        """The link that each shape belongs to."""
        return tuple(made.link for made in self.made)

    @cached_property
    def wholes(self) -> frozenset[int]:
        """The shapes that count against what they must not touch, one of each link."""
        return frozenset(i for i, made in enumerate(self.made) if made.is_whole)

    @cached_property
    def details(self) -> frozenset[int]:
        """The shapes that count against what the hand grasps."""
        return frozenset(i for i, made in enumerate(self.made) if made.is_detail)

    @cached_property
    def pieces(self) -> Mapping[int, tuple[int, ...]]:
        """Of fingers and their tips: the number of all triangles -> those of the pieces."""
        found: dict[int, tuple[int, ...]] = {}
        for number, made in enumerate(self.made):
            if made.is_whole:
                whole = number
            else:
                found[whole] = (*found.get(whole, ()), number)
        return found

    @cached_property
    def whole_of(self) -> tuple[int, ...]:
        """For each shape, the number of the whole link that it is, or is a piece of."""
        whole = {made.link: number for number, made in enumerate(self.made) if made.is_whole}
        return tuple(whole[made.link] for made in self.made)

    @cached_property
    def trees(self) -> Mapping[int, ClusterTree]:
        """The clusters that each whole link consists of, for proofs."""
        text = self.robot.description.text
        trees = trees_of(self.body, self.fitted_body, self._there, text)
        return {number: trees[self.links[number]] for number in self.wholes}

    @cached_property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """The pairs of shapes of the robot that may meet.

        Those that the body skips are left out, unless more than one joint is between them and what
        was proven of the stock robot is not known of this one.
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
        """Those of them that an arm moves, but within its hand; found once."""
        if arm.side not in self._pairs_of:
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
        """Simple shapes around each."""
        return Covers.of([made.geometry for made in self.made])

    def hull(self, index: int) -> coal.CollisionGeometry:
        """The convex hull of a shape; found when it is first asked for."""
        shape = self._shape(index)
        if index not in self._hulls:
            self._hulls[index] = hull(shape.geometry)
        return self._hulls[index]

    def of_arm(self, arm: Arm) -> frozenset[int]:
        """The shapes that an arm moves, those of its hand among them."""
        return self._below[_checked(arm).joint_names[0]]

    def of_hand(self, arm: Arm) -> frozenset[int]:
        """The shapes that move with the last joint of an arm, its wrist among them."""
        return self._below[_checked(arm).joint_names[-1]]

    def of_fingers(self, arm: Arm) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """The shapes of both fingers, those of the one that opens along +y of the tip first."""
        letter = _checked(arm).side[0]
        first, second = (
            tuple(sorted(self._below[f"{letter}_gripper_{finger}_finger_joint"])) for finger in "lr"
        )
        return first, second

    def finger_pieces(self, arm: Arm) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Those of them that count against what the hand grasps."""
        first, second = (
            tuple(i for i in finger if i in self.details) for finger in self.of_fingers(arm)
        )
        return first, second

    def of_palm(self, arm: Arm) -> frozenset[int]:
        """The shapes of the hand that are not of a finger."""
        return self.of_hand(arm).difference(*self.of_fingers(arm))

    def of_pads(self, arm: Arm) -> frozenset[int]:
        """The shapes of both finger tips, which may press on what is grasped."""
        fingers = {index for finger in self.finger_pieces(arm) for index in finger}
        return frozenset(index for index in fingers if self.links[index].endswith("_tip"))

    def part_at_tip(self, index: int, arm: Arm) -> Part:
        """A convex shape of the hand, seen from the tip with the fingers closed."""
        T_tip_shape = self._T_tip_shape(index, arm)
        return Part(of_scene(self.made[index]), T_tip_shape)

    def highest_at_tip_m(self, index: int, arm: Arm) -> float:
        """How far the box around a shape of the hand reaches along z of the tip."""
        geometry = self._shape(index).geometry
        geometry.computeLocalAABB()
        middle = (geometry.aabb_local.max_ + geometry.aabb_local.min_) / 2
        T_tip_shape = self._T_tip_shape(index, arm)
        reach = np.abs(T_tip_shape.rotation[2]) @ (geometry.aabb_local.max_ - middle)
        return float(T_tip_shape.act(middle)[2] + reach)

    def _facts(self) -> tuple[str, ...]:
        return repr(self.robot), repr(self.body)

    @cached_property
    def _there(self) -> frozenset[str]:
        """The links of the body that the robot has; only grippers may be missing."""
        model = self.robot.model
        links = self.fitted_body.links
        there = frozenset(n for n in links if model.existFrame(n, pin.FrameType.BODY))
        lost = sorted(n for n in self.body.links.keys() - there if GRIPPER not in n)
        if lost:
            raise SceneError(f"the robot lacks links that its body has: {', '.join(lost)}")
        return there

    def _shape(self, index: int) -> pin.GeometryObject:
        most = self.model.ngeoms - 1
        number = whole_scalar(index, "index of a shape", SceneError, least=0, most=most)
        return self.model.geometryObjects[number]

    def _T_tip_shape(self, index: int, arm: Arm) -> pin.SE3:
        shape = self._shape(index)
        model, data = self.robot.model, self.robot.model.createData()
        pin.framesForwardKinematics(model, data, np.zeros(model.nq))
        T_base_tip = data.oMf[model.getFrameId(_checked(arm).tip_frame)]
        return T_base_tip.inverse() * data.oMi[shape.parentJoint] * shape.placement

    @cached_property
    def _below(self) -> Mapping[str, frozenset[int]]:
        """The shapes that each joint moves; none where there is no such joint, as of no fingers."""
        model, shapes = self.robot.model, list(self.model.geometryObjects)
        found: defaultdict[str, frozenset[int]] = defaultdict(frozenset)
        for joint, name in enumerate(model.names):
            moved = set(model.subtrees[joint].tolist())
            found[name] = frozenset(i for i, s in enumerate(shapes) if s.parentJoint in moved)
        return found


def _checked(arm: Arm) -> Arm:
    return expect(arm, Arm, "arm", SceneError)
