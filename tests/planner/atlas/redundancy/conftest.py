"""A redundancy map that tests share."""

from __future__ import annotations

from pathlib import Path

import pytest

from baxter_kin.parallel import Serial
from planner.atlas import ReachMap
from planner.atlas.redundancy import RedundancyMap, RedundancySearch, Subset, build_redundancy_map


@pytest.fixture(scope="session")
def subset() -> Subset:
    """Two planes and six rolls of the tool that points down, in three blocks."""
    return Subset(("left",), (0, 2), tuple(range(10)), (1,), tuple(range(6)))


@pytest.fixture(scope="session")
def redundancy_map(
    small_map: ReachMap, subset: Subset, tmp_path_factory: pytest.TempPathFactory
) -> RedundancyMap:
    """A map of that; not to be changed."""
    path: Path = tmp_path_factory.mktemp("maps") / "freedom.zarr"
    return build_redundancy_map(path, small_map, subset, engine=Serial())


@pytest.fixture(scope="session")
def search(small_map: ReachMap) -> RedundancySearch:
    """Of the left arm."""
    return RedundancySearch(small_map.robot, "left")
