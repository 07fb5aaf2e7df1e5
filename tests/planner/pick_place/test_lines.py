"""Picks out of a bin along level lines: what vertical ones cannot reach."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Arm
from baxter_kin.fields import evolve
from baxter_kin.frames import raised
from planner import Line, Manipulator, Move, PickAndPlace, Plan, Scene, plan_retract, verify
from planner.errors import TaskError
from planner.motion.paths.straight_line import DEFAULT_TOLERANCE, StraightLine
from planner.pick_place.task import UP
from sim import Simulation, World
from tests.conftest import overhead
from tests.planner.pick_place.conftest import STAGES, box, labels, planned

LEVEL = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""Rotation of a hand that points forwards."""

FRONT_M, FLOOR_M, DEPTH_M, HEIGHT_M = 0.77, 0.10, 0.15, 0.14
OUT_M, LIFT_M = DEPTH_M + 0.06, 0.01
PICK = pin.SE3(LEVEL, np.array([FRONT_M + DEPTH_M, 0.08, FLOOR_M + 0.07]))
PLACE = pin.SE3(pin.utils.rotate("z", 0.3) @ LEVEL, np.array([0.74, 0.40, -0.085]))
INTO, BACK = Line((1.0, 0.0, 0.0), OUT_M), Line("tool", OUT_M)
LIFTED = PickAndPlace(
    *("item", PICK, PLACE),
    approach=INTO,
    retreat=(Line(UP, LIFT_M), BACK),
    place_retreat=Line("tool", 0.12),
)

CONTINUITY_M = 1e-6
"""How near to its goal a straight move ends."""


@pytest.fixture(scope="module")
def bin_scene(scene: Scene) -> Scene:
    """The demo's table, and a bin that is open towards the robot, with an item inside."""
    x, y, z = FRONT_M + 0.185, 0.08, FLOOR_M + 0.11
    walls = (
        box("floor", (0.37, 0.29, 0.01), x, y, FLOOR_M - 0.005),
        box("roof", (0.37, 0.29, 0.01), x, y, FLOOR_M + 0.225),
        box("back", (0.01, 0.27, 0.22), FRONT_M + 0.375, y, z),
        box("left wall", (0.37, 0.01, 0.22), x, y + 0.14, z),
        box("right wall", (0.37, 0.01, 0.22), x, y - 0.14, z),
    )
    item = box("item", (0.05, 0.05, HEIGHT_M), FRONT_M + DEPTH_M, 0.08, FLOOR_M + HEIGHT_M / 2.0)
    return Scene.of([scene["table"], *walls, evolve(item, is_movable=True)])


@pytest.fixture(scope="module")
def out_of_bin(manipulator: Manipulator, bin_scene: Scene) -> Plan:
    found = planned(LIFTED, manipulator, bin_scene)
    assert found.is_valid, str(found.failure)
    return found


def move_of(plan: Plan, label: str) -> Move:
    return next(move for move in plan.moves if move.label == label)


def test_it_is_lifted_then_drawn_out_then_placed(out_of_bin: Plan) -> None:
    expected = STAGES.copy()
    expected.insert(1 + expected.index("pick: retract"), "pick: retract 2")
    assert labels(out_of_bin) == expected
    certificate = verify(out_of_bin)
    assert certificate.is_valid, certificate.verdict


def test_each_line_is_a_straight_move_in_its_direction(out_of_bin: Plan, left: Arm) -> None:
    ways = {
        "pick: descend": (OUT_M, 0.0, 0.0),
        "pick: retract": (0.0, 0.0, LIFT_M),
        "pick: retract 2": (-OUT_M, 0.0, 0.0),
        "place: descend": (0.0, 0.0, -LIFTED.clear_m),
    }
    for label, way in ways.items():
        move = move_of(out_of_bin, label)
        T_start, T_goal = (left.T_base_tip(q) for q in move.trajectory.q[[0, -1]])
        np.testing.assert_allclose(
            T_goal.translation - T_start.translation, way, atol=CONTINUITY_M, err_msg=label
        )
        assert move.is_straight
        times = np.linspace(0.0, move.trajectory.duration, 200)
        off_m, off_rad = StraightLine(T_start, T_goal).deviations(
            left.T_base_tips(move.trajectory.sample(times).q)
        )
        assert off_m.max() <= DEFAULT_TOLERANCE.position_m
        assert off_rad.max() <= DEFAULT_TOLERANCE.rotation_rad


