"""The IK service, by messages."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin import Arm, Baxter
from baxter_kin.frames import quaternion_xyzw
from sim.errors import ServiceRefused
from sim.ros1.definitions import service_type
from sim.ros1.robot.position_ik import TYPE, PositionIK
from tests.conftest import overhead

POSE_M = 1e-6
FAR = overhead(3.0, 0.0, 0.0)


class Desk:
    """The left arm's service, where the arm is at its start, and what it said."""

    def __init__(self, robot: Baxter) -> None:
        self.robot, self.arm = robot, robot.arm("left")
        self.said: list[str] = []
        self.q = np.array(robot.configuration(self.arm.joints(self.arm.start)))
        self.ik = PositionIK(robot, "left", lambda: self.q, self.said.append)

    def ask(self, *poses: Any, frame: str = "base", **more: Any) -> Any:
        stamped = [{"header": {"frame_id": frame}, "pose": as_pose(pose)} for pose in poses]
        return self.ik.answer(service_type(TYPE).request.make(pose_stamp=stamped, **more))


def as_pose(T: pin.SE3) -> dict[str, Any]:
    x, y, z = T.translation.tolist()
    qx, qy, qz, qw = quaternion_xyzw(T).tolist()
    return {
        "position": {"x": x, "y": y, "z": z},
        "orientation": {"x": qx, "y": qy, "z": qz, "w": qw},
    }


def seed_of(arm: Arm, q: Any) -> dict[str, Any]:
    return {"name": list(arm.joint_names), "position": list(map(float, q))}


@pytest.fixture(scope="module")
def desk(robot: Baxter) -> Desk:
    return Desk(robot)


@pytest.fixture
def said(desk: Desk) -> list[str]:
    desk.said.clear()
    return desk.said


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1), st.floats(0.1, 10.0))
def test_its_solutions_reach_the_poses_however_long_the_quaternion(
    desk: Desk, seed: int, length: float
) -> None:
    T = desk.arm.T_base_tip(desk.arm.random_configuration(np.random.default_rng(seed)))
    pose = as_pose(T)
    pose["orientation"] = {k: length * v for k, v in pose["orientation"].items()}
    stamped = [{"header": {"frame_id": "base"}, "pose": pose}]
    answer = desk.ik.answer(service_type(TYPE).request.make(pose_stamp=stamped))
    if answer.isValid[0]:
        found = dict(zip(answer.joints[0].name, answer.joints[0].position, strict=True))
        q = [found[name] for name in desk.arm.joint_names]
        assert desk.arm.T_base_tip(q).isApprox(T, POSE_M)
        assert answer.result_type[0] in (2, 3)


def test_result_types_name_the_seed(desk: Desk) -> None:
    T = overhead(0.70, 0.15, -0.129)
    seed = [seed_of(desk.arm, desk.arm.neutral)]
    assert desk.ask(T).result_type.tolist() == [2]
    assert desk.ask(T, seed_angles=seed).result_type.tolist() == [1]
    for mode in (1, 2, 3):
        assert desk.ask(T, seed_angles=seed, seed_mode=mode).result_type.tolist() == [mode]


def test_each_pose_has_its_answer_and_failures_their_reason(desk: Desk, said: list[str]) -> None:
    answer = desk.ask(overhead(0.7, 0.15, 0.0), FAR, overhead(0.7, 0.0, 0.0))
    assert answer.isValid.tolist() == [True, False, True]
    assert answer.result_type[1] == 0
    assert (list(answer.joints[1].name), answer.joints[1].position.tolist()) == ([], [])
    (reason,) = said
    assert reason.startswith("left IK, pose 1: ")
    assert "out of reach" in reason


def test_an_empty_request_has_an_empty_answer_even_in_user_mode(desk: Desk) -> None:
    for mode in range(4):
        answer = desk.ask(seed_mode=mode)
        assert (len(answer.joints), len(answer.isValid), len(answer.result_type)) == (0, 0, 0)


def test_user_mode_without_seeds_and_unknown_modes_are_service_errors(desk: Desk) -> None:
    with pytest.raises(ServiceRefused, match="USER needs seed_angles"):
        desk.ask(FAR, seed_mode=1)
    with pytest.raises(ServiceRefused, match="seed mode 9 is unknown"):
        desk.ask(FAR, seed_mode=9)


def test_seeds_may_be_fewer_than_poses_and_of_some_joints_beyond_the_limits(desk: Desk) -> None:
    T = overhead(0.70, 0.15, -0.129)
    answer = desk.ask(T, T, seed_angles=[seed_of(desk.arm, desk.arm.neutral)])
    assert answer.result_type.tolist() == [1, 2]
    seed = {"name": ["left_s1", "right_e0", "left_s0"], "position": [-2.175, 7.0, 0.1]}
    assert desk.ask(T, seed_angles=[seed]).result_type.tolist() == [1]


@pytest.mark.parametrize(
    "seed",
    [
        {"name": ["left_s0"], "position": []},
        {"name": ["left_s0"], "position": [float("nan")]},
    ],
)
def test_a_seed_that_makes_no_sense_is_left_out_and_told(
    desk: Desk, said: list[str], seed: dict[str, Any]
) -> None:
    answer = desk.ask(overhead(0.70, 0.15, -0.129), seed_angles=[seed])
    assert answer.result_type.tolist() == [2]
    assert "its seed is left out" in said[0]


@pytest.mark.parametrize("frame", ["left_gripper", "/left_hand_camera", "torso", "right_wrist"])
def test_frames_are_those_of_the_robots_tree(desk: Desk, frame: str) -> None:
    T_base_tip = overhead(0.72, 0.10, -0.05)
    model, data = desk.robot.model, desk.robot.model.createData()
    pin.framesForwardKinematics(model, data, desk.q)
    link = frame.strip("/")
    link = link if model.existFrame(link, pin.FrameType.BODY) else f"{link}_link"
    T_root_frame = data.oMf[model.getFrameId(link, pin.FrameType.BODY)]
    T_root_base = data.oMf[model.getFrameId("base")]
    T_frame_tip = T_root_frame.actInv(T_root_base * T_base_tip)
    answer = desk.ask(T_frame_tip, frame=frame)
    assert answer.isValid.tolist() == [True]
    assert desk.arm.T_base_tip(answer.joints[0].position).isApprox(T_base_tip, POSE_M)


@pytest.mark.parametrize(
    ("frame", "why"), [("kitchen", "no frame 'kitchen'"), ("world", "give the pose in 'base'")]
)
def test_frames_that_nobody_knows_are_a_reason(
    desk: Desk, said: list[str], frame: str, why: str
) -> None:
    assert desk.ask(overhead(0.7, 0.1, 0.0), frame=frame).isValid.tolist() == [False]
    assert why in said[0]


def test_a_pose_that_is_none_is_a_reason(desk: Desk, said: list[str]) -> None:
    request = service_type(TYPE).request
    answer = desk.ik.answer(request.make(pose_stamp=[{}, {"pose": {"position": {"x": np.nan}}}]))
    assert answer.isValid.tolist() == [False, False]
    assert "zero, which is no rotation" in said[0]
    assert "finite" in said[1]
