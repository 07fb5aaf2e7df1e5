from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from attrs.exceptions import FrozenInstanceError
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin import Arm, Baxter, BaxterError
from baxter_kin.errors import ConfigurationError, PoseError, RequestError
from baxter_kin.fields import evolve
from baxter_kin.frames import angle_between
from baxter_kin.ik.self_motion.continuation import EndKind
from baxter_kin.ik.self_motion.tracing import SelfMotion, trace_self_motion
from baxter_kin.kinematics.arm import MIRROR
from baxter_kin.validation import FloatArray

EXACT = 1e-9
"""Required accuracy of every pose on a curve, in m and rad."""

SAME_CURVE_RAD = 1e-6
"""Distance of two curves traced from different points: the corrector's residual of 1e-12, divided
by the smallest singular values that occur, 1e-6."""

CLOSED = np.array([-0.612, 0.769, 0.603, 0.212, 0.315, 0.696, 1.904])
"""On a curve of the left arm that closes before any joint meets a limit."""

CROSSING = np.array([0.7192, -1.8374, 2.278, 1.3773, -1.2564, 0.0263, -2.8857])
"""Next to a singular configuration of the left arm in which two branches cross."""

ALONE = np.array([1.3192, 0.5717, -0.0826, 0.1944, 1.848, 1.8152, -1.4308])
"""Next to a singular configuration of the left arm that no branch leaves."""


def random_curves(arm: Arm, count: int = 4) -> list[SelfMotion]:
    rng = np.random.default_rng(11)
    return [trace_self_motion(arm, arm.random_configuration(rng)) for _ in range(count)]


@pytest.fixture(scope="module")
def curves(robot: Baxter) -> list[SelfMotion]:
    """Curves of random configurations of both arms, and a closed one."""
    both = [curve for side in ("left", "right") for curve in random_curves(robot.arm(side))]
    return [*both, trace_self_motion(robot.arm("left"), CLOSED)]


