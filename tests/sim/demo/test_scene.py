"""The demo's world is the original's, mirrored for the other arm."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Baxter, quaternion_xyzw
from planner import Body, Box
from sim import World
from sim.demo.options import DEFAULT_POSES_M
from sim.demo.scene import OVERHEAD_XYZW, centred_below, demo_bodies, obstacles, overhead
from tests.conftest import at

ROUNDING = 1e-12
TABLE_TOP_M = -0.155
DROP_M = 0.0075
"""The original spawns the block so far above its table."""

metres = st.floats(-1.0, 1.0)


@pytest.mark.parametrize("limb", ["left", "right"])
def test_the_block_is_spawned_a_little_above_the_table(limb: str) -> None:
    table, block = demo_bodies(limb)
    assert table.extent_m((0, 0, 1))[1] == pytest.approx(TABLE_TOP_M, abs=1e-9)
    bottom_m = block.extent_m((0, 0, 1))[0]
    assert bottom_m - TABLE_TOP_M == pytest.approx(DROP_M, abs=1e-9)
    assert (table.is_movable, block.is_movable) == (False, True)


def test_the_right_arms_block_is_the_mirror_image() -> None:
    (left_table, left), (right_table, right) = (demo_bodies(limb) for limb in ("left", "right"))
    assert left_table.T_base_body == right_table.T_base_body
    assert right.centre_base == pytest.approx(left.centre_base * [1, -1, 1], abs=ROUNDING)


def test_the_block_comes_to_rest_below_the_first_pick(robot: Baxter) -> None:
    world = World(robot)
    assert [world.spawn(body) for body in demo_bodies("left")] == ["table", "table"]
    off_m = world.body("block").centre_base[:2] - np.array(DEFAULT_POSES_M[0][:2])
    assert np.abs(off_m).max() < 3e-3


@given(metres, metres, metres)
def test_picks_and_places_have_the_originals_orientation(x: float, y: float, z: float) -> None:
    T = overhead((x, y, z))
    assert T.translation.tolist() == [x, y, z]
    assert abs(quaternion_xyzw(T) @ np.array(OVERHEAD_XYZW)) == pytest.approx(1.0, abs=ROUNDING)
    assert T.rotation[2, 2] < -0.999  # it points down


@given(metres, metres, metres)
def test_a_body_is_moved_below_a_tip_and_neither_up_nor_turned(
    block: Body, x: float, y: float, z: float
) -> None:
    moved = block.at(centred_below(block, overhead((x, y, z))))
    assert moved.centre_base == pytest.approx([x, y, block.centre_base[2]], abs=ROUNDING)
    assert np.array_equal(moved.T_base_body.rotation, block.T_base_body.rotation)


def test_obstacles_are_boxes_by_centre_and_size_numbered_from_1() -> None:
    first, second = obstacles([(0.7, 0.1, 0.0, 0.1, 0.2, 0.3), (0.5, 0.0, 0.2, 0.4, 0.4, 0.4)])
    assert (first.name, second.name) == ("obstacle 1", "obstacle 2")
    assert first.T_base_body == at(0.7, 0.1, 0.0)
    assert first.parts[0].shape == Box((0.1, 0.2, 0.3))
    assert first.centre_base == pytest.approx([0.7, 0.1, 0.0], abs=ROUNDING)
    assert not first.is_movable
