from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Arm, Baxter
from baxter_kin.errors import DescriptionError
from baxter_kin.ik.search.arm_numbers import ArmNumbers
from baxter_kin.kinematics.dh_parameters import DHParameters
from baxter_kin.kinematics.symbolic import Shape


def test_bounds_are_the_joint_limits(any_arm: Arm) -> None:
    low, high = np.split(ArmNumbers.of(any_arm).bounds, 2)
    np.testing.assert_array_equal(low, any_arm.limits.q_min)
    np.testing.assert_array_equal(high, any_arm.limits.q_max)


def test_frames_lead_from_base_and_from_the_tip(any_arm: Arm) -> None:
    dh, frames = DHParameters.of(any_arm), ArmNumbers.of(any_arm).frames
    assert frames.shape == (24,)
    expected = dh.T_base_first.inverse(), dh.T_last_tip.inverse()
    for numbers, T in zip(np.split(frames, 2), expected, strict=True):
        np.testing.assert_array_equal(numbers[:9].reshape(3, 3).T, T.rotation)
        np.testing.assert_array_equal(numbers[9:], T.translation)


def test_an_arm_as_drawn_leaves_fewer_dimensions_open_than_a_calibrated_one(any_arm: Arm) -> None:
    numbers = ArmNumbers.of(any_arm)
    is_drawn = numbers.shape is not Shape.GENERAL
    assert numbers.dimensions.shape == (len(numbers.shape.free),)
    assert (len(numbers.shape.free) < len(Shape.GENERAL.free)) == is_drawn


def test_other_bounds_take_the_place_of_the_limits_alone(left: Arm) -> None:
    numbers, unlimited = ArmNumbers.of(left), np.repeat([-np.pi, np.pi], 7)
    usual, other = numbers.within(), numbers.within(unlimited)
    np.testing.assert_array_equal(usual[:14], numbers.bounds)
    np.testing.assert_array_equal(other[:14], unlimited)
    np.testing.assert_array_equal(usual[14:], other[14:])


def test_an_arm_with_parallel_axes_is_refused(robot: Baxter) -> None:
    arm = Arm("left", robot.model)
    T = arm.model.jointPlacements[2]
    arm.model.jointPlacements[2] = T * pin.SE3(pin.exp3(np.array([1.4, 0.0, 0.0])), np.zeros(3))
    with pytest.raises(DescriptionError, match="parallel"):
        ArmNumbers.of(arm)