def pose_error(robot: Baxter, arm: Arm, q: FloatArray, T: pin.SE3) -> float:
    """The error by Pinocchio on the full URDF, the larger of m and rad."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.configuration(arm.joints(q)))
    reached = data.oMf[robot.model.getFrameId(f"{arm.side}_gripper")]
    offset = float(np.linalg.norm(reached.translation - T.translation))
    return max(offset, angle_between(T.rotation, reached.rotation))


def spread(curve: SelfMotion, count: int) -> list[FloatArray]:
    """Configurations evenly spaced along the curve."""
    return [curve.at(s) for s in np.linspace(0.0, curve.length_rad, count)]


def hausdorff_rad(a: SelfMotion, b: SelfMotion) -> float:
    """The largest distance from a point of one curve to the other curve."""
    there = (b.nearest(q)[1] for q in spread(a, 12))
    back = (a.nearest(q)[1] for q in spread(b, 12))
    return max(*there, *back)


def with_limits(arm: Arm, robot: Baxter, q_min: FloatArray, q_max: FloatArray) -> Arm:
    """The same arm with other position limits, within its stops."""
    low, high = np.maximum(q_min, arm.limits.q_min), np.minimum(q_max, arm.limits.q_max)
    return robot.arm(arm.side).with_limits(evolve(arm.limits, q_min=low, q_max=high))


def singular_near(arm: Arm, q: FloatArray) -> FloatArray:
    """A configuration where the Jacobian loses rank, by Newton's method on `J' w = 0, |w| = 1`."""
    x = np.concatenate([q, np.linalg.svd(arm.jacobian(q))[0][:, 5]])

    def residual(x: FloatArray) -> FloatArray:
        return np.append(arm.jacobian(x[:7]).T @ x[7:], x[7:] @ x[7:] - 1.0)

    for _ in range(20):
        steps = 1e-6 * np.eye(13)
        slope = np.array([(residual(x + h) - residual(x - h)) / 2e-6 for h in steps]).T
        x = x - np.linalg.lstsq(slope, residual(x), rcond=1e-8)[0]
    return np.array(x[:7])


# --- what a curve is


def test_every_point_reaches_the_pose(robot: Baxter, curves: list[SelfMotion]) -> None:
    for curve in curves:
        for q in curve.q:
            assert pose_error(robot, curve.arm, q, curve.T_base_tip) <= EXACT


def test_every_configuration_between_the_points_reaches_the_pose(
    robot: Baxter, curves: list[SelfMotion]
) -> None:
    rng = np.random.default_rng(12)
    for curve in curves:
        for s in rng.uniform(0.0, curve.length_rad, 20):
            assert pose_error(robot, curve.arm, curve.at(s), curve.T_base_tip) <= EXACT


def test_residual_is_reported(curves: list[SelfMotion]) -> None:
    assert all(0.0 <= curve.pose_residual <= 1e-11 for curve in curves)


def test_no_joint_leaves_its_limits(curves: list[SelfMotion]) -> None:
    for curve in curves:
        for q in [*curve.q, *spread(curve, 50)]:
            assert not curve.arm.limits.violations(q)


def test_configuration_it_was_traced_from_is_on_it(arm: Arm) -> None:
    rng = np.random.default_rng(11)
    for _ in range(8):
        q = arm.random_configuration(rng)
        curve = trace_self_motion(arm, q)
        np.testing.assert_array_equal(curve.at(curve.s_start), q)


def test_tangents_span_the_null_space(curves: list[SelfMotion]) -> None:
    rounding = 1e-9  # of a null vector, relative to the smallest singular values
    for curve in curves:
        for q, tangent in zip(curve.q[::10], curve.tangent[::10], strict=True):
            assert np.linalg.norm(tangent) == pytest.approx(1.0, abs=1e-12)
            assert np.linalg.norm(curve.arm.jacobian(q) @ tangent) < rounding


def test_direction_is_that_of_the_cofactors(curves: list[SelfMotion]) -> None:
    for curve in curves:
        for q, tangent in zip(curve.q[::10], curve.tangent[::10], strict=True):
            assert np.linalg.det(np.vstack([curve.arm.jacobian(q), tangent])) > 0.0


def test_length_is_that_of_a_fine_polygon(arm: Arm) -> None:
    curve = trace_self_motion(arm, arm.start)
    fine = np.array(spread(curve, 1000))
    polygon = np.linalg.norm(np.diff(fine, axis=0), axis=1).sum()
    cut_corners = 1e-5  # (length / 1000)^2 / 24 for each bend of one radian's radius
    assert curve.length_rad == pytest.approx(polygon, rel=cut_corners)


def test_manipulability_is_that_of_yoshikawa(curves: list[SelfMotion]) -> None:
    for curve in curves:
        J = np.array([curve.arm.jacobian(q) for q in curve.q])
        expected = np.sqrt(np.linalg.det(J @ J.transpose(0, 2, 1)))
        np.testing.assert_allclose(curve.manipulability, expected, rtol=1e-6, atol=1e-9)


def test_limit_distance_is_that_of_the_nearest_joint(curves: list[SelfMotion]) -> None:
    for curve in curves:
        limits = curve.arm.limits
        to_limits = np.concatenate([curve.q - limits.q_min, limits.q_max - curve.q], axis=1)
        np.testing.assert_array_equal(curve.limit_distance_rad, to_limits.min(axis=1))


def test_no_step_is_longer_than_requested(left: Arm) -> None:
    for step_rad in (0.005, 0.1):
        curve = trace_self_motion(left, left.start, step_rad=step_rad)
        bent = 1.05  # an arc is longer than its tangent's share
        assert np.diff(curve.s).max() <= bent * step_rad


# --- its ends


def test_ends_stand_exactly_on_the_limit_they_name(curves: list[SelfMotion]) -> None:
    for curve in curves:
        if not curve.is_closed:
            for q, end in zip((curve.q[0], curve.q[-1]), curve.ends, strict=True):
                assert curve.arm.joints(q)[str(end.joint_name)] == end.limit_rad


def test_beyond_its_ends_the_named_joint_leaves_its_range(curves: list[SelfMotion]) -> None:
    for curve in curves:
        ways = [(curve.q[0], -curve.tangent[0]), (curve.q[-1], curve.tangent[-1])]
        for (q, outward), end in zip(ways, curve.ends, strict=True):
            if end.kind is EndKind.LIMIT:
                assert str(end.joint_name) in curve.arm.limits.violations(q + 1e-3 * outward)[0]


def test_length_along_a_closed_curve_goes_round(left: Arm) -> None:
    curve = trace_self_motion(left, CLOSED)
    once, again = curve.at(0.3), curve.at(0.3 - 2 * curve.length_rad)
    np.testing.assert_allclose(once, again, atol=1e-9)


def test_tracing_from_an_end_gives_the_same_curve(curves: list[SelfMotion]) -> None:
    for curve in curves[:4]:
        for q in (curve.q[0], curve.q[-1]):
            again = trace_self_motion(curve.arm, q)
            assert again.ends == curve.ends
            assert hausdorff_rad(curve, again) < SAME_CURVE_RAD


# --- the same curve however it is traced


@settings(max_examples=12)
@given(seed=st.integers(0, 10_000), share=st.floats(0.0, 1.0))
def test_any_other_point_gives_the_same_curve(seed: int, share: float, robot: Baxter) -> None:
    arm = robot.arm("left" if seed % 2 else "right")
    q = arm.random_configuration(np.random.default_rng(seed))
    curve = trace_self_motion(arm, q, step_rad=0.05)
    again = trace_self_motion(arm, curve.at(share * curve.length_rad), step_rad=0.05)
    assert again.ends == curve.ends
    assert again.length_rad == pytest.approx(curve.length_rad, abs=1e-4)  # cubics, 0.05 rad long
    assert hausdorff_rad(curve, again) < SAME_CURVE_RAD


def test_step_does_not_matter(curves: list[SelfMotion]) -> None:
    for curve in curves:
        coarse = trace_self_motion(curve.arm, curve.at(0.5 * curve.length_rad), step_rad=0.2)
        assert hausdorff_rad(curve, coarse) < SAME_CURVE_RAD
        assert coarse.length_rad == pytest.approx(curve.length_rad, abs=1e-3)


def test_other_arm_has_the_mirrored_curve(robot: Baxter) -> None:
    left, right = robot.arm("left"), robot.arm("right")
    one, other = (trace_self_motion(a, s * left.start) for a, s in ((left, 1.0), (right, MIRROR)))
    assert other.length_rad == pytest.approx(one.length_rad, abs=1e-9)
    assert max(other.nearest(MIRROR * q)[1] for q in spread(one, 12)) < SAME_CURVE_RAD


def test_nearest_finds_the_length_it_was_given(curves: list[SelfMotion]) -> None:
    for curve in curves:
        s = 0.37 * curve.length_rad
        found, distance = curve.nearest(curve.at(s))
        assert found == pytest.approx(s, abs=1e-7)
        assert distance < SAME_CURVE_RAD


def test_nearest_measures_the_distance_across(left: Arm) -> None:
    curve = trace_self_motion(left, left.start)
    across = np.linalg.svd(curve.tangent[50:51])[2][3]
    s, distance = curve.nearest(curve.q[50] + 0.01 * across)
    assert s == pytest.approx(curve.s[50], abs=1e-9)
    assert distance == pytest.approx(0.01, rel=1e-9)


# --- bad input


OUTSIDE = np.array([0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        *(({"arm": arm}, RequestError) for arm in (None, 5, "left")),
        *(({"q": q}, ConfigurationError) for q in (np.zeros(6), [math.nan] * 7, "q", OUTSIDE)),
        *(({"step_rad": step}, RequestError) for step in (0.0, -0.02, math.nan, math.inf)),
        *(({"step_rad": step}, RequestError) for step in ("0.02", None, True, 1e-9, 1)),
        *(({"towards": t}, RequestError) for t in (np.zeros(7), np.ones(6), [math.nan] * 7)),
        ({"T_base_tip": np.eye(3)}, PoseError),
    ],
    ids=str,
)
def test_invalid_arguments_are_refused(
    left: Arm, changes: dict[str, Any], error: type[BaxterError]
) -> None:
    arguments: dict[str, Any] = {"arm": left, "q": left.start} | changes
    with pytest.raises(error):
        trace_self_motion(**arguments)


@pytest.mark.parametrize("s", [-0.1, 1e3, math.nan, "0"])
def test_invalid_arguments_of_a_curve_are_refused(curves: list[SelfMotion], s: Any) -> None:
    with pytest.raises(RequestError):
        curves[0].at(s)
    with pytest.raises(ConfigurationError):
        curves[0].nearest(np.zeros(6))


@pytest.mark.parametrize(
    "changes",
    [
        {"arm": 5},
        {"T_base_tip": np.eye(4)},
        {"q": np.zeros((2, 6))},
        {"s": np.zeros(3)},
        {"q": np.zeros((0, 7)), "tangent": np.zeros((0, 7))},
        {"manipulability": np.array([math.nan, 1.0])},
        {"ends": ()},
    ],
    ids=str,
)
def test_an_inconsistent_curve_is_refused(left: Arm, changes: dict[str, Any]) -> None:
    curve = trace_self_motion(left, left.start)
    with pytest.raises(ConfigurationError):
        evolve(curve, **changes)


def test_curve_cannot_be_changed(left: Arm) -> None:
    curve = trace_self_motion(left, left.start)
    with pytest.raises(FrozenInstanceError):
        curve.s_start = 0.0  # type: ignore[misc]
    for array in (curve.q, curve.s, curve.tangent, curve.manipulability, curve.limit_distance_rad):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0
