"""Phases of a pick and place: what fits between the fingers, and what stays where it is put."""

from __future__ import annotations

import re

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter, ElectricGripper
from baxter_kin.frames import raised
from planner import (
    Body,
    Box,
    Manipulator,
    Mesh,
    Part,
    PickAndPlace,
    PlanFailure,
    Scene,
    load_object,
    make_block,
    plan_pick_and_place,
    verify,
)
from planner.grasping.finger_travel import closing_travel, travel_check
from planner.pick_place.phases import (
    MAX_DROP_M,
    OPENING_STEP_M,
    PhaseMaker,
    Phases,
    refuse_blocked_hand,
)
from planner.pick_place.plan_builder import NoSolutionError
from planner.pick_place.task import MOVES, PlanRequest
from planner.scene.support import settle
from tests.bodies import grasp_of
from tests.conftest import at, overhead
from tests.planner.pick_place.conftest import ORIGIN, PICK, PLACE, TASK, box, labels, planned


@pytest.mark.parametrize(("dx", "dy"), [(0.055, 0.0), (0.0, 0.12), (-0.055, 0.0)])
def test_a_block_beside_the_pads_is_not_grasped(
    manipulator: Manipulator, table: Body, block: Body, dx: float, dy: float
) -> None:
    beside = block.at(at(0.6725 + dx, 0.1265 + dy, -0.155))
    plan = planned(TASK, manipulator, Scene.of([table, beside]))
    assert plan.failure is not None
    assert plan.failure.stage == "pick: close"
    number = re.search(r"block is (\d+) mm to the side of the tip", plan.failure.reason)
    assert number is not None
    across = 1e3 * np.hypot(dx - 0.0025, dy + 0.0015)
    assert float(number[1]) == pytest.approx(across, abs=1.0)  # the hand is tilted by 1 degree
    assert labels(plan) == []


def test_a_body_wider_than_the_hand_fails_with_both_widths(
    manipulator: Manipulator, table: Body
) -> None:
    wide = Body(
        "crate", (Part(Box((0.06, 0.06, 0.05)), ORIGIN),), at(0.7, 0.15, -0.13), is_movable=True
    )
    plan = planned(PickAndPlace("crate", PICK, PLACE), manipulator, Scene.of([table, wide]))
    assert plan.failure is not None
    assert plan.failure.stage == "pick: open"
    assert "crate measures 50.0 mm" in plan.failure.reason or "60.0" in plan.failure.reason
    assert "the left hand opens only 57.0 mm" in plan.failure.reason
    assert labels(plan) == []


@pytest.mark.parametrize(
    ("edge_m", "beside_m", "reason"),
    [
        (
            *(0.054, 0.0),
            "block measures 54.0 mm, 55.3 mm between the pads as it lies, but the right hand opens "
            "only 52.7 mm",
        ),
        (
            *(0.050, 0.0015),
            "block measures 50.0 mm, 51.2 mm between the pads as it lies, which the right hand "
            "opens for (52.7 mm), but off its middle: a pad would come down 0.5 mm inside it",
        ),
    ],
)
def test_a_narrower_hand_refuses_the_block_with_both_widths(
    table: Body, edge_m: float, beside_m: float, reason: str
) -> None:
    robot = Baxter.load(hands={"right": ElectricGripper(tips="half_round")})
    right = Manipulator.of(robot, "right")
    pick = overhead(0.7, -0.15, -0.129)
    block = make_block("block", at(0.7, -0.15 + beside_m, -0.155 + edge_m / 2), edge_m=edge_m)
    task = PickAndPlace("block", pick, overhead(0.75, 0.0, -0.129))
    plan = planned(task, right, Scene.of([table, block]))
    assert plan.failure is not None
    assert plan.failure.reason == reason


def test_a_block_that_fits_between_half_round_tips_is_carried(table: Body) -> None:
    """Its corners reach beside the tips, 53.2 mm apart along the closing axis."""
    robot = Baxter.load(hands={"right": ElectricGripper(tips="half_round")})
    right = Manipulator.of(robot, "right")
    block = make_block("block", at(0.7, -0.15, -0.13), edge_m=0.05)
    task = PickAndPlace("block", overhead(0.7, -0.15, -0.129), overhead(0.75, 0.0, -0.129))
    plan = planned(task, right, Scene.of([table, block]))
    assert plan.is_valid, str(plan.failure)
    assert verify(plan, description=robot.description).is_valid


def test_a_place_that_the_body_would_tip_off_is_refused_with_how_far(
    manipulator: Manipulator, scene: Scene
) -> None:
    """The table begins at x = 0.5435 m; the block's middle comes to lie 3.4 mm outside."""
    task = PickAndPlace("block", PICK, overhead(0.5425, 0.15, -0.129))
    plan = planned(task, manipulator, scene)
    assert plan.failure is not None
    assert plan.failure.stage == "place: open"
    assert "block would tip: its centre is 3.4 mm beyond the edge of table" in plan.failure.reason
    assert plan.failure.is_certain


