"""From poses to checked, timed motion; knows no simulator and no viewer.

Names are loaded when they are first used, as those of `baxter_kin`; so `planner.certificate` runs
where NumPy alone is installed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from baxter_kin.lazy import lazy

if TYPE_CHECKING:
    from planner.collision.context import CollisionContext as CollisionContext
    from planner.collision.proof import prove_clear as prove_clear
    from planner.collision.robot.robot_body import RobotBody as RobotBody
    from planner.collision.robot.robot_shapes import RobotShapes as RobotShapes
    from planner.completion import complete as complete
    from planner.completion import tilt_of as tilt_of
    from planner.errors import PathMoveError as PathMoveError
    from planner.errors import PlannerError as PlannerError
    from planner.errors import StraightMoveError as StraightMoveError
    from planner.grasping.hand import Hand as Hand
    from planner.grasping.overhead import overhead_grasp as overhead_grasp
    from planner.grasping.tool import tool_of as tool_of
    from planner.manipulator import Manipulator as Manipulator
    from planner.manipulator import context_of_both as context_of_both
    from planner.manipulator import limits_of_both as limits_of_both
    from planner.motion.free_move import plan_free_move as plan_free_move
    from planner.motion.joint_move import plan_joint_move as plan_joint_move
    from planner.motion.paths.deviation import FollowedPath as FollowedPath
    from planner.motion.paths.path import Arc as Arc
    from planner.motion.paths.path import Curve as Curve
    from planner.motion.paths.path import Polyline as Polyline
    from planner.motion.paths.path_move import PathMove as PathMove
    from planner.motion.paths.path_move import plan_path_move as plan_path_move
    from planner.motion.paths.straight_line import LineTolerance as LineTolerance
    from planner.motion.paths.straight_line import StraightLine as StraightLine
    from planner.motion.paths.straight_move import plan_straight_move as plan_straight_move
    from planner.motion.response import Response as Response
    from planner.motion.response import fit_response as fit_response
    from planner.motion.upright import Upright as Upright
    from planner.pick_place.candidates import transfer_bound_s as transfer_bound_s
    from planner.pick_place.planning import plan_pick_and_place as plan_pick_and_place
    from planner.pick_place.planning import plan_retract as plan_retract
    from planner.pick_place.planning import plan_start_move as plan_start_move
    from planner.pick_place.task import Line as Line
    from planner.pick_place.task import PickAndPlace as PickAndPlace
    from planner.pick_place.tracking import TrackingProof as TrackingProof
    from planner.pick_place.tracking import prove_tracking as prove_tracking
    from planner.plan import Claim as Claim
    from planner.plan import Grip as Grip
    from planner.plan import GripperAction as GripperAction
    from planner.plan import Move as Move
    from planner.plan import Plan as Plan
    from planner.plan import PlanFailure as PlanFailure
    from planner.plan_file import load_plan as load_plan
    from planner.plan_file import save_plan as save_plan
    from planner.scene.bodies import Attachment as Attachment
    from planner.scene.bodies import Body as Body
    from planner.scene.bodies import Box as Box
    from planner.scene.bodies import Cylinder as Cylinder
    from planner.scene.bodies import Part as Part
    from planner.scene.bodies import Scene as Scene
    from planner.scene.bodies import Sphere as Sphere
    from planner.scene.contact import Contact as Contact
    from planner.scene.mesh import Mesh as Mesh
    from planner.scene.mesh import load_mesh as load_mesh
    from planner.scene.objects import load_object as load_object
    from planner.scene.objects import make_block as make_block
    from planner.state import State as State
    from planner.trajectory import Trajectory as Trajectory
    from planner.two_arms.handover.search import plan_handover as plan_handover
    from planner.two_arms.handover.task import Handover as Handover
    from planner.two_arms.pair_moves.pair_carry import PairCarry as PairCarry
    from planner.two_arms.pair_moves.pair_carry import plan_pair_carry as plan_pair_carry
    from planner.two_arms.pair_moves.pair_move import PairMove as PairMove
    from planner.two_arms.pair_moves.pair_move import plan_pair_move as plan_pair_move
    from planner.two_arms.plan import TwoArmPlan as TwoArmPlan
    from planner.two_arms.plan_file import load_two_arm_plan as load_two_arm_plan
    from planner.two_arms.plan_file import save_two_arm_plan as save_two_arm_plan
    from planner.two_arms.together import plan_together as plan_together
    from planner.two_arms.tracking.proof import TwoArmTrackingProof as TwoArmTrackingProof
    from planner.two_arms.tracking.proof import prove_tracking_of_both as prove_tracking_of_both
    from planner.verification import Certificate as Certificate
    from planner.verification import MotionCertificate as MotionCertificate
    from planner.verification import PolynomialMotion as PolynomialMotion
    from planner.verification import TwoArmCertificate as TwoArmCertificate
    from planner.verification import certify as certify
    from planner.verification import verify as verify
    from planner.verification import verify_both as verify_both

__all__, __getattr__ = lazy(
    __name__,
    {
        "Arc": "planner.motion.paths.path",
        "Attachment": "planner.scene.bodies",
        "Body": "planner.scene.bodies",
        "Box": "planner.scene.bodies",
        "Certificate": "planner.verification",
        "Claim": "planner.plan",
        "CollisionContext": "planner.collision.context",
        "Contact": "planner.scene.contact",
        "Curve": "planner.motion.paths.path",
        "Cylinder": "planner.scene.bodies",
        "FollowedPath": "planner.motion.paths.deviation",
        "Grip": "planner.plan",
        "GripperAction": "planner.plan",
        "Hand": "planner.grasping.hand",
        "Handover": "planner.two_arms.handover.task",
        "Line": "planner.pick_place.task",
        "LineTolerance": "planner.motion.paths.straight_line",
        "Manipulator": "planner.manipulator",
        "Mesh": "planner.scene.mesh",
        "MotionCertificate": "planner.verification",
        "Move": "planner.plan",
        "PairCarry": "planner.two_arms.pair_moves.pair_carry",
        "PairMove": "planner.two_arms.pair_moves.pair_move",
        "Part": "planner.scene.bodies",
        "PathMove": "planner.motion.paths.path_move",
        "PathMoveError": "planner.errors",
        "PickAndPlace": "planner.pick_place.task",
        "Plan": "planner.plan",
        "PlanFailure": "planner.plan",
        "PlannerError": "planner.errors",
        "Polyline": "planner.motion.paths.path",
        "PolynomialMotion": "planner.verification",
        "Response": "planner.motion.response",
        "RobotBody": "planner.collision.robot.robot_body",
        "RobotShapes": "planner.collision.robot.robot_shapes",
        "Scene": "planner.scene.bodies",
        "Sphere": "planner.scene.bodies",
        "State": "planner.state",
        "StraightLine": "planner.motion.paths.straight_line",
        "StraightMoveError": "planner.errors",
        "TrackingProof": "planner.pick_place.tracking",
        "Trajectory": "planner.trajectory",
        "TwoArmCertificate": "planner.verification",
        "TwoArmPlan": "planner.two_arms.plan",
        "TwoArmTrackingProof": "planner.two_arms.tracking.proof",
        "Upright": "planner.motion.upright",
        "certify": "planner.verification",
        "complete": "planner.completion",
        "context_of_both": "planner.manipulator",
        "fit_response": "planner.motion.response",
        "limits_of_both": "planner.manipulator",
        "load_mesh": "planner.scene.mesh",
        "load_object": "planner.scene.objects",
        "load_plan": "planner.plan_file",
        "load_two_arm_plan": "planner.two_arms.plan_file",
        "make_block": "planner.scene.objects",
        "overhead_grasp": "planner.grasping.overhead",
        "plan_free_move": "planner.motion.free_move",
        "plan_handover": "planner.two_arms.handover.search",
        "plan_joint_move": "planner.motion.joint_move",
        "plan_pair_carry": "planner.two_arms.pair_moves.pair_carry",
        "plan_pair_move": "planner.two_arms.pair_moves.pair_move",
        "plan_path_move": "planner.motion.paths.path_move",
        "plan_pick_and_place": "planner.pick_place.planning",
        "plan_retract": "planner.pick_place.planning",
        "plan_start_move": "planner.pick_place.planning",
        "plan_straight_move": "planner.motion.paths.straight_move",
        "plan_together": "planner.two_arms.together",
        "prove_clear": "planner.collision.proof",
        "prove_tracking": "planner.pick_place.tracking",
        "prove_tracking_of_both": "planner.two_arms.tracking.proof",
        "save_plan": "planner.plan_file",
        "save_two_arm_plan": "planner.two_arms.plan_file",
        "tilt_of": "planner.completion",
        "tool_of": "planner.grasping.tool",
        "transfer_bound_s": "planner.pick_place.candidates",
        "verify": "planner.verification",
        "verify_both": "planner.verification",
    },
)
