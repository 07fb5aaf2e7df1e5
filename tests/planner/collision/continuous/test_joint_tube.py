"""JointTube: what joints may reach in some of its cells."""

from __future__ import annotations

import numpy as np
import pytest

from planner.collision.continuous.joint_tube import JointTube


@pytest.fixture
def tube() -> JointTube:
    """Two joints: one rises, the other stands; each known to 0.1 rad."""
    times = np.linspace(0.0, 1.0, 11)
    middle = np.column_stack([times, np.zeros(11)])
    return JointTube(times, middle - 0.05, middle + 0.05)


def test_a_hull_holds_both_ends_of_its_cells(tube: JointTube) -> None:
    low, high = tube.hull(2, 4)
    np.testing.assert_allclose(low, [0.15, -0.05])
    np.testing.assert_allclose(high, [0.45, 0.05])


def test_a_part_holds_all_cells_that_it_shares_a_time_with(tube: JointTube) -> None:
    part = tube.between(0.25, 0.51)
    np.testing.assert_allclose(part.times_s[[0, -1]], [0.2, 0.6])
    assert part.cells == 4
    assert tube.between(0.95, np.inf).times_s[-1] == 1.0
    assert tube.between(5.0, 6.0).cells == 1
    assert tube.between(0.3, 0.3).cells == 1


def test_it_says_when_joints_may_be_somewhere_at_once(tube: JointTube) -> None:
    assert tube.instant_at(0, 10, np.array([0.32, 0.0])) == 3
    assert tube.instant_at(5, 10, np.array([0.32, 0.0])) is None
    assert tube.instant_at(0, 10, np.array([0.32, 0.06])) is None


def test_it_may_be_widened(tube: JointTube) -> None:
    wide = tube.widened(np.array([0.01, 0.02]))
    np.testing.assert_allclose(wide.widths[0], [0.12, 0.14])
    assert repr(wide) == "JointTube(10 cells, 1.00 s, up to 0.14 rad wide)"
