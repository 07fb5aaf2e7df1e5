"""Motion along paths: on the path at every sample, by other code; fast, smooth, clear; refusals."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Arm, Baxter, pose_from_quaternion
from baxter_kin.errors import BaxterError, ConfigurationError, UnknownNameError
from baxter_kin.validation import FloatArray
from planner import (
    Arc,
    Body,
    LineTolerance,
    Manipulator,
    Part,
    PathMove,
    PathMoveError,
    Polyline,
    Scene,
    Sphere,
    plan_path_move,
)
from planner.errors import MotionError
from planner.motion.paths import windows
from planner.motion.paths.deviation import deviations
from planner.motion.paths.pieces import Piece

STRICT, LAX = LineTolerance(), LineTolerance(1e-3, math.radians(0.5))
Z, RADIUS_M, SIDE_M = np.array([0.0, 0.0, 1.0]), 0.06, 0.12
DOWN = (0.0, 1.0, 0.0, 0.0)


def at(x: float, y: float, z: float = 0.0) -> pin.SE3:
    return pose_from_quaternion((x, y, z), DOWN)


def middle(side: str) -> tuple[float, float]:
    return 0.70, 0.15 if side == "left" else -0.15


def circle(side: str, *, turns_hand: bool = False) -> Arc:
    x, y = middle(side)
    return Arc(at(x + RADIUS_M, y), np.array([x, y, 0.0]), Z, 2.0 * math.pi, turns_hand)


def rectangle(side: str, half_x: float, half_y: float) -> Polyline:
    (x, y), (a, b) = middle(side), (half_x, half_y)
    corners = (a, 0.0), (a, b), (-a, b), (-a, -b), (a, -b), (a, 0.0)
    return Polyline([at(x + dx, y + dy) for dx, dy in corners])


def square(side: str) -> Polyline:
    return rectangle(side, SIDE_M / 2.0, SIDE_M / 2.0)


def slanted(seed: int, count: int, side: str) -> Polyline:
    """Random waypoints in front of an arm; the hand is down but for up to 15 deg."""
    rng, (x, y) = np.random.default_rng(seed), middle(side)
    poses: list[pin.SE3] = []
    position = np.array([x, y, 0.05])
    while len(poses) < count:
        axis = rng.normal(size=3)
        turn = math.radians(rng.uniform(0.0, 15.0)) * axis / np.linalg.norm(axis)
        poses.append(pin.SE3(pin.exp3(turn) @ at(0, 0).rotation, position))
        step = rng.normal(size=3)
        moved = position + rng.uniform(0.04, 0.12) * step / np.linalg.norm(step)
        if np.abs(moved - [x, y, 0.05]).max() < 0.12:
            position = moved
    return Polyline(poses)


@pytest.fixture(scope="module", params=["left", pytest.param("right", marks=pytest.mark.slow)])
def side(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def arms(robot: Baxter) -> dict[str, Manipulator]:
    return {side: Manipulator.of(robot, side) for side in ("left", "right")}


def tips(move: PathMove, arm: Arm, step_s: float = 0.004) -> FloatArray:
    """Poses of the tip at equal times, both ends included."""
    duration_s = move.trajectory.duration
    times = np.linspace(0.0, duration_s, 2 + int(duration_s / step_s))
    return arm.T_base_tips(move.trajectory.sample(times).q)


def most_off(poses: Sequence[pin.SE3], found: FloatArray, tolerance: LineTolerance) -> float:
    """Largest share of a tolerance by which poses are off a polyline, by dense samples of it."""
    wanted: list[tuple[FloatArray, FloatArray]] = []
    for start, goal in pairwise(poses):
        first, last = pin.Quaternion(start.rotation), pin.Quaternion(goal.rotation)
        way = goal.translation - start.translation
        for s in np.linspace(0.0, 1.0, 1500).tolist():
            R = first.slerp(s, last).toRotationMatrix()
            wanted.append((start.translation + s * way, R))
    p, R = (np.array(each) for each in zip(*wanted, strict=True))
    shares = []
    for T in found:
        near = np.flatnonzero(np.linalg.norm(p - T[:3, 3], axis=1) < 4.0 * tolerance.position_m)
        if not len(near):
            return math.inf
        traces = np.einsum("kij,ij->k", R[near], T[:3, :3])
        angles = np.arccos(((traces - 1.0) / 2.0).clip(-1.0, 1.0))
        away = np.linalg.norm(p[near] - T[:3, 3], axis=1)
        both = np.maximum(away / tolerance.position_m, angles / tolerance.rotation_rad)
        shares.append(both.min())
    return float(np.max(shares))


def keeps_limits_and_rests(move: PathMove) -> bool:
    motion = move.trajectory
    low, high = motion.position_extrema()
    is_inside = (low >= motion.limits.q_min).all() and (high <= motion.limits.q_max).all()
    at_rest = max(np.abs(motion.v[[0, -1]]).max(), np.abs(motion.a[[0, -1]]).max())
    return bool(is_inside and max(motion.peak_ratios()) <= 1.0 + 1e-9 and at_rest < 1e-9)


def test_a_circle_is_followed_to_a_tenth_of_a_millimetre(
    arms: dict[str, Manipulator], side: str
) -> None:
    move = plan_path_move(arms[side], None, circle(side))
    poses = tips(move, arms[side].arm)
    spokes = poses[:, :3, 3] - [*middle(side), 0.0]
    off_m = np.hypot(np.linalg.norm(spokes[:, :2], axis=1) - RADIUS_M, spokes[:, 2])
    assert off_m.max() < 1e-4
    angles = np.arccos((poses[:, :3, 2] @ -Z).clip(-1.0, 1.0))
    assert angles.max() < math.radians(0.02)
    turned = np.unwrap(np.arctan2(spokes[:, 1], spokes[:, 0]))
    assert turned[-1] - turned[0] == pytest.approx(2.0 * math.pi, abs=1e-6)
    assert move.trajectory.duration < 2.3
    assert keeps_limits_and_rests(move)


@pytest.mark.slow
def test_it_is_nearly_as_fast_as_with_twice_the_intervals(
    arms: dict[str, Manipulator], monkeypatch: pytest.MonkeyPatch
) -> None:
    usual = plan_path_move(arms["left"], None, circle("left"))
    monkeypatch.setattr(windows, "FEW", 2 * windows.FEW)
    fine = plan_path_move(arms["left"], None, circle("left"))
    assert usual.trajectory.duration < 1.02 * fine.trajectory.duration


@pytest.mark.slow
def test_turns_of_a_closed_path_take_time_that_grows_evenly(arms: dict[str, Manipulator]) -> None:
    once, thrice = (
        plan_path_move(arms["left"], None, [circle("left")] * n).trajectory.duration for n in (1, 3)
    )
    assert 2.5 * once < thrice < 3.0 * once


def test_corners_are_rounded_within_the_tolerance_or_stopped_at(
    arms: dict[str, Manipulator], side: str
) -> None:
    path, m = square(side), arms[side]
    rounded = plan_path_move(m, None, path, tolerance=LineTolerance(1e-3))
    stopping = plan_path_move(m, None, path, tolerance=LineTolerance(1e-3), stop_at_corners=True)
    assert rounded.trajectory.duration < 3.3 < stopping.trajectory.duration
    assert most_off(path.poses, tips(rounded, m.arm), LineTolerance(1e-3)) < 1.0
    reached = m.arm.T_base_tips(stopping.trajectory.q[(stopping.trajectory.v == 0.0).all(axis=1)])
    for corner in path.poses:
        assert np.linalg.norm(reached[:, :3, 3] - corner.translation, axis=1).min() < 1e-7
    assert keeps_limits_and_rests(rounded)
    assert keeps_limits_and_rests(stopping)


@pytest.mark.parametrize(("seed", "tolerance"), [(1, LAX), (3, STRICT)])
def test_position_and_rotation_are_kept_between_random_waypoints(
    arms: dict[str, Manipulator], side: str, seed: int, tolerance: LineTolerance
) -> None:
    path, m = slanted(seed, 7, side), arms[side]
    move = plan_path_move(m, None, path, tolerance=tolerance)
    assert most_off(path.poses, tips(move, m.arm, 0.01), tolerance) < 1.03  # of dense samples
    assert keeps_limits_and_rests(move)
    assert (
        move.deviations(m.arm, np.linspace(0.0, move.trajectory.duration, 999)).share.max() <= 1.0
    )


def test_a_set_speed_is_kept_but_for_the_ends(arms: dict[str, Manipulator], side: str) -> None:
    speed_m_s, arm = 0.05, arms[side].arm
    move = plan_path_move(arms[side], None, circle(side), speed_m_s=speed_m_s)
    times = np.linspace(0.0, move.trajectory.duration, 3000)
    positions = arm.T_base_tips(move.trajectory.sample(times).q)[:, :3, 3]
    speeds = np.linalg.norm(np.gradient(positions, times, axis=0), axis=1)
    assert speeds.max() < 1.02 * speed_m_s
    slower_s = move.path.slower_s
    assert sum(end - begin for begin, end in slower_s) < 0.05 * move.trajectory.duration
    is_inside = ~np.any([(times >= a - 0.01) & (times <= b + 0.01) for a, b in slower_s], axis=0)
    assert speeds[is_inside].min() > 0.98 * speed_m_s
    assert not plan_path_move(arms[side], None, circle(side)).path.slower_s.size


@pytest.mark.parametrize(
    "axis", ["z", *(pytest.param(axis, marks=pytest.mark.slow) for axis in "xy")]
)
def test_a_hand_may_turn_about_one_of_its_axes(arms: dict[str, Manipulator], axis: str) -> None:
    m, path = arms["left"], rectangle("left", 0.10, 0.15)
    fixed = plan_path_move(m, None, path)
    free = plan_path_move(m, None, path, tolerance=LineTolerance.about(axis))
    k = "xyz".index(axis)
    wanted, reached = path.poses[0].rotation[:, k], tips(free, m.arm)[:, :3]
    assert np.arccos((reached[:, :, k] @ wanted).clip(-1.0, 1.0)).max() < math.radians(0.02)
    beside = reached[:, :, (k + 1) % 3]
    assert np.arccos((beside @ beside[0]).clip(-1.0, 1.0)).max() > math.radians(3.0)
    assert free.trajectory.duration < 1.001 * fixed.trajectory.duration


@pytest.mark.slow
def test_a_position_alone_may_be_asked(arms: dict[str, Manipulator]) -> None:
    m = arms["left"]
    move = plan_path_move(m, None, circle("left"), tolerance=LineTolerance.position_only())
    spokes = tips(move, m.arm)[:, :3, 3] - [*middle("left"), 0.0]
    off_m = np.hypot(np.linalg.norm(spokes[:, :2], axis=1) - RADIUS_M, spokes[:, 2])
    assert off_m.max() < 1e-4
    assert move.trajectory.duration < 2.0


def test_it_begins_where_the_arm_is(arms: dict[str, Manipulator]) -> None:
    m = arms["left"]
    q = m.ik.solve(circle("left").T_base_start).q
    move = plan_path_move(m, q, circle("left"))
    np.testing.assert_allclose(move.trajectory.q_start, q, atol=1e-12)
    with pytest.raises(MotionError, match="start of the path"):
        plan_path_move(m, m.arm.start, circle("left"))


def ball(x: float, y: float, z: float) -> Body:
    place = pin.SE3(np.eye(3), np.array([x, y, z]))
    return Body("ball", (Part(Sphere(0.03), pin.SE3.Identity()),), place)


def test_it_is_proven_clear_of_what_is_beside_it(arms: dict[str, Manipulator]) -> None:
    m, path = arms["left"], square("left")
    context = m.context(Scene.of([ball(0.538, 0.33, 0.499)]))  # on the forearm's way
    alone = plan_path_move(m, None, path)
    assert not context.is_clear(alone.trajectory)
    beside = plan_path_move(m, None, path, context=context)
    assert context.is_clear(beside.trajectory)
    assert most_off(path.poses, tips(beside, m.arm), STRICT) < 1.0


def test_a_blocked_path_is_refused(arms: dict[str, Manipulator]) -> None:
    m = arms["left"]
    context = m.context(Scene.of([ball(0.76, 0.15, 0.0)]))
    with pytest.raises(PathMoveError, match="too near to something"):
        plan_path_move(m, None, circle("left"), context=context)


def test_a_waypoint_out_of_reach_is_told_with_its_place(arms: dict[str, Manipulator]) -> None:
    path = Polyline([at(0.70, 0.15), at(0.80, 0.15), at(1.90, 0.15)])
    with pytest.raises(PathMoveError) as refused:
        plan_path_move(arms["left"], None, path)
    reach_m = refused.value.length_m
    assert arms["left"].ik.solve(at(0.70 + reach_m - 0.2, 0.15)).is_valid
    assert not arms["left"].ik.solve(at(0.70 + reach_m, 0.15)).is_valid


BAD: list[tuple[dict[str, Any], type[BaxterError]]] = [
    ({"manipulator": 1}, MotionError),
    ({"q_start": [1.0]}, ConfigurationError),
    ({"path": 1}, MotionError),
    ({"tolerance": 1e-3}, MotionError),
    ({"speed_m_s": 0.0}, MotionError),
    ({"speed_m_s": math.nan}, MotionError),
    ({"context": 1}, MotionError),
]


@pytest.mark.parametrize(("changed", "error"), BAD)
def test_invalid_arguments_are_refused(
    arms: dict[str, Manipulator], changed: dict[str, Any], error: type[BaxterError]
) -> None:
    usual = {"manipulator": arms["left"], "q_start": None, "path": circle("left")}
    with pytest.raises(error):
        plan_path_move(**usual | changed)


@pytest.mark.parametrize("axis", ["a", "", "xyz"])
def test_there_is_no_tolerance_about_another_axis(axis: str) -> None:
    with pytest.raises(UnknownNameError):
        LineTolerance.about(axis)


def test_a_slow_speed_is_kept_too(arms: dict[str, Manipulator]) -> None:
    path = Polyline([at(0.66, 0.15), at(0.74, 0.15)])
    move = plan_path_move(arms["left"], None, path, speed_m_s=0.005)
    assert move.trajectory.duration == pytest.approx(16.0, rel=0.02)


def test_a_flipped_hand_is_not_at_the_start(arms: dict[str, Manipulator]) -> None:
    m, path = arms["left"], square("left")
    flipped = path.poses[0] * pin.SE3(pin.exp3(math.pi * Z), np.zeros(3))
    q = m.ik.solve(flipped).q
    with pytest.raises(MotionError, match=r"3\.14\d rad from"):
        plan_path_move(m, q, path)


@pytest.mark.parametrize(
    ("moved", "expected"),
    [
        (lambda T: T, 0.0),
        (lambda T: pin.SE3(T.rotation, T.translation + 5e-5 * Z), 0.5),
        (lambda T: T * pin.SE3(pin.exp3(np.radians([0.0, 0.0, 0.01])), np.zeros(3)), 0.5),
        (lambda T: pin.SE3(T.rotation, T.translation - 2e-4 * np.eye(3)[0]), 2.0),
        (lambda T: T * pin.SE3(pin.exp3(math.pi * Z), np.zeros(3)), 9000.0),
    ],
)
def test_a_deviation_is_the_greater_share(
    moved: Callable[[pin.SE3], pin.SE3], expected: float
) -> None:
    piece = Piece(at(0.7, 0.1), np.array([[0.1, 0, 0], [0, 0, 0], [0, 0, 0]]), np.zeros(3))
    T = moved(piece.at(0.0)).homogeneous[None]
    found = deviations([piece], STRICT, T, np.zeros(1, dtype=np.intp))
    assert found.share[0] == pytest.approx(expected, abs=1e-6)
