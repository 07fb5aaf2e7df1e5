"""The robot's shapes as Rethink drew them: the visual meshes of its description.

The planner's shapes are others. Of the description's shapes

- the visual shape counts for every link that has one, mesh or not; of fingers, their tips and tools
  that of the robot's own text;
- the collision shape counts for a link that has no visual one, which is `<side>_hand_link`;
- no part of the robot are the spheres named `collision_head_*`, which MoveIt's configuration added
  to keep the arms away from the head, the spheres of 1 mm that stand for head, screen and sonar
  ring among the collision shapes, and the cylinders of `*_upper_forearm_visual` and
  `*_upper_elbow_visual`, links that exist to be looked at but have nothing to see.

Where the mesh files cannot be read, nothing stands for them: the planner's stored body would judge
itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from operator import itemgetter

import pinocchio as pin

from baxter_kin.description import RobotDescription
from baxter_kin.distribution.extras import run_to_install
from baxter_kin.errors import DescriptionError
from planner.verification.body.solid import Solid
from planner.verification.body.urdf_shapes import UrdfShape, link_shapes
from planner.verification.urdf_robot import read_model

DISTRIBUTION = "example-robot-data"
"""The package that brings the meshes."""

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
    source: str = "Rethink's meshes"


class MissingMeshesError(DescriptionError):
    """The meshes of the robot cannot be read, so there is nothing to measure distances on."""


@lru_cache(maxsize=8)
def robot_body(description: RobotDescription) -> SolidBody:
    """The robot's shapes on its own joints, made once for the same robot.

    Links that the robot lacks, of a gripper that is not mounted, have none.

    Raises:
        DescriptionError: when the URDF cannot be read.
        MissingMeshesError: when its meshes cannot be read; says which package brings them.
    """
    model = read_model(description)
    shapes = _shapes(description)
    there = [shape for shape in shapes if _is_there(model, shape.link)]
    placed = sorted(((_frame(model, shape.link), shape) for shape in there), key=itemgetter(0))
    measured: dict[int, Solid] = {}
    solids = tuple(_solid(model.frames[frame], shape, measured) for frame, shape in placed)
    return SolidBody(solids)


def _shapes(description: RobotDescription) -> list[UrdfShape]:
    """The shapes of all links."""
    try:
        return link_shapes(description.stock, NO_PARTS, description.text)
    except DescriptionError as cause:
        raise MissingMeshesError(
            f"{cause}; the package {DISTRIBUTION} brings the meshes: {run_to_install(DISTRIBUTION)}"
        ) from cause


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
