from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Arm, Baxter, IKService, SeedType
from baxter_kin.errors import RequestError, UnknownNameError
from baxter_kin.ik import Backend
from baxter_kin.ik.reach.bound import ReachBound
from baxter_kin.ik.tolerance import FREE, Tolerance
from tests.conftest import at

ROUNDING = 1e-9

small = st.floats(-0.5, 0.5)


def deviated(T: pin.SE3, displacement: list[float], rotation: list[float]) -> pin.SE3:
    """A pose displaced along and rotated about the axes of another."""
    return T * pin.SE3(pin.exp3(np.array(rotation)), np.array(displacement))


@pytest.mark.parametrize("bounds", [0.0, 0.2])
@given(where=st.lists(small, min_size=6, max_size=6), by=st.lists(small, min_size=6, max_size=6))
def test_excess_is_zero_inside_and_the_rest_outside(
    where: list[float], by: list[float], bounds: float
) -> None:
    T = pin.exp6(np.array(where))
    tolerance = Tolerance((bounds,) * 3, (bounds,) * 3)
    excess = tolerance.excess(T, deviated(T, by[:3], by[3:]))
    outside = [np.linalg.norm(np.maximum(np.abs(part) - bounds, 0.0)) for part in (by[:3], by[3:])]
    assert excess == pytest.approx(outside, abs=ROUNDING)


angles = st.floats(-np.pi, np.pi)
bounds = st.floats(0.0, np.pi / 2)


def leaning(axis: str, lean: float, towards: float, roll: float = 0.0) -> pin.SE3:
    """A frame rolled about an axis that then leans, by an angle, in a direction."""
    unit = np.eye(3)["xyz".index(axis)]
    across = pin.exp3(towards * unit) @ np.roll(unit, 1)
    return pin.SE3(pin.exp3(lean * across) @ pin.exp3(roll * unit), np.zeros(3))


def excess_rad(tolerance: Tolerance, reached: pin.SE3) -> float:
    return tolerance.excess(pin.SE3.Identity(), reached)[1]


axes = pytest.mark.parametrize("axis", ["x", "y", "z"])


@axes
@given(tilt=bounds, lean=st.floats(0.0, 3.0), towards=angles, roll=angles)
def test_outside_a_cone_the_excess_is_the_rest_of_the_lean(
    axis: str, tilt: float, lean: float, towards: float, roll: float
) -> None:
    reached = leaning(axis, lean, towards, roll)
    cosine = reached.rotation["xyz".index(axis), "xyz".index(axis)]
    excess = excess_rad(Tolerance.about(axis, tilt_rad=tilt), reached)
    assert excess == pytest.approx(max(np.arccos(min(cosine, 1.0)) - tilt, 0.0), abs=1e-7)


@axes
@given(tilt=bounds, lean=st.floats(0.0, 3.0), towards=angles, roll=angles)
def test_a_box_contains_the_cone_of_its_half_width(
    axis: str, tilt: float, lean: float, towards: float, roll: float
) -> None:
    cone, box = Tolerance.about(axis, tilt_rad=tilt), Tolerance.tilt_box(axis, tilt_rad=tilt)
    reached = leaning(axis, lean, towards, roll)
    assert excess_rad(box, reached) <= excess_rad(cone, reached) + ROUNDING


@given(widths=st.tuples(bounds, bounds, bounds), roll=angles)
def test_rotations_within_a_tolerance_keep_its_bound(
    widths: tuple[float, float, float], roll: float
) -> None:
    """At the corners, where rotation or lean is largest."""
    assert Tolerance(rotation_rad=widths).max_rotation_rad == pytest.approx(np.linalg.norm(widths))
    box = Tolerance.tilt_box("z", tilt_rad=widths[:2])
    corner = pin.exp3(np.array([widths[0], widths[1], 0.0])) @ pin.exp3(np.array([0.0, 0.0, roll]))
    reached = pin.SE3(corner, np.zeros(3))
    assert excess_rad(box, reached) == pytest.approx(0.0, abs=ROUNDING)
    lean = excess_rad(Tolerance.about("z"), reached)
    assert lean == pytest.approx(box.max_rotation_rad, abs=1e-7)
    assert Tolerance.about("x", tilt_rad=widths[0]).max_rotation_rad == widths[0]
    assert Tolerance.position_only().max_rotation_rad == np.pi


