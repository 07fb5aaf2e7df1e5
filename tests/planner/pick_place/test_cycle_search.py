"""The search for a cycle: ways around what is there, and what no cycle can pass."""

from __future__ import annotations

import re

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from baxter_kin.frames import raised
from planner import (
    Body,
    Manipulator,
    Mesh,
    Part,
    PickAndPlace,
    Plan,
    RobotBody,
    Scene,
    State,
    load_object,
    make_block,
    plan_pick_and_place,
    verify,
)
from tests.bodies import grasp_of
from tests.conftest import at, overhead
from tests.planner.pick_place.conftest import PICK, PLACE, STAGES, TASK, box, labels, planned

REACHED_M = 1e-6
"""What a valid IK result promises, in m and rad."""


class TestImpossible:
    """What cannot be done is said, with stage, names and numbers, and nothing is raised."""

    def test_a_pose_out_of_reach_fails_with_how_far(
        self, manipulator: Manipulator, scene: Scene
    ) -> None:
        task = PickAndPlace("block", PICK, overhead(1.5, 0.0, 0.5))
        plan = planned(task, manipulator, scene)
        assert plan.failure is not None
        assert plan.failure.stage == "place: approach"
        assert plan.failure.ik is not None
        assert not plan.failure.ik.is_valid
        assert "(1.500, 0.000, 0.550) m in base is proven out of reach" in plan.failure.reason
        assert plan.failure.is_certain
        assert labels(plan) == []

    def test_a_pick_in_millimetres_is_told_to_be_out_of_reach(
        self, manipulator: Manipulator, scene: Scene
    ) -> None:
        far = PickAndPlace("block", overhead(2000.0, 0.0, -0.129), PLACE)
        failure = planned(far, manipulator, scene).failure
        assert failure is not None
        assert "millimetres" in failure.reason

    def test_a_place_inside_the_table_fails_with_how_deep(
        self, manipulator: Manipulator, scene: Scene
    ) -> None:
        plan = planned(PickAndPlace("block", PICK, overhead(0.75, 0.0, -0.149)), manipulator, scene)
        assert plan.failure is not None
        assert plan.failure.stage == "place: descend"
        assert re.fullmatch(
            r"all \d+ IK solutions collide: block with table, at best 20.0 mm deep \(\d+\); "
            r"torso with left_upper_elbow, at best [\d.]+ mm deep \(\d+\)",
            plan.failure.reason,
        )
        assert plan.failure.is_certain

    def test_a_pick_that_drives_the_fingers_into_the_table_fails(
        self, manipulator: Manipulator, table: Body
    ) -> None:
        flat = box("tile", (0.05, 0.05, 0.01), 0.70, 0.15, -0.150)
        tile = Body(flat.name, flat.parts, flat.T_base_body, is_movable=True)
        task = PickAndPlace("tile", overhead(0.70, 0.15, -0.155), PLACE)
        plan = planned(task, manipulator, Scene.of([table, tile]))
        assert plan.failure is not None
        assert plan.failure.stage == "pick: descend"
        assert "finger_tip with table, at best 3.9 mm deep" in plan.failure.reason

    def test_a_block_that_a_finger_would_land_on_is_refused_by_how_deep(
        self, manipulator: Manipulator, table: Body, block: Body
    ) -> None:
        shifted = block.at(at(0.6725, 0.1265 + 0.03, -0.155))
        plan = planned(TASK, manipulator, Scene.of([table, shifted]))
        assert plan.failure is not None
        assert plan.failure.stage == "pick: open"
        assert "a pad would come down 26.1 mm inside it" in plan.failure.reason

    def test_an_obstacle_under_the_hand_is_a_collision_that_names_it(
        self, manipulator: Manipulator, scene: Scene
    ) -> None:
        post = box("post", (0.03, 0.03, 0.3), 0.75, 0.05, 0.0)
        plan = planned(TASK, manipulator, scene.with_body(post))
        assert plan.failure is not None
        assert plan.failure.stage == "place: descend"
        assert "with post, at best" in plan.failure.reason

    def test_a_second_block_at_the_place_is_a_collision(
        self, manipulator: Manipulator, scene: Scene
    ) -> None:
        other = load_object("block", at(0.7225, -0.0235, -0.155), name="other", is_movable=True)
        plan = planned(TASK, manipulator, scene.with_body(other))
        assert plan.failure is not None
        assert plan.failure.stage == "place: descend"
        assert plan.failure.reason.startswith("other stands there: block would be")
        (tally,) = plan.failure.tallies
        assert tally.colliding == tally.solutions

    def test_a_start_inside_something_fails_at_the_first_move(
        self, manipulator: Manipulator, scene: Scene
    ) -> None:
        tip = manipulator.arm.T_base_tip(manipulator.arm.start).translation
        crate = box("crate", (0.2, 0.2, 0.2), *tip)
        plan = planned(TASK, manipulator, scene.with_body(crate))
        assert plan.failure is not None
        assert plan.failure.stage == "pick: approach"
        assert re.fullmatch(
            r"the arm is blocked at its start: \w+ is [\d.]+ mm inside crate",
            plan.failure.reason,
        )
        assert plan.failure.is_certain


