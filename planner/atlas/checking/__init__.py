"""Checks maps by code that shares nothing with the searches that computed them."""

from planner.atlas.checking.reach_check import (
    CELLS,
    MAX_CELLS,
    NEAR_LIMITS_RAD,
    MapCheck,
    check_map,
)

__all__ = ["CELLS", "MAX_CELLS", "NEAR_LIMITS_RAD", "MapCheck", "check_map"]
