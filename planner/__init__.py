"""From poses to checked, timed motion; knows no simulator and no viewer."""

import baxter_kin.kinematics.pinocchio_loading  # noqa: F401 - says what it lacks, before all others
from planner.collision.context import CollisionContext
from planner.collision.continuous.proof import prove_clear
from planner.collision.robot.robot_body import RobotBody
from planner.collision.robot.robot_shapes import RobotShapes
from planner.errors import PlannerError, StraightMoveError
from planner.grasping.hand import Hand
from planner.grasping.overhead import overhead_grasp
from planner.grasping.tool import tool_of
from planner.manipulator import Manipulator
from planner.motion.free_move import plan_free_move
from planner.motion.joint_move import plan_joint_move
from planner.motion.response import Response
from planner.motion.response_fit import fit_response
from planner.motion.straight_line import LineTolerance, StraightLine
from planner.motion.straight_move import plan_straight_move
from planner.pick_place.candidates import transfer_bound_s
from planner.pick_place.planning import plan_pick_and_place, plan_retract, plan_start_move
from planner.pick_place.task import PickAndPlace
from planner.pick_place.tracking.proof import prove_tracking
from planner.pick_place.tracking.result import TrackingProof
from planner.plan import Grip, GripperAction, Move, Plan, PlanFailure
from planner.plan_file import load_plan, save_plan
from planner.scene.bodies import Body, Box, Cylinder, Part, Scene, Sphere
from planner.scene.held import Held
from planner.scene.mesh import Mesh
from planner.scene.objects import load_object, make_block
from planner.situation import Situation
from planner.trajectory import Trajectory
from planner.verification import Certificate, verify

__all__ = [
    "Body",
    "Box",
    "Certificate",
    "CollisionContext",
    "Cylinder",
    "Grip",
    "GripperAction",
    "Hand",
    "Held",
    "LineTolerance",
    "Manipulator",
    "Mesh",
    "Move",
    "Part",
    "PickAndPlace",
    "Plan",
    "PlanFailure",
    "PlannerError",
    "Response",
    "RobotBody",
    "RobotShapes",
    "Scene",
    "Situation",
    "Sphere",
    "StraightLine",
    "StraightMoveError",
    "TrackingProof",
    "Trajectory",
    "fit_response",
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
