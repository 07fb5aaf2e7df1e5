"""A transfer refuses what nobody can do; a result tells of its last plan."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin.errors import PoseError
from planner import Body, Manipulator, Plan
from sim import SimulationError, Transfer
from sim.perception import LoopResult
from sim.perception.transfer import Attempt
from tests.conftest import at, state_at

TIP, GOAL = at(0.0, 0.0, 0.02), at(0.7, 0.1, -0.155)


@pytest.fixture(scope="module")
def plans(manipulator: Manipulator) -> list[Plan]:
    return [Plan(state_at(manipulator.arm.neutral), (), limb="left") for _ in range(2)]


def test_a_transfer_keeps_its_poses_when_the_callers_change() -> None:
    tip, goal = pin.SE3(TIP), pin.SE3(GOAL)
    transfer = Transfer("block", tip, goal)
    tip.translation, goal.translation = np.ones(3), np.ones(3)
    assert transfer.T_body_tip == TIP
    assert transfer.T_base_goal == GOAL


@pytest.mark.parametrize("name", ["hover_m", "clear_m"])
@pytest.mark.parametrize("height_m", [0.0, -0.1, np.nan, np.inf, None, "high"])
def test_a_height_that_is_not_above_zero_is_refused(name: str, height_m: Any) -> None:
    with pytest.raises(SimulationError, match=name):
        Transfer("block", TIP, GOAL, **{name: height_m})


@pytest.mark.parametrize("name", [None, 5, ["block"]])
def test_a_body_without_a_name_is_refused(name: Any) -> None:
    with pytest.raises(SimulationError, match=r"Transfer\.body must be str"):
        Transfer(name, TIP, GOAL)


@pytest.mark.parametrize("pose", [None, "here", np.zeros((4, 4))], ids=str)
def test_a_pose_that_is_not_valid_is_refused(pose: Any) -> None:
    with pytest.raises(PoseError):
        Transfer("block", pose, GOAL)
    with pytest.raises(PoseError):
        Transfer("block", TIP, pose)


def test_the_plan_of_a_result_is_that_of_the_last_look_that_saw_the_body(
    plans: list[Plan], block: Body
) -> None:
    seen = [Attempt(block, plan, "missed") for plan in plans]
    blind = Attempt(None, None, "block was not seen")
    assert LoopResult((*seen, blind), "gave up").plan is plans[1]
    assert LoopResult((blind,), "gave up").plan is None
    assert LoopResult((), "gave up").plan is None


def test_a_result_is_a_success_when_it_has_no_failure(plans: list[Plan], block: Body) -> None:
    done = Attempt(block, plans[0], None)
    assert LoopResult((done,), None, block, 0.001).is_success
    assert not LoopResult((done,), "the block slipped").is_success


def test_its_line_says_how_far_off_or_why_not(plans: list[Plan], block: Body) -> None:
    done = Attempt(block, plans[0], None)
    assert "1 attempt, success, 1.0 mm off" in repr(LoopResult((done,), None, block, 0.001))
    assert "failed: gave up" in repr(LoopResult((done, done), "gave up"))
    assert "not seen" in repr(Attempt(None, None, "dark"))
