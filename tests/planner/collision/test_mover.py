"""Both arms as one mover: bounds and proofs compared with distances while both arms move."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin import Arm, Baxter
from baxter_kin.kinematics.joint_chain import JointChain
from baxter_kin.validation import FloatArray, Indices
from planner import Manipulator, Scene, Trajectory, plan_joint_move
from planner.certificate.motion import carried
from planner.clearance import Clearance, ContinuousContact, ContinuousProof
from planner.collision.checker import ClearanceChecker
from planner.collision.context import CollisionContext
from planner.collision.mover import Mover, Walk, about_z
from planner.collision.proof import prove_move
from planner.prover.problem import SHARES

GJK_M = 2e-6
"""Difference of two runs of coal on one pair."""

BODY_M = 2e-3
"""Coal's shapes contain Rethink's meshes, and its distances are up to this much less: twice half a
millimetre for each of two links."""

SAMPLES = 60

SAMPLING_M = 2e-4
"""Error between samples 10 ms apart, where the second derivative is at most 16 m/s^2."""

STEP_RAD = 1e-5

STEP_S = 1e-4

seeds = st.integers(0, 2**32 - 1)
sizes = st.sampled_from([1e-3, 0.03, 0.3])


class BothArms(ClearanceChecker):
    """The pairs of one arm, while both arms move."""

    @cached_property
    def mover(self) -> Mover:
        return Mover.of(*(self.shapes.robot.arm(side) for side in ("right", "left")))

    def distances(self, full: FloatArray, q: FloatArray, pairs: Indices) -> FloatArray:
        """Distances of some pairs, with the joints of both arms at `q`."""
        there = np.array(full)
        there[self.motion_bounds.q_index] = q
        return np.array(self.distances_m(there, pairs.tolist()))

    def nearest_by_peers(self, full: FloatArray, q: FloatArray, pairs: Indices) -> Clearance:
        """The smallest distance of some pairs by Pinocchio and coal, with both arms at `q`."""
        data, there = self.robot.createData(), np.array(full)
        there[self.motion_bounds.q_index] = q
        pin.forwardKinematics(self.robot, data, there)
        shapes, checked = self.geometry.geometryObjects, self.checked
        T = np.array([(data.oMi[each.parentJoint] * each.placement).homogeneous for each in shapes])
        checked.distances.place(T)
        bounds = checked.gaps_m(T[None], np.zeros_like(pairs), pairs)
        found, least_m = int(pairs[0]), np.inf
        for i in np.argsort(bounds).tolist():
            if bounds[i] >= max(least_m, 0.0):
                break
            distance_m = checked.distances.measure(int(pairs[i]), max(least_m, 0.0))
            if distance_m < least_m:
                found, least_m = int(pairs[i]), distance_m
        return checked.clearance_of(found, least_m)

    @property
    def across(self) -> Indices:
        """The pairs of one arm with the other."""
        moves = self.motion_bounds.moves[self.pairs]
        return np.flatnonzero(moves[..., :7].any(axis=(1, 2)) & moves[..., 7:].any(axis=(1, 2)))

    def some_pairs(self, rng: np.random.Generator) -> Indices:
        """Twenty pairs, half of them between the two arms."""
        parts = self.across, np.setdiff1d(np.arange(len(self.pairs)), self.across)
        return np.concatenate([rng.choice(part, 10, replace=False) for part in parts])


@pytest.fixture(scope="module")
def checker(manipulator: Manipulator, robot: Baxter, arm: Arm, scene: Scene) -> BothArms:
    """Checkers of each arm's pairs, including those with the other arm."""
    return BothArms(manipulator.shapes, robot.arm(arm.side), scene)


@pytest.fixture(scope="module")
def full(robot: Baxter) -> FloatArray:
    return robot.configuration()


@pytest.fixture(scope="module")
def neutral(robot: Baxter) -> FloatArray:
    """The hands in front of the robot, some centimetres apart."""
    left, right = (np.array(robot.arm(side).neutral) for side in ("left", "right"))
    left[0], right[0] = -0.97, 0.98
    return np.concatenate([left, right])


def test_joints_of_the_left_arm_come_first(robot: Baxter) -> None:
    left, right = robot.arm("left"), robot.arm("right")
    mover = Mover.of(right, left)
    assert mover.joint_names == mover.limits.names == left.joint_names + right.joint_names
    expected = np.concatenate([left.limits.q_min, right.limits.q_min])
    np.testing.assert_array_equal(mover.limits.q_min, expected)


