from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Arm, IKService
from baxter_kin.errors import ConfigurationError, PoseError, RequestError
from baxter_kin.frames import angle_between
from baxter_kin.ik import sample_solutions
from baxter_kin.ik.self_motion.objectives import NearestTo, best_on
from baxter_kin.ik.self_motion.tracing import SelfMotion, trace_self_motion
from baxter_kin.ik.solution_set import MAX_CANDIDATES, MAX_TURNS, distinct_solutions, solutions
from baxter_kin.validation import FloatArray
from tests.conftest import at, overhead

ON_CURVE_RAD = 1e-6
BLOCK = overhead(0.70, 0.15, -0.129)


def independent_solutions(arm: Arm, T: pin.SE3, starts: int, seed: int) -> list[FloatArray]:
    """Solutions by damped least squares from random seeds, clipped to the limits: no piece of what
    is tested here.
    """
    rng = np.random.default_rng(seed)
    attempts = (_descended(arm, T, arm.random_configuration(rng)) for _ in range(starts))
    return [q for q in attempts if q is not None]


def _descended(arm: Arm, T: pin.SE3, q: FloatArray) -> FloatArray | None:
    for _ in range(40):
        reached = arm.T_base_tip(q)
        turn = pin.log3(T.rotation @ reached.rotation.T)
        error = np.concatenate([T.translation - reached.translation, turn])
        if np.linalg.norm(error) < 1e-11:
            return q
        J = arm.jacobian(q)
        damped = J @ J.T + 1e-3 * (error @ error) * np.eye(6)
        step = J.T @ np.linalg.solve(damped, error)
        q = np.clip(q + step, arm.limits.q_min, arm.limits.q_max)
    return None


def holder(curves: tuple[SelfMotion, ...], q: FloatArray) -> int | None:
    """The index of the curve on which `q` lies."""
    on = [i for i, curve in enumerate(curves) if curve.nearest(q)[1] < ON_CURVE_RAD]
    assert len(on) <= 1
    return on[0] if on else None


@pytest.fixture(scope="module")
def found(robot: Any) -> tuple[SelfMotion, ...]:
    """The ways to reach the demo's first block pose, from solutions of a plain solver."""
    arm = robot.arm("left")
    return distinct_solutions(arm, independent_solutions(arm, BLOCK, 150, seed=1))


def test_every_other_solution_lies_on_one_of_the_curves(arm: Arm) -> None:
    rng = np.random.default_rng(5)
    for _ in range(3):
        T = arm.T_base_tip(arm.random_configuration(rng))
        curves = distinct_solutions(arm, independent_solutions(arm, T, 100, seed=2))
        others = independent_solutions(arm, T, 100, seed=3)
        assert others
        assert None not in [holder(curves, q) for q in others]


def test_every_candidate_is_on_one_curve(left: Arm, found: tuple[SelfMotion, ...]) -> None:
    candidates = independent_solutions(left, BLOCK, 150, seed=1)
    assert None not in [holder(found, q) for q in candidates]


def test_every_curve_reaches_the_pose(left: Arm, found: tuple[SelfMotion, ...]) -> None:
    for curve in found:
        difference = left.T_base_tip(curve.at(0.5 * curve.length_rad)).actInv(BLOCK)
        assert np.linalg.norm(pin.log6(difference).vector) < 1e-9


def test_curves_are_distinct(found: tuple[SelfMotion, ...]) -> None:
    assert len(found) > 1
    for i, curve in enumerate(found):
        for other in found[:i]:
            assert min(other.nearest(q)[1] for q in curve.q[::10]) > 1e-2


def test_best_over_all_curves_beats_every_solution(
    left: Arm, found: tuple[SelfMotion, ...]
) -> None:
    objective = NearestTo(left.neutral)
    best = np.array([best_on(curve, objective) for curve in found])
    others = np.array(independent_solutions(left, BLOCK, 100, seed=4))
    least = objective.costs(left, others).min()
    assert objective.costs(left, best).min() <= least + 1e-12


