"""Phases of a pick and place: what fits between the fingers, and what stays where it is put."""

from __future__ import annotations

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
from tests.planner.pick_place.conftest import ORIGIN, PICK, PLACE, TASK, box, planned


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


@pytest.mark.slow
def test_a_block_that_fits_between_half_round_tips_is_carried(table: Body) -> None:
    """Its corners reach beside the tips, 53.2 mm apart along the closing axis."""
    robot = Baxter.load(hands={"right": ElectricGripper(tips="half_round")})
    right = Manipulator.of(robot, "right")
    block = make_block("block", at(0.7, -0.15, -0.13), edge_m=0.05)
    task = PickAndPlace("block", overhead(0.7, -0.15, -0.129), overhead(0.75, 0.0, -0.129))
    plan = planned(task, right, Scene.of([table, block]))
    assert plan.is_valid, str(plan.failure)
    assert verify(plan, description=robot.description).is_valid


def test_a_block_may_be_put_on_another(manipulator: Manipulator, scene: Scene) -> None:
    other = load_object("block", at(0.7225, -0.0235, -0.155), name="other", is_movable=True)
    task = PickAndPlace("block", PICK, overhead(0.75, 0.0, -0.079))
    plan = planned(task, manipulator, scene.with_body(other))
    assert plan.is_valid, str(plan.failure)


@pytest.mark.parametrize("off_m", [0.0034, 0.0038])
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
    assert tuple(phases.contexts) == MOVES


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


def test_a_body_is_let_go_a_little_above_its_support_and_not_higher(
    manipulator: Manipulator, scene: Scene
) -> None:
    task = PickAndPlace("block", PICK, raised(PLACE, 0.99 * MAX_DROP_M))
    made(manipulator, scene, task).refuse_impossible()
    found = made(manipulator, scene, PickAndPlace("block", PICK, raised(PLACE, 0.02)))
    with pytest.raises(NoSolutionError, match=r"within 10 mm below it, and table is 20 mm below"):
        found.refuse_impossible()


def cube_at(name: str, x: float, y: float, above_m: float = 0.0) -> Body:
    return make_block(name, at(x, y, -0.13 + above_m), edge_m=0.05)


def test_a_neighbour_of_the_place_does_not_take_it(manipulator: Manipulator, scene: Scene) -> None:
    """It stands 0.3 mm beside the placed block, along the fingers."""
    blue = cube_at("blue", 0.75 - 0.0025 + 0.0503, 0.0015)
    assert made(manipulator, scene.with_body(blue)).taken is None


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


@pytest.mark.slow
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


LID = box("lid", (0.1, 0.1, 0.02), 0.75, 0.0, 0.221)
"""Above all that the hand reaches on the line down, which is 50 mm long."""


@pytest.mark.parametrize(
    "case",
    [
        (-0.02, 0.0, (), "place: descend: for every IK solution, block is 20.0 mm inside table at"),
        (0.0, 0.025, (), "finger_tip is 22.1 mm from table at the pose, and 25.0 mm are required"),
        (0.0, 0.0, (LID,), "inside lid 150 mm above the pose"),
    ],
)
def test_what_the_hand_meets_at_a_pose_or_above_it_is_told(
    manipulator: Manipulator, scene: Scene, case: tuple[float, float, tuple[Body, ...], str]
) -> None:
    lift_m, margin_m, lids, told = case
    task = PickAndPlace("block", PICK, raised(PLACE, lift_m))
    for lid in lids:
        scene = scene.with_body(lid)
    failure = refuse(manipulator, scene, task, margin_m)
    assert failure is not None
    assert told in str(failure)
    assert failure.contact is not None
    assert margin_m in (0.0, failure.contact.needed_m)


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
