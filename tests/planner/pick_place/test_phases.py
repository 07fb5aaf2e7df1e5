"""Phases of a pick and place: what fits between the fingers, and what stays where it is put."""

from __future__ import annotations

import re

import numpy as np
import pytest

from baxter_kin import Baxter, ElectricGripper
from baxter_kin.frames import raised
from planner import (
    Body,
    Box,
    Manipulator,
    Part,
    PickAndPlace,
    Scene,
    load_object,
    plan_pick_and_place,
    verify,
)
from planner.grasping.finger_travel import closing_travel, travel_check
from planner.pick_place.cycle import MOVES
from planner.pick_place.phases import LONGEST_DROP_M, OPENING_STEP_M, PhaseMaker, Phases
from planner.pick_place.plan_builder import NoSolutionError
from planner.pick_place.request import PlanRequest
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


def test_a_narrower_hand_refuses_the_block_with_both_widths(scene: Scene) -> None:
    robot = Baxter.load(hands={"right": ElectricGripper(tips="half_round")})
    right = Manipulator.of(robot, "right")
    task = PickAndPlace("block", overhead(0.7, -0.15, -0.129), overhead(0.75, 0.0, -0.129))
    plan = planned(task, right, scene)
    assert plan.failure is not None
    assert "block measures 50.0 mm" in plan.failure.reason
    assert "the right hand opens only 52.7 mm" in plan.failure.reason


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
    return PhaseMaker(PlanRequest(manipulator, scene, manipulator.arm.start, margin_m), task).made()


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
    task = PickAndPlace("block", PICK, raised(PLACE, share * LONGEST_DROP_M))
    made(manipulator, scene, task).refuse_impossible()


def test_a_body_let_go_higher_would_fall_and_how_far_is_told(
    manipulator: Manipulator, scene: Scene
) -> None:
    found = made(manipulator, scene, PickAndPlace("block", PICK, raised(PLACE, 0.02)))
    with pytest.raises(NoSolutionError, match=r"within 10 mm below it, and table is 20 mm below"):
        found.refuse_impossible()
