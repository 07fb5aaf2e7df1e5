"""Mistakes in a request are told in a sentence that says what to write instead."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from IPython.lib.pretty import pretty

from baxter_kin import Baxter, NamedFrame, StampedPose
from baxter_kin.frames import checked_pose
from planner.errors import SceneError
from sim import Workbench
from sim.workbench.tabletop import TABLE_Z_M
from tests.conftest import at


@pytest.fixture
def bench(robot: Baxter) -> Workbench:
    """A red block before the left arm, and a blue one."""
    bench = Workbench(robot)
    bench.add_block("red", 0.70, 0.15)
    bench.add_block("blue", 0.70, -0.10)
    return bench


def test_places_and_blocks_that_are_mixed_up_are_told_apart(bench: Workbench) -> None:
    with pytest.raises(SceneError, match="write onto='blue'"):
        bench.carry("red", to="blue")
    onto: Any = (0.7, 0.0)
    with pytest.raises(SceneError, match=r"name of a block, such as 'blue', got \(0.7, 0.0\)"):
        bench.carry("red", onto=onto)


@pytest.mark.slow
def test_a_place_may_be_seen_from_a_frame_of_ones_own(bench: Workbench) -> None:
    stand = NamedFrame("stand", at(0.75, 0.05, TABLE_Z_M))
    for place in (StampedPose(at(0.0, 0.0, 0.025), stand), at(0.70, 0.15, -0.13).homogeneous):
        assert bench.carry("red", to=place, arm="left").is_done
        found = bench.world.body("red").T_base_body
        assert found.isApprox(checked_pose(place), 1e-6)


def test_a_place_in_other_units_is_questioned(bench: Workbench) -> None:
    for x_m, hint in ((75.0, "75 cm is 0.75 m"), (750.0, "750 mm is 0.75 m")):
        assert str(bench.carry("red", to=(x_m, 0.0))).endswith(hint)
    beside = bench.carry("red", to=(1.6, 0.0))
    assert "are these" not in str(beside)
    assert len(str(beside)) > len(repr(beside))
    assert pretty(beside) == str(beside)  # type: ignore[no-untyped-call]  # as a notebook shows it


@pytest.mark.slow
def test_an_idle_arm_that_alone_is_in_the_way_withdraws_first(bench: Workbench) -> None:
    assert bench.carry("blue", to=(0.75, 0.0), arm="right").is_done
    motion_s = bench.motion_s
    task = bench.carry("blue", to=(0.75, 0.25), arm="left")
    assert task.is_done
    assert task.arm == "left"
    assert task.verdict.endswith("; the right arm withdrew first")
    assert task.motion_s == pytest.approx(bench.motion_s - motion_s)
    np.testing.assert_allclose(bench.world.arm_q("right"), bench.robot.arm("right").neutral)


@pytest.mark.slow
def test_an_arm_does_not_withdraw_in_vain(bench: Workbench) -> None:
    assert bench.carry("blue", to=(0.75, 0.0), arm="right").is_done
    bench.add_obstacle("wall", 0.75, 0.25, size_m=(0.05, 0.05, 0.1))
    before = bench.world.q
    refused = bench.carry("blue", to=(0.75, 0.25), arm="left")
    assert "; with the right arm withdrawn, " in refused.verdict
    assert "wall" in refused.verdict
    np.testing.assert_array_equal(bench.world.q, before)


@pytest.mark.slow
def test_an_arm_that_holds_something_does_not_withdraw(bench: Workbench) -> None:
    assert bench.carry("blue", to=(0.75, 0.0), arm="right").is_done
    bench.add_block("green", 0.60, -0.30, edge_m=0.04)
    bench.world.attach("right", "green", at(0.0, 0.0, 0.0))
    before = bench.world.q
    refused = bench.carry("red", to=(0.75, -0.02), arm="left")
    assert not refused.is_done
    assert "withdr" not in refused.verdict
    np.testing.assert_array_equal(bench.world.q, before)


def test_an_arm_that_rests_is_in_nobodys_way(bench: Workbench) -> None:
    bench.add_obstacle("wall", 0.70, 0.30, size_m=(0.3, 0.02, 0.2))
    refused = str(bench.carry("red", to=(0.70, 0.30), arm="left"))
    assert "wall stands there" in refused
    assert not re.search("withdraw", refused)
