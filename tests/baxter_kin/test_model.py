from __future__ import annotations

import math
from typing import Any, cast

import numpy as np
import pytest

from baxter_kin import Arm, Baxter, BaxterError, IKService, quaternion_xyzw
from baxter_kin.errors import ConfigurationError, UnknownNameError


def test_unknown_limb_names_the_known_ones(robot: Baxter) -> None:
    with pytest.raises(UnknownNameError, match="unknown limb 'top'; use one of: left, right"):
        robot.arm("top")


@pytest.mark.parametrize("limb", [None, 3, ["left"], {}])
def test_limb_of_another_type_is_unknown(robot: Baxter, limb: object) -> None:
    with pytest.raises(UnknownNameError, match="unknown limb"):
        robot.arm(limb)  # type: ignore[arg-type]


def test_full_configuration_rejects_unknown_joints(robot: Baxter) -> None:
    with pytest.raises(UnknownNameError, match="unknown joint 'left_s9'"):
        robot.configuration({"left_s9": 0.0})
    with pytest.raises(UnknownNameError, match="unknown joint 'left_s9'"):
        robot.indices(("left_s9",))


def test_full_configuration_rejects_values_that_are_not_finite(robot: Baxter) -> None:
    with pytest.raises(ConfigurationError, match="must be finite"):
        robot.configuration({"left_s0": math.nan})


@pytest.mark.parametrize("bad", ["abc", np.zeros(3), 5])
def test_full_configuration_wants_joints_by_name(robot: Baxter, bad: Any) -> None:
    with pytest.raises(ConfigurationError, match="joints must be of class Mapping"):
        robot.configuration(bad)


def test_malformed_arguments_are_errors_of_ours(robot: Baxter, left: Arm) -> None:
    for call in (
        lambda: robot.indices(cast(Any, None)),
        lambda: robot.indices(cast(Any, ([],))),
        lambda: left.random_configuration(cast(Any, None)),
        lambda: Baxter.load(cast(Any, "x")),
        lambda: Arm("left", None),
        lambda: IKService(cast(Any, None)),
        lambda: quaternion_xyzw(None),
    ):
        with pytest.raises(BaxterError):
            call()
