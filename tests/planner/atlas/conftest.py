"""Small maps that tests of atlases share."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.parallel import Serial
from planner.atlas import (
    PositionGrid,
    ReachDefinition,
    ReachMap,
    RotationGrid,
    build_reach_map,
)
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
def small_grid() -> PositionGrid:
    """Positions at the edge of what the left arm reaches, in two blocks."""
    return PositionGrid.within([0.5, 0.0, 0.0], [0.8, 0.9, 0.2], 0.1)


@pytest.fixture(scope="session")
def small_map(
    robot: Baxter, small_grid: PositionGrid, tmp_path_factory: pytest.TempPathFactory
) -> ReachMap:
    """A map of both arms with 72 rotations; not to be changed."""
    path: Path = tmp_path_factory.mktemp("maps") / "small.zarr"
    return build_reach_map(path, robot, small_grid, RotationGrid.hopf(0), engine=Serial())


@pytest.fixture(scope="session")
def table_map(robot: Baxter, tmp_path_factory: pytest.TempPathFactory) -> ReachMap:
    """Both arms, the tool pointing down with 12 rolls, 10 cm apart; not to be changed."""
    positions = PositionGrid.within((0.2, -0.9, -0.2), (1.3, 0.9, 0.1), 0.1)
    rotations = RotationGrid.about_tool_axis(np.diag([-1.0, 1.0, -1.0]), 12)
    path: Path = tmp_path_factory.mktemp("maps") / "table.zarr"
    return build_reach_map(path, robot, positions, rotations, engine=Serial())


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