@axes
def test_a_cone_of_no_width_is_any_rotation_about_the_axis(axis: str) -> None:
    rotation: Any = [FREE if name == axis else 0.0 for name in "xyz"]
    assert Tolerance.about(axis, tilt_rad=0.0) == Tolerance.about(axis)
    assert Tolerance.about(axis) == Tolerance.tilt_box(axis, tilt_rad=0.0)
    assert Tolerance.about(axis) == Tolerance(rotation_rad=rotation)
    box = Tolerance.tilt_box("y", tilt_rad=(0.1, 0.2))
    assert box == Tolerance(rotation_rad=(0.1, FREE, 0.2)) != Tolerance.about("y", tilt_rad=0.1)


@given(st.lists(small, min_size=3, max_size=3), st.lists(small, min_size=3, max_size=3))
def test_position_only_ignores_the_orientation(by: list[float], rotation: list[float]) -> None:
    T = pin.exp6(np.arange(6) / 7.0)
    distance, angle = Tolerance.position_only(0.1).excess(T, deviated(T, by, rotation))
    outside = np.linalg.norm(np.maximum(np.abs(by) - 0.1, 0.0))
    assert distance == pytest.approx(outside, abs=ROUNDING)
    assert angle == 0.0


ABOUT_Z = (0.0, 0.0, FREE)


@pytest.mark.parametrize(
    ("make", "arguments", "error"),
    [
        *(
            (Tolerance, {"position_m": given}, RequestError)
            for given in ((0.0, -0.1, 0.0), (0.0, math.nan, 0.0), (0.0, 0.0), 0.1, "abc")
        ),
        (Tolerance, {"rotation_rad": (FREE, FREE, 0.0)}, RequestError),
        (Tolerance, {"rotation_rad": (1.6, 0.0, 0.0)}, RequestError),
        *(
            (Tolerance, {"rotation_rad": ABOUT_Z, "tilt_rad": given}, RequestError)
            for given in (-0.1, 1.6, FREE, "5 deg")
        ),
        (Tolerance, {"tilt_rad": 0.1}, RequestError),
        (Tolerance, {"rotation_rad": (FREE, FREE, FREE), "tilt_rad": 0.1}, RequestError),
        (Tolerance, {"rotation_rad": (0.1, 0.1, FREE), "tilt_rad": 0.1}, RequestError),
        *(
            (Tolerance.position_only, {"position_m": given}, RequestError)
            for given in ([1, 2], [[1.0]], "0.1", None)
        ),
        (Tolerance.about, {"axis": "z", "tilt_rad": math.nan}, RequestError),
        *((Tolerance.about, {"axis": axis}, UnknownNameError) for axis in ("w", "xyz", 5)),
        (Tolerance.tilt_box, {"axis": "w", "tilt_rad": 0.1}, UnknownNameError),
        (Tolerance.tilt_box, {"axis": "z", "tilt_rad": (0.1, 0.2, 0.3)}, RequestError),
        (Tolerance().excess, {"T_base_target": 5, "T_base_tip": at(1.0, 0.0, 0.0)}, RequestError),
        (Tolerance().excess, {"T_base_target": at(1.0, 0.0, 0.0), "T_base_tip": 5}, RequestError),
    ],
)
def test_invalid_arguments_are_refused(
    make: Callable[..., object], arguments: dict[str, Any], error: type[Exception]
) -> None:
    with pytest.raises(error):
        make(**arguments)


def test_tolerances_compare_by_value() -> None:
    made_of_lists: Any = [0.0, 0.0, 0.1], np.zeros(3)
    assert Tolerance(*made_of_lists) == Tolerance((0.0, 0.0, 0.1))
    assert hash(Tolerance(*made_of_lists)) == hash(Tolerance((0.0, 0.0, 0.1)))


