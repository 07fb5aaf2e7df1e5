from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Arm, Baxter, Tolerance
from baxter_kin.ik.reach.bound import PositionSweep, ReachBound, ReachProof, Shells
from baxter_kin.ik.reach.linkage import Linkage
from baxter_kin.ik.reach.shoulder_sweep import SWEEP_MARGIN_M
from baxter_kin.kinematics.arm import JOINTS
from baxter_kin.validation import FloatArray

RESOLUTION_M = 1e-2
"""Resolution of the bound: cells of 1.7 mrad, and points up to 3 m away from the axis."""

coordinates = st.floats(-3.0, 3.0)
points = st.tuples(coordinates, coordinates, coordinates).map(np.array)


@pytest.fixture(scope="module")
def left_linkage(left: Arm) -> Linkage:
    return Linkage.of(left)


@pytest.fixture(scope="module")
def sweep(left_linkage: Linkage) -> PositionSweep:
    return PositionSweep(left_linkage)


def elbow_distance_m(left_linkage: Linkage, point: FloatArray) -> float:
    """Distance from a point to the nearest of elbows all over the ranges of s0, s1 and e0."""
    ranges = zip(left_linkage.q_min[:3], left_linkage.q_max[:3], (120, 60, 60), strict=True)
    grid = np.meshgrid(*(np.linspace(low, high, count) for low, high, count in ranges))
    s0, s1, e0 = (angles.ravel() for angles in grid)
    zero = np.zeros_like(s0)
    radial = np.array([np.cos(s0), np.sin(s0), zero])
    down = np.array([zero, zero, zero - 1.0])
    u = np.cos(s1) * radial + np.sin(s1) * down
    swing = np.cos(s1) * down - np.sin(s1) * radial
    r = np.cos(e0) * swing + np.sin(e0) * np.cross(u.T, swing.T).T
    elbow = (
        left_linkage.shoulder_offset_m * radial
        + left_linkage.upper_m * u
        + left_linkage.elbow_offset_m * r
    )
    return float(np.linalg.norm(elbow.T - point, axis=1).min())


def test_it_bounds_the_distance_to_sampled_elbows_from_below_and_not_by_much(
    left_linkage: Linkage, sweep: PositionSweep
) -> None:
    grid_m, cap_m = 0.03, 0.07  # between neighbours; across the arc, where e0 does not lead
    for point in np.random.default_rng(1).uniform(-2.0, 2.0, (10, 3)):
        sampled = elbow_distance_m(left_linkage, point) - sweep.tip_reach_m
        assert sampled - cap_m - grid_m <= sweep.excess_m(point) <= sampled


def test_no_tip_of_the_arm_has_an_excess(
    left: Arm, left_linkage: Linkage, sweep: PositionSweep
) -> None:
    rng, rounding = np.random.default_rng(2), 1e-9
    for _ in range(100):
        tip = left.T_base_tip(left.random_configuration(rng)).translation
        assert sweep.excess_m(left_linkage.T_base_first.actInv(tip)) <= rounding


@given(points, points)
def test_bound_changes_by_at_most_the_motion_of_the_point(
    sweep: PositionSweep, one: FloatArray, other: FloatArray
) -> None:
    change = abs(sweep.excess_m(one) - sweep.excess_m(other))
    assert change <= np.linalg.norm(one - other) + RESOLUTION_M


@pytest.fixture(scope="module")
def linkage(any_arm: Arm) -> Linkage:
    return Linkage.of(any_arm)


@pytest.fixture(scope="module")
def shells(linkage: Linkage) -> Shells:
    return Shells(linkage)


def distances(linkage: Linkage, point: FloatArray) -> FloatArray:
    """Distances from a point, (3,), to S at many angles of s0, m."""
    s0 = np.linspace(linkage.q_min[0], linkage.q_max[0], 20_001)
    arc = linkage.shoulder_offset_m * np.array([np.cos(s0), np.sin(s0), np.zeros_like(s0)])
    away: FloatArray = np.linalg.norm(arc.T - point, axis=1)
    return away


