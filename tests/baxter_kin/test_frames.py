from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from baxter_kin import Frame, NamedFrame, StampedPose
from baxter_kin.errors import PoseError, QuaternionOrderWarning, UnknownNameError
from baxter_kin.frames import (
    T_world_base,
    angle_between,
    checked_pose,
    nearest_rotation,
    pose_from_quaternion,
    pose_matrices,
    quaternion_xyzw,
    read_with_w_first,
)
from tests.conftest import OVERHEAD_XYZW

ROUNDING = 1e-12

components = st.floats(-1.0, 1.0)
unit_quaternions = st.tuples(components, components, components, components).map(np.array)


@given(unit_quaternions)
def test_quaternion_survives_the_round_trip_up_to_sign(quat: np.ndarray) -> None:
    assume(np.linalg.norm(quat) > 1e-3)
    quat = quat / np.linalg.norm(quat)
    back = quaternion_xyzw(pose_from_quaternion((0.0, 0.0, 0.0), quat))
    assert min(np.abs(back - quat).max(), np.abs(back + quat).max()) < ROUNDING


def test_quaternion_order_is_xyzw() -> None:
    quarter_turn_about_z = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))
    R = pose_from_quaternion((0.0, 0.0, 0.0), quarter_turn_about_z).rotation
    np.testing.assert_allclose(R @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=ROUNDING)


@given(unit_quaternions, st.floats(-290.0, 290.0))
def test_any_length_but_zero_is_normalised_when_asked_to(quat: np.ndarray, power: float) -> None:
    assume(np.linalg.norm(quat) > 1e-3)
    R = pose_from_quaternion((0, 0, 0), quat / np.linalg.norm(quat)).rotation
    scaled = pose_from_quaternion((0, 0, 0), quat * 10.0**power, normalise=True)
    np.testing.assert_allclose(scaled.rotation, R, atol=ROUNDING)


@pytest.mark.parametrize("size", [5e-324, 1.7e308])
def test_the_smallest_and_the_largest_numbers_are_normalised(size: float) -> None:
    R = pose_from_quaternion((0, 0, 0), [0.0, size, size, 0.0], normalise=True).rotation
    np.testing.assert_allclose(R @ [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], atol=ROUNDING)


@pytest.mark.parametrize("identity", [(1, 0, 0, 0), [1.0, 0.0, 0.0, 0.0], np.array([1, 0, 0, 0])])
def test_a_written_identity_with_w_first_warns(identity: object) -> None:
    with pytest.warns(
        QuaternionOrderWarning, match=r"read as x, y, z, w: .* \(0, 0, 0, 1\)"
    ) as told:
        T = pose_from_quaternion((0, 0, 0), identity)  # type: ignore[arg-type]
    np.testing.assert_array_equal(T.rotation, np.diag([1.0, -1.0, -1.0]))
    assert told[0].filename == __file__


DOWN = [(0, 1, 0, 0), (0.0, -1.0, 0.0, 0.0), (-1, 0, 0, 0), (0.6, 0.8, 0.0, 0.0), OVERHEAD_XYZW]


@pytest.mark.parametrize("quat", [*DOWN, (0, 0, 0, 1), (0, 0, 1, 0), (0.9999, 0.01, 0, 0)])
def test_no_other_quaternion_warns(quat: tuple[float, ...]) -> None:
    pose_from_quaternion((0, 0, 0), quat)  # warnings are errors here


@given(st.integers(0, 3), st.integers(0, 3))
def test_no_quaternion_of_a_pose_warns(about_x: int, about_z: int) -> None:
    turns = np.linalg.matrix_power([[1, 0, 0], [0, 0, -1], [0, 1, 0]], about_x)
    turns = turns @ np.linalg.matrix_power([[0, -1, 0], [1, 0, 0], [0, 0, 1]], about_z)
    T = pin.SE3(turns.astype(float), np.zeros(3))
    for quat in (quaternion_xyzw(T), tuple(quaternion_xyzw(T))):
        back = pose_from_quaternion((0, 0, 0), quat)  # warnings are errors here
        np.testing.assert_allclose(back.rotation, T.rotation, atol=ROUNDING)


@given(unit_quaternions)
def test_what_was_meant_with_w_first_is_told_from_the_rotation(quat_wxyz: np.ndarray) -> None:
    assume(np.linalg.norm(quat_wxyz) > 1e-3)
    quat_wxyz = quat_wxyz / np.linalg.norm(quat_wxyz)
    meant = pose_from_quaternion((0, 0, 0), np.roll(quat_wxyz, -1))
    read = pose_from_quaternion((0, 0, 0), quat_wxyz)
    np.testing.assert_allclose(read_with_w_first(read.rotation), meant.rotation, atol=1e-7)
    assert math.isclose(read.rotation[0, 0], meant.rotation[2, 2], abs_tol=ROUNDING)


