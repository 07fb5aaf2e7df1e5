from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from baxter_kin import Arm, Baxter
from baxter_kin.ik.reach.linkage import Linkage
from baxter_kin.ik.reach.shoulder_sweep import BLOCK, ShoulderSweep, UncertainAngle, UncertainVector
from baxter_kin.validation import FloatArray

ROUNDING = 1e-9

ARC_SINE = 1e-6
"""An arc sine or cosine near 1 loses half the digits."""

angles = st.floats(-20.0, 20.0)
slacks = st.floats(0.0, 4.0)


def one(*numbers: float) -> tuple[FloatArray, ...]:
    """The numbers as arrays of length 1."""
    return tuple(np.array([number]) for number in numbers)


def turn(angle: float) -> float:
    """The same angle up to whole turns, in [-pi, pi]."""
    return math.remainder(angle, 2.0 * math.pi)


@given(angles, slacks, angles, st.floats(0.0, math.pi), st.floats(-1.0, 1.0))
def test_an_angle_within_the_slack_of_a_range_is_never_excluded(
    middle: float, slack: float, range_middle: float, half: float, share: float
) -> None:
    inside = UncertainAngle(*one(range_middle + share * half + share * slack, slack))
    assert inside.is_within(range_middle, half + ROUNDING)[0]
    given_angle = UncertainAngle(*one(middle, slack))
    is_near = abs(turn(middle - range_middle)) <= half + slack
    assume(abs(abs(turn(middle - range_middle)) - half - slack) > ROUNDING)
    assert given_angle.is_within(range_middle, half)[0] == is_near


shares = st.floats(-1.0, 1.0)
known = st.tuples(angles, slacks)


@given(known, known, shares, shares)
def test_a_difference_holds_the_differences_of_all_that_may_be(
    a: tuple[float, float], b: tuple[float, float], share_a: float, share_b: float
) -> None:
    difference = UncertainAngle(*one(*a)).minus(UncertainAngle(*one(*b)))
    found = (a[0] + share_a * a[1]) - (b[0] + share_b * b[1])
    assert abs(found - difference.middle[0]) <= difference.slack[0] + ROUNDING


coordinates = st.floats(-2.0, 2.0)
vectors = st.tuples(coordinates, coordinates, st.floats(5e-6, 1.0))
"""Components and slack; the margins of the sweeps are 5e-6."""


def moved(vector: tuple[float, float, float], share: float, towards: float) -> tuple[float, float]:
    """The components of a vector whose end is displaced by a share of the slack."""
    x, y, slack = vector
    return x + share * slack * math.cos(towards), y + share * slack * math.sin(towards)


@given(vectors, shares, angles)
def test_every_vector_within_the_slack_has_an_angle_within_its_slack(
    vector: tuple[float, float, float], share: float, towards: float
) -> None:
    angle = UncertainVector(*one(*vector)).angle
    x, y = moved(vector, share, towards)
    assume(math.hypot(x, y) > ROUNDING)
    off = abs(turn(math.atan2(y, x) - angle.middle[0]))
    assert off <= angle.slack[0] + ARC_SINE


@given(vectors, shares, angles, angles, st.floats(0.0, 0.5))
def test_every_direction_with_a_component_in_the_range_is_within_the_angle(
    vector: tuple[float, float, float], share: float, towards: float, direction: float, width: float
) -> None:
    x, y = moved(vector, share, towards)
    assume(math.hypot(*vector[:2]) > vector[2] + 1e-3)
    component = x * math.cos(direction) + y * math.sin(direction)
    limits = one(component - width, component + 0.5 * width)
    found, is_possible = UncertainVector(*one(*vector)).arc_cosine(*limits)
    between = abs(turn(direction - math.atan2(y, x)))
    assert is_possible[0]
    assert abs(between - found.middle[0]) <= found.slack[0] + ARC_SINE


def test_a_component_longer_than_the_vector_is_impossible() -> None:
    vector = UncertainVector(*one(3.0, 4.0, 0.1))
    assert vector.length[0] == 5.0
    assert not vector.arc_cosine(*one(5.2, 6.0))[1][0]
    assert not vector.arc_cosine(*one(-6.0, -5.2))[1][0]
    assert vector.arc_cosine(*one(5.05, 6.0))[1][0]


def test_the_slack_of_an_angle_is_that_of_the_tangent_to_where_the_end_may_be() -> None:
    assert UncertainVector(*one(0.0, 2.0, 1.0)).angle.slack[0] == math.asin(0.5)


@pytest.mark.parametrize("vector", [(0.1, 0.0, 0.1), (0.0, 0.0, 0.0)])
def test_a_vector_that_may_be_zero_may_have_any_angle(vector: tuple[float, ...]) -> None:
    assert UncertainVector(*one(*vector)).angle.slack[0] == math.pi


