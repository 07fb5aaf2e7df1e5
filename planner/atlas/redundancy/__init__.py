"""Redundancy maps: how much freedom the self-motion of reachable poses leaves."""

from planner.atlas.redundancy.freedom import Freedom, RedundancySearch, freedom_at
from planner.atlas.redundancy.redundancy_map import (
    RedundancyCell,
    RedundancyDefinition,
    RedundancyMap,
    build_redundancy_map,
)
from planner.atlas.redundancy.subset import Subset

__all__ = [
    "Freedom",
    "RedundancyCell",
    "RedundancyDefinition",
    "RedundancyMap",
    "RedundancySearch",
    "Subset",
    "build_redundancy_map",
    "freedom_at",
]
