"""What a build is expected to take."""

from __future__ import annotations

import pytest

from baxter_kin import Baxter
from planner.atlas import ReachMap, RotationGrid
from planner.atlas.commands.build import BLOCK_S, BlockCosts
from planner.atlas.cost import OVERHEAD, estimate


def test_the_costs_of_all_blocks_add_up_to_that_of_the_map(
    robot: Baxter, small_map: ReachMap
) -> None:
    grid, arms = small_map.positions, small_map.arms
    cost = estimate(robot, grid, RotationGrid.hopf(0), arms, measure_s=1e-6)
    costs = BlockCosts(robot, grid, arms, cost)
    expected = [costs.expected_s(block) - BLOCK_S for block in small_map.blocks]
    assert min(expected) > 0.0
    assert OVERHEAD * sum(expected) == pytest.approx(cost.core_s)