def test_order_is_by_length(found: tuple[SelfMotion, ...]) -> None:
    lengths = [curve.length_rad for curve in found]
    assert lengths == sorted(lengths, reverse=True)


def test_order_does_not_depend_on_the_candidates(left: Arm, found: tuple[SelfMotion, ...]) -> None:
    again = distinct_solutions(left, reversed(independent_solutions(left, BLOCK, 150, seed=1)))
    assert [c.length_rad for c in again] == pytest.approx([c.length_rad for c in found], abs=1e-6)
    assert [c.ends for c in again] == [c.ends for c in found]


def test_same_candidate_twice_is_one_solution(left: Arm) -> None:
    assert len(distinct_solutions(left, [left.start, left.start])) == 1


def test_point_of_a_curve_is_no_other_solution(left: Arm) -> None:
    curve = trace_self_motion(left, left.start)
    points = [curve.at(s) for s in np.linspace(0.0, curve.length_rad, 20)]
    assert len(distinct_solutions(left, points)) == 1


def test_candidates_may_miss_the_pose_as_a_service_does(left: Arm) -> None:
    """By 1e-6 m and rad, also with a joint on its limit."""
    curve = trace_self_motion(left, left.start)
    rng = np.random.default_rng(6)
    points = [curve.at(s) for s in np.linspace(0.0, curve.length_rad, 20)]
    candidates = [q + 2e-7 * rng.uniform(-1.0, 1.0, 7) for q in points]
    inside = [np.clip(q, left.limits.q_min, left.limits.q_max) for q in candidates]
    assert len(distinct_solutions(left, inside, T_base_tip=curve.T_base_tip)) == 1


def test_no_candidates_give_no_solutions(left: Arm) -> None:
    assert distinct_solutions(left, []) == ()


def test_solutions_come_from_a_service(ik: IKService) -> None:
    curves = solutions(ik, BLOCK, starts=6)
    assert curves
    assert all(curve.pose_residual < 1e-9 for curve in curves)


def test_solutions_of_a_tool_reach_its_pose(left: Arm) -> None:
    tipped = left.with_tip(pin.SE3(pin.utils.rotate("x", 0.4), np.array([0.05, 0.0, 0.2])))
    T = tipped.T_base_tip(left.start)
    curves = solutions(IKService(tipped), T)
    assert min(curve.nearest(left.start)[1] for curve in curves) < 1e-6
    for curve in curves:
        difference = tipped.T_base_tip(curve.at(0.5 * curve.length_rad)).actInv(T)
        assert np.linalg.norm(pin.log6(difference).vector) < 1e-11


def test_same_pose_has_the_same_solutions(ik: IKService) -> None:
    once, again = (solutions(ik, BLOCK, starts=3) for _ in range(2))
    for one, other in zip(once, again, strict=True):
        np.testing.assert_array_equal(one.q, other.q)


def test_pose_out_of_reach_has_no_solutions(ik: IKService) -> None:
    assert solutions(ik, at(3.0, 0.0, 0.0), starts=2) == ()


def test_candidate_of_another_pose_is_refused_by_index(left: Arm) -> None:
    with pytest.raises(ConfigurationError, match=r"candidates\[1\] misses the pose by"):
        distinct_solutions(left, [left.start, left.neutral])


def test_candidate_outside_the_limits_is_refused_by_index_and_name(left: Arm) -> None:
    with pytest.raises(ConfigurationError, match=r"candidates\[1\] .* left_s0 = 5 rad"):
        distinct_solutions(left, [left.start, [5.0, *left.start[1:]]])


@pytest.mark.parametrize("candidate", [np.zeros(6), [np.nan] * 7, "q"])
def test_malformed_candidate_is_refused_by_index(left: Arm, candidate: Any) -> None:
    with pytest.raises(ConfigurationError, match=r"candidates\[0\]"):
        distinct_solutions(left, [candidate])


def test_candidates_that_are_not_iterable_are_refused(left: Arm) -> None:
    with pytest.raises(RequestError, match="candidates must be an iterable, got NoneType"):
        distinct_solutions(left, None)  # type: ignore[arg-type]