WITHIN = 1e-6
"""Allowed excess of a result over its tolerance, in m and rad."""

TOOL = pin.SE3(pin.exp3(np.array([0.3, -0.5, 0.2])), np.array([0.03, -0.02, 0.15]))

TOLERANCES = {
    "exact": Tolerance(),
    "position": Tolerance.position_only(),
    "position within 1 cm": Tolerance.position_only(0.01),
    "about x": Tolerance.about("x"),
    "about z": Tolerance.about("z"),
    "about y, leaning": Tolerance.about("y", tilt_rad=0.2),
    "about z, leaning": Tolerance.about("z", tilt_rad=0.02),
    "about y, in a box": Tolerance.tilt_box("y", tilt_rad=(0.2, 0.1)),
    "1 cm and 0.1 rad": Tolerance((0.01,) * 3, (0.1,) * 3),
    "in a plane": Tolerance((FREE, FREE, 0.0)),
    "a finger's width": Tolerance((0.0, 0.0, 1e-4), (0.0, 1e-3, 0.0)),
}


@pytest.fixture(
    scope="module",
    params=[("left", "left_gripper"), ("right", "right_hand_camera"), ("left", TOOL)],
    ids=["gripper", "camera", "tool"],
)
def tipped(robot: Baxter, request: pytest.FixtureRequest) -> Arm:
    """An arm with one tip or another."""
    side, tip = request.param
    return robot.arm(side).with_tip(tip)


@pytest.fixture(scope="module")
def service(tipped: Arm) -> IKService:
    return IKService(tipped)


def reachable(arm: Arm, count: int, seed: int) -> list[pin.SE3]:
    """Every third pose is of a configuration with joints at their limits."""
    rng, limits = np.random.default_rng(seed), arm.limits
    qs = [arm.random_configuration(rng) for _ in range(count)]
    for q in qs[::3]:
        joints = rng.choice(7, 2, replace=False)
        q[joints] = np.where(rng.random(2) < 0.5, limits.q_min[joints], limits.q_max[joints])
    return [arm.T_base_tip(q) for q in qs]


@pytest.mark.parametrize("name", TOLERANCES)
def test_every_reachable_pose_is_solved_within_its_tolerance(
    tipped: Arm, service: IKService, name: str
) -> None:
    tolerance, poses = TOLERANCES[name], reachable(tipped, 60, 1)
    for T, result in zip(poses, service.solve_batch(poses, tolerance=tolerance), strict=True):
        assert result.is_valid, str(result.failure)
        excess = tolerance.excess(T, tipped.T_base_tip(result.q))
        assert max(excess) <= WITHIN
        if min(tolerance.position_m) > 0.0 and min(tolerance.rotation_rad) > 0.0:
            assert max(excess) == 0.0  # bounds above zero are kept exactly
        assert excess == pytest.approx(
            (result.position_error_m, result.orientation_error_rad), abs=1e-9
        )
        assert not tipped.limits.violations(result.q)


def test_poses_out_of_reach_become_solvable_with_free_coordinates(left: Arm, ik: IKService) -> None:
    T = at(0.6, 0.3, 0.2)
    backwards = pin.SE3(pin.exp3(np.array([0.0, -np.pi / 2, 0.0])), T.translation)
    assert not ik.solve(backwards).is_valid
    result = ik.solve(backwards, tolerance=Tolerance.position_only())
    assert result.is_valid
    reached = left.T_base_tip(result.q).translation
    assert np.linalg.norm(reached - T.translation) <= WITHIN


def test_a_seed_near_the_solution_is_where_it_came_from(left: Arm, ik: IKService) -> None:
    T, tolerance = left.T_base_tip(left.start), Tolerance.about("z")
    seed = np.array(left.start) + 0.05
    for result in (
        ik.solve(T, seed, tolerance=tolerance),
        ik.solve_batch([T], [seed], tolerance=tolerance)[0],
    ):
        assert result.seed_type is SeedType.USER
        assert np.abs(result.q - left.start).max() < 0.3
    chained = ik.solve_batch([T, T], current=seed, chain=True, tolerance=tolerance)
    assert [r.seed_type for r in chained] == [SeedType.CURRENT, SeedType.CURRENT]
    streamed = list(ik.solve_stream(iter([T]), tolerance=tolerance))
    assert streamed[0].is_valid


