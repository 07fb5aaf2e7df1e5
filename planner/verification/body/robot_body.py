"""The robot's shapes as Rethink drew them: the visual meshes of its description.

The planner's shapes are others. Of the description's shapes

- the visual shape counts for every link that has one, mesh or not; of fingers, their tips and tools
  that of the robot's own text;
- the collision shape counts for a link that has no visual one, which is `<side>_hand_link`;
- no part of the robot are the spheres named `collision_head_*`, which MoveIt's configuration added
  to keep the arms away from the head, the spheres of 1 mm that stand for head, screen and sonar
  ring among the collision shapes, and the cylinders of `*_upper_forearm_visual` and
  `*_upper_elbow_visual`, links that exist to be looked at but have nothing to see.

Where the mesh files cannot be read, the planner's stored body stands for them, and `source` says
so: then the planner's shapes are on both sides of the check.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from operator import itemgetter

import pinocchio as pin

from baxter_kin.description import RobotDescription
from baxter_kin.errors import DescriptionError
from planner.collision.robot.hand_body import fitted
from planner.collision.robot.robot_body import RobotBody as StoredBody
from planner.scene.contact import convex, surface
from planner.verification.body.solid import Solid
from planner.verification.body.urdf_shapes import UrdfShape, link_shapes
from planner.verification.urdf_robot import read_model

NO_PARTS = ("collision_head_link_", "_forearm_visual", "_elbow_visual")
"""In names of links that are no parts of the robot."""

GRIPPER = "_gripper_"
"""In names of links that a robot with a bare flange lacks."""


@dataclass(frozen=True, slots=True, eq=False)
class SolidBody:
    """All shapes of the robot.

    Attributes:
        solids: each on its joint.
        source: what they are, as a phrase.
    """

    solids: tuple[Solid, ...]
    source: str


@lru_cache(maxsize=8)
def robot_body(description: RobotDescription) -> SolidBody:
    """The robot's shapes on its own joints, made once for the same robot.

    Links that the robot lacks, of a gripper that is not mounted, have none.

    Raises:
        DescriptionError: when the URDF cannot be read.
        BodyFileError: when neither the meshes nor the stored body can be read.
    """
    model = read_model(description)
    shapes, source = _shapes(description)
    there = [shape for shape in shapes if _is_there(model, shape.link)]
    placed = sorted(((_frame(model, shape.link), shape) for shape in there), key=itemgetter(0))
    measured: dict[int, Solid] = {}
    solids = tuple(_solid(model.frames[frame], shape, measured) for frame, shape in placed)
    return SolidBody(solids, source)


def _shapes(description: RobotDescription) -> tuple[tuple[UrdfShape, ...], str]:
    """The shapes of all links, and what they are."""
    try:
        shapes = link_shapes(description.stock, NO_PARTS, description.text)
        return tuple(shapes), "Rethink's meshes"
    except DescriptionError as cause:
        stored = tuple(_stored_shapes(description))
        return stored, f"the planner's own body, since {cause}"


def _stored_shapes(description: RobotDescription) -> Iterator[UrdfShape]:
    """The triangles and pieces that the planner takes the links to be."""
    for link in fitted(StoredBody.load(), description).links.values():
        if not link.is_in_pieces:
            yield UrdfShape(link.name, pin.SE3.Identity(), surface(*link.surface))
        for piece in link.pieces if link.is_in_pieces else ():
            yield UrdfShape(link.name, pin.SE3.Identity(), convex(*piece))


def _is_there(model: pin.Model, link: str) -> bool:
    """Whether the robot has a link; only grippers may be missing."""
    is_there = bool(model.existFrame(link, pin.FrameType.BODY))
    if not is_there and GRIPPER not in link:
        raise DescriptionError(f"the robot's tree lacks the link {link}")
    return is_there


def _frame(model: pin.Model, link: str) -> int:
    return int(model.getFrameId(link, pin.FrameType.BODY))


def _solid(frame: pin.Frame, shape: UrdfShape, measured: dict[int, Solid]) -> Solid:
    """A shape on its joint; cover and ball are taken from `measured` where it is there already."""
    T_joint_shape = frame.placement * shape.T_link_shape
    joint = int(frame.parentJoint)
    same = measured.get(id(shape.shape))
    if same is None:
        measured[id(shape.shape)] = Solid.of(shape.link, joint, T_joint_shape, shape.shape)
        return measured[id(shape.shape)]
    return replace(same, name=shape.link, joint=joint, T_joint_shape=T_joint_shape)
