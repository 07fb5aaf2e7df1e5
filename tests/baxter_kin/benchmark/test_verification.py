from __future__ import annotations

import math

import numpy as np
import pytest

from baxter_kin import Arm, Baxter
from baxter_kin.benchmark.entrants import SAME_CHAIN
from baxter_kin.benchmark.verification import (
    LIMIT_ROUNDING_RAD,
    LOOSE_LIMIT_RAD,
    TOLERANCE,
    Verdict,
    Verifier,
)


@pytest.mark.parametrize(
    ("excess_rad", "is_solved", "is_solved_loosely"),
    [
        (0.5 * LIMIT_ROUNDING_RAD, True, True),
        (0.5 * LOOSE_LIMIT_RAD, False, True),
        (2.0 * LOOSE_LIMIT_RAD, False, False),
    ],
)
def test_answer_outside_the_limits_is_unsolved(
    left: Arm, verifier: Verifier, excess_rad: float, is_solved: bool, is_solved_loosely: bool
) -> None:
    q = left.neutral.copy()
    q[3] = left.limits.q_max[3] + excess_rad
    verdict = verifier.verdict(left.T_base_tip(q), q)
    assert verdict.position_error_m <= TOLERANCE
    assert (verdict.is_solved, verdict.is_solved_loosely) == (is_solved, is_solved_loosely)


def test_verifier_measures_a_known_displacement(left: Arm, verifier: Verifier) -> None:
    target = left.T_base_tip(left.neutral)
    moved = left.neutral.copy()
    moved[6] += 0.25  # the tip lies on the axis of the last joint
    verdict = verifier.verdict(target, moved)
    assert verdict.orientation_error_rad == pytest.approx(0.25, abs=1e-12)
    assert verdict.position_error_m == pytest.approx(0.0, abs=1e-12)
    assert verdict.axis_error == pytest.approx(0.25, abs=1e-12)


def test_verifier_has_the_tip_where_the_arm_has_it(robot: Baxter, arm: Arm) -> None:
    verifier, rng = Verifier(robot, arm), np.random.default_rng(4)
    for _ in range(20):
        q = arm.random_configuration(rng)
        difference = verifier.T_base_tip(q).homogeneous - arm.T_base_tip(q).homogeneous
        assert np.abs(difference).max() < SAME_CHAIN


@pytest.mark.parametrize(
    ("answer", "is_claimed"), [(None, False), ("seven", True), (np.full(7, np.nan), True)]
)
def test_what_is_no_answer_is_infinitely_far_away(
    left: Arm, verifier: Verifier, answer: object, is_claimed: bool
) -> None:
    verdict = verifier.verdict(left.T_base_tip(left.neutral), answer)
    assert verdict == Verdict(is_claimed=is_claimed)
    assert (verdict.position_error_m, verdict.limit_excess_rad) == (math.inf, math.inf)
    assert not verdict.is_solved
    assert not verdict.is_solved_loosely
