"""From poses to checked, timed motion; knows no simulator and no viewer.

Names are loaded when they are first used, as those of `baxter_kin`; so `planner.certificate` runs
where NumPy alone is installed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from baxter_kin.lazy import loader

if TYPE_CHECKING:
    from planner.collision.context import CollisionContext
    from planner.collision.continuous.proof import prove_clear
    from planner.collision.robot.robot_body import RobotBody
    from planner.collision.robot.robot_shapes import RobotShapes
    from planner.completion import complete
    from planner.errors import PlannerError, StraightMoveError
    from planner.grasping.hand import Hand
    from planner.grasping.overhead import overhead_grasp
    from planner.grasping.tool import tool_of
    from planner.manipulator import Manipulator
    from planner.motion.free_move import plan_free_move
    from planner.motion.joint_move import plan_joint_move
    from planner.motion.response import Response, fit_response
    from planner.motion.straight_line import LineTolerance, StraightLine
    from planner.motion.straight_move import plan_straight_move
    from planner.pick_place.candidates import transfer_bound_s
    from planner.pick_place.planning import plan_pick_and_place, plan_retract, plan_start_move
    from planner.pick_place.task import PickAndPlace
    from planner.pick_place.tracking import TrackingProof, prove_tracking
    from planner.plan import Claim, Grip, GripperAction, Move, Plan, PlanFailure
    from planner.plan_file import load_plan, save_plan
    from planner.scene.attachment import Attachment
    from planner.scene.bodies import Body, Box, Cylinder, Part, Scene, Sphere
    from planner.scene.contact import Contact
    from planner.scene.mesh import Mesh
    from planner.scene.mesh_file import load_mesh
    from planner.scene.objects import load_object, make_block
    from planner.state import State
    from planner.trajectory import Trajectory
    from planner.verification import (
        Certificate,
        MotionCertificate,
        PolynomialMotion,
        certify,
        verify,
    )

__all__ = [
    "Attachment",
    "Body",
    "Box",
    "Certificate",
    "Claim",
    "CollisionContext",
    "Contact",
    "Cylinder",
    "Grip",
    "GripperAction",
    "Hand",
    "LineTolerance",
    "Manipulator",
    "Mesh",
    "MotionCertificate",
    "Move",
    "Part",
    "PickAndPlace",
    "Plan",
    "PlanFailure",
    "PlannerError",
    "PolynomialMotion",
    "Response",
    "RobotBody",
    "RobotShapes",
    "Scene",
    "Sphere",
    "State",
    "StraightLine",
    "StraightMoveError",
    "TrackingProof",
    "Trajectory",
    "certify",
    "complete",
    "fit_response",
    "load_mesh",
    "load_object",
    "load_plan",
    "make_block",
    "overhead_grasp",
    "plan_free_move",
    "plan_joint_move",
    "plan_pick_and_place",
    "plan_retract",
    "plan_start_move",
    "plan_straight_move",
    "prove_clear",
    "prove_tracking",
    "save_plan",
    "tool_of",
    "transfer_bound_s",
    "verify",
]

__getattr__ = loader(
    __name__,
    (
        "baxter_kin.kinematics.pinocchio_loading",
        "planner.collision.context",
        "planner.collision.continuous.proof",
        "planner.collision.robot.robot_body",
        "planner.collision.robot.robot_shapes",
        "planner.completion",
        "planner.errors",
        "planner.grasping.hand",
        "planner.grasping.overhead",
        "planner.grasping.tool",
        "planner.manipulator",
        "planner.motion.free_move",
        "planner.motion.joint_move",
        "planner.motion.response",
        "planner.motion.straight_line",
        "planner.motion.straight_move",
        "planner.pick_place.candidates",
        "planner.pick_place.planning",
        "planner.pick_place.task",
        "planner.pick_place.tracking",
        "planner.plan",
        "planner.plan_file",
        "planner.scene.attachment",
        "planner.scene.bodies",
        "planner.scene.contact",
        "planner.scene.mesh",
        "planner.scene.mesh_file",
        "planner.scene.objects",
        "planner.state",
        "planner.trajectory",
        "planner.verification",
    ),
)
