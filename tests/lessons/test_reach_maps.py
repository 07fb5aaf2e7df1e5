"""The checks of notebook 7: every right answer passes, typical mistakes get their sentence."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin.fields import evolve
from lessons.reach_maps import (
    DOWN,
    FAR_BASE,
    HIGH_M,
    LOW_M,
    ROLLS,
    STEP_M,
    check_area,
    check_nearest,
    check_widest,
)
from planner.atlas import (
    Cell,
    PositionGrid,
    ReachMap,
    nearest_reachable,
)
from tests.lessons.told import assert_told

pytest.importorskip("zarr", reason="maps need zarr, and it Python 3.11", exc_type=ImportError)

FAR = pin.SE3(DOWN, np.array(FAR_BASE))


def test_the_notebook_and_the_tests_build_the_same_map(table_map: ReachMap) -> None:
    assert table_map.positions == PositionGrid.within(LOW_M, HIGH_M, STEP_M)
    assert np.array_equal(table_map.rotations.R_base_tips, DOWN[None])
    assert len(table_map.rotations) == ROLLS


@pytest.fixture(scope="module")
def reached(table_map: ReachMap) -> Any:
    """By arm, position and roll, at z = -0.1 m: whether there is a witness."""
    return np.stack([table_map.margins(side)[:, :, 1] >= 0 for side in ("left", "right")])


@pytest.fixture(scope="module")
def widest(table_map: ReachMap) -> Cell:
    """The cell at z = -0.1 m that is farthest from the left arm's limits."""
    margins = table_map.margins("left")[:, :, 1]
    i, j, rotation = (int(each) for each in np.unravel_index(margins.argmax(), margins.shape))
    return table_map.cell("left", (i, j, 1), rotation)


def test_the_area_of_both_arms_is_right(reached: Any) -> None:
    assert check_area(0.01 * reached.any(axis=-1).all(axis=0).sum()).is_right


def test_a_wrong_area_is_explained(table_map: ReachMap, reached: Any) -> None:
    left, right = reached.any(axis=-1)
    higher = [(table_map.margins(side)[:, :, 3] >= 0).any(axis=-1) for side in ("left", "right")]
    for answer, told in (
        ((left & right).sum(), "how many positions"),
        (0.01 * (left | right).sum(), "either arm"),
        (0.01 * left.sum(), "one arm"),
        (0.01 * reached.sum(), "every roll by itself"),
        (0.01 * (higher[0] & higher[1]).sum(), "at z = 0.1 m"),
        (12.3, "take the layer"),
        (table_map, "class ReachMap"),
    ):
        assert_told(check_area(answer), told)


def test_the_widest_cell_is_right(widest: Cell) -> None:
    assert check_widest(widest).is_right


def test_a_wrong_cell_is_explained(table_map: ReachMap, widest: Cell) -> None:
    turned = pin.SE3(np.diag([1.0, -1.0, -1.0]) @ DOWN, widest.T_base_tip.translation)
    for answer, told in (
        (table_map.nearest_cell("right", widest.T_base_tip), "the right arm"),
        (table_map.cell("left", (5, 9, 0), 0), "at z = -0.2 m"),
        (evolve(widest, T_base_tip=turned), "does not point down"),
        (table_map.cell("left", (11, 9, 1), 0), "unreachable, so it has no margin"),
        (table_map.cell("left", (5, 9, 1), 0), "another cell's"),
        (widest.q, "should be a Cell"),
    ):
        assert_told(check_widest(answer), told)


def test_the_nearest_pose_is_right(table_map: ReachMap) -> None:
    assert check_nearest(nearest_reachable(table_map, FAR, "left")).is_right


@pytest.mark.slow
def test_a_wrong_nearest_pose_is_explained(table_map: ReachMap) -> None:
    found = nearest_reachable(table_map, FAR, "left")
    assert found.q is not None
    nearer = pin.SE3(DOWN, np.array([1.0, 0.3, -0.1]))
    rolled = pin.SE3(DOWN @ pin.utils.rotate("z", np.pi / 2), FAR.translation)
    for answer, told in (
        (nearest_reachable(table_map, FAR, "right"), "the right arm"),
        (nearest_reachable(table_map, nearer, "left"), r"at \(1.000, 0.300, -0.100\) m, not"),
        (nearest_reachable(table_map, rolled, "left"), "does not point down as DOWN does"),
        (nearest_reachable(table_map, FAR, "left", keep="nothing"), "leave `keep` out"),
        (evolve(found, T_base_tip=None, q=None), "nothing was found"),
        (evolve(found, q=found.q + 0.1), "not those of its pose"),
        (0.229, "should be a NearestPose"),
    ):
        assert_told(check_nearest(answer), told)