def test_excesses_agree_with_dense_sampling_of_the_first_joint(
    linkage: Linkage, shells: Shells
) -> None:
    points = np.random.default_rng(1).uniform(-1.2, 1.2, (40, 3))
    beyond_m, inside_m = shells.wrist_excess_m(points)
    sampling = 1e-8  # an arc of 0.069 m in steps of 0.2 mrad, at an extreme
    for point, beyond, inside in zip(points, beyond_m, inside_m, strict=True):
        away = distances(linkage, point)
        assert beyond == pytest.approx(away.min() - shells.span_m - SWEEP_MARGIN_M, abs=sampling)
        assert inside == pytest.approx(shells.fold_m - away.max() - SWEEP_MARGIN_M, abs=sampling)
        expected = away.min() - shells.radius_m - SWEEP_MARGIN_M
        assert shells.tip_excess_m(point) == pytest.approx(expected, abs=sampling)


def test_no_wrist_and_no_tip_of_the_arm_has_an_excess(
    any_arm: Arm, linkage: Linkage, shells: Shells
) -> None:
    rng = np.random.default_rng(2)
    qs = [any_arm.random_configuration(rng) for _ in range(300)]
    for i, e1 in enumerate(np.resize([linkage.elbow_angle, any_arm.limits.q_max[3]], 100)):
        qs[i][3] = e1  # nearly straight, and fully bent
    Ts = np.array([any_arm.T_base_tip(q).homogeneous for q in qs])
    wrists = linkage.targets(Ts)[:, :3, 3]
    assert max(map(np.max, shells.wrist_excess_m(wrists))) <= 0.0
    tips = (Ts[:, :3, 3] - linkage.T_base_first.translation) @ linkage.T_base_first.rotation
    assert max(map(shells.tip_excess_m, tips)) <= 0.0
    assert max(map(shells.elbow_excess_m, tips)) <= 0.0


def test_the_elbow_excludes_more_than_the_straight_arm(shells: Shells) -> None:
    """A point straight below, which s1 does not allow."""
    point = np.array([0.0, 0.0, 0.01 - shells.radius_m])
    assert shells.tip_excess_m(point) <= 0.0 < shells.elbow_excess_m(point)


NAMES = {joint: f"left_{joint}" for joint in JOINTS}
WRIST = np.array([1.0204, -0.0001, 0.25])


def proof_of(excess_m: float) -> ReachProof:
    return ReachProof.of("span", excess_m, WRIST, NAMES, 0.745)


@given(st.floats(1e-6, 1e4))
def test_lengths_are_rounded_down_in_texts(excess_m: float) -> None:
    number, unit = str(proof_of(excess_m)).split()[:2]
    said_m = float(number) * {"m": 1.0, "mm": 1e-3}[unit]
    digits = 1e-9 if excess_m < 10.0 else 5e-6 * excess_m  # six, of metres
    assert excess_m - max(1e-6, 0.1 * excess_m) <= said_m <= excess_m + digits


@given(st.floats(1e-6, 1.0), st.floats(0.0, 1.0))
def test_leeway_is_subtracted(excess_m: float, leeway_m: float) -> None:
    left = proof_of(excess_m).less(leeway_m)
    assert (left is None) == (excess_m <= leeway_m)
    if left is not None:
        assert left.excess_m == excess_m - leeway_m
        assert left.bound == "span"


def test_leeway_is_rounded_up_in_texts() -> None:
    proof = proof_of(0.1)
    assert str(proof.less(0.0121)) == f"{proof}, and no more than 13 mm can be made up"
    assert proof.less(0.0) == proof


MIRROR_Y = np.diag([1.0, -1.0, 1.0])

SPARING = 20
"""Of poses that are within reach, the sweep over all limits is asked about every so many: it gives
up after 30 ms."""


@pytest.fixture(scope="module")
def bounds(robot: Baxter) -> dict[str, ReachBound]:
    return {side: ReachBound(arm) for side, arm in robot.arms.items()}


