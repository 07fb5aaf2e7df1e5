"""World: what falls, what rests on what, what moves with a hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin import Baxter
from baxter_kin.errors import PoseError
from planner import Body, Box, Cylinder, Part, Scene, Sphere, State, load_object
from planner.errors import SceneError
from planner.scene.bodies import Shape
from planner.scene.faces import FLOOR_Z_M
from planner.scene.support import FLOOR
from sim import SimulationError, World
from tests.conftest import at

REST_M = 1e-7
"""Contacts are found to 1e-8 m, and a fall begins half a millimetre up and ends on one."""

RIGID = 1e-12
"""Products of rotations of order 1."""

TABLE_Z_M = -0.155
EDGE_X_M = 0.5435
"""Where the table begins."""

ORIGIN = at(0.0, 0.0, 0.0)
UP = (0.0, 0.0, 1.0)
seeds = st.integers(0, 2**32 - 1)


def rested(world: World, thing: Body) -> tuple[Body, str]:
    """The body where it came to rest, and its support; it is removed again."""
    support = world.spawn(thing)
    found = world.body(thing.name)
    world.delete(thing.name)
    return found, support


def body(name: str, shape: Shape, T: pin.SE3) -> Body:
    return Body(name, (Part(shape, ORIGIN),), T, is_movable=True)


def cube(name: str, x: float, y: float, z: float, edge: float = 0.05) -> Body:
    return body(name, Box((edge, edge, edge)), at(x, y, z))


def lowest(world: World, name: str) -> float:
    return world.body(name).extent_m(UP)[0]


def is_level(T: pin.SE3) -> bool:
    """Whether one of the axes is vertical."""
    return bool(np.isclose(np.abs(T.rotation[2]).max(), 1.0, atol=1e-12))


class TestSettling:
    """A movable body falls straight until it touches something."""

    def test_the_demos_block_drops_75_mm_onto_the_table(self, world: World) -> None:
        block = load_object("block", at(0.6725, 0.1265, 0.7825 - 0.93), is_movable=True)
        assert world.spawn(block) == "table"
        assert world.body("block").centre_base == pytest.approx(
            [0.6975, 0.1515, -0.130], abs=REST_M
        )

    @pytest.mark.parametrize("gap", [0.0, -1e-9, -2e-4])
    def test_a_body_falls_down_a_wall_that_it_touches(self, world: World, gap: float) -> None:
        world.spawn(cube("wall", 0.7, 0.1, 0.0, edge=0.1))
        world.spawn(cube("b", 0.9, 0.1, 0.0))
        world.place_body("b", at(0.7 + 0.075 + gap, 0.1, TABLE_Z_M + 0.05))
        assert world.settle("b").support == "table"
        assert lowest(world, "b") == pytest.approx(TABLE_Z_M, abs=REST_M)

    def test_a_body_under_another_falls_without_it(self, world: World) -> None:
        for name in "ab":
            world.spawn(cube(name, 0.7, 0.1, 0.3))
        z = TABLE_Z_M + 0.025 + 0.1
        world.place_body("a", at(0.7, 0.1, z))
        world.place_body("b", at(0.7, 0.1, z + 0.05))
        assert world.settle("a").support == "table"
        assert world.settle("b").support == "a"

    def test_how_far_it_falls_is_known_before_it_does(self, world: World) -> None:
        world.spawn(cube("b", 0.7, 0.1, TABLE_Z_M + 0.025))
        world.place_body("b", at(0.7, 0.1, TABLE_Z_M + 0.025 + 0.0075))
        assert world.rest("b").fall_m == pytest.approx(0.0075, abs=REST_M)
        assert lowest(world, "b") == pytest.approx(TABLE_Z_M + 0.0075, abs=REST_M)

    @pytest.mark.parametrize(
        ("x", "y", "z", "support"),
        [
            (0.7, 0.1, 0.3, "table"),
            (0.3, 0.0, 0.2, FLOOR),
            (0.0, 0.0, -2.0, FLOOR),  # from below it comes up
            (EDGE_X_M + 1e-4, 0.0, 0.0, "table"),
            (EDGE_X_M - 1e-4, 0.0, 0.0, FLOOR),
            (EDGE_X_M - 0.025 - 1e-4, 0.0, 0.3, FLOOR),  # past the edge by a hair
        ],
    )
    def test_a_body_rests_where_its_centre_is_above_something(
        self, world: World, x: float, y: float, z: float, support: str
    ) -> None:
        assert world.spawn(cube("b", x, y, z)) == support
        height = {FLOOR: FLOOR_Z_M, "table": TABLE_Z_M}[support]
        assert lowest(world, "b") == pytest.approx(height, abs=REST_M)

    def test_bodies_stack(self, world: World) -> None:
        supports = [world.spawn(cube(name, 0.7, 0.1, 0.3)) for name in "abc"]
        assert supports == ["table", "a", "b"]
        heights = [lowest(world, name) - TABLE_Z_M for name in "abc"]
        assert heights == pytest.approx([0.0, 0.05, 0.10], abs=3 * REST_M)

    @pytest.mark.parametrize("gap", [1e-5, 1e-4, 5e-4, 2e-3])
    def test_a_body_falls_past_another_that_it_does_not_touch(
        self, world: World, gap: float
    ) -> None:
        world.spawn(cube("tower", 0.7, 0.1, 0.0, edge=0.1))
        assert world.spawn(cube("b", 0.7 + 0.075 + gap, 0.1, 0.5)) == "table"

    def test_of_two_bodies_below_the_higher_one_supports(self, world: World) -> None:
        world.spawn(cube("low", 0.70, 0.1, 0.0, edge=0.04))
        world.spawn(cube("high", 0.76, 0.1, 0.0, edge=0.06))
        assert world.spawn(cube("bridge", 0.73, 0.1, 0.3, edge=0.05)) == "high"

    @settings(max_examples=25)
    @given(seeds)
    def test_a_tilted_cube_comes_to_rest_level_on_the_table_where_it_was(
        self, shared: World, seed: int
    ) -> None:
        rng = np.random.default_rng(seed)
        quat = rng.normal(size=4)
        R = pin.Quaternion(*(quat / np.linalg.norm(quat))).toRotationMatrix()
        centre = np.array([rng.uniform(0.6, 1.4), rng.uniform(-0.4, 0.4), 0.2])
        found, support = rested(shared, body("b", Box((0.05, 0.05, 0.05)), pin.SE3(R, centre)))
        assert support == "table"
        assert is_level(found.T_base_body)
        assert found.centre_base == pytest.approx(
            [centre[0], centre[1], TABLE_Z_M + 0.025], abs=REST_M
        )

    @settings(max_examples=25)
    @given(seeds)
    def test_levelling_turns_by_the_least_angle(self, shared: World, seed: int) -> None:
        rng = np.random.default_rng(seed)
        roll, pitch = rng.uniform(-0.6, 0.6, 2)
        yaw = rng.uniform(-3.0, 3.0)
        R = pin.rpy.rpyToMatrix(roll, pitch, yaw)
        T = pin.SE3(R, np.array([0.8, 0.0, 0.2]))
        found, _ = rested(shared, body("b", Box((0.05, 0.06, 0.07)), T))
        turn = found.T_base_body.rotation @ R.T
        tilt = np.arccos(np.clip(np.abs(R[2]).max(), -1.0, 1.0))
        assert np.linalg.norm(pin.log3(turn)) == pytest.approx(tilt, abs=1e-7)

    @given(
        st.floats(-1.5, 1.5),
        st.tuples(*[st.floats(0.01, 0.3)] * 3),
        st.sampled_from(["box", "rod", "ball"]),
    )
    def test_nothing_comes_to_rest_inside_the_table(
        self, shared: World, pitch: float, size: tuple[float, float, float], kind: str
    ) -> None:
        shapes: dict[str, Shape] = {
            "box": Box(size),
            "rod": Cylinder(size[0] / 2, size[1]),
            "ball": Sphere(size[0]),
        }
        R = pin.rpy.rpyToMatrix(0.0, pitch, 0.3)
        thing = body("thing", shapes[kind], pin.SE3(R, np.array([1.0, 0.0, 0.0])))
        lift = TABLE_Z_M - thing.extent_m(UP)[0] + 0.001  # a millimetre above, as it is tilted
        found, support = rested(shared, thing.at(pin.SE3(R, np.array([1.0, 0.0, lift]))))
        assert support == "table"
        assert found.extent_m(UP)[0] == pytest.approx(TABLE_Z_M, abs=REST_M)

    def test_a_body_pressed_in_slightly_comes_up_again(self, world: World) -> None:
        world.spawn(cube("b", 0.7, 0.1, TABLE_Z_M + 0.025))
        world.place_body("b", at(0.7, 0.1, TABLE_Z_M + 0.025 - 3e-4))
        world.settle("b")
        assert lowest(world, "b") == pytest.approx(TABLE_Z_M, abs=REST_M)

    def test_an_immovable_body_stays_in_the_air(self, world: World, block: Body) -> None:
        shelf = Body("shelf", block.parts, at(0.7, 0.1, 0.5))
        assert world.spawn(shelf) == "shelf"
        assert world.body("shelf").T_base_body.translation.tolist() == [0.7, 0.1, 0.5]


class TestSpawnAndDelete:
    """Bodies come and go."""

    def test_a_deleted_body_is_gone_also_from_a_hand_and_its_name_free(
        self, world: World, block: Body
    ) -> None:
        world.spawn(block)
        world.delete("block")
        assert list(world.scene.bodies) == ["table"]
        assert "block" not in world.supports
        assert world.spawn(block) == "table"
        world.attach("left", "block", ORIGIN)
        world.delete("block")
        assert world.holding("left") is None

    def test_what_stood_on_a_deleted_body_falls(self, world: World) -> None:
        for name in "abc":
            world.spawn(cube(name, 0.7, 0.1, 0.3))
        world.delete("a")
        assert world.supports == {"b": ("table",), "c": ("b",)}
        heights = [lowest(world, name) - TABLE_Z_M for name in "bc"]
        assert heights == pytest.approx([0.0, 0.05], abs=3 * REST_M)

    def test_without_the_table_everything_lies_on_the_floor(self, world: World) -> None:
        world.spawn(cube("a", 0.7, 0.1, 0.3))
        world.spawn(cube("b", 0.9, 0.1, 0.3))
        world.delete("table")
        assert world.supports == {"a": (FLOOR,), "b": (FLOOR,)}
        assert lowest(world, "a") == pytest.approx(FLOOR_Z_M, abs=REST_M)

    def test_a_name_that_is_taken_is_refused_and_nothing_changes(
        self, world: World, block: Body
    ) -> None:
        world.spawn(block)
        before = world.body("block").T_base_body
        with pytest.raises(SceneError, match="already has a body named 'block'"):
            world.spawn(block.at(at(0.9, 0.0, 0.3)))
        assert world.body("block").T_base_body == before

    def test_unknown_bodies_are_refused_naming_those_there(self, world: World) -> None:
        name: Any
        for name in ("brick", "", None, 5, ["table"], {}):
            for use in (
                world.body,
                world.delete,
                world.rest,
                world.settle,
                lambda name: world.place_body(name, ORIGIN),
                lambda name: world.attach("left", name, ORIGIN),
            ):
                with pytest.raises(SceneError, match="it has: table"):
                    use(name)
        for name in (None, "block", 5):
            with pytest.raises(SceneError, match="body"):
                world.spawn(name)

    def test_the_scene_shows_bodies_where_they_are_and_poses_handed_out_are_copies(
        self, world: World
    ) -> None:
        world.spawn(cube("b", 0.7, 0.1, 0.3))
        poses = world.body_poses()
        poses["b"].translation = np.zeros(3)
        world.q[:] = 99.0
        assert world.q.max() < 99.0
        assert world.body("b").T_base_body.translation.any()
        assert world.scene["b"].T_base_body == world.body("b").T_base_body
        world.place_body("b", at(0.1, 0.2, 0.3))
        assert world.scene["b"].T_base_body.translation.tolist() == [0.1, 0.2, 0.3]


class TestRiders:
    """What stands on a body goes where that goes."""

    @pytest.fixture
    def tower(self, world: World) -> World:
        """Three cubes on each other."""
        for name in "abc":
            world.spawn(cube(name, 0.7, 0.1, 0.3))
        return world

    def test_a_body_put_elsewhere_takes_along_what_stands_on_it(self, tower: World) -> None:
        assert (tower.riders("a"), tower.riders("c")) == (("b", "c"), ())
        tower.place_body("a", at(0.9, -0.2, TABLE_Z_M + 0.025))
        centres = [tower.body(name).centre_base for name in "abc"]
        for centre, height in zip(centres, (0.025, 0.075, 0.125), strict=True):
            assert centre == pytest.approx([0.9, -0.2, TABLE_Z_M + height], abs=3 * REST_M)
        assert tower.supports == {"a": ("table",), "b": ("a",), "c": ("b",)}

    def test_a_body_taken_off_a_tower_is_no_rider_any_more(self, tower: World) -> None:
        tower.place_body("b", at(0.9, -0.2, TABLE_Z_M + 0.025))
        assert tower.supports == {"a": ("table",), "b": ("table",), "c": ("b",)}
        before = tower.body("b").T_base_body
        tower.place_body("a", at(0.6, 0.2, TABLE_Z_M + 0.025))
        assert tower.body("b").T_base_body == before

    def test_a_body_put_into_the_air_stands_on_nothing(self, tower: World) -> None:
        tower.place_body("c", at(0.9, -0.2, 0.3))
        assert "c" not in tower.supports
        assert tower.body("c").centre_base[2] == 0.3

    def test_a_hand_carries_what_stands_on_the_held_body(self, tower: World) -> None:
        T_tip_a = tower.T_base_tip("left").inverse() * tower.body("a").T_base_body
        tower.attach("left", "a", T_tip_a)
        before = {
            name: tower.T_base_tip("left").actInv(tower.body(name).centre_base) for name in "abc"
        }
        tower.move_arm("left", tower.robot.arm("left").start)
        for name, seen in before.items():
            now = tower.T_base_tip("left").actInv(tower.body(name).centre_base)
            assert now == pytest.approx(seen, abs=1e-9)

    def test_a_tower_let_go_settles_as_one(self, tower: World) -> None:
        tower.carry("a", at(0.8, 0.0, TABLE_Z_M + 0.1))
        tower.settle("a")
        heights = [lowest(tower, name) - TABLE_Z_M for name in "abc"]
        assert heights == pytest.approx([0.0, 0.05, 0.10], abs=3 * REST_M)


class TestHolding:
    """What a hand holds moves with it."""

    @settings(max_examples=20)
    @given(seeds)
    def test_a_held_body_keeps_its_pose_in_the_hand_wherever_the_arm_goes(
        self, shared: World, block: Body, seed: int
    ) -> None:
        rng = np.random.default_rng(seed)
        shared.spawn(block)
        T_tip_body = pin.SE3(pin.rpy.rpyToMatrix(*rng.uniform(-1, 1, 3)), rng.uniform(-0.1, 0.1, 3))
        shared.attach("left", "block", T_tip_body)
        offsets = []
        for _ in range(3):
            shared.move_arm("left", shared.robot.arm("left").random_configuration(rng))
            offsets.append(shared.T_base_tip("left").inverse() * shared.body("block").T_base_body)
        shared.delete("block")
        for held in offsets:
            assert held.homogeneous == pytest.approx(T_tip_body.homogeneous, abs=RIGID)

    def test_a_body_let_go_stays_until_it_is_settled(self, world: World, block: Body) -> None:
        world.spawn(block)
        world.attach("left", "block", ORIGIN)
        assert world.supports == {}
        in_hand = world.body("block").T_base_body
        world.move_arm("right", world.robot.arm("right").start)
        assert world.body("block").T_base_body == in_hand
        assert world.detach("left") == "block"
        world.move_arm("left", world.robot.arm("left").start)
        assert world.body("block").T_base_body == in_hand
        assert world.settle("block").support in ("table", FLOOR)
        assert world.detach("right") is None

    def test_what_a_hand_cannot_hold_and_what_it_holds_cannot_do(self, world: World) -> None:
        for name, x in (("a", 0.7), ("b", 0.9)):
            world.spawn(cube(name, x, 0.1, 0.3))
        world.attach("left", "a", ORIGIN)
        for use, words in (
            (lambda: world.attach("left", "b", ORIGIN), "left hand already holds 'a'"),
            (lambda: world.attach("right", "a", ORIGIN), "'a' is in the left hand"),
            (lambda: world.place_body("a", ORIGIN), "'a' is in the left hand"),
            (lambda: world.settle("a"), "'a' is in the left hand"),
            (lambda: world.attach("right", "table", ORIGIN), "'table' is not movable"),
        ):
            with pytest.raises(SimulationError, match=words):
                use()
        pose: Any
        for pose in (None, "here", np.eye(3), np.full((4, 4), np.nan), 0):
            with pytest.raises(PoseError):
                world.attach("right", "b", pose)
            with pytest.raises(PoseError):
                world.place_body("b", pose)


def test_what_is_no_rest_moves_nothing(robot: Baxter) -> None:
    world = World(robot)
    world.spawn(Body("block", (Part(Sphere(0.02), at(0, 0, 0)),), at(0.7, 0.0, 0.1)))
    rest: Any
    for rest in (None, 5, "table", np.eye(4)):
        with pytest.raises(SimulationError, match="rest"):
            world.put_to_rest("block", rest)


def test_a_world_from_a_state_has_that_state(robot: Baxter) -> None:
    """Also joints that no simulation would have reached, and a body in the air."""
    joints = dict.fromkeys(robot.joint_names, 0.01)
    state = State(Scene.of([cube("b", 0.7, 0.1, 0.3), cube("a", 0.7, 0.1, 0.25)]), joints)
    world = World.from_state(state, robot)
    assert world.state.joints == state.joints
    assert world.supports == {"b": ("a",)}
    for name, pose in world.body_poses().items():
        assert np.array_equal(pose.homogeneous, state.scene[name].T_base_body.homogeneous)