@pytest.mark.parametrize("starts", [0, -1, 1.5, True, None])
def test_malformed_number_of_starts_is_refused(ik: IKService, starts: Any) -> None:
    with pytest.raises(RequestError, match="starts must be a whole number"):
        solutions(ik, BLOCK, starts=starts)


def test_malformed_pose_is_refused(ik: IKService) -> None:
    with pytest.raises(PoseError):
        solutions(ik, np.eye(3))


@pytest.mark.parametrize("starts", [MAX_CANDIDATES + 1, 10**12, 10**400])
def test_starts_have_a_greatest_value(ik: IKService, starts: int) -> None:
    with pytest.raises(RequestError, match=f"from 1 to {MAX_CANDIDATES}, got"):
        solutions(ik, BLOCK, starts=starts)


@pytest.mark.parametrize("rng", [5, "seed", np.random], ids=str)
def test_seeds_are_drawn_by_a_generator(ik: IKService, rng: Any) -> None:
    with pytest.raises(RequestError, match="rng must be of class Generator"):
        solutions(ik, BLOCK, rng=rng)


def test_other_classes_than_service_and_arm_are_refused(left: Arm) -> None:
    with pytest.raises(RequestError, match="ik must be of class IKService, got int"):
        solutions(5, BLOCK)  # type: ignore[arg-type]
    with pytest.raises(RequestError, match="arm must be of class Arm, got int"):
        distinct_solutions(5, [left.neutral])  # type: ignore[arg-type]


def test_endless_candidates_are_refused(left: Arm) -> None:
    with pytest.raises(RequestError, match=f"at most {MAX_CANDIDATES} candidates are allowed"):
        distinct_solutions(left, itertools.repeat(left.neutral))


TOLERANCE = 1e-6


def test_samples_are_solutions_all_over_the_solution_set(arm: Arm) -> None:
    service, rng = IKService(arm), np.random.default_rng(9)
    for _ in range(10):
        q_goal = arm.random_configuration(rng)
        T = arm.T_base_tip(q_goal)
        samples = sample_solutions(service, T)
        for q in samples:
            reached = arm.T_base_tip(q)
            assert np.linalg.norm(reached.translation - T.translation) <= TOLERANCE
            assert angle_between(reached.rotation, T.rotation) <= TOLERANCE
            assert not arm.limits.violations(q)
        assert np.abs(samples - q_goal).max(axis=1).min() < 0.5
        assert len(np.unique(samples.round(4), axis=0)) == len(samples)


def test_a_pose_out_of_reach_has_no_samples(ik: IKService) -> None:
    assert sample_solutions(ik, at(2.0, 0.0, 0.0)).shape == (0, 7)
    with pytest.raises(RequestError, match="turns must be a whole number from 1 to 10000"):
        sample_solutions(ik, at(0.6, 0.3, 0.2), turns=0)


def test_another_tip_has_the_samples_of_its_own(left: Arm) -> None:
    tipped = left.with_tip(pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.1])))
    T = tipped.T_base_tip(tipped.start)
    for q in sample_solutions(IKService(tipped), T):
        assert np.linalg.norm(tipped.T_base_tip(q).translation - T.translation) <= TOLERANCE


@pytest.mark.parametrize("turns", [0.5, 48.0, "48", None, True, -1, MAX_TURNS + 1, 10**12], ids=str)
def test_turns_are_a_whole_number_with_a_greatest_value(ik: IKService, turns: Any) -> None:
    with pytest.raises(RequestError, match=f"turns must be a whole number from 1 to {MAX_TURNS}"):
        sample_solutions(ik, at(0.7, 0.2, 0.1), turns=turns)


@pytest.mark.parametrize("service", [None, 5, "ik"], ids=str)
def test_samples_of_another_class_than_service_are_refused(service: Any) -> None:
    with pytest.raises(RequestError, match="ik must be of class IKService"):
        sample_solutions(service, at(0.7, 0.2, 0.1))
