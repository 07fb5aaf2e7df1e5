"""The search for a cycle: ways around what is there, and what no cycle can pass."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin.frames import raised
from planner import (
    Body,
    Manipulator,
    PickAndPlace,
    Plan,
    Scene,
    State,
    make_block,
    plan_pick_and_place,
    verify,
)
from tests.bodies import grasp_of
from tests.conftest import overhead
from tests.planner.pick_place.conftest import PICK, PLACE, STAGES, TASK, box, labels, planned

REACHED_M = 1e-6
"""What a valid IK result promises, in m and rad."""


def placing(place: pin.SE3, pick: pin.SE3 = PICK) -> PickAndPlace:
    return PickAndPlace("block", pick, place)


@pytest.fixture(scope="module")
def walled(scene: Scene) -> Scene:
    height = 0.26
    return scene.with_body(box("wall", (0.3, 0.02, height), 0.72, 0.075, -0.155 + height / 2))


def test_over_a_wall(plan: Plan, manipulator: Manipulator, walled: Scene) -> None:
    over = planned(TASK, manipulator, walled)
    assert over.is_valid, str(over.failure)
    assert labels(over) == STAGES
    assert over.motion_time_s < plan.motion_time_s + 1.0
    speeds = [float(np.abs(move.trajectory.v[-1]).max()) for move in over.moves]
    assert [speed > 0.1 for speed in speeds] == [True, False, True, True, False, False]
    for stage, T in (("pick: approach", PICK), ("place: approach", PLACE)):
        move = next(move for move in over.moves if move.label == stage)
        T_end = manipulator.arm.T_base_tip(move.trajectory.q_goal)
        above = raised(T, TASK.clear_m)
        np.testing.assert_allclose(T_end.translation, above.translation, atol=REACHED_M)


@pytest.mark.slow
def test_a_wall_before_the_pick_is_passed_too(manipulator: Manipulator, scene: Scene) -> None:
    q_start = manipulator.ik.solve(overhead(0.72, -0.2, -0.05)).q
    wall = box("wall", (0.3, 0.02, 0.2), 0.72, 0.03, -0.055)
    task = placing(overhead(0.70, 0.25, -0.129))
    plan = plan_pick_and_place(task, manipulator, scene.with_body(wall), q_start)
    assert plan.is_valid, str(plan.failure)
    assert verify(plan).is_valid


def test_a_wall_that_only_shapes_smaller_than_the_meshes_miss_is_not_passed(
    manipulator: Manipulator, scene: Scene
) -> None:
    """30 cm high: it was believed to be passed."""
    wall = box("wall", (0.3, 0.02, 0.3), 0.72, 0.075, -0.005)
    refused = planned(TASK, manipulator, scene.with_body(wall))
    assert "left_lower_forearm with wall, at best" in str(refused.failure)


def test_where_no_way_is_found_the_search_says_so(
    manipulator: Manipulator, walled: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The program is not led, and the search around has no time."""
    monkeypatch.setattr("planner.motion.program.motion_program.MAX_ROUNDS", 0)
    monkeypatch.setattr("planner.pick_place.cycles.TIMEOUT_S", 1e-9)
    failure = planned(TASK, manipulator, walled).failure
    assert failure is not None
    assert failure.stage == "place: approach"
    assert "no way around was found in 1e-09 s" in str(failure.tried[-1])
    assert "wall" in str(failure)


def test_a_plate_in_the_way_is_found_however_thin(
    plan: Plan, manipulator: Manipulator, scene: Scene
) -> None:
    """A tenth of a millimetre: samples 10 ms apart are centimetres apart."""
    plate = box("plate", (0.3, 0.0001, 0.2), 0.72, 0.075, -0.05)
    failed = verify(plan, State.of(manipulator, scene.with_body(plate)))
    assert not failed.is_valid
    assert "plate" in str(failed)


@pytest.mark.slow
def test_where_all_cycles_collide_on_a_line_one_is_led_around(
    manipulator: Manipulator, table: Body
) -> None:
    """The elbow would be 9 mm inside the torso as the hand rises from the place."""
    pick, place = (
        pin.SE3(pin.utils.rotate("z", turn), np.array([x, y, -0.1325]))
        for x, y, turn in ((0.8488, 0.1634, -0.7609), (0.6230, 0.1946, 0.8266))
    )
    down = pin.SE3(np.diag([-1.0, 1.0, -1.0]), np.zeros(3))
    scene = Scene.of([table, make_block("block", pick, edge_m=0.045)])
    plan = planned(placing(place * down, pick * down), manipulator, scene)
    assert plan.is_valid, plan.failure
    assert plan.motion_time_s < 5.3  # by stopping, it was 6.00 s
    assert verify(plan).is_valid


@pytest.mark.slow
@pytest.mark.parametrize("gap_m", [-0.007, 0.003])
def test_a_held_block_keeps_clear_of_a_post_below_its_shortest_way(
    plan: Plan, manipulator: Manipulator, scene: Scene, gap_m: float
) -> None:
    """A post in the middle of the way to the place, a gap below the lowest block near it."""
    grasp = grasp_of(manipulator.hand, PICK, scene["block"], manipulator.hand.stroke_m)
    assert grasp is not None
    way = next(move for move in plan.moves if move.label == "place: approach").trajectory
    carried = [
        scene["block"].at(manipulator.arm.T_base_tip(q) * grasp.T_tip_body)
        for q in way.sample(np.linspace(0.0, way.duration, 500)).q
    ]
    x, y, _ = carried[len(carried) // 2].centre_base
    above = [b for b in carried if np.hypot(*(b.centre_base[:2] - (x, y))) < 0.034]
    top = min(body.extent_m((0, 0, 1))[0] for body in above) - gap_m
    post = box("post", (0.001, 0.001, 0.02), x, y, top - 0.01)
    found = planned(TASK, manipulator, scene.with_body(post))
    assert found.is_valid, str(found.failure)
    assert found.motion_time_s > 0.99 * plan.motion_time_s
    assert found.clearance is not None
    if gap_m > 0.0:
        assert (found.clearance.first, found.clearance.second) == ("block", "post")
        assert 0.0025 <= found.clearance.distance_m <= 0.01
    else:
        assert verify(found).is_valid
