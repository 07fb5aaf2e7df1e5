"""Spawning: what is inside something is refused, and what stands on several knows them all."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter
from planner import Body, Box, Mesh, Part, make_block
from planner.errors import SceneError
from sim import Simulation, World
from tests.conftest import at

TABLE_Z_M = -0.155
EDGE_M = 0.05
ORIGIN = at(0.0, 0.0, 0.0)
REST_M = 1e-6


def cube(name: str, x: float, y: float, above_m: float = 0.0) -> Body:
    return make_block(name, at(x, y, TABLE_Z_M + EDGE_M / 2 + above_m), edge_m=EDGE_M)


class TestInside:
    """Nothing that is carried begins inside something else."""

    @pytest.mark.parametrize("low_m", [0.001, 0.04])
    def test_a_block_spawned_too_low_is_refused_with_how_deep(
        self, world: World, low_m: float
    ) -> None:
        wanted = f"{1e3 * low_m:.1f} mm inside 'table'.*{1e3 * low_m:.1f} mm higher"
        with pytest.raises(SceneError, match=wanted):
            world.spawn(cube("b", 0.7, 0.1, -low_m))
        assert list(world.scene.bodies) == ["table"]

    def test_a_block_that_presses_less_than_a_contact_may_comes_up(self, world: World) -> None:
        assert world.spawn(cube("b", 0.7, 0.1, -4e-4)) == "table"
        bottom_m, _ = world.body("b").extent_m((0.0, 0.0, 1.0))
        assert bottom_m == pytest.approx(TABLE_Z_M, abs=REST_M)

    def test_a_block_in_another_is_refused_but_what_stays_may_be_built_into_others(
        self, world: World
    ) -> None:
        world.spawn(cube("a", 0.7, 0.1))
        with pytest.raises(SceneError, match=r"'b' would be 10.0 mm inside 'a'"):
            world.spawn(cube("b", 0.74, 0.1))
        with pytest.raises(SceneError, match="inside 'table'"):
            Simulation(world).spawn(cube("b", 0.7, 0.3, -0.01))
        wall = Body("wall", (Part(Box((0.02, 0.2, 0.2)), ORIGIN),), at(0.9, 0.1, -0.1))
        assert world.spawn(wall) == "wall"

    def test_a_block_that_a_surface_passes_through_is_refused_and_one_within_is_not(
        self, world: World
    ) -> None:
        corners = np.array(
            [[x, y, z] for x in (0.5, 0.9) for y in (-0.1, 0.3) for z in (-0.1, 0.3)]
        )
        faces = [[0, 2, 6], [0, 6, 4], [0, 1, 5], [0, 5, 4], [2, 3, 7], [2, 7, 6]]
        trough = Mesh(corners, np.array(faces))
        world.spawn(Body("trough", (Part(trough, ORIGIN),), ORIGIN))
        with pytest.raises(SceneError, match=r"'b' would be 20.0 mm inside 'trough'"):
            world.spawn(make_block("b", at(0.7, 0.1, -0.095), edge_m=EDGE_M))
        assert world.spawn(make_block("b", at(0.7, 0.1, 0.1), edge_m=EDGE_M)) == "trough"


class TestSlopes:
    """Measured tables are off level; ramps are no tables."""

    @staticmethod
    def ramp(tilt_deg: float) -> Body:
        T = pin.SE3(pin.exp3(np.array([math.radians(tilt_deg), 0.0, 0.0])), np.array([0.7, 0, 0.1]))
        return Body("ramp", (Part(Box((0.5, 0.5, 0.02)), ORIGIN),), T)

    def test_a_block_over_a_ramp_is_refused_by_its_angle(self, robot: Baxter) -> None:
        world = World(robot)
        world.spawn(self.ramp(5.0))
        with pytest.raises(SceneError, match=r"'b' would not stand: 'ramp' slopes by 5.0 deg"):
            world.spawn(make_block("b", at(0.7, 0.0, 0.2)))
        assert "b" not in world.scene.bodies

    @pytest.mark.parametrize("tilt_deg", [0.001, 0.3, 0.99])
    def test_on_a_table_slightly_off_level_a_block_stays_where_it_is_put(
        self, robot: Baxter, tilt_deg: float
    ) -> None:
        world = World(robot)
        world.spawn(self.ramp(tilt_deg))
        assert world.spawn(make_block("b", at(0.72, 0.03, 0.2))) == "ramp"
        assert world.body("b").centre_base[:2] == pytest.approx([0.72, 0.03], abs=1e-9)
        before = world.body("b").T_base_body
        rest = world.settle("b")
        assert math.degrees(rest.tilt_rad) == pytest.approx(tilt_deg if tilt_deg > 0.01 else 0.0)
        after = world.body("b").T_base_body
        assert after.homogeneous == pytest.approx(before.homogeneous, abs=REST_M)


class TestSeveralSupports:
    """A body on two others stands on both."""

    @pytest.fixture
    def bridged(self, world: World) -> World:
        """A plank on two cubes."""
        for name, x in (("a", 0.65), ("b", 0.75)):
            world.spawn(cube(name, x, 0.1))
        world.spawn(make_block("top", at(0.70, 0.1, 0.0), edge_m=(0.14, 0.04, 0.02)))
        return world

    @pytest.mark.parametrize(("gone", "left"), [("a", "b"), ("b", "a")])
    def test_it_knows_all_of_them_and_without_one_it_falls(
        self, bridged: World, gone: str, left: str
    ) -> None:
        supports = bridged.supports
        assert supports["top"] == ("a", "b")
        assert bridged.riders("a") == bridged.riders("b") == ("top",)
        bridged.delete(gone)
        assert bridged.supports["top"] == ("table",)
        assert bridged.supports[left] == ("table",)

    def test_carried_away_with_one_it_does_not_stand_on_the_other(self, bridged: World) -> None:
        bridged.carry("a", at(0.65, -0.3, TABLE_Z_M + EDGE_M / 2))
        assert bridged.supports["top"] == ("a",)

    def test_riders_come_after_all_that_they_stand_on(self, world: World) -> None:
        world.spawn(make_block("base", at(0.7, 0.1, 0.0), edge_m=(0.2, 0.1, 0.02)))
        world.spawn(make_block("left", at(0.65, 0.1, 0.0), edge_m=0.04))
        world.spawn(make_block("right", at(0.75, 0.1, 0.0), edge_m=0.04))
        world.spawn(make_block("top", at(0.70, 0.1, 0.2), edge_m=(0.14, 0.04, 0.02)))
        assert world.riders("base") == ("left", "right", "top")