class TestObstacles:
    """Sideways motions go around what is in the way, and stop at nothing."""

    @pytest.fixture
    def walled(self, scene: Scene) -> Scene:
        height = 0.26
        return scene.with_body(box("wall", (0.3, 0.02, height), 0.72, 0.075, -0.155 + height / 2))

    def test_over_a_wall(self, plan: Plan, manipulator: Manipulator, walled: Scene) -> None:
        over = planned(TASK, manipulator, walled)
        assert over.is_valid, str(over.failure)
        assert labels(over) == STAGES
        assert over.motion_time_s < plan.motion_time_s + 1.0
        speeds = [float(np.abs(move.trajectory.v[-1]).max()) for move in over.moves]
        assert [speed > 0.1 for speed in speeds] == [True, False, True, True, False, False]

    def test_lines_up_to_the_clear_height_stay_straight(
        self, manipulator: Manipulator, walled: Scene
    ) -> None:
        over = planned(TASK, manipulator, walled)
        for stage, T in (("pick: approach", PICK), ("place: approach", PLACE)):
            move = next(move for move in over.moves if move.label == stage)
            T_end = manipulator.arm.T_base_tip(move.trajectory.q_goal)
            above = raised(T, TASK.clear_m)
            np.testing.assert_allclose(T_end.translation, above.translation, atol=REACHED_M)

    def test_a_wall_before_the_pick_is_passed_too(
        self, manipulator: Manipulator, scene: Scene
    ) -> None:
        q_start = manipulator.ik.solve(overhead(0.72, -0.2, -0.05)).q
        wall = box("wall", (0.3, 0.02, 0.2), 0.72, 0.03, -0.055)
        task = PickAndPlace("block", PICK, overhead(0.70, 0.25, -0.129))
        plan = plan_pick_and_place(task, manipulator, scene.with_body(wall), q_start)
        assert plan.is_valid, str(plan.failure)
        assert verify(plan).is_valid

    def test_the_same_obstacle_gives_the_same_plan(
        self, manipulator: Manipulator, walled: Scene
    ) -> None:
        first, again = (planned(TASK, manipulator, walled) for _ in range(2))
        for one, other in zip(first.moves, again.moves, strict=True):
            assert one.trajectory.q.tolist() == other.trajectory.q.tolist()

    def test_a_wall_that_the_forearm_goes_into_was_believed_to_be_passed(
        self, robot: Baxter, manipulator: Manipulator, scene: Scene
    ) -> None:
        """30 cm high; shapes smaller than the meshes miss it, and `verify` does not."""
        wall = box("wall", (0.3, 0.02, 0.3), 0.72, 0.075, -0.005)
        body = RobotBody.load()
        lacking = {name: link for name, link in body.links.items() if "forearm" not in name}
        thin = Manipulator.of(robot, "left", body=evolve(body, links=lacking))
        believed = planned(TASK, thin, scene.with_body(wall))
        assert believed.is_valid
        found = verify(believed)
        assert not found.is_valid
        assert "wall" in found.reason
        refused = planned(TASK, manipulator, scene.with_body(wall))
        assert "left_lower_forearm with wall, at best" in str(refused.failure)

    def test_where_no_way_is_found_the_search_says_so(
        self, manipulator: Manipulator, walled: Scene, monkeypatch: pytest.MonkeyPatch
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
        self, plan: Plan, manipulator: Manipulator, scene: Scene
    ) -> None:
        """A tenth of a millimetre: samples 10 ms apart are centimetres apart."""
        plate = box("plate", (0.3, 0.0001, 0.2), 0.72, 0.075, -0.05)
        failed = verify(plan, State.of(manipulator, scene.with_body(plate)))
        assert not failed.is_valid
        assert "plate" in str(failed)
        around = planned(TASK, manipulator, scene.with_body(plate))
        assert verify(around).is_valid

    def test_a_sheet_in_the_way_is_gone_around(
        self, manipulator: Manipulator, scene: Scene
    ) -> None:
        corners = np.array(
            [(-0.15, 0.0, -0.1), (0.15, 0.0, -0.1), (0.15, 0.0, 0.1), (-0.15, 0.0, 0.1)]
        )
        sheet = Part(Mesh(corners, np.array([(0, 1, 2), (0, 2, 3)])), at(0.0, 0.0, 0.0))
        plan = planned(
            TASK, manipulator, scene.with_body(Body("sheet", (sheet,), at(0.72, 0.075, -0.055)))
        )
        assert plan.is_valid, str(plan.failure)
        assert verify(plan).is_valid


