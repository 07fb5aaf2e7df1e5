"""The nearest reachable pose, against random configurations and an independent solver."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter, BaxterError, IKService, pose_from_quaternion
from baxter_kin.errors import PoseError, UnknownNameError
from planner.atlas import Keep, NearestPose, ReachMap, nearest_reachable
from planner.atlas.checking.pose_finder import PoseFinder
from planner.errors import AtlasError

POSES, SAMPLES = 2, 20_000


def unreachable(robot: Baxter) -> list[pin.SE3]:
    """Poses out of the left arm's reach, but near it."""
    rng, ik, poses = np.random.default_rng(12), IKService(robot.arm("left")), list[pin.SE3]()
    while len(poses) < POSES:
        p = rng.uniform((0.4, -0.1, -0.1), (1.1, 1.0, 0.4))
        T = pin.SE3(pin.exp3(rng.normal(size=3)), p)
        if not ik.solve(T).is_valid:
            poses.append(T)
    return poses


@pytest.fixture(scope="module")
def asked(robot: Baxter, small_map: ReachMap) -> list[NearestPose]:
    """All three questions about some poses."""
    return [
        nearest_reachable(small_map, T, "left", keep=keep)
        for T in unreachable(robot)
        for keep in Keep
    ]


@pytest.mark.slow
def test_the_nearest_pose_has_a_witness_and_the_kept_part(
    asked: list[NearestPose], finders: dict[str, PoseFinder]
) -> None:
    found = [each for each in asked if each.T_base_tip is not None]
    assert len(found) > POSES
    for each in found:
        assert each.T_base_tip is not None
        assert each.q is not None
        assert finders["left"].holds(each.T_base_tip, each.q)
        kept = each.measure.keep
        assert kept is not Keep.ORIENTATION or each.angle_rad < 1e-12
        assert kept is not Keep.POSITION or each.offset_m < 1e-12
        wanted = {
            Keep.ORIENTATION: each.offset_m,
            Keep.POSITION: each.angle_rad,
            Keep.NOTHING: math.hypot(each.offset_m, 0.3 * each.angle_rad),
        }[kept]
        assert each.distance == pytest.approx(wanted, abs=1e-9)
        is_moved, is_turned = each.measure.weights
        assert (f"{1e3 * each.offset_m:.1f} mm away" in str(each)) is bool(is_moved)
        assert (f"{math.degrees(each.angle_rad):.2f} deg" in str(each)) is bool(is_turned)
        assert "proven" in str(each)


@pytest.mark.slow
def test_lower_bounds_are_below_upper_ones(asked: list[NearestPose]) -> None:
    for each in asked:
        assert 0.0 <= each.proven <= each.distance
    assert sum(each.proven > 0.8 * each.distance for each in asked) >= POSES


def test_no_random_configuration_is_nearer_than_proven_or_than_found(
    robot: Baxter, asked: list[NearestPose]
) -> None:
    arm, rng = robot.arm("left"), np.random.default_rng(1)
    tips = arm.T_base_tips(rng.uniform(arm.limits.q_min, arm.limits.q_max, (SAMPLES, 7)))
    for each in asked:
        if each.measure.keep is not Keep.NOTHING:
            continue
        T = each.T_base_asked
        offset = np.linalg.norm(tips[:, :3, 3] - T.translation, axis=1)
        traces = np.einsum("nij,ij->n", tips[:, :3, :3], T.rotation)
        angle = np.arccos((0.5 * (traces - 1.0)).clip(-1.0, 1.0))
        assert np.hypot(offset, 0.3 * angle).min() >= each.distance


def test_an_independent_solver_reaches_nothing_nearer_than_proven(
    asked: list[NearestPose], finders: dict[str, PoseFinder]
) -> None:
    rng = np.random.default_rng(2)
    for each in asked:
        if not 0.0 < each.proven < math.inf or each.measure.keep is Keep.NOTHING:
            continue
        direction = rng.normal(size=3)
        step = 0.98 * each.proven * direction / np.linalg.norm(direction)
        T = each.T_base_asked
        if each.measure.keep is Keep.ORIENTATION:
            nearer = pin.SE3(T.rotation, T.translation + step)
        else:
            nearer = pin.SE3(T.rotation @ pin.exp3(step), T.translation)
        assert finders["left"].find(nearer) is None


def test_no_nearer_cell_has_a_witness(asked: list[NearestPose]) -> None:
    nearer = [each.cells for each in asked if each.cells is not None]
    assert sum(sum(cells) for cells in nearer) > 0
    assert all(cells.reachable == 0 for cells in nearer)


def test_a_slow_search_counts_the_same_nearer_cells(small_map: ReachMap) -> None:
    grid, codes = small_map.positions, small_map.margins("left")
    at, rotation = (int(i) for i in np.argwhere(codes.reshape(-1, 72) == -1)[-1])
    p = grid.points().reshape(-1, 3)[at]
    T = pin.SE3(small_map.rotations.matrices[rotation], p)
    found = nearest_reachable(small_map, T, "left", keep="nothing")
    assert found.cells is not None
    turned = [np.linalg.norm(pin.log3(T.rotation.T @ R)) for R in small_map.rotations.matrices]
    offset = np.linalg.norm(grid.points().reshape(-1, 3) - p, axis=1)
    near = np.hypot(offset[:, None], 0.3 * np.array(turned)) < found.distance
    counted = codes.reshape(-1, 72)[near]
    assert found.cells.proven > 0
    assert found.cells == ((counted == -1).sum(), (counted == -2).sum(), (counted >= 0).sum())


def test_a_reachable_pose_is_its_own_answer(small_map: ReachMap) -> None:
    T = pose_from_quaternion((0.7, 0.2, -0.1), (0.0, 1.0, 0.0, 0.0))
    found = nearest_reachable(small_map, T, "left")
    assert (found.distance, found.proven) == (0.0, 0.0)
    assert found.T_base_tip is not None
    assert found.T_base_tip.isApprox(T)
    assert "reaches the pose itself" in str(found)


def test_a_position_that_no_orientation_reaches_is_proven(small_map: ReachMap) -> None:
    T = pose_from_quaternion((3.0, 0.2, -0.1), (0.0, 1.0, 0.0, 0.0))
    found = nearest_reachable(small_map, T, "left", keep="position")
    assert found.T_base_tip is None
    assert math.isinf(found.proven)
    assert str(found).endswith("it is proven that there is none")


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ({"keep": "oriention"}, UnknownNameError),
        ({"side": "middle"}, UnknownNameError),
        ({"m_per_rad": 0.0}, AtlasError),
        ({"atlas": 3}, AtlasError),
        ({"T_base_tip": 3}, PoseError),
    ],
)
def test_invalid_arguments_are_refused(
    small_map: ReachMap, arguments: dict[str, object], error: type[BaxterError]
) -> None:
    valid: dict[str, object] = {
        "atlas": small_map,
        "T_base_tip": pin.SE3.Identity(),
        "side": "left",
    }
    with pytest.raises(error):
        nearest_reachable(**(valid | arguments))  # type: ignore[arg-type]
