"""What is put on the table stands on it; what cannot be is told with its unit."""

from __future__ import annotations

import math
from typing import Any

import pytest

from baxter_kin import Baxter
from planner import Body, Box, Cylinder, Part
from planner.errors import SceneError
from sim import Workbench
from sim.workbench.tabletop import TABLE_Z_M
from tests.conftest import at

WALL = (0.30, 0.02, 0.20)


@pytest.fixture
def bench(robot: Baxter) -> Workbench:
    """A red block before the right arm."""
    bench = Workbench(robot)
    bench.add_block("red", 0.65, -0.30, edge_m=0.04)
    return bench


def test_an_obstacle_stands_on_the_table_and_stays_there(bench: Workbench) -> None:
    bench.add_obstacle("wall", 0.70, -0.15, size_m=WALL)
    wall = bench.world.body("wall")
    assert wall.T_base_body.isApprox(at(0.70, -0.15, TABLE_Z_M + 0.10))
    assert wall.extent_m((0.0, 0.0, 1.0)) == pytest.approx((TABLE_Z_M, TABLE_Z_M + 0.20))
    with pytest.raises(SceneError, match="'wall' is not a block to carry; there are: red"):
        bench.carry("wall", to=(0.70, 0.0))


@pytest.mark.slow
def test_a_block_is_carried_around_an_obstacle(bench: Workbench) -> None:
    bench.add_obstacle("wall", 0.70, -0.15, size_m=WALL)
    task = bench.carry("red", to=(0.80, 0.0), arm="right")
    assert task.is_done
    assert task.plan is not None
    assert task.plan.proven_clearance_m is not None
    assert task.plan.proven_clearance_m > 0.0


def test_an_obstacle_can_be_turned_and_coloured(bench: Workbench) -> None:
    bench.add_obstacle("wall", 0.70, 0.0, size_m=WALL, yaw_rad=math.pi / 2.0, colour="yellow")
    wall = bench.world.body("wall")
    assert wall.extent_m((0.0, 1.0, 0.0)) == pytest.approx((-0.15, 0.15))
    bench.add_block("yellow", 0.60, 0.3)
    assert wall.parts[0].rgba == bench.world.body("yellow").parts[0].rgba


def test_an_obstacle_is_not_put_where_a_block_stands(bench: Workbench) -> None:
    with pytest.raises(SceneError, match=r"no room for 'wall' at \(0.65, -0.3\) m: 'red' stands"):
        bench.add_obstacle("wall", 0.65, -0.30, size_m=WALL)


@pytest.mark.slow
def test_a_box_and_a_cylinder_stand_on_the_table_and_are_carried(robot: Baxter) -> None:
    bench = Workbench(robot)
    bench.add_box("book", 0.65, 0.20, size_m=(0.15, 0.04, 0.10), yaw_rad=0.3, colour="blue")
    bench.add_cylinder("tin", 0.75, -0.15, radius_m=0.02, length_m=0.09)
    for name, height_m in (("book", 0.10), ("tin", 0.09)):
        body = bench.world.body(name)
        assert body.extent_m((0, 0, 1)) == pytest.approx((TABLE_Z_M, TABLE_Z_M + height_m))
        assert body.is_movable
    assert bench.carry("book", to=(0.75, 0.1), arm="left").is_done
    assert bench.carry("tin", to=(0.65, -0.2), arm="right").is_done
    for name, where in (("book", (0.75, 0.1)), ("tin", (0.65, -0.2))):
        assert bench.world.body(name).centre_base[:2] == pytest.approx(where, abs=1e-5)


def test_cylinders_may_touch_where_their_bounding_boxes_overlap(robot: Baxter) -> None:
    bench, step = Workbench(robot), 0.1 / math.sqrt(2.0)
    bench.add_cylinder("one", 0.70, 0.0, radius_m=0.05, length_m=0.1)
    bench.add_cylinder("two", 0.70 + step, step, radius_m=0.05, length_m=0.1)
    with pytest.raises(SceneError, match=r"no room for 'three' at .* 'one' stands there"):
        bench.add_cylinder("three", 0.70 - step, -step + 0.002, radius_m=0.05, length_m=0.1)


