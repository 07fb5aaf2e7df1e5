"""Redundancy maps: how much freedom the self-motion of reachable poses leaves."""

from planner.atlas.cost import Cost
from planner.atlas.redundancy.building import RedundancyReport, build_redundancy_map
from planner.atlas.redundancy.cost import estimate
from planner.atlas.redundancy.freedom import Freedom, RedundancySearch, freedom_at
from planner.atlas.redundancy.redundancy_map import RedundancyCell, RedundancyMap
from planner.atlas.redundancy.subset import Subset

__all__ = [
    "Cost",
    "Freedom",
    "RedundancyCell",
    "RedundancyMap",
    "RedundancyReport",
    "RedundancySearch",
    "Subset",
    "build_redundancy_map",
    "estimate",
    "freedom_at",
]
