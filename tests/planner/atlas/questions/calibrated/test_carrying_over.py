"""A stock map for a calibrated robot, against a map of its own and an independent solver."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter
from baxter_kin.errors import UnknownNameError
from baxter_kin.parallel import Serial
from planner.atlas import (
    CalibratedCells,
    PositionGrid,
    ReachMap,
    RotationGrid,
    build_reach_map,
    for_calibrated,
)
from planner.atlas.checking.pose_finder import PoseFinder
from tests.served_urdf import served_urdf

GRID = PositionGrid.within((0.6, 0.1, 0.1), (0.8, 0.7, 0.1), 0.1)


@pytest.fixture(scope="module")
def own() -> Baxter:
    """Off by 2 mm and 4 mrad at every joint."""
    return Baxter.load(served_urdf(np.random.default_rng(8), apart_m=0.002, turned_rad=0.004))


@pytest.fixture(scope="module")
def stock_map(robot: Baxter, tmp_path_factory: pytest.TempPathFactory) -> ReachMap:
    path: Path = tmp_path_factory.mktemp("maps") / "stock.zarr"
    return build_reach_map(path, robot, GRID, RotationGrid.hopf(0), ("left",), engine=Serial())


@pytest.fixture(scope="module")
def cells(stock_map: ReachMap, own: Baxter) -> CalibratedCells:
    return for_calibrated(stock_map, own, "left")


def test_nothing_contradicts_a_map_of_its_own(
    cells: CalibratedCells, own: Baxter, tmp_path: Path
) -> None:
    path, rotations = tmp_path / "own.zarr", RotationGrid.hopf(0)
    codes = build_reach_map(path, own, GRID, rotations, ("left",), engine=Serial()).margins("left")
    assert not ((cells.margins >= 0) & (codes == -1)).any()
    assert not ((cells.margins == -1) & (codes >= 0)).any()
    assert ((cells.margins >= 0) != (codes >= 0)).mean() < 0.01
    assert cells.shares["undecided"] < (codes == -2).mean() + 0.01


def test_its_witnesses_hold_for_it_and_stock_ones_do_not(
    cells: CalibratedCells, stock_map: ReachMap, own: Baxter
) -> None:
    finder, bound = PoseFinder(own, "left"), cells.deviation
    points, matrices = GRID.points(), stock_map.rotations.matrices
    at = np.argwhere(cells.margins >= 0)
    assert len(at) > 200
    stock = stock_map.witnesses("left")
    for *position, rotation in at[::9].tolist():
        T = pin.SE3(matrices[rotation], points[tuple(position)])
        assert finder.holds(T, cells.witnesses[(*position, rotation)])
        q = stock[(*position, rotation)]
        assert not finder.holds(T, q)
        off = T.actInv(own.arm("left").T_base_tip(q))
        assert np.linalg.norm(off.translation) <= bound.position_m + 1e-6
        assert np.linalg.norm(pin.log3(off.rotation)) <= bound.angle_rad + 1e-6


def test_an_independent_solver_reaches_nothing_that_is_proven(
    cells: CalibratedCells, stock_map: ReachMap, own: Baxter
) -> None:
    finder, points = PoseFinder(own, "left"), GRID.points()
    at = np.argwhere(cells.margins == -1)
    for *position, rotation in np.random.default_rng(9).permutation(at)[:25].tolist():
        T = pin.SE3(stock_map.rotations.matrices[rotation], points[tuple(position)])
        assert finder.find(T) is None


def test_margins_are_those_of_its_witnesses(cells: CalibratedCells, own: Baxter) -> None:
    limits, is_there = own.arm("left").limits, cells.margins >= 0
    q = cells.witnesses[is_there]
    margins = np.minimum(q - limits.q_min, limits.q_max - q).min(axis=1)
    assert (np.abs(margins - 1e-4 * cells.margins[is_there] - 0.5e-4) <= 0.5e-4 + 1e-9).all()
    assert not cells.witnesses[~is_there].any()


def test_the_stock_robot_itself_keeps_every_cell(stock_map: ReachMap, robot: Baxter) -> None:
    same = for_calibrated(stock_map, robot, "left")
    stock = stock_map.margins("left")
    assert same.lost == 0
    assert np.array_equal(same.margins >= 0, stock >= 0)
    assert not ((same.margins == -1) & (stock != -1)).any()


def test_a_part_is_what_all_has_there(
    cells: CalibratedCells, stock_map: ReachMap, own: Baxter
) -> None:
    part = slice(1, 3), slice(0, 4), slice(0, 1)
    some = for_calibrated(stock_map, own, "left", part)
    assert np.array_equal(some.margins, cells.margins[part])


def test_it_says_the_bound_and_the_shares(cells: CalibratedCells) -> None:
    assert f"off by {cells.deviation}" in str(cells)
    assert sum(cells.shares.values()) == pytest.approx(1.0)


def test_an_arm_that_the_map_lacks_is_refused(stock_map: ReachMap, own: Baxter) -> None:
    with pytest.raises(UnknownNameError, match="arm of this map"):
        for_calibrated(stock_map, own, "right")