def test_world_stands_on_the_floor_0_93_m_below_base() -> None:
    np.testing.assert_array_equal(T_world_base().act(np.zeros(3)), [0.0, 0.0, 0.93])
    in_world = pose_from_quaternion((0.7, 0.1, 0.801), OVERHEAD_XYZW)
    in_base = StampedPose(in_world, Frame.WORLD).T_base_tip
    np.testing.assert_allclose(in_base.translation, [0.7, 0.1, -0.129], atol=ROUNDING)
    np.testing.assert_array_equal(in_base.rotation, in_world.rotation)


def poses() -> st.SearchStrategy[pin.SE3]:
    twist = st.lists(st.floats(-2.0, 2.0), min_size=6, max_size=6)
    return twist.map(lambda values: pin.exp6(np.array(values)))


@given(T_base_map=poses(), T_map_tip=poses())
def test_a_pose_in_a_frame_of_ones_own_is_seen_from_base(
    T_base_map: pin.SE3, T_map_tip: pin.SE3
) -> None:
    stamped = StampedPose(T_map_tip, NamedFrame("map", T_base_map))
    expected = T_base_map.homogeneous @ T_map_tip.homogeneous
    np.testing.assert_allclose(checked_pose(stamped).homogeneous, expected, atol=ROUNDING)
    np.testing.assert_allclose(pose_matrices([stamped])[0], expected, atol=ROUNDING)


def test_frames_may_stand_in_each_other() -> None:
    on_floor = StampedPose(pose_from_quaternion((1.0, 0.0, 0.75), (0, 0, 0, 1)), "world")
    table = NamedFrame("table", on_floor)
    np.testing.assert_allclose(table.T_base_frame.translation, [1.0, 0.0, -0.18], atol=ROUNDING)


def test_poses_are_copied() -> None:
    T = pin.SE3.Random()
    before = T.homogeneous
    frame, stamped, checked = NamedFrame("map", T), StampedPose(T, "base"), checked_pose(T)
    T.translation = np.ones(3)
    for pose in (frame.T_base_frame, stamped.T_base_tip, checked, checked_pose(before)):
        np.testing.assert_array_equal(pose.homogeneous, before)


@given(T=poses(), digits=st.integers(3, 6))
def test_a_matrix_of_rounded_numbers_is_normalised_where_that_is_asked(
    T: pin.SE3, digits: int
) -> None:
    rounded = T.homogeneous.round(digits)
    given_to: list[Any] = [rounded, rounded.tolist(), pin.SE3(rounded[:3, :3], rounded[:3, 3])]
    for each in given_to:
        pose = checked_pose(each, normalise=True)
        R = pose.rotation
        np.testing.assert_allclose(R.T @ R, np.eye(3), atol=ROUNDING)
        assert angle_between(T.rotation, R) < 3.0 * 10.0**-digits  # nine roundings by half a digit
        np.testing.assert_array_equal(pose.translation, rounded[:3, 3])


def test_the_nearest_rotation_is_that_of_the_symmetric_polar_factor() -> None:
    rng = np.random.default_rng(5)
    for _ in range(100):
        near = pin.exp3(rng.standard_normal(3)) + 1e-3 * rng.uniform(-1.0, 1.0, (3, 3))
        stretch = nearest_rotation(near).T @ near
        np.testing.assert_allclose(stretch, stretch.T, atol=ROUNDING)
        assert np.linalg.eigvalsh(stretch).min() > 0.0


def test_four_digits_are_refused_with_what_mends_them() -> None:
    four_digits = pose_from_quaternion((0.7, 0.1, 0.0), (0.1, 0.9, 0.2, 0.3), normalise=True)
    matrix = four_digits.homogeneous.round(4)
    with pytest.raises(
        PoseError, match=r"not orthonormal: .* checked_pose\(pose, normalise=True\)"
    ):
        checked_pose(matrix)
    with pytest.raises(PoseError, match=r"poses\[0\]: .* checked_pose\(pose, normalise=True\)"):
        pose_matrices([matrix])
    assert checked_pose(matrix, normalise=True).isApprox(four_digits, 1e-4)


@given(st.floats(1e-12, math.pi - 1e-6))
def test_angle_between_is_exact_for_small_angles_too(angle: float) -> None:
    axis = np.array([2.0, -1.0, 0.5]) / np.linalg.norm([2.0, -1.0, 0.5])
    R = pin.exp3(angle * axis)
    start = pin.exp3(np.array([0.3, 0.2, -0.9]))
    assert angle_between(start, start @ R) == pytest.approx(angle, rel=1e-6, abs=1e-15)