@pytest.fixture(scope="module")
def bounds_of_axis(robot: Baxter) -> dict[str, ReachBound]:
    """A bound for every rotation about the last axis; its proofs take a hundredth of the time."""
    return {side: ReachBound(arm, Tolerance.about("z")) for side, arm in robot.arms.items()}


@pytest.fixture
def bound_of_axis(arm: Arm, bounds_of_axis: dict[str, ReachBound]) -> ReachBound:
    """The arms in turn."""
    return bounds_of_axis[arm.side]


@pytest.fixture
def bound(arm: Arm, bounds: dict[str, ReachBound]) -> ReachBound:
    """The bounds of the arms in turn."""
    return bounds[arm.side]


@pytest.mark.parametrize("off", [0.0, 1e-6])
def test_no_reachable_pose_is_proved_out_of_reach(
    arm: Arm, bound: ReachBound, bound_of_axis: ReachBound, off: float
) -> None:
    """Nor one that misses a reachable one by no more than a solution may."""
    rng = np.random.default_rng(6)
    uniform = [arm.random_configuration(rng) for _ in range(100)]
    for i, q in enumerate([*uniform, *_extreme_configurations(arm, 250)]):
        T = arm.T_base_tip(q)
        R = pin.exp3(off * _direction(rng)) @ T.rotation
        near = pin.SE3(R, T.translation + off * _direction(rng))
        assert (bound_of_axis if i % SPARING else bound).proof(near) is None, q
        assert off or bound.proof_of_position(T.translation) is None, q


@pytest.mark.slow
def test_no_pose_that_a_calibrated_arm_reaches_has_a_proof(any_arm: Arm) -> None:
    bound = ReachBound(any_arm)
    qs = _extreme_configurations(any_arm, 400)
    Ts = np.array([any_arm.T_base_tip(q).homogeneous for q in qs])
    assert not bound.are_outside_shells(Ts).any()
    assert not bound.are_proven(Ts).any()
    assert not bound.are_beyond_limits(Ts[:15]).any()
    for T in map(pin.SE3, Ts[:15]):
        assert bound.proof(T) is bound.proof_of_wrist(T) is None
        assert bound.proof_of_position(T.translation) is None


def test_proofs_of_many_agree_with_single_ones(any_arm: Arm) -> None:
    bound, rng = ReachBound(any_arm), np.random.default_rng(8)
    poses = [
        any_arm.T_base_tip(any_arm.random_configuration(rng))
        * pin.SE3(pin.exp3(rng.normal(size=3)), 0.3 * rng.normal(size=3))
        for _ in range(150)
    ]
    proven = bound.are_proven(np.array([T.homogeneous for T in poses]))
    assert 15 < proven.sum() < 135
    T_tip_wrist = bound.T_last_tip.inverse()  # a calibrated arm's hand is not on its last axis
    of_axis = ReachBound(any_arm.with_tip(T_tip_wrist, "wrist"), Tolerance.about("z"))
    assert proven.tolist() == [of_axis.proof(T * T_tip_wrist) is not None for T in poses]


@pytest.mark.parametrize(
    ("q", "away"),  # with the elbow bent as far as it goes, e0 at a limit, w1 at a limit
    [
        ((-0.234, -0.207, -1.566, 2.618, 1.278, -1.262, 0.722), 0.03),
        ((0.252, -0.481, 3.054, 2.328, 0.257, -0.949, 2.142), 0.03),
        ((-1.182, 0.67, 2.86, 1.064, -0.017, 2.094, -2.744), 0.03),
    ],
)
def test_limits_of_all_joints_prove_more_than_other_bounds(
    left: Arm, q: tuple[float, ...], away: float
) -> None:
    """Some poses next to these, displaced in all directions, have only that proof."""
    bound, T, rng = ReachBound(left), left.T_base_tip(q), np.random.default_rng(9)
    found = 0
    for _ in range(12):
        pushed = pin.SE3(T.rotation, T.translation + away * _direction(rng))
        proof = bound.proof(pushed)
        if proof is not None and proof.bound == "limits":
            found += 1
            assert ReachBound(left, Tolerance.about("z")).proof(pushed) is None
            assert 0.0 < proof.excess_m <= away + 1e-6
    assert found > 0


