from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from baxter_kin import Arm, Baxter, BaxterError
from baxter_kin.errors import ConfigurationError, DescriptionError, UnknownNameError


def test_indices_are_places_in_a_full_configuration(robot: Baxter) -> None:
    names = ("right_w2", "left_s0")
    q = robot.configuration({"right_w2": 0.3, "left_s0": -0.2})
    assert q[list(robot.indices(names))].tolist() == [0.3, -0.2]
    neutral = robot.configuration()
    for arm in robot.arms.values():
        np.testing.assert_array_equal(neutral[list(robot.indices(arm.joint_names))], arm.neutral)


@pytest.mark.parametrize(
    ("method", "argument", "error"),
    [
        *(("arm", limb, UnknownNameError) for limb in list[Any](["top", None, 3, ["left"], {}])),
        ("configuration", {"left_s9": 0.0}, UnknownNameError),
        ("configuration", {"left_s0": math.nan}, ConfigurationError),
        *(("configuration", joints, ConfigurationError) for joints in ("abc", np.zeros(3), 5)),
        *(("indices", names, UnknownNameError) for names in list[Any]([("left_s9",), ([],)])),
        ("indices", None, ConfigurationError),
        ("load", "x", DescriptionError),
    ],
)
def test_invalid_arguments_are_refused(
    robot: Baxter, method: str, argument: Any, error: type[BaxterError]
) -> None:
    with pytest.raises(error):
        getattr(robot, method)(argument)


def test_an_arm_needs_a_model() -> None:
    with pytest.raises(BaxterError):
        Arm("left", None)