def lean_rad(T: pin.SE3, reached: pin.SE3, axis: int) -> float:
    """The angle between an axis of one frame and that of another."""
    a, b = T.rotation[:, axis], reached.rotation[:, axis]
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


@pytest.mark.parametrize("name", ["x", "y", "z"])
@pytest.mark.parametrize("tilt_rad", [1e-9, np.radians(5.0), np.pi / 2])
def test_the_axis_leans_by_no_more_than_the_cone(
    left: Arm, ik: IKService, name: str, tilt_rad: float
) -> None:
    axis, tolerance = "xyz".index(name), Tolerance.about(name, tilt_rad=tilt_rad)
    poses = reachable(left, 50, 7)
    for T, result in zip(poses, ik.solve_batch(poses, tolerance=tolerance), strict=True):
        assert result.is_valid, str(result.failure)
        reached = left.T_base_tip(result.q)
        assert lean_rad(T, reached, axis) <= tilt_rad + WITHIN
        assert np.linalg.norm(reached.translation - T.translation) <= WITHIN


def aslant(arm: Arm, tilt_rad: float) -> list[pin.SE3]:
    """Poses from which the arm reaches one within the cone about z, near its edge."""
    rng, found = np.random.default_rng(8), []
    for reached in reachable(arm, 300, 9):
        towards, lean = rng.uniform(-np.pi, np.pi), tilt_rad * rng.uniform(0.7, 1.0)
        back = pin.exp3(-lean * np.array([np.cos(towards), np.sin(towards), 0.0]))
        roll = pin.exp3(np.array([0.0, 0.0, rng.uniform(-np.pi, np.pi)]))
        found.append(reached * pin.SE3(roll @ back, np.zeros(3)))
    return found


def needing_a_lean(arm: Arm, service: IKService, tilt_rad: float) -> list[pin.SE3]:
    """The poses among them that are not solved upright."""
    poses = aslant(arm, tilt_rad)
    upright = service.solve_batch(poses, tolerance=Tolerance.about("z"))
    return [T for T, result in zip(poses, upright, strict=True) if not result.is_valid]


@pytest.mark.parametrize("tilt_rad", [0.02, 0.4])
def test_poses_within_reach_only_when_leaning_are_solved_by_leaning(
    left: Arm, ik: IKService, tilt_rad: float
) -> None:
    tolerance, poses = Tolerance.about("z", tilt_rad=tilt_rad), needing_a_lean(left, ik, tilt_rad)
    assert len(poses) > 5
    for T, result in zip(poses, ik.solve_batch(poses, tolerance=tolerance), strict=True):
        assert result.is_valid, str(result.failure)
        assert WITHIN < lean_rad(T, left.T_base_tip(result.q), 2) <= tilt_rad + WITHIN


def test_ipopt_leans_where_the_fast_search_does(left: Arm, ik: IKService) -> None:
    reference, tolerance = IKService(left, Backend.IPOPT), Tolerance.about("z", tilt_rad=0.4)
    for T in needing_a_lean(left, ik, 0.4)[:3]:
        result = reference.solve(T, tolerance=tolerance)
        assert result.is_valid, str(result.failure)
        assert WITHIN < lean_rad(T, left.T_base_tip(result.q), 2) <= 0.4 + WITHIN


@pytest.mark.parametrize("name", ["position", "about z", "about y, leaning", "1 cm and 0.1 rad"])
def test_ipopt_solves_the_same_tasks(left: Arm, name: str) -> None:
    reference, tolerance = IKService(left, Backend.IPOPT), TOLERANCES[name]
    for T in reachable(left, 3, 3):
        result = reference.solve(T, tolerance=tolerance)
        assert result.is_valid, str(result.failure)
        assert max(tolerance.excess(T, left.T_base_tip(result.q))) <= WITHIN