def test_a_block_may_be_put_on_another(manipulator: Manipulator, scene: Scene) -> None:
    other = load_object("block", at(0.7225, -0.0235, -0.155), name="other", is_movable=True)
    task = PickAndPlace("block", PICK, overhead(0.75, 0.0, -0.079))
    plan = planned(task, manipulator, scene.with_body(other))
    assert plan.is_valid, str(plan.failure)


@pytest.mark.parametrize("off_m", [0.0032, 0.0036, 0.0038, 0.0042])
def test_a_body_that_a_finger_begins_inside_is_planned_for_or_refused(
    manipulator: Manipulator, scene: Scene, off_m: float
) -> None:
    """Beside its middle by about as much as the open hand has room."""
    x, y, _ = scene["block"].centre_base
    task = PickAndPlace("block", overhead(x, y + off_m, -0.129), PLACE)
    plan = plan_pick_and_place(task, manipulator, scene, manipulator.arm.start)
    assert plan.failure is not None or verify(plan).is_valid


@pytest.fixture(scope="module")
def phases(manipulator: Manipulator, scene: Scene) -> Phases:
    return made(manipulator, scene)


def made(
    manipulator: Manipulator, scene: Scene, task: PickAndPlace = TASK, margin_m: float = 0.0
) -> Phases:
    return PhaseMaker(
        PlanRequest(manipulator, scene, manipulator.arm.start, margin_m), task
    ).phases()


def test_each_move_has_a_situation(phases: Phases) -> None:
    assert tuple(phases.contexts) == MOVES


@pytest.mark.parametrize(
    ("stage", "at_pick", "at_place"),
    [
        ("pick: retract", True, False),
        ("place: approach", False, False),
        ("place: descend", False, True),
    ],
)
def test_on_its_lines_alone_the_body_may_touch_what_it_stands_on(
    manipulator: Manipulator, scene: Scene, stage: str, at_pick: bool, at_place: bool
) -> None:
    """The pick is on a box, the place on the table."""
    x, y, _ = scene["block"].centre_base.tolist()
    stand = box("stand", (0.05, 0.05, 0.01), x, y, -0.150)
    lifted = scene.moved("block", at(0.0, 0.0, 0.01) * scene["block"].T_base_body)
    pick = raised(PICK, 0.01)
    task = PickAndPlace("block", pick, PLACE)
    context = made(manipulator, lifted.with_body(stand), task).contexts[stage]
    for T_base_tip, is_free in ((pick, at_pick), (PLACE, at_place)):
        assert context.is_free(manipulator.ik.solve(T_base_tip).q) is is_free


@pytest.mark.parametrize(("stage", "is_free"), [("pick: approach", False), ("pick: descend", True)])
def test_on_its_line_alone_the_hand_may_come_nearer_to_the_body_than_the_margin(
    manipulator: Manipulator, scene: Scene, stage: str, is_free: bool
) -> None:
    """The open fingers are 0.6 mm beside the block."""
    context = made(manipulator, scene, margin_m=0.005).contexts[stage]
    assert context.is_free(manipulator.ik.solve(PICK).q) is is_free


def test_the_fingers_open_all_the_way_where_nothing_is_beside_them(
    manipulator: Manipulator, phases: Phases
) -> None:
    assert phases.opening_m == manipulator.hand.stroke_m


def test_the_fingers_open_as_far_as_is_free_and_no_farther(
    manipulator: Manipulator, table: Body
) -> None:
    """A post stands between a cube of 20 mm and where the open finger would be."""
    cube = Body("cube", (Part(Box((0.02,) * 3), ORIGIN),), at(0.7, 0.15, -0.145), is_movable=True)
    post = box("post", (0.01, 0.008, 0.05), 0.715, 0.1726, -0.130)
    scene = Scene.of([table, cube, post])
    task = PickAndPlace("cube", overhead(0.7, 0.15, -0.139), overhead(0.75, 0.0, -0.139))
    found = made(manipulator, scene, task)
    grasp = grasp_of(manipulator.hand, task.T_base_pick, cube, manipulator.hand.stroke_m)
    assert grasp is not None
    assert found.opening_m < manipulator.hand.stroke_m
    for opening_m, is_clear in ((found.opening_m, True), (found.opening_m + OPENING_STEP_M, False)):
        contacts = [
            travel_check(manipulator, travel).contact_above(task.T_base_pick, 0.0)
            for travel in closing_travel(scene, "cube", opening_m, grasp)
        ]
        assert (contacts == [None] * len(contacts)) is is_clear


@pytest.mark.parametrize("share", [0.5, 0.99])
def test_a_body_may_be_let_go_a_little_above_its_support(
    manipulator: Manipulator, scene: Scene, share: float
) -> None:
    task = PickAndPlace("block", PICK, raised(PLACE, share * MAX_DROP_M))
    made(manipulator, scene, task).refuse_impossible()


