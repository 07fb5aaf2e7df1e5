"""Bounds on a relative pose, compared with Pinocchio at dense instants."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin import Baxter
from baxter_kin.validation import FloatArray
from planner import Trajectory, plan_joint_move
from planner.collision.mover import Mover
from planner.two_arms.pair_moves.relative_pose import CELLS, relative_deviation, relative_poses

INSTANTS = 400

seeds = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module")
def mover(robot: Baxter) -> Mover:
    return Mover.of(robot.arm("left"), robot.arm("right"))


def by_pinocchio(robot: Baxter, q: FloatArray) -> pin.SE3:
    """The pose of the right tip seen from the left one, on the model of the whole robot."""
    full, data = np.array(robot.configuration()), robot.model.createData()
    names = [*robot.arm("left").joint_names, *robot.arm("right").joint_names]
    full[list(robot.indices(tuple(names)))] = q
    pin.framesForwardKinematics(robot.model, data, full)
    left, right = (data.oMf[robot.model.getFrameId(f"{s}_gripper")] for s in ("left", "right"))
    return left.actInv(right)


def worst(robot: Baxter, motion: Trajectory, wanted: pin.SE3, times: FloatArray) -> FloatArray:
    """Maximum distance, m, and angle, rad."""
    errors = [wanted.actInv(by_pinocchio(robot, q)) for q in motion.sample(times).q]
    each = [(np.linalg.norm(e.translation), np.linalg.norm(pin.log3(e.rotation))) for e in errors]
    found: FloatArray = np.array(each).max(axis=0)
    return found


@given(seeds, st.sampled_from([1e-4, 0.01, 0.3]))
@settings(max_examples=15)
def test_no_instant_is_beyond_the_bounds_which_are_close(
    robot: Baxter, mover: Mover, seed: int, size: float
) -> None:
    """Of any motion: the pose wanted is that at the start, which most motions leave by far."""
    rng, limits = np.random.default_rng(seed), mover.limits
    q_start = rng.uniform(0.8 * limits.q_min, 0.8 * limits.q_max)
    q_goal = np.clip(q_start + rng.uniform(-size, size, 14), limits.q_min, limits.q_max)
    motion = plan_joint_move(q_start, q_goal, limits)
    wanted = by_pinocchio(robot, q_start)
    times = rng.uniform(0.0, motion.duration, INSTANTS)
    measured = worst(robot, motion, wanted, np.append(times, motion.duration))
    allowed = 1e-4, 3.5e-4
    found = relative_deviation(mover, motion, wanted, *allowed)
    bounds = np.array([found.position_m, found.rotation_rad])
    assert (measured <= bounds + 1e-9).all()
    # where no tolerance is broken, cells are made small enough to show it
    if (measured <= 0.5 * np.array(allowed)).all():
        assert found.is_within(*allowed)
    assert found.cells in CELLS
    assert (bounds <= 1.2 * measured + 1e-4).all()


def test_a_rest_has_the_deviation_of_its_configuration(robot: Baxter, mover: Mover) -> None:
    q = np.concatenate([robot.arm(side).neutral for side in ("left", "right")])
    stay = Trajectory.stay(q, mover.limits)
    wanted = by_pinocchio(robot, q) * pin.SE3(pin.utils.rotate("x", 0.01), np.full(3, 1e-3))
    found = relative_deviation(mover, stay, wanted, 1.0, 1.0)
    error = wanted.actInv(by_pinocchio(robot, q))
    assert found.position_m == pytest.approx(float(np.linalg.norm(error.translation)), abs=1e-5)
    assert found.rotation_rad == pytest.approx(0.01, abs=1e-9)


@given(seeds)
@settings(max_examples=20)
def test_relative_poses_are_those_of_pinocchio(robot: Baxter, mover: Mover, seed: int) -> None:
    q = np.random.default_rng(seed).uniform(mover.limits.q_min, mover.limits.q_max)
    expected = by_pinocchio(robot, q).homogeneous
    np.testing.assert_allclose(relative_poses(mover, q[None])[0], expected, atol=1e-12)