@pytest.mark.parametrize("name", TOLERANCES)
def test_no_proof_is_false(tipped: Arm, name: str) -> None:
    """Requests that a reachable pose fulfils, often barely."""
    tolerance, rng = TOLERANCES[name], np.random.default_rng(5)
    reach = ReachBound(tipped, tolerance)
    asked = []
    for reached in reachable(tipped, 50, 6):
        T = reached * _within(tolerance, rng).inverse()
        assert max(tolerance.excess(T, reached)) <= 1e-9
        assert reach.proof(T) is None
        asked.append(T.homogeneous)
    assert not reach.are_outside_shells(np.array(asked)).any()


def _within(tolerance: Tolerance, rng: np.random.Generator) -> pin.SE3:
    """A deviation that the tolerance allows, at its bounds."""
    signs = rng.choice([-1.0, 1.0], 6)
    p = np.where(np.isinf(tolerance.position_m), 2.0, tolerance.position_m) * signs[:3]
    if tolerance.is_position_only:
        return pin.SE3(pin.exp3(rng.normal(size=3)), p)
    r = np.array(tolerance.rotation_rad) * signs[3:]
    roll = np.zeros(3)
    if tolerance.free_axis is not None:
        roll[tolerance.free_axis] = rng.uniform(-3.0, 3.0)
        if tolerance.tilt_rad > 0.0:
            r = rng.normal(size=3)
            r[tolerance.free_axis] = 0.0
            r *= tolerance.tilt_rad / np.linalg.norm(r)
        r[tolerance.free_axis] = 0.0
    return pin.SE3(pin.exp3(r) @ pin.exp3(roll), p)


@pytest.mark.parametrize("axis", ["x", "z"])
def test_no_lean_is_proven_away_at_the_edge_of_the_reach(tipped: Arm, axis: str) -> None:
    """Poses that the arm, straight or fully bent, reaches by leaning in any direction."""
    tolerance, rng, unit = Tolerance.about(axis, tilt_rad=0.4), np.random.default_rng(10), np.eye(3)
    reach = ReachBound(tipped, tolerance)
    along, across = unit["xyz".index(axis)], unit["xyz".index(axis) - 1]
    asked = []
    for e1 in np.repeat([0.0, tipped.limits.q_max[3]], 15):
        q = tipped.random_configuration(rng)
        q[3] = e1
        for towards in np.arange(8) * np.pi / 4:
            lean = pin.exp3(0.4 * (pin.exp3(towards * along) @ across))
            turned = pin.SE3(lean @ pin.exp3(rng.uniform(-3.0, 3.0) * along), np.zeros(3))
            asked.append(tipped.T_base_tip(q) * turned.inverse())
    assert not any(reach.proof(T) for T in asked)


def test_leaning_poses_are_proven_out_of_reach_by_the_wrist(left: Arm, ik: IKService) -> None:
    T, bound = at(1.0, 0.3, -0.1), ReachBound(left)
    assert bound.proof_of_position(T.translation) is None
    five, ten = (
        ik.solve(T, tolerance=Tolerance.about("z", tilt_rad=np.radians(tilt))).failure
        for tilt in (5.0, 10.0)
    )
    assert five is not None
    assert ten is not None
    assert five.beyond_reach_m > ten.beyond_reach_m > 0.0
    assert "span from left_s1, with the wrist at" in str(five)
    assert "no more than 34 mm can be made up" in str(five)


@pytest.mark.parametrize("name", ["exact", "position", "about z", "1 cm and 0.1 rad"])
def test_poses_far_out_of_reach_are_proven_so(tipped: Arm, service: IKService, name: str) -> None:
    result = service.solve(at(2.5, 0.0, 0.5), tolerance=TOLERANCES[name])
    assert result.failure is not None
    assert result.failure.beyond_reach_m > 0.5
    assert "proven out of reach" in str(result.failure)
    what = "position (2.5" if name == "position" else "pose at (2.5"
    assert what in str(result.failure)