def test_beyond_what_calibration_can_hide_a_calibrated_arm_has_proofs(any_arm: Arm) -> None:
    """Displaced from a fully stretched pose, straight away from the shoulder."""
    bound, linkage, rng = ReachBound(any_arm), Linkage.of(any_arm), np.random.default_rng(7)
    q = np.array(any_arm.neutral)
    q[2:5] = 0.0, linkage.elbow_angle, np.pi
    for _ in range(50):
        q[0], q[1] = (rng.uniform(any_arm.limits.q_min[i], any_arm.limits.q_max[i]) for i in (0, 1))
        T = any_arm.T_base_tip(q)
        away = T.act(linkage.T_last_tip.inverse().translation) - linkage.T_base_first.translation
        out_m = 2.0 * linkage.deviation.wrist_m + 0.07 + 0.01  # and what the shoulder is offset by
        pushed = pin.SE3(T.rotation, T.translation + out_m * away / np.linalg.norm(away))
        proof = bound.proof(pushed)
        assert proof is not None
        assert proof.excess_m <= out_m


def test_a_proof_of_the_wrist_holds_in_every_orientation_about_it(
    arm: Arm, bound: ReachBound
) -> None:
    rng, proved = np.random.default_rng(15), 0
    for q in _extreme_configurations(arm, 70):
        T = arm.T_base_tip(q)
        pushed = pin.SE3(T.rotation, T.translation + 0.3 * _direction(rng))
        proof, about_wrist = bound.proof_of_wrist(pushed), bound.T_last_tip.inverse()
        turn = pin.SE3(pin.exp3(np.pi * _direction(rng)), np.zeros(3))
        turned = bound.proof_of_wrist(pushed * about_wrist * turn * about_wrist.inverse())
        assert bound.proof_of_wrist(T) is None
        assert (proof is None) == (turned is None)
        if proof is not None and turned is not None:
            proved += 1
            assert bound.proof(pushed) is not None
            assert proof.excess_m == pytest.approx(turned.excess_m, abs=1e-9)
            assert proof.excess_m <= 0.3
    assert proved > 0


@pytest.mark.slow
def test_excess_never_exceeds_the_distance_to_a_reachable_pose(
    arm: Arm, bound: ReachBound, bound_of_axis: ReachBound
) -> None:
    rng = np.random.default_rng(8)
    found = set()
    for i, q in enumerate(_extreme_configurations(arm, 300)):
        T, distance_m = arm.T_base_tip(q), 10.0 ** rng.uniform(-3.0, -0.3)
        pushed = T.translation + distance_m * _direction(rng)
        proof = (bound_of_axis if i % 8 else bound).proof(pin.SE3(T.rotation, pushed))
        if proof is not None:
            found.add(proof.bound)
            assert 0.0 < proof.excess_m <= distance_m, (q, pushed)
    assert {"span", "fold", "shoulder", "wrist"} <= found


def test_excess_of_a_position_never_exceeds_the_distance_to_sampled_tips(
    left: Arm, bounds: dict[str, ReachBound]
) -> None:
    tips = np.array([left.T_base_tip(q).translation for q in _extreme_configurations(left, 3000)])
    rng, proved = np.random.default_rng(9), set()
    for p in rng.uniform([-1.5, -1.3, -1.2], [1.5, 1.7, 1.7], (100, 3)):
        proof = bounds["left"].proof_of_position(p)
        if proof is not None:
            proved.add(proof.bound)
            assert 0.0 < proof.excess_m <= np.linalg.norm(tips - p, axis=1).min()
    assert proved == {"span", "shoulder"}


