"""What is put on the table stands on it; what cannot be is told with its unit."""

from __future__ import annotations

import math
from typing import Any

import pytest

from baxter_kin import Baxter
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


@pytest.mark.parametrize("size", [0.3, (0.3, 0.2), "big", None, (0.3, 0.2, math.nan)])
def test_a_size_is_three_lengths(bench: Workbench, size: Any) -> None:
    with pytest.raises(SceneError, match="three edges along x, y and z in m, such as"):
        bench.add_obstacle("wall", 0.70, 0.0, size_m=size)


def test_a_size_is_above_zero(bench: Workbench) -> None:
    with pytest.raises(SceneError, match="every edge of size_m must be above zero"):
        bench.add_obstacle("wall", 0.70, 0.0, size_m=(0.3, 0.0, 0.2))


@pytest.mark.parametrize(
    ("block", "hint"),
    [
        ({"edge_m": 5.0}, "it is 5 m wide along x, the table 0.91 m; .* 5 cm is 0.05 m"),
        ({"x_m": 70.0, "y_m": 15.0}, "are these centimetres.* 70 cm is 0.7 m"),
        ({"x_m": 700.0, "y_m": 150.0}, "are these millimetres.* 700 mm is 0.7 m"),
        ({"yaw_rad": 45.0}, "at most a whole turn, got 45; are these degrees.* 0.7854 rad"),
    ],
)
def test_other_units_are_asked_about(bench: Workbench, block: dict[str, Any], hint: str) -> None:
    with pytest.raises(SceneError, match=hint):
        bench.add_block("blue", **({"x_m": 0.7, "y_m": 0.0} | block))
