"""What stands in the way of the hand alone."""

from __future__ import annotations

import pinocchio as pin
import pytest

from baxter_kin.frames import raised
from planner import Manipulator, PickAndPlace, PlanFailure, Scene
from planner.pick_place.hand_lines import refuse_blocked_hand
from planner.pick_place.phases import PhaseMaker
from planner.pick_place.plan_builder import NoSolutionError
from planner.pick_place.task import PlanRequest
from tests.planner.pick_place.conftest import PICK, PLACE, TASK, box, labels, planned


def test_what_the_hand_meets_on_its_line_is_found_once_for_all_solutions(
    manipulator: Manipulator, scene: Scene
) -> None:
    """A bead that the shoulders of the hand meet on the way up, whatever the arm does."""
    bead = box("bead", (0.004, 0.004, 0.004), 0.70, 0.19, 0.020)
    plan = planned(TASK, manipulator, scene.with_body(bead))
    failure = plan.failure
    assert failure is not None
    assert failure.stage == "pick: descend"
    assert failure.is_certain
    assert failure.reason.startswith("for every IK solution, l_gripper_l_finger")
    assert failure.contact is not None
    assert failure.contact.nearest.second == "bead"
    assert labels(plan) == []


def refuse(
    manipulator: Manipulator, scene: Scene, task: PickAndPlace = TASK, margin_m: float = 0.0
) -> PlanFailure | None:
    request = PlanRequest(manipulator, scene, manipulator.arm.start, margin_m)
    contexts = PhaseMaker(request, task).made().contexts
    try:
        refuse_blocked_hand(task, contexts)
    except NoSolutionError as stop:
        return stop.failure
    return None


@pytest.mark.parametrize("margin_m", [0.0, 0.02])
def test_nothing_is_said_of_lines_that_are_free(
    manipulator: Manipulator, scene: Scene, margin_m: float
) -> None:
    """The body, its supports and what the hand grasps are no obstacles on these."""
    assert refuse(manipulator, scene, margin_m=margin_m) is None


def test_a_body_that_would_be_put_into_its_support_is_too_deep_at_the_pose(
    manipulator: Manipulator, scene: Scene
) -> None:
    failure = refuse(manipulator, scene, PickAndPlace("block", PICK, raised(PLACE, -0.02)))
    assert failure is not None
    assert failure.stage == "place: descend"
    assert failure.reason == ("for every IK solution, block is 20.0 mm inside table at the pose")


def test_a_margin_that_a_pose_does_not_leave_is_told(
    manipulator: Manipulator, scene: Scene
) -> None:
    failure = refuse(manipulator, scene, margin_m=0.025)
    assert failure is not None
    assert failure.stage == "pick: descend"
    assert failure.reason.endswith(
        "finger_tip is 22.1 mm from table at the pose, and 25.0 mm are asked for"
    )
    assert failure.contact is not None
    assert failure.contact.needed_m == 0.025


def test_a_lid_above_the_place_is_met_on_the_way_up_and_how_high_is_told(
    manipulator: Manipulator, scene: Scene
) -> None:
    """It is above all that the hand reaches on the line down, which is 50 mm long."""
    x, y, z = PLACE.translation.tolist()
    lid = box("lid", (0.1, 0.1, 0.02), x, y, z + 0.35)
    failure = refuse(manipulator, scene.with_body(lid))
    assert failure is not None
    assert failure.stage == "place: retract"
    assert failure.reason.endswith("inside lid 150 mm above the pose")


def test_what_only_the_arm_meets_is_left_to_the_solutions(
    manipulator: Manipulator, scene: Scene
) -> None:
    robot, q = manipulator.robot, manipulator.ik.solve(PICK).q
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, next(manipulator.configurations(q[None], 0.0)))
    x, y, z = data.oMf[robot.model.getFrameId("left_lower_elbow")].translation.tolist()
    crowded = scene.with_body(box("crate", (0.1, 0.1, 0.1), x, y, z))
    assert manipulator.context(crowded).clearance(q).second == "crate"
    assert refuse(manipulator, crowded) is None