def test_a_position_out_of_reach_is_out_of_reach_in_every_orientation(
    arm: Arm, bound: ReachBound
) -> None:
    rng = np.random.default_rng(10)
    for p in rng.uniform(-1.5, 1.5, (60, 3)):
        proof = bound.proof_of_position(p)
        if proof is not None:
            T = pin.SE3(pin.exp3(np.pi * _direction(rng)), p)
            assert bound.proof(T) is not None, p


def test_pushing_farther_out_keeps_the_proof_and_grows_the_excess(
    arm: Arm, bound: ReachBound
) -> None:
    rng, shoulder = np.random.default_rng(11), Linkage.of(arm).T_base_first.translation
    for _ in range(15):
        R, outward = pin.exp3(np.pi * _direction(rng)), _direction(rng)
        wrists = [shoulder + length * outward for length in (0.85, 0.86, 0.9, 1.0, 2.0)]
        excesses = [_excess_m(bound, _with_wrist(arm, wrist, R)) for wrist in wrists]
        assert excesses[0] > 0.0
        assert excesses == sorted(excesses)


def test_mirrored_arms_agree(robot: Baxter, bounds: dict[str, ReachBound]) -> None:
    rng = np.random.default_rng(12)
    for q in _extreme_configurations(robot.arm("left"), 30):
        T = robot.arm("left").T_base_tip(q)
        p, R = T.translation + 0.1 * _direction(rng), T.rotation
        left = bounds["left"].proof(pin.SE3(R, p))
        right = bounds["right"].proof(pin.SE3(MIRROR_Y @ R @ MIRROR_Y, MIRROR_Y @ p))
        assert (left is None) == (right is None)
        if left is not None and right is not None:
            assert left.bound == right.bound
            assert left.excess_m == pytest.approx(right.excess_m, abs=1e-9)


def test_a_rotation_about_the_tool_axis_changes_nothing(arm: Arm, bound: ReachBound) -> None:
    rng = np.random.default_rng(13)
    for q in _extreme_configurations(arm, 20):
        T = arm.T_base_tip(q)
        far = pin.SE3(T.rotation, T.translation + 0.2 * _direction(rng))
        rolled = far * pin.SE3(pin.exp3(np.array([0.0, 0.0, 2.0])), np.zeros(3))
        assert _excess_m(bound, rolled) == pytest.approx(_excess_m(bound, far), abs=1e-9)


def test_quick_test_agrees_with_the_proofs_by_shells(
    arm: Arm, bound: ReachBound, bound_of_axis: ReachBound
) -> None:
    rng = np.random.default_rng(14)
    poses = []
    for q in _extreme_configurations(arm, 150):
        T = arm.T_base_tip(q)
        poses.append(pin.SE3(T.rotation, T.translation + rng.uniform(0.0, 0.4) * _direction(rng)))
    outside = bound.are_outside_shells(np.array([T.homogeneous for T in poses]))
    assert 0 < outside.sum() < len(poses)
    for T, is_outside in zip(poses, outside, strict=True):
        proof = bound_of_axis.proof(T)
        assert is_outside == (proof is not None and proof.bound in {"span", "fold"})


@pytest.mark.parametrize(
    ("wrist_from_shoulder", "tool_axis", "bound_name"),
    [
        ((0.9, 0.0, 0.0), (0.0, 0.0, -1.0), "span"),  # too far
        ((0.07, 0.0, 0.1), (0.0, 0.0, 1.0), "fold"),  # the elbow does not bend that much
        ((0.0, 0.0, -0.72), (0.0, 0.0, -1.0), "shoulder"),  # s1 stops at 60 deg below horizontal
        ((-0.5, 0.0, -0.5), (0.0, 0.0, -1.0), "shoulder"),  # behind the robot, out of s0's range
        ((0.75, 0.0, 0.0), (-1.0, 0.0, 0.0), "wrist"),  # the hand would fold back on the forearm
    ],
)
def test_each_bound_proves_what_only_it_can(
    arm: Arm,
    bound: ReachBound,
    wrist_from_shoulder: tuple[float, float, float],
    tool_axis: tuple[float, float, float],
    bound_name: str,
) -> None:
    linkage = Linkage.of(arm)
    R_base_arm = linkage.T_base_first.rotation
    wrist = linkage.T_base_first.act(np.array(wrist_from_shoulder))
    R = (
        R_base_arm
        @ pin.Quaternion.FromTwoVectors(
            np.array([0.0, 0.0, 1.0]), np.array(tool_axis)
        ).toRotationMatrix()
    )
    proof = bound.proof(_with_wrist(arm, wrist, R))
    assert proof is not None
    assert proof.bound == bound_name