LEVELS = 5


def reached(arm: Arm, count: int, seed: int) -> FloatArray:
    """Last axes of random configurations, half of them with joints at limits."""
    rng, linkage = np.random.default_rng(seed), Linkage.of(arm)
    qs = np.array([arm.random_configuration(rng) for _ in range(count)])
    ends = np.where(rng.random((count, 7)) < 0.5, arm.limits.q_min, arm.limits.q_max)
    is_at_limit = (rng.random((count, 7)) < 0.4) & (np.arange(count)[:, None] % 2 == 0)
    qs = np.where(is_at_limit, ends, qs)
    return linkage.targets(np.array([arm.T_base_tip(q).homogeneous for q in qs]))


def pushed(targets: FloatArray, away_m: float, seed: int) -> FloatArray:
    """The same targets in the same orientations, moved in random directions."""
    directions = np.random.default_rng(seed).normal(size=(len(targets), 3))
    moved = targets.copy()
    moved[:, :3, 3] += away_m * directions / np.linalg.norm(directions, axis=1)[:, None]
    return moved


def test_nothing_that_the_arm_reaches_is_excluded(any_arm: Arm) -> None:
    targets = reached(any_arm, 150, 1)
    sweep = ShoulderSweep(Linkage.of(any_arm))
    assert not sweep.exclusions(targets, np.zeros(len(targets)), LEVELS).is_proven.any()


@pytest.mark.parametrize("away_m", [0.01, 0.1])
def test_targets_near_reachable_ones_are_not_excluded(left: Arm, away_m: float) -> None:
    targets = pushed(reached(left, 300, 2), away_m, 3)
    found = ShoulderSweep(Linkage.of(left)).exclusions(targets, np.full(300, away_m), LEVELS)
    assert not found.is_proven.any()


def test_a_proof_holds_for_every_smaller_radius_and_with_more_levels(left: Arm) -> None:
    sweep, targets = ShoulderSweep(Linkage.of(left)), pushed(reached(left, 300, 4), 0.4, 5)
    proven = {
        (radius_m, levels): sweep.exclusions(targets, np.full(300, radius_m), levels).is_proven
        for radius_m in (0.0, 0.01, 0.1)
        for levels in (1, LEVELS)
    }
    assert 0 < proven[0.1, 1].sum() < proven[0.0, LEVELS].sum() < 300
    for (radius_m, levels), found in proven.items():
        for (smaller_m, more), others in proven.items():
            if smaller_m <= radius_m and more >= levels:
                assert others[found].all(), (radius_m, levels, smaller_m, more)


def test_results_do_not_depend_on_other_targets(left: Arm) -> None:
    count = BLOCK + 20
    sweep, targets = ShoulderSweep(Linkage.of(left)), pushed(reached(left, count, 6), 0.4, 7)
    together = sweep.exclusions(targets, np.zeros(count), 3)
    alone = [sweep.exclusions(T[None], np.zeros(1), 3) for T in targets]
    assert together.is_proven.tolist() == [bool(found.is_proven[0]) for found in alone]
    assert together.needs_wrist.tolist() == [bool(found.needs_wrist[0]) for found in alone]
    assert not sweep.exclusions(targets[:0], np.zeros(0), 3).is_proven.size


def test_a_hand_that_folds_back_is_excluded_by_the_wrist_alone(arm: Arm) -> None:
    target = np.eye(4)
    target[:3, 3], target[:3, 2] = (0.69, 0.0, 0.0), (-1.0, 0.0, 0.0)
    ahead = target.copy()
    ahead[:3, 2] = 1.0, 0.0, 0.0
    both = np.array([target, ahead])
    found = ShoulderSweep(Linkage.of(arm)).exclusions(both, np.zeros(2), LEVELS)
    assert found.is_proven.tolist() == [True, False]
    assert found.needs_wrist[0]


def test_mirrored_targets_of_both_arms_are_judged_alike(robot: Baxter) -> None:
    one, other = (ShoulderSweep(Linkage.of(robot.arm(side))) for side in ("left", "right"))
    targets = pushed(reached(robot.arm("left"), 300, 8), 0.3, 9)
    mirrored = targets.copy()
    mirrored[:, 1] *= -1.0  # z axes and positions; the others are not looked at
    found = (
        sweep.exclusions(each, np.full(300, 1e-4), LEVELS).is_proven
        for sweep, each in ((one, targets), (other, mirrored))
    )
    on_the_edge = 2  # of 300 may be judged otherwise for the URDF's rounding
    assert (next(found) != next(found)).sum() <= on_the_edge
