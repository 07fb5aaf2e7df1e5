"""Small redundancy maps that tests of atlases share; `tests/conftest.py` has the reach maps."""

from __future__ import annotations

from pathlib import Path

import pytest

from baxter_kin.parallel import Serial
from planner.atlas import ReachDefinition, ReachMap
from planner.atlas.redundancy import (
    RedundancyDefinition,
    RedundancyMap,
    RedundancySearch,
    Subset,
    build_redundancy_map,
)
from tests.planner.atlas.maps import BuiltMap

pytest.importorskip("zarr", reason="maps need zarr, and it Python 3.11", exc_type=ImportError)


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


@pytest.fixture(params=["reach", "redundancy"])
def built(request: pytest.FixtureRequest, small_map: ReachMap, subset: Subset) -> BuiltMap:
    """A map of each kind; not to be changed."""
    if request.param == "reach":
        robot, positions, rotations = small_map.robot, small_map.positions, small_map.rotations
        return BuiltMap(small_map, ReachDefinition(robot, positions, rotations))
    found: RedundancyMap = request.getfixturevalue("redundancy_map")
    return BuiltMap(found, RedundancyDefinition(small_map, subset), (small_map.path,))