def test_the_simulation_carries_it_out(out_of_bin: Plan, manipulator: Manipulator) -> None:
    world = World.from_state(out_of_bin.start, manipulator.robot)
    outcome = Simulation(world).execute(out_of_bin, unverified=True)
    assert outcome.is_success, outcome.failure
    assert world.supports["item"] == ("table",)


def test_on_vertical_lines_the_roof_is_in_the_way_for_certain(
    manipulator: Manipulator, bin_scene: Scene
) -> None:
    refused = planned(PickAndPlace("item", PICK, PLACE, clear_m=0.15), manipulator, bin_scene)
    assert refused.failure is not None
    assert refused.failure.is_certain
    assert "roof" in str(refused.failure)


def test_what_hangs_in_front_of_a_bin_is_met_on_the_line(
    manipulator: Manipulator, bin_scene: Scene
) -> None:
    curtain = box("curtain", (0.01, 0.4, 0.5), FRONT_M - 0.03, 0.08, FLOOR_M + 0.1)
    refused = planned(LIFTED, manipulator, bin_scene.with_body(curtain))
    assert refused.failure is not None
    assert refused.failure.is_certain
    assert "curtain" in str(refused.failure)


@pytest.mark.slow
def test_an_item_that_is_dragged_over_its_support_is_not_certified(
    manipulator: Manipulator, bin_scene: Scene
) -> None:
    task = evolve(LIFTED, retreat=())
    plan = planned(task, manipulator, bin_scene)
    assert plan.is_valid, str(plan.failure)
    certificate = verify(plan)
    assert "slides" in certificate.verdict
    assert not certificate.is_valid


def test_an_empty_hand_leaves_a_bin_along_lines(
    out_of_bin: Plan, manipulator: Manipulator, bin_scene: Scene
) -> None:
    q = move_of(out_of_bin, "pick: descend").trajectory.q_goal
    empty = bin_scene.without("item")
    plan = plan_retract(manipulator, empty, q, retreat=(Line(UP, LIFT_M), BACK))
    assert labels(plan) == ["open", "retract", "retract 2"]
    assert verify(plan).is_valid
    T_end = manipulator.arm.T_base_tip(plan.moves[-1].trajectory.q_goal)
    there = raised(PICK, LIFT_M).translation - [OUT_M, 0.0, 0.0]
    np.testing.assert_allclose(T_end.translation, there, atol=CONTINUITY_M)
    assert not plan_retract(manipulator, empty, q, 0.15).is_valid
    with pytest.raises(TaskError, match="give height_m or retreat"):
        plan_retract(manipulator, empty, q)
    with pytest.raises(TaskError, match="not both"):
        plan_retract(manipulator, empty, q, 0.15, retreat=BACK)


def test_a_line_into_a_bin_may_come_after_one_beside_it(
    manipulator: Manipulator, scene: Scene
) -> None:
    """An approach of two lines, and a retreat of two that is the same in reverse."""
    aside = Line((0.0, -1.0, 0.0), 0.04)
    task = PickAndPlace(
        "block",
        overhead(0.70, 0.15, -0.129),
        overhead(0.75, 0.0, -0.129),
        approach=(aside, Line((0.0, 0.0, -1.0), 0.05)),
    )
    plan = planned(task, manipulator, scene)
    assert plan.is_valid, str(plan.failure)
    lines = [move.label for move in plan.moves if move.label.startswith("pick")]
    assert lines[1:] == ["pick: descend 2", "pick: descend", "pick: retract", "pick: retract 2"]
    assert verify(plan).is_valid
