from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Arm, IKService
from baxter_kin.errors import BaxterError, ConfigurationError, PoseError, RequestError
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
    return distinct_solutions(arm, independent_solutions(arm, BLOCK, 60, seed=1))


def test_every_other_solution_lies_on_one_of_the_curves(arm: Arm) -> None:
    rng = np.random.default_rng(5)
    for _ in range(2):
        T = arm.T_base_tip(arm.random_configuration(rng))
        curves = distinct_solutions(arm, independent_solutions(arm, T, 50, seed=2))
        others = independent_solutions(arm, T, 40, seed=3)
        assert others
        assert None not in [holder(curves, q) for q in others]


def test_every_curve_reaches_the_pose_and_is_none_of_the_others(
    left: Arm, found: tuple[SelfMotion, ...]
) -> None:
    assert len(found) > 1
    for i, curve in enumerate(found):
        for other in found[:i]:
            assert curve.length_rad <= other.length_rad
            assert min(other.nearest(q)[1] for q in curve.q[::10]) > 1e-2
        difference = left.T_base_tip(curve.at(0.5 * curve.length_rad)).actInv(BLOCK)
        assert np.linalg.norm(pin.log6(difference).vector) < 1e-9


def test_best_over_all_curves_beats_every_solution(
    left: Arm, found: tuple[SelfMotion, ...]
) -> None:
    objective = NearestTo(left.neutral)
    best = np.array([best_on(curve, objective) for curve in found])
    others = np.array(independent_solutions(left, BLOCK, 40, seed=4))
    least = objective.costs(left, others).min()
    assert objective.costs(left, best).min() <= least + 1e-12


def test_order_does_not_depend_on_the_candidates(left: Arm, found: tuple[SelfMotion, ...]) -> None:
    again = distinct_solutions(left, reversed(independent_solutions(left, BLOCK, 60, seed=1)))
    assert [c.length_rad for c in again] == pytest.approx([c.length_rad for c in found], abs=1e-6)
    assert [c.ends for c in again] == [c.ends for c in found]


def test_same_candidate_twice_is_one_solution_and_none_is_none(left: Arm) -> None:
    assert len(distinct_solutions(left, [left.start, left.start])) == 1
    assert distinct_solutions(left, []) == ()


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


TOLERANCE = 1e-6


def test_samples_are_solutions_all_over_the_solution_set(arm: Arm) -> None:
    service, rng = IKService(arm), np.random.default_rng(9)
    for _ in range(5):
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


def test_another_tip_has_the_samples_of_its_own(left: Arm) -> None:
    tipped = left.with_tip(pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.1])))
    T = tipped.T_base_tip(tipped.start)
    for q in sample_solutions(IKService(tipped), T):
        assert np.linalg.norm(tipped.T_base_tip(q).translation - T.translation) <= TOLERANCE


def calls(ik: IKService) -> dict[str, tuple[Any, dict[str, Any]]]:
    """The public functions and arguments that they take."""
    return {
        "distinct_solutions": (
            distinct_solutions,
            {"arm": ik.arm, "candidates": [ik.arm.start], "step_rad": 0.1},
        ),
        "solutions": (solutions, {"ik": ik, "T_base_tip": BLOCK, "starts": 1}),
        "sample_solutions": (sample_solutions, {"ik": ik, "T_base_tip": BLOCK}),
    }


OUTSIDE = np.array([5.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("function", "changes", "error"),
    [
        ("distinct_solutions", {"candidates": [np.zeros(7), np.ones(7)]}, ConfigurationError),
        *(
            ("distinct_solutions", {"candidates": [q]}, ConfigurationError)
            for q in (OUTSIDE, np.zeros(6), [np.nan] * 7, "q")
        ),
        ("distinct_solutions", {"candidates": None}, RequestError),
        ("distinct_solutions", {"candidates": itertools.repeat(np.zeros(7))}, RequestError),
        ("distinct_solutions", {"candidates": [np.zeros(7)] * (MAX_CANDIDATES + 1)}, RequestError),
        ("distinct_solutions", {"arm": 5}, RequestError),
        ("distinct_solutions", {"step_rad": 0.0}, RequestError),
        ("solutions", {"ik": 5}, RequestError),
        ("solutions", {"T_base_tip": np.eye(3)}, PoseError),
        *(
            ("solutions", {"starts": starts}, RequestError)
            for starts in (0, 1.5, True, None, MAX_CANDIDATES + 1, 10**400)
        ),
        *(("solutions", {"rng": rng}, RequestError) for rng in (5, np.random)),
        ("solutions", {"step_rad": -1.0}, RequestError),
        ("sample_solutions", {"ik": None}, RequestError),
        ("sample_solutions", {"T_base_tip": np.eye(3)}, PoseError),
        *(
            ("sample_solutions", {"turns": turns}, RequestError)
            for turns in (0, 48.0, None, True, MAX_TURNS + 1)
        ),
    ],
)
def test_invalid_arguments_are_refused(
    ik: IKService, function: str, changes: dict[str, Any], error: type[BaxterError]
) -> None:
    call, arguments = calls(ik)[function]
    with pytest.raises(error):
        call(**(arguments | changes))


@pytest.mark.parametrize("function", ["distinct_solutions", "solutions", "sample_solutions"])
def test_those_arguments_alone_are_taken(ik: IKService, function: str) -> None:
    call, arguments = calls(ik)[function]
    assert len(call(**arguments)) > 0