@given(seed=st.integers(0, 10_000), exponent=st.floats(-8.0, -4.0))
def test_many_matrices_are_judged_as_each_alone(seed: int, exponent: float) -> None:
    rng = np.random.default_rng(seed)
    T = pin.exp6(rng.standard_normal(6)).homogeneous
    T = T + 10.0**exponent * rng.standard_normal((4, 4)) * rng.integers(0, 2, (4, 4))
    try:
        expected = checked_pose(T).homogeneous
    except PoseError:
        with pytest.raises(PoseError):
            pose_matrices([T])
    else:
        np.testing.assert_array_equal(pose_matrices([T])[0], expected)


MIRRORED = np.diag([1.0, 1.0, -1.0, 1.0])
BAD_MATRICES: list[Any] = [
    MIRRORED,
    np.diag([1.0, 1.0, 1.0, 2.0]),
    np.full((4, 4), np.nan),
    np.full((4, 4), 1e300),
    np.where(np.eye(4, k=1) == 1.0, np.inf, np.eye(4)),
    np.eye(4) + 0.01 * np.eye(4, k=1),
    np.eye(4) + 0.5 * np.eye(4, k=-3),
    np.zeros((4, 4)),
]
NO_MATRICES: list[Any] = [None, "up", [], np.eye(3), [[1], [1, 2], 3]]
FLAT_POSES: list[Any] = [(0.7, 0.15, 0.0), [0.7, 0.15, 0.0, 0, 1, 0, 0]]
BAD_ROTATIONS = [np.diag([-1.0, 1.0, 1.0]), np.zeros((3, 3)), 2.0 * np.eye(3)]

REFUSED: list[tuple[Any, tuple[Any, ...], dict[str, Any], type[Exception]]] = [
    *(
        (pose_from_quaternion, (position, OVERHEAD_XYZW), {}, PoseError)
        for position in (
            (math.nan, 0, 0),
            (math.inf, 0, 0),
            (0, 0),
            (0,) * 4,
            1.0,
            "abc",
            None,
            ((0,), 1, 2),
        )
    ),
    *(
        (pose_from_quaternion, ((0, 0, 0), quat), {}, PoseError)
        for quat in ((0, 0, 0, 0), (0, 0, 0, 0.9), (0, 0, 0, 2), (1, 1, 0, 0), (0, 0, 1), "z", None)
    ),
    (pose_from_quaternion, ((0, 0, 0), (0, 0, 0, 0)), {"normalise": True}, PoseError),
    (pose_from_quaternion, ((0, 0, 0), (0, 0, 0, 1)), {"normalise": "no"}, PoseError),
    *((checked_pose, (pose,), {}, PoseError) for pose in BAD_MATRICES + NO_MATRICES + FLAT_POSES),
    *(
        (checked_pose, (np.diag([scale, scale, scale, 1.0]),), {"normalise": True}, PoseError)
        for scale in (1.02, 0.5, 1000.0)
    ),
    (checked_pose, (MIRRORED,), {"normalise": True}, PoseError),
    *(
        (NamedFrame, (name, pin.SE3.Identity()), {}, PoseError)
        for name in ("", "base", "world", None, 5, "m" * 1000, "\ud800", Frame.BASE)
    ),
    (NamedFrame, ("map", MIRRORED), {}, PoseError),
    (StampedPose, (MIRRORED,), {}, PoseError),
    *((StampedPose, (np.eye(4), name), {}, UnknownNameError) for name in ("map", "torso", 5, None)),
    *((pose_matrices, (poses,), {}, PoseError) for poses in (5, None, iter([np.eye(4)]))),
    *(
        (quaternion_xyzw, (pin.SE3(R, np.zeros(3)),), {}, PoseError)
        for R in (*BAD_ROTATIONS, np.full((3, 3), np.nan))
    ),
    *(
        (angle_between, pair, {}, PoseError)
        for R in (5, np.zeros(3), np.full((3, 3), np.nan))
        for pair in ((R, np.eye(3)), (np.eye(3), R))
    ),
]


@pytest.mark.parametrize(("call", "arguments", "options", "error"), REFUSED)
def test_malformed_input_is_refused(
    call: Any, arguments: tuple[Any, ...], options: dict[str, Any], error: type[Exception]
) -> None:
    with pytest.raises(error):
        call(*arguments, **options)


@pytest.mark.parametrize("bad", BAD_MATRICES, ids=range(len(BAD_MATRICES)))
def test_a_bad_matrix_among_many_is_refused_by_its_index(bad: np.ndarray) -> None:
    several: list[Any] = [[np.eye(4), bad], np.stack([np.eye(4), bad]), [np.eye(4), bad.tolist()]]
    for poses in several:
        with pytest.raises(PoseError, match=r"^poses\[8\]: "):
            pose_matrices(poses, 7)


@pytest.mark.parametrize("pose", [*FLAT_POSES, NO_MATRICES[3]])
def test_a_flat_pose_is_answered_with_how_to_make_one(pose: Any) -> None:
    with pytest.raises(PoseError) as refused:
        checked_pose(pose)
    assert ("pose_from_quaternion(" in str(refused.value)) == (pose is not NO_MATRICES[3])