@settings(max_examples=10)
@given(seeds, sizes)
def test_no_distance_changes_by_more_than_the_bound(
    checker: BothArms, full: FloatArray, neutral: FloatArray, seed: int, size: float
) -> None:
    """The lemma for two moving shapes, tested with joints at the ends of their turns."""
    rng, bounds = np.random.default_rng(seed), checker.motion_bounds
    pairs = checker.some_pairs(rng)
    q, turns = neutral + rng.uniform(-0.5, 0.5, 14), rng.uniform(0.0, size, 14)
    placed, zero = bounds.place(full, q[None]), np.zeros_like(pairs)
    bound = bounds.motions_m(placed, turns[None], zero, checker.pairs[pairs])
    before = checker.distances(full, q, pairs)
    after = checker.distances(full, q + turns * rng.choice([-1.0, 0.0, 1.0], 14), pairs)
    apart = (before > 0.0) & (after > 0.0)  # inside each other, surfaces have no distance
    assert (np.abs(after - before) <= bound + GJK_M)[apart].all()


def test_pairs_keep_their_distance_when_only_the_other_arm_turns(
    robot: Baxter, checker: BothArms, full: FloatArray, neutral: FloatArray
) -> None:
    bounds, pairs = checker.motion_bounds, checker.pairs
    other = robot.arm("right" if checker.arm.side == "left" else "left")
    turns = np.array([name in other.joint_names for name in checker.mover.joint_names], float)
    placed, zero = bounds.place(full, neutral[None]), np.zeros(len(pairs), dtype=np.intp)
    moved = bounds.motions_m(placed, turns[None], zero, pairs) > 0.0
    of_other = np.isin(pairs, sorted(checker.shapes.of_arm(other))).any(axis=1)
    np.testing.assert_array_equal(moved, of_other)


def test_linear_bounds_change_with_the_joints_of_both_arms(
    checker: BothArms, full: FloatArray, neutral: FloatArray
) -> None:
    obstacles = CollisionContext(checker, full).obstacles(0.0, np.zeros((0, 14)))
    numbers = obstacles.sampled(np.tile(neutral, (4, 1))).linear.coefficients[0]
    nearest = numbers[np.argmin(numbers @ [*neutral, 1.0])]
    steps = STEP_RAD * np.eye(14)
    ahead, behind = (
        [obstacles.sampled(np.tile(neutral + step, (4, 1))).excess_m for step in sign * steps]
        for sign in (1.0, -1.0)
    )
    slopes = (np.array(ahead) - behind) / (2.0 * STEP_RAD)
    np.testing.assert_allclose(nearest[:-1], slopes, atol=2e-3)
    assert (np.abs(slopes).reshape(2, 7).max(axis=1) > 0.05).all()


# The walk


@given(seeds)
def test_axes_may_lie_anywhere_in_the_frames_of_joints(seed: int) -> None:
    rng = np.random.default_rng(seed)
    T = np.array([pin.SE3.Random().homogeneous for _ in range(7)])
    axes = rng.normal(size=(7, 3))
    chain = JointChain(T, axes / np.linalg.norm(axes, axis=1, keepdims=True))
    q = rng.uniform(-3.0, 3.0, 7)
    found, T_own = about_z(chain)
    there = pin.SE3.Identity()
    for R, p, angle, own, expected in zip(
        found.R, found.p, q, T_own[1:], chain.poses(q[None])[0], strict=True
    ):
        there = there * pin.SE3(R @ pin.utils.rotate("z", angle), p)
        assert (there * pin.SE3(own)).isApprox(pin.SE3(expected), 1e-9)


def poses_on(walk: Walk, q: FloatArray) -> FloatArray:
    """Poses of the frames of a walk with the joints of its mover at `q`, shape (n + 1, 4, 4)."""
    T = [np.eye(4)]
    for R, p, angle in zip(walk.chain.R, walk.chain.p, walk.along(q), strict=True):
        T.append(T[-1] @ pin.SE3(R @ pin.utils.rotate("z", angle), p).homogeneous)
    return np.array(T)