def test_a_body_of_any_shape_stands_where_its_pose_says(bench: Workbench) -> None:
    plate = Part(Cylinder(0.06, 0.01), at(0.0, 0.0, 0.005))
    knob = Part(Cylinder(0.012, 0.06), at(0.0, 0.0, 0.04))
    bench.add_body(Body("lid", (plate, knob), at(0.70, 0.0, TABLE_Z_M + 0.003), is_movable=True))
    shelf = Body("shelf", (Part(Box((0.2, 0.2, 0.02)), at(0.0, 0.0, 0.0)),), at(0.9, 0.3, 0.1))
    bench.add_body(shelf)
    assert bench.world.body("lid").T_base_body.isApprox(at(0.70, 0.0, TABLE_Z_M), 1e-6)
    assert bench.world.body("shelf").T_base_body.isApprox(shelf.T_base_body)
    with pytest.raises(SceneError, match="body must be of class Body, got str"):
        bench.add_body("lid")  # type: ignore[arg-type]
    with pytest.raises(SceneError, match="already has a body named 'lid'"):
        bench.add_body(shelf.__class__("lid", shelf.parts, shelf.T_base_body))


def test_lengths_are_numbers_above_zero(bench: Workbench) -> None:
    size: Any
    for size in (0.3, (0.3, 0.2), "big", None, (0.3, 0.2, math.nan)):
        with pytest.raises(SceneError, match="three edges along x, y and z"):
            bench.add_obstacle("wall", 0.70, 0.0, size_m=size)
    with pytest.raises(SceneError, match="size_m must be above zero"):
        bench.add_obstacle("wall", 0.70, 0.0, size_m=(0.3, 0.0, 0.2))
    wrong: dict[str, Any]
    for wrong in ({"radius_m": 0.0}, {"length_m": math.nan}, {"x_m": None}):
        numbers = {"x_m": 0.7, "y_m": 0.0, "radius_m": 0.02, "length_m": 0.1} | wrong
        with pytest.raises(SceneError, match=next(iter(wrong))):
            bench.add_cylinder("tin", **numbers)


@pytest.mark.parametrize(
    ("block", "hint"),
    [
        ({"edge_m": 5.0}, "it is 5 m wide along x, the table 0.91 m; .* 5 cm is 0.05 m"),
        ({"x_m": 70.0, "y_m": 15.0}, "are these centimetres.* 70 cm is 0.7 m"),
        ({"x_m": 700.0, "y_m": 150.0}, "are these millimetres.* 700 mm is 0.7 m"),
        ({"yaw_rad": 45.0}, "at most a whole turn, got 45; are these degrees.* 0.7854 rad"),
    ],
)
def test_other_units_are_questioned(bench: Workbench, block: dict[str, Any], hint: str) -> None:
    with pytest.raises(SceneError, match=hint):
        bench.add_block("blue", **({"x_m": 0.7, "y_m": 0.0} | block))


@pytest.mark.slow
def test_a_mug_is_carried_by_its_handle(robot: Baxter) -> None:
    """The cup is 10 cm wide, which no hand holds; the handle 18 mm."""
    bench = Workbench(robot)
    cup = Part(Cylinder(0.05, 0.09), at(0.0, 0.0, 0.045))
    handle = Part(Box((0.1, 0.018, 0.03)), at(0.09, 0.0, 0.07))
    bench.add_body(Body("mug", (cup, handle), at(0.65, 0.15, TABLE_Z_M), is_movable=True))
    task = bench.carry("mug", to=at(0.70, 0.0, TABLE_Z_M), arm="left")
    assert task.is_done, task.verdict
    assert task.off_m is not None
    assert task.off_m < 1e-4


@pytest.mark.slow
def test_a_block_between_others_is_grasped_where_there_is_room(robot: Baxter) -> None:
    """Its narrow side is closed in by neighbours, where it stands or where it goes."""
    for y_m in (0.10, -0.05):
        bench = Workbench(robot)
        bench.add_box("red", 0.65, 0.10, size_m=(0.045, 0.04, 0.05))
        bench.add_block("blue", 0.65, y_m + 0.05, edge_m=0.05)
        bench.add_block("green", 0.65, y_m - 0.05, edge_m=0.05)
        assert bench.carry("red", to=(0.65, -0.05), arm="left").is_done
