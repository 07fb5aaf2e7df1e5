"""Exact answers for poses, and the choice of an arm."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter, IKService, pose_from_quaternion
from baxter_kin.errors import PoseError
from baxter_kin.ik.solution_set import sample_solutions
from planner.atlas import ArmChoice, ReachMap, which_arm
from planner.atlas.checking.pose_finder import PoseFinder
from planner.atlas.questions.arm_choice import answer_pose, limit_margins
from planner.errors import AtlasError

DOWN = (0.0, 1.0, 0.0, 0.0)
MIRROR = np.diag([1.0, -1.0, 1.0])


@pytest.mark.parametrize("side", ["left", "right"])
def test_no_sampled_solution_has_a_greater_margin_than_the_witness(
    robot: Baxter, finders: dict[str, PoseFinder], side: str
) -> None:
    arm, rng = robot.arm(side), np.random.default_rng(4)
    ik = IKService(arm)
    for _ in range(6):
        T = arm.T_base_tip(arm.random_configuration(rng))
        answer = answer_pose(ik, T)
        assert answer.status == "reachable"
        assert answer.q is not None
        assert answer.margin_rad is not None
        assert finders[side].holds(T, answer.q)
        others = [limit_margins(arm.limits, q).min() for q in sample_solutions(ik, T)]
        assert answer.margin_rad >= max(others, default=0.0) - 1e-6
        joint = arm.joint_names.index(answer.nearest_limit)
        low, high = arm.limits.q_min[joint], arm.limits.q_max[joint]
        to_limit = min(answer.q[joint] - low, high - answer.q[joint])
        assert to_limit == pytest.approx(answer.margin_rad, abs=1e-12)


def test_an_independent_solver_agrees(
    robot: Baxter, table_map: ReachMap, finders: dict[str, PoseFinder]
) -> None:
    rng = np.random.default_rng(6)
    poses = [robot.arm("left").T_base_tip(robot.arm("left").random_configuration(rng))]
    for _ in range(10):
        p = rng.uniform((0.3, -0.9, -0.3), (1.1, 0.9, 0.5))
        poses.append(pin.SE3(pin.exp3(rng.normal(size=3)), p))
    choice = which_arm(table_map, poses)
    statuses = set()
    for side, answers in choice.answers.items():
        for T, answer in zip(poses, answers, strict=True):
            statuses.add(answer.status)
            if answer.q is not None:
                assert finders[side].holds(T, answer.q)
            elif answer.is_proven_unreachable:
                assert finders[side].find(T) is None
    assert {"reachable", "unreachable"} <= statuses
    assert "left" in choice.arms_by_pose[0]


def test_mirrored_poses_exchange_the_arms(table_map: ReachMap) -> None:
    T = pose_from_quaternion((0.75, 0.25, -0.1), DOWN)
    mirrored = pin.SE3(MIRROR @ T.rotation @ MIRROR, MIRROR @ T.translation)
    one, other = (which_arm(table_map, pose) for pose in (T, mirrored))
    assert one.margins_rad["left"] == pytest.approx(other.margins_rad["right"], abs=1e-3)
    assert (one.best, other.best) == ("left", "right")


def test_the_reason_names_margins_limits_and_missed_poses(table_map: ReachMap) -> None:
    positions = {"pick": (0.7, 0.2, -0.1), "place": (0.7, 0.65, -0.1)}
    choice = which_arm(
        table_map, {name: pose_from_quaternion(p, DOWN) for name, p in positions.items()}
    )
    assert choice.best == "left"
    assert f"{choice.margins_rad['left']:.3f} rad from left_" in choice.reason
    assert "the right arm reaches 1 of 2, not 'place': the pose at (0.700, 0.650" in choice.reason
    same = choice.answers["left"]
    assert ArmChoice({"left": same, "right": same}).best == "left"


def test_a_pose_that_no_arm_reaches_has_no_best_arm(table_map: ReachMap) -> None:
    choice = which_arm(table_map, pose_from_quaternion((2.0, 0.0, 0.0), DOWN))
    assert choice.best is None
    assert choice.arms_by_pose == ((),)
    answer = choice.answers["left"][0]
    assert answer.status == "unreachable"
    assert answer.q is None
    assert "proven out of reach" in str(answer)


@pytest.mark.parametrize("poses", [[], {}, [3], 3])
def test_invalid_poses_are_refused(table_map: ReachMap, poses: Any) -> None:
    with pytest.raises(PoseError):
        which_arm(table_map, poses)


def test_another_value_than_a_map_is_refused() -> None:
    with pytest.raises(AtlasError):
        which_arm(3, pin.SE3.Identity())  # type: ignore[arg-type]