def test_excess_is_the_distance_beyond_the_straight_arm(arm: Arm, bound: ReachBound) -> None:
    linkage = Linkage.of(arm)
    radial = linkage.T_base_first.rotation[:, 0]
    shoulder = linkage.T_base_first.translation + linkage.shoulder_offset_m * radial
    proof = bound.proof(_with_wrist(arm, shoulder + 1.0 * radial, np.eye(3)))
    assert proof is not None
    assert proof.excess_m == pytest.approx(1.0 - 0.745318 - SWEEP_MARGIN_M, abs=1e-6)


def test_a_proof_reads_as_a_clause_with_numbers(bounds: dict[str, ReachBound]) -> None:
    T = pin.SE3(pin.exp3(np.array([0.0, np.pi / 2, 0.0])), np.array([1.5, 0.3, 0.2]))
    assert str(bounds["left"].proof(T)) == (
        "255 mm beyond the 0.745 m that upper arm and forearm span from left_s1, "
        "with the wrist at (1.113, 0.3, 0.2) m"
    )
    assert str(bounds["right"].proof_of_position(np.array([9.0, 0.0, 0.0]))) == (
        "7747 mm beyond the 1.133 m that the straight arm spans from right_s1, "
        "with the tip at (9, 0, 0) m"
    )


def test_a_point_on_the_first_axis_is_judged_too(arm: Arm, bound: ReachBound) -> None:
    p, up = Linkage.of(arm).T_base_first.translation, np.eye(3)[2]
    assert bound.proof_of_position(p + 0.5 * up) is None
    assert bound.proof_of_position(p + 1.3 * up) is not None


def test_absurdly_far_poses_are_proved_in_few_words(bound: ReachBound) -> None:
    for length in (1e5, 1e200, 1.7e308):
        proof = bound.proof(pin.SE3(np.eye(3), np.array([length, -length, 0.0])))
        assert proof is not None
        assert len(proof.text) < 200


def _with_wrist(arm: Arm, wrist_base: FloatArray, R_base_tip: FloatArray) -> pin.SE3:
    """The pose with an orientation and a position of the wrist."""
    return pin.SE3(R_base_tip, wrist_base + Linkage.of(arm).hand_m * R_base_tip[:, 2])


def _excess_m(bound: ReachBound, T: pin.SE3) -> float:
    proof = bound.proof(T)
    return 0.0 if proof is None else proof.excess_m


def _direction(rng: np.random.Generator) -> FloatArray:
    v = rng.standard_normal(3)
    return v / np.linalg.norm(v)


def _extreme_configurations(arm: Arm, count: int) -> Iterator[FloatArray]:
    """Configurations with joints on limits, the elbow straight or the wrist singular."""
    rng, (q_min, q_max) = np.random.default_rng(14), (arm.limits.q_min, arm.limits.q_max)
    for i in range(count):
        q = arm.random_configuration(rng)
        at_limit = rng.random(7) < (0.15, 0.3, 0.7)[i % 3]
        q = np.where(at_limit, np.where(rng.random(7) < 0.5, q_min, q_max), q)
        if i % 4 == 1:
            q[3] = rng.choice([0.0, 0.187, q_min[3]])  # the forearm in line with the upper arm
        if i % 4 == 2:
            q[5] = 0.0  # the axes of w0 and w2 in line
        yield q
