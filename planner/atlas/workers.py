"""What workers keep open between their tasks."""

from __future__ import annotations

from functools import lru_cache

from baxter_kin.display import shown_path
from planner.atlas.reach_map import ReachMap
from planner.errors import AtlasError


@lru_cache(maxsize=1)
def opened_for_work(path: str, identity: str) -> ReachMap:
    """The map that a task is of, opened once.

    Args:
        path: its folder.
        identity: `ReachMap.identity`, as whoever made the task has seen it: workers of a cluster
            live longer than maps.
    """
    found = ReachMap(path)
    if found.identity != identity:
        raise AtlasError(f"the map at {shown_path(found.path)} was replaced by another one")
    return found
