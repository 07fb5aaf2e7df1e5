"""A stock map transferred to a calibrated robot, and how far tips deviate."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin import Arm, Baxter, BaxterError
from baxter_kin.errors import UnknownNameError
from baxter_kin.parallel import Serial
from planner.atlas import (
    CalibratedCells,
    PositionGrid,
    ReachMap,
    TipDeviation,
    build_reach_map,
    for_calibrated,
)
from planner.atlas.checking.pose_finder import PoseFinder
from planner.errors import AtlasError
from tests.calibrated import calibrated_arm
from tests.served_urdf import served_urdf

GRID = PositionGrid.within((0.6, 0.1, 0.1), (0.8, 0.7, 0.1), 0.1)
PART = (slice(1, 4), slice(1, 8), slice(1, 2))
"""The same points in the shared small map."""


@pytest.fixture(scope="module")
def own() -> Baxter:
    """Off by 2 mm and 4 mrad at every joint."""
    return Baxter.load(served_urdf(np.random.default_rng(8), apart_m=0.002, turned_rad=0.004))


@pytest.fixture(scope="module")
def cells(small_map: ReachMap, own: Baxter) -> CalibratedCells:
    return for_calibrated(small_map, own, "left", PART)


def test_nothing_contradicts_a_map_built_for_the_robot(
    cells: CalibratedCells, small_map: ReachMap, own: Baxter, tmp_path: Path
) -> None:
    assert np.allclose(GRID.points(), small_map.positions.points(PART))
    path, rotations = tmp_path / "own.zarr", small_map.rotations
    codes = build_reach_map(path, own, GRID, rotations, ("left",), engine=Serial()).margins("left")
    assert not ((cells.margins >= 0) & (codes == -1)).any()
    assert not ((cells.margins == -1) & (codes >= 0)).any()
    assert ((cells.margins >= 0) != (codes >= 0)).mean() < 0.01
    assert cells.shares["undecided"] < (codes == -2).mean() + 0.01
    assert sum(cells.shares.values()) == pytest.approx(1.0)


def test_transferred_witnesses_hold_and_stock_ones_deviate_within_the_bound(
    cells: CalibratedCells, small_map: ReachMap, own: Baxter
) -> None:
    finder, bound = PoseFinder(own, "left"), cells.deviation
    stock, limits = small_map.witnesses("left", PART), own.arm("left").limits
    at = np.argwhere(cells.margins >= 0)
    assert len(at) > 200
    for *position, rotation in at[::9].tolist():
        T = pin.SE3(small_map.rotations.matrices[rotation], GRID.points()[tuple(position)])
        assert finder.holds(T, cells.witnesses[(*position, rotation)])
        q = stock[(*position, rotation)]
        assert not finder.holds(T, q)
        off = T.actInv(own.arm("left").T_base_tip(q))
        assert np.linalg.norm(off.translation) <= bound.position_m + 1e-6
        assert np.linalg.norm(pin.log3(off.rotation)) <= bound.angle_rad + 1e-6
    q = cells.witnesses[cells.margins >= 0]
    margins = np.minimum(q - limits.q_min, limits.q_max - q).min(axis=1)
    below = margins - 1e-4 * cells.margins[cells.margins >= 0]  # stored margins are rounded down
    assert (below > -1e-9).all()
    assert (below < 1e-4 + 1e-9).all()
    assert not cells.witnesses[cells.margins < 0].any()


@pytest.mark.slow
def test_an_independent_solver_reaches_nothing_that_is_proven(
    cells: CalibratedCells, small_map: ReachMap, own: Baxter
) -> None:
    finder, at = PoseFinder(own, "left"), np.argwhere(cells.margins == -1)
    for *position, rotation in np.random.default_rng(9).permutation(at)[:25].tolist():
        T = pin.SE3(small_map.rotations.matrices[rotation], GRID.points()[tuple(position)])
        assert finder.find(T) is None


def test_the_stock_robot_keeps_every_cell_of_its_map(small_map: ReachMap, robot: Baxter) -> None:
    part = slice(0, 4), slice(0, 5), slice(0, 1)
    same, stock = for_calibrated(small_map, robot, "left", part), small_map.margins("left", part)
    assert same.lost == 0
    assert np.array_equal(same.margins >= 0, stock >= 0)
    assert not ((same.margins == -1) & (stock != -1)).any()


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ({"side": "middle"}, UnknownNameError),
        ({"atlas": 3}, AtlasError),
        ({"robot": 3}, AtlasError),
    ],
)
def test_invalid_arguments_are_refused(
    small_map: ReachMap, robot: Baxter, arguments: dict[str, object], error: type[BaxterError]
) -> None:
    valid: dict[str, object] = {"atlas": small_map, "robot": robot, "side": "left"}
    with pytest.raises(error):
        for_calibrated(**(valid | arguments))  # type: ignore[arg-type]


def deviations(first: Arm, second: Arm, qs: np.ndarray) -> tuple[float, float]:
    """The greatest distance, m, and angle, rad, of two tips at some configurations."""
    offs = [first.T_base_tip(q).actInv(second.T_base_tip(q)) for q in qs]
    distances = [float(np.linalg.norm(off.translation)) for off in offs]
    return max(distances), max(float(np.linalg.norm(pin.log3(off.rotation))) for off in offs)


@given(seed=st.integers(0, 2**32), share=st.floats(0.0, 1.0))
@settings(max_examples=15)
def test_no_configuration_exceeds_the_bound(robot: Baxter, seed: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    first, second = robot.arm("left"), calibrated_arm(robot, "left", rng, share)
    bound = TipDeviation.of(first, second)
    position_m, angle_rad = deviations(first, second, rng.uniform(-np.pi, np.pi, (40, 7)))
    assert position_m <= bound.position_m
    assert angle_rad <= bound.angle_rad


def test_axes_other_than_z_are_within_the_bound(robot: Baxter) -> None:
    """Robots that serve a URDF have such axes."""
    rng = np.random.default_rng(3)
    first, own = robot.arm("right"), Baxter.load(served_urdf(rng)).arm("right")
    assert np.abs(own.chain.axes[:, :2]).max() > 1e-3
    bound = TipDeviation.of(first, own)
    position_m, angle_rad = deviations(first, own, rng.uniform(-np.pi, np.pi, (500, 7)))
    assert 0.2 * bound.position_m < position_m <= bound.position_m
    assert angle_rad <= bound.angle_rad


def test_a_longer_tool_deviates_by_its_length_and_the_same_arm_not_at_all(robot: Baxter) -> None:
    arm = robot.arm("left")
    longer = arm.with_tip(pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.02])))
    assert TipDeviation.of(arm, longer).position_m == pytest.approx(0.02)
    none = TipDeviation.of(arm, Baxter.load().arm("left"))
    assert (none.position_m, none.angle_rad) == pytest.approx((0.0, 0.0), abs=1e-11)


@pytest.mark.parametrize("joint", ["s1", "e1", "w1"])
def test_a_rotated_joint_deviates_by_nearly_the_bound_when_the_arm_is_straight(
    robot: Baxter, joint: str
) -> None:
    """What follows the joint turns with it, so its length counts."""
    model = robot.model.copy()
    number = model.getJointId(f"left_{joint}")
    turn = pin.SE3(pin.exp3(np.array([0.0, 0.01, 0.0])), np.zeros(3))
    model.jointPlacements[number] = model.jointPlacements[number] * turn
    first, second = robot.arm("left"), Arm("left", model)
    bound = TipDeviation.of(first, second)
    qs = np.random.default_rng(5).uniform(-np.pi, np.pi, (2000, 7))
    tips = first.T_base_tips(qs)[:, :3, 3] - second.T_base_tips(qs)[:, :3, 3]
    worst_m = np.linalg.norm(tips, axis=1).max()
    assert 0.6 * bound.position_m < worst_m <= bound.position_m
    assert bound.angle_rad == pytest.approx(0.01)
