"""Witnesses and proofs against independent kinematics and an independent solver."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import least_squares

from baxter_kin import Baxter
from planner.atlas import PositionGrid, ReachMap, RotationGrid
from planner.atlas.reach_search import RAD_PER_MARGIN, RAD_PER_STEP, UNREACHABLE, ReachSearch

RESTARTS = 12


def sampled(robot: Baxter, side: str, count: int, seed: int) -> np.ndarray:
    """Positions of a fine grid around a robot, at random."""
    grid = PositionGrid.around(robot, 0.025)
    reach = grid.points().reshape(-1, 3)
    near = reach[
        np.linalg.norm(reach - robot.arm(side).T_base_tip(np.zeros(7)).translation, axis=1) < 1.2
    ]
    chosen: np.ndarray = near[np.random.default_rng(seed).permutation(len(near))[:count]]
    return chosen


def residual(arm: object, data: object, frame: int, T: pin.SE3, q: np.ndarray) -> np.ndarray:
    pin.forwardKinematics(arm.model, data, q)  # type: ignore[attr-defined]
    reached = pin.updateFramePlacement(arm.model, data, frame)  # type: ignore[attr-defined]
    return np.array(pin.log6(reached.actInv(T)).vector)


def is_reached(robot: Baxter, side: str, T: pin.SE3, rng: np.random.Generator) -> bool:
    """Bounded least squares from many random starts, on Pinocchio's kinematics."""
    arm = robot.arm(side)
    data, frame = arm.model.createData(), arm.model.getFrameId(f"{side}_gripper")
    low, high = arm.limits.q_min, arm.limits.q_max
    for _ in range(RESTARTS):
        found = least_squares(
            lambda q: residual(arm, data, frame, T, q),
            rng.uniform(low, high),
            bounds=(low, high),
            xtol=1e-14,
            ftol=1e-14,
            gtol=1e-14,
            max_nfev=100,
        )
        if np.abs(found.fun).max() < 1e-6:
            return True
    return False


@pytest.mark.parametrize("side", ["left", "right"])
def test_stored_witnesses_reach_their_poses(robot: Baxter, side: str) -> None:
    """By Pinocchio, on the model of the whole robot, from the stored whole numbers."""
    rotations, points = RotationGrid.hopf(0), sampled(robot, side, 40, 5)
    cells = ReachSearch(robot.arm(side), rotations).search(points)
    data, frame = robot.model.createData(), robot.model.getFrameId(f"{side}_gripper")
    limits = robot.arm(side).limits
    where = robot.indices(limits.names)
    at, rotation = np.nonzero(cells.margins >= 0)
    assert len(at) > 200
    for i, r in zip(at[::7], rotation[::7], strict=True):
        q = robot.configuration()
        full = q.copy()
        full[list(where)] = cells.witnesses[i, :, r] * RAD_PER_STEP
        pin.forwardKinematics(robot.model, data, full)
        off = pin.log6(
            pin.SE3(rotations.matrices[r], points[i]).actInv(
                pin.updateFramePlacement(robot.model, data, frame)
            )
        ).vector
        assert np.linalg.norm(off[:3]) <= 1e-6
        assert np.linalg.norm(off[3:]) <= 1e-6
        margin = np.minimum(
            full[list(where)] - limits.q_min, limits.q_max - full[list(where)]
        ).min()
        assert 0.0 <= margin - cells.margins[i, r] * RAD_PER_MARGIN < RAD_PER_MARGIN + 1e-12


@pytest.mark.slow
def test_an_independent_solver_reaches_nothing_that_is_proven_unreachable(robot: Baxter) -> None:
    rotations, rng = RotationGrid.hopf(0), np.random.default_rng(8)
    points = sampled(robot, "left", 30, 9)
    search = ReachSearch(robot.arm("left"), rotations)
    cells = search.search(points)
    matrices = rotations.matrices
    at, rotation = np.nonzero(cells.margins == UNREACHABLE)
    near = [
        (i, r)
        for i, r in zip(at, rotation, strict=True)
        if (cells.margins[i] >= 0).any()  # at positions where others are reached: hard ones
    ]
    assert len(near) > 100
    for k in rng.permutation(len(near))[:25]:
        i, r = near[k]
        assert not is_reached(robot, "left", pin.SE3(matrices[r], points[i]), rng)


def test_little_is_undecided(small_map: ReachMap) -> None:
    codes = np.concatenate([small_map.margins(side).ravel() for side in small_map.arms])
    assert (codes == -2).mean() <= 0.002
    assert 0.1 < (codes >= 0).mean() < 0.9


def test_poses_are_decided_alike_in_lists_of_rotations(robot: Baxter) -> None:
    """A list has one roll for each direction, so that every pose is searched for on its own."""
    grid, points = RotationGrid.hopf(0), sampled(robot, "right", 6, 11)
    arm = robot.arm("right")
    shared = ReachSearch(arm, grid).search(points).margins
    alone = ReachSearch(arm, grid.expanded()).search(points).margins
    decided = (shared != -2) & (alone != -2)
    assert decided.mean() > 0.99
    assert np.array_equal(shared[decided] >= 0, alone[decided] >= 0)


def test_far_positions_are_out_of_reach(robot: Baxter) -> None:
    cells = ReachSearch(robot.arm("left"), RotationGrid.hopf(0)).search(np.full((2, 3), 5.0))
    assert (cells.margins == UNREACHABLE).all()
    assert not cells.witnesses.any()