def test_where_all_cycles_collide_on_a_line_one_is_led_around(
    manipulator: Manipulator, table: Body
) -> None:
    """The elbow would be 9 mm inside the torso as the hand rises from the place: by stopping, it
    was 6.00 s."""
    pick, place = (
        pin.SE3(pin.utils.rotate("z", turn), np.array([x, y, -0.1325]))
        for x, y, turn in ((0.8488, 0.1634, -0.7609), (0.6230, 0.1946, 0.8266))
    )
    down = pin.SE3(np.diag([-1.0, 1.0, -1.0]), np.zeros(3))
    scene = Scene.of([table, make_block("block", pick, edge_m=0.045)])
    task = PickAndPlace("block", pick * down, place * down)
    plan = plan_pick_and_place(task, manipulator, scene, manipulator.arm.start)
    assert plan.is_valid, plan.failure
    assert plan.motion_time_s < 5.3
    assert verify(plan).is_valid


class TestCarried:
    """What the block in the hand comes near counts as what the arm does."""

    def test_what_the_held_block_would_graze_on_the_shortest_way_is_gone_around(
        self, plan: Plan, manipulator: Manipulator, scene: Scene
    ) -> None:
        post = post_below_the_carried_block(plan, manipulator, scene, gap_m=-0.007)
        cluttered = planned(TASK, manipulator, scene.with_body(post))
        assert cluttered.is_valid, str(cluttered.failure)
        assert cluttered.motion_time_s > 0.99 * plan.motion_time_s
        assert verify(cluttered).is_valid

    def test_the_clearance_of_a_held_block_counts(
        self, plan: Plan, manipulator: Manipulator, scene: Scene
    ) -> None:
        post = post_below_the_carried_block(plan, manipulator, scene, gap_m=0.003)
        close = planned(TASK, manipulator, scene.with_body(post))
        assert close.is_valid, str(close.failure)
        assert close.clearance is not None
        assert (close.clearance.first, close.clearance.second) == ("block", "post")
        assert 0.0025 <= close.clearance.distance_m <= 0.01  # 3 mm below where it is lowest nearby


def post_below_the_carried_block(
    plan: Plan, manipulator: Manipulator, scene: Scene, gap_m: float
) -> Body:
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
    return box("post", (0.001, 0.001, 0.02), x, y, top - 0.01)
