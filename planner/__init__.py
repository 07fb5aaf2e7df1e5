"""From poses to checked, timed motion; knows no simulator and no viewer."""

from planner.collision import Clearance, ClearanceChecker, RobotShapes
from planner.errors import MotionError, PlannerError, SceneError, TaskError, TrajectoryError
from planner.hand import Grasp, Hand
from planner.manipulator import Manipulator
from planner.objects import load_object
from planner.pick_place import PickAndPlace, plan_pick_and_place, plan_start_move
from planner.plan import Grip, GripperAction, Move, Plan, PlanFailure
from planner.scene import Body, Box, Cylinder, Part, Scene, Sphere
from planner.timing import plan_joint_move
from planner.trajectory import JointState, PeakRatios, Trajectory

__all__ = [
    "Body",
    "Box",
    "Clearance",
    "ClearanceChecker",
    "Cylinder",
    "Grasp",
    "Grip",
    "GripperAction",
    "Hand",
    "JointState",
    "Manipulator",
    "MotionError",
    "Move",
    "Part",
    "PeakRatios",
    "PickAndPlace",
    "Plan",
    "PlanFailure",
    "PlannerError",
    "RobotShapes",
    "Scene",
    "SceneError",
    "Sphere",
    "TaskError",
    "Trajectory",
    "TrajectoryError",
    "load_object",
    "plan_joint_move",
    "plan_pick_and_place",
    "plan_start_move",
]
