from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin import Arm, Baxter
from baxter_kin.errors import ConfigurationError, RequestError
from baxter_kin.ik.self_motion.objectives import (
    FarthestFromLimits,
    MostManipulable,
    NearestTo,
    Objective,
    best_of,
    best_on,
)
from baxter_kin.ik.self_motion.tracing import SelfMotion, trace_self_motion
from baxter_kin.ik.solution_set import distinct_solutions
from baxter_kin.validation import FloatArray
from tests.baxter_kin.ik.self_motion.test_pieces import WITH_TINY_PIECE
from tests.baxter_kin.ik.self_motion.test_tracing import ALONE, CLOSED, singular_near

LOCATED = 1e-9
"""How far above the lowest cost a result may be: costs of size 1, flat at their minimum."""


def objectives(arm: Arm, seed: int) -> list[Objective]:
    """One objective of each kind."""
    rng = np.random.default_rng(seed)
    return [
        NearestTo(arm.random_configuration(rng)),
        FarthestFromLimits(),
        MostManipulable(),
    ]


def cost(objective: Objective, arm: Arm, q: FloatArray) -> float:
    return float(objective.costs(arm, q[None])[0])


@pytest.fixture(scope="module")
def curve(robot: Baxter) -> SelfMotion:
    arm = robot.arm("left")
    return trace_self_motion(arm, arm.start)


@settings(max_examples=12)
@given(seed=st.integers(0, 10_000))
def test_best_is_not_beaten_anywhere_on_the_curve(seed: int, robot: Baxter) -> None:
    arm = robot.arm("left" if seed % 2 else "right")
    q = arm.random_configuration(np.random.default_rng(seed))
    curve = trace_self_motion(arm, q, step_rad=0.05)
    lengths = np.linspace(0.0, curve.length_rad, 100)
    samples = np.array([q, *(curve.at(s) for s in lengths)])
    for objective in objectives(arm, seed):
        best = cost(objective, arm, best_on(curve, objective))
        assert best <= objective.costs(arm, samples).min() + LOCATED


def test_best_is_on_the_curve_and_inside_the_limits(curve: SelfMotion) -> None:
    for objective in objectives(curve.arm, 1):
        best = best_on(curve, objective)
        assert curve.nearest(best)[1] < LOCATED
        assert not curve.arm.limits.violations(best)


def test_nearest_to_a_point_of_the_curve_is_that_point(curve: SelfMotion) -> None:
    q = curve.at(0.123)
    np.testing.assert_allclose(best_on(curve, NearestTo(q)), q, atol=1e-7)


def test_way_to_the_nearest_is_normal_to_the_curve(curve: SelfMotion) -> None:
    seed = curve.at(1.0) + 0.1 * np.linalg.svd(curve.tangent[:1])[2][3]
    best = best_on(curve, NearestTo(seed))
    self_motion = np.linalg.svd(curve.arm.jacobian(best))[2][6]
    assert abs(self_motion @ (best - seed)) < 1e-6


def test_cost_of_limits_is_zero_on_one_and_minus_one_in_the_middle(left: Arm) -> None:
    middle = 0.5 * (left.limits.q_min + left.limits.q_max)
    at_limit = np.array(middle)
    at_limit[4] = left.limits.q_max[4]
    costs = FarthestFromLimits().costs(left, np.array([middle, at_limit]))
    np.testing.assert_allclose(costs, [-1.0, 0.0], atol=1e-12)


def test_cost_of_manipulability_agrees_with_the_curve(curve: SelfMotion) -> None:
    costs = MostManipulable().costs(curve.arm, curve.q)
    np.testing.assert_allclose(-costs, curve.manipulability, rtol=1e-9)


def test_best_on_a_closed_curve_may_lie_across_its_start(left: Arm) -> None:
    whole = trace_self_motion(left, CLOSED)
    for objective in objectives(left, 3):
        best = best_on(whole, objective)
        from_there = trace_self_motion(left, best)
        assert from_there.is_closed
        again = best_on(from_there, objective)
        assert cost(objective, left, again) == pytest.approx(
            cost(objective, left, best), abs=LOCATED
        )


def test_best_of_several_curves_is_that_of_the_best(left: Arm) -> None:
    curves = distinct_solutions(left, [WITH_TINY_PIECE[1]], step_rad=0.1)
    assert len(curves) > 1
    for objective in objectives(left, 4):
        each = [cost(objective, left, best_on(curve, objective)) for curve in curves]
        together = cost(objective, left, best_of(curves, objective))
        assert together == pytest.approx(min(each), abs=LOCATED)


def test_best_of_a_single_point_is_that_point(left: Arm) -> None:
    q = singular_near(left, ALONE)
    alone = trace_self_motion(left, q)
    np.testing.assert_array_equal(best_on(alone, NearestTo(left.start)), q)


def test_minimum_between_points_is_found_even_when_another_point_is_lower(
    curve: SelfMotion,
) -> None:
    """A narrow valley between two points, next to which every point is higher than elsewhere."""
    i = len(curve.s) // 2
    q_valley = curve.at(0.5 * float(curve.s[i] + curve.s[i + 1]))

    @dataclass(frozen=True)
    class Valley:
        def costs(self, arm: Arm, q: FloatArray) -> FloatArray:  # noqa: ARG002
            distance = np.linalg.norm(q - q_valley, axis=1)
            plateau = 0.5 + 1e-3 * np.linalg.norm(q - curve.q[0], axis=1)
            return np.array(np.minimum(plateau, 30.0 * distance))

    np.testing.assert_allclose(best_on(curve, Valley()), q_valley, atol=1e-8)


def test_objectives_keep_a_copy(left: Arm) -> None:
    seed = np.array(left.start)
    objective = NearestTo(seed)
    seed[0] = 9.0
    assert objective.q_seed[0] == left.start[0]
    assert not objective.q_seed.flags.writeable


@dataclass(frozen=True)
class Odd:
    """An objective whose costs are invalid."""

    given: Any

    def costs(self, arm: Arm, q: FloatArray) -> Any:  # noqa: ARG002
        return self.given if np.ndim(self.given) < 2 else np.resize(self.given, len(q))


@pytest.mark.parametrize(
    "objective",
    [
        *(None, FarthestFromLimits, "nearest"),
        *(Odd(costs) for costs in (np.zeros(3), 0.0, [[math.nan]])),
    ],
    ids=str,
)
def test_invalid_objectives_are_refused(curve: SelfMotion, objective: Any) -> None:
    with pytest.raises(RequestError):
        best_on(curve, objective)


def test_invalid_curves_and_configurations_are_refused(left: Arm) -> None:
    with pytest.raises(RequestError):
        best_on(5, FarthestFromLimits())  # type: ignore[arg-type]
    for q in list[Any]([np.zeros(6), [math.nan] * 7, "q"]):
        with pytest.raises(ConfigurationError):
            NearestTo(q)
    rows: Any
    for rows in (np.zeros(7), np.zeros((2, 6)), np.full((1, 7), np.nan)):
        for objective in objectives(left, 0):
            with pytest.raises(ConfigurationError):
                objective.costs(left, rows)