@given(seeds)
def test_a_walk_passes_base_and_every_link_at_their_poses(robot: Baxter, seed: int) -> None:
    """Outbound and on the way back, seen from base."""
    mover = Mover.of(robot.arm("left"), robot.arm("right"))
    walk, limits = Walk.of(mover), mover.limits
    q = np.random.default_rng(seed).uniform(limits.q_min, limits.q_max)
    chain = JointChain.side_by_side([arm.chain for arm in mover.arms])
    expected = np.concatenate([np.eye(4)[None], chain.poses(q[None])[0]])
    at = poses_on(walk, q)
    for levels, T_level_link in zip(walk.levels, walk.T_level_link, strict=True):
        met = levels >= 0
        found = (at[levels] @ T_level_link)[met]
        np.testing.assert_allclose(found, expected[met], atol=1e-12)
    assert (walk.levels[1] >= 0).all()


@given(seeds)
def test_no_point_of_one_hand_accelerates_more_than_its_bound_seen_from_the_other(
    robot: Baxter, seed: int
) -> None:
    """The lemma along a chain whose first joints are passed backwards, on constant jerks."""
    walk = Walk.of(Mover.of(robot.arm("left"), robot.arm("right")))
    rng = np.random.default_rng(seed)
    q, v, a, point = (rng.uniform(-1.0, 1.0, n) for n in (14, 14, 14, 3))
    T = [poses_on(walk, q + v * t + a * t**2 / 2.0) for t in STEP_S * np.arange(-1, 2)]
    hand, other = 7, len(walk.joints)
    seen = [(np.linalg.inv(each[hand]) @ each[other] @ [*point, 1.0])[:3] for each in T]
    between = (np.arange(other) >= hand)[None]
    speeds, hard = (np.abs(walk.along(x))[None] for x in (np.abs(v) + np.abs(a) * STEP_S, a))
    reach = np.array([np.linalg.norm(point)])
    u, w = carried(speeds, hard, reach, walk.chain.offsets, between)
    assert np.linalg.norm(seen[2] - seen[0]) / (2.0 * STEP_S) <= u[0]
    assert np.linalg.norm(seen[2] - 2.0 * seen[1] + seen[0]) / STEP_S**2 <= w[0] + 1e-5


# Proofs


def sampled(checker: BothArms, full: FloatArray, motion: Trajectory, pairs: Indices) -> FloatArray:
    """The smallest distances of some pairs at samples of a motion, by Pinocchio and coal."""
    qs = motion.sample(np.linspace(0.0, motion.duration, SAMPLES)).q
    return np.array([checker.nearest_by_peers(full, q, pairs).distance_m for q in qs])


def random_motion(checker: BothArms, neutral: FloatArray, seed: int) -> Trajectory:
    """A motion of all 14 joints between configurations with the hands some centimetres apart."""
    rng = np.random.default_rng(seed)
    apart = neutral + 0.1 * (np.eye(14)[0] - np.eye(14)[7])
    q_start, q_goal = apart + rng.uniform(-0.15, 0.15, (2, 14))
    return plan_joint_move(q_start, q_goal, checker.mover.limits)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_the_proven_distance_of_both_arms_is_that_of_samples(
    checker: BothArms, full: FloatArray, neutral: FloatArray, seed: int
) -> None:
    motion = random_motion(checker, neutral, seed)
    for pairs in (checker.across, np.arange(len(checker.pairs))):
        least_m = sampled(checker, full, motion, pairs).min()
        result = prove_move(checker, motion, full, 0.0, pairs)
        assert isinstance(result, ContinuousProof)
        assert result.proven_m <= least_m + BODY_M
        assert result.proven_m >= SHARES[0] * (least_m - SAMPLING_M)
        assert result.proven_m >= SHARES[0] * result.nearest.distance_m - 1e-6


@pytest.mark.parametrize("seed", range(2))
def test_a_collision_of_both_arms_is_found_with_its_pair_and_time(
    checker: BothArms, full: FloatArray, neutral: FloatArray, seed: int
) -> None:
    """The hands move through each other; at the start they are apart."""
    clear = random_motion(checker, neutral, seed)
    inwards = clear.q_goal + 0.5 * (np.eye(14)[7] - np.eye(14)[0])
    motion = plan_joint_move(clear.q_start, inwards, checker.mover.limits)
    result = prove_move(checker, motion, full, 0.0)
    assert isinstance(result, ContinuousContact)
    near = result.nearest
    assert near.time_s is not None
    assert {name[0] for name in (near.first, near.second)} == {"l", "r"}
    q = motion.sample(near.time_s).q
    at_it = checker.nearest_by_peers(full, q, checker.across)
    assert at_it.distance_m <= near.distance_m + GJK_M <= GJK_M
    assert at_it.distance_m == pytest.approx(near.distance_m, abs=GJK_M)