def test_a_body_let_go_higher_would_fall_and_how_far_is_told(
    manipulator: Manipulator, scene: Scene
) -> None:
    found = made(manipulator, scene, PickAndPlace("block", PICK, raised(PLACE, 0.02)))
    with pytest.raises(NoSolutionError, match=r"within 10 mm below it, and table is 20 mm below"):
        found.refuse_impossible()


def cube_at(name: str, x: float, y: float, above_m: float = 0.0) -> Body:
    return make_block(name, at(x, y, -0.13 + above_m), edge_m=0.05)


@pytest.mark.parametrize("dx", [0.0, 0.03])
def test_a_place_that_is_taken_is_refused_by_who_stands_there(
    manipulator: Manipulator, scene: Scene, dx: float
) -> None:
    blue = cube_at("blue", 0.75 + dx, 0.0)
    plan = planned(TASK, manipulator, scene.with_body(blue))
    assert plan.failure is not None
    assert plan.failure.stage == "place: descend"
    assert re.fullmatch(
        r"blue stands there: block would be [\d.]+ mm inside it", plan.failure.reason
    )
    assert plan.failure.is_certain


def test_a_wall_that_stands_in_the_place_is_named(manipulator: Manipulator, scene: Scene) -> None:
    wall = box("wall", (0.02, 0.2, 0.2), 0.75, 0.0, -0.055)
    plan = planned(TASK, manipulator, scene.with_body(wall))
    assert plan.failure is not None
    assert plan.failure.reason.startswith("wall stands there: block would be")


def test_a_neighbour_of_the_place_does_not_take_it(manipulator: Manipulator, scene: Scene) -> None:
    """It stands 0.3 mm beside the placed block, along the fingers."""
    blue = cube_at("blue", 0.75 - 0.0025 + 0.0503, 0.0015)
    assert made(manipulator, scene.with_body(blue)).taken is None


@pytest.mark.parametrize(("supports", "too"), [(("block",), ""), (("block", "other"), ", too")])
def test_a_body_that_something_stands_on_is_not_taken_away_from_under_it(
    manipulator: Manipulator, scene: Scene, supports: tuple[str, ...], too: str
) -> None:
    x, y, _ = scene["block"].centre_base.tolist()
    middle = x + 0.05 * (len(supports) - 1)
    top = make_block("top", at(middle, y, -0.095), edge_m=(0.14, 0.04, 0.02))
    loaded = scene.with_body(top).with_body(cube_at("other", x + 0.1, y))
    plan = planned(TASK, manipulator, loaded)
    assert plan.failure is not None
    assert str(plan.failure) == (f"pick: retract: top stands on block{too}; carry that away first")
    assert plan.failure.is_certain


@pytest.mark.parametrize(
    ("tilt_deg", "is_level_enough"), [(0.001, True), (0.8, True), (3.0, False)]
)
def test_a_measured_table_may_be_off_level_by_a_degree(
    manipulator: Manipulator, block: Body, tilt_deg: float, is_level_enough: bool
) -> None:
    R = pin.exp3(np.array([0.0, np.radians(tilt_deg), 0.0]))
    table = box("table", (0.6, 0.8, 0.02), 0.7, 0.1, -0.165)
    top = R @ np.array([0.0, 0.0, 0.01])
    tilted = table.at(pin.SE3(R, np.array([0.7, 0.1, -0.155]) - top))
    x = 0.7 - 0.05 / np.cos(np.radians(tilt_deg))
    standing = settle(block.at(at(x - 0.0275, 0.1265, -0.05)), [tilted]).body
    place = overhead(0.75, 0.0, -0.129 - 0.05 * np.tan(np.radians(tilt_deg)) + 0.003)
    pick = overhead(x, 0.15, float(standing.centre_base[2]))
    maker = made(manipulator, Scene.of([tilted, standing]), PickAndPlace("block", pick, place))
    if is_level_enough:
        maker.refuse_impossible()
    else:
        with pytest.raises(NoSolutionError, match=r"would not stand: table slopes by 3.0 deg"):
            maker.refuse_impossible()


def test_a_block_is_put_into_a_bin_that_is_one_mesh(manipulator: Manipulator, scene: Scene) -> None:
    """A floor, and one triangle that rises by 1 mm at its far edge, 0.4 m away."""
    corners = [[-0.1, -0.4, 0], [0.1, -0.4, 0], [0.1, 0.1, 0], [-0.1, 0.1, 0], [0.1, -0.1, 0.001]]
    floor = Mesh(np.array(corners), np.array([[0, 1, 2], [0, 2, 3], [2, 1, 4]]))
    bin_ = Body("bin", (Part(floor, ORIGIN),), at(0.77, 0.0, -0.1549))
    task = PickAndPlace("block", PICK, overhead(0.72, 0.0, -0.1285))
    plan = planned(task, manipulator, scene.with_body(bin_))
    assert plan.is_valid, str(plan.failure)
    certificate = verify(plan)
    assert certificate.is_valid, certificate.verdict


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
    contexts = PhaseMaker(request, task).phases().contexts
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
        "finger_tip is 22.1 mm from table at the pose, and 25.0 mm are required"
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
