"""Maps of what Baxter can reach: every "yes" has a witness, every "no" a proof."""

from planner.atlas.building import BlockReport, build_reach_map
from planner.atlas.cell import Cell
from planner.atlas.positions import PositionGrid
from planner.atlas.reach_map import ReachMap
from planner.atlas.rotations import RotationGrid

__all__ = [
    "BlockReport",
    "Cell",
    "PositionGrid",
    "ReachMap",
    "RotationGrid",
    "build_reach_map",
]
