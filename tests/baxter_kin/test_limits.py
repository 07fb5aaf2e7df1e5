from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Baxter, JointLimits
from baxter_kin.errors import ConfigurationError, LimitsError, UnknownNameError
from baxter_kin.limits import PRESETS


def limits(**changes: object) -> JointLimits:
    """Limits of two joints, changed where asked."""
    values: dict[str, object] = {
        "names": ("a", "b"),
        "q_min": [-1.0, -2.0],
        "q_max": [1.0, 2.0],
        "v_max": [1.5, 4.0],
        "a_max": [2.0, 2.0],
        "j_max": [20.0, 20.0],
    }
    return JointLimits(**{**values, **changes})  # type: ignore[arg-type]


def test_arrays_are_copied_and_read_only() -> None:
    given = np.array([-1.0, -2.0])
    made = limits(q_min=given)
    given[0] = 0.0
    assert made.q_min[0] == -1.0
    with pytest.raises(ValueError, match="read-only"):
        made.q_min[0] = 0.0


def test_is_frozen() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        limits().v_max = np.ones(2)  # type: ignore[misc]


def test_every_kind_of_limit_names_its_origin() -> None:
    assert set(limits().origins) == {"position", "velocity", "acceleration", "jerk"}


@pytest.mark.parametrize("name", ["v_max", "a_max", "j_max"])
@pytest.mark.parametrize("value", [0.0, -1.0])
def test_rejects_limit_that_is_not_above_zero(name: str, value: float) -> None:
    with pytest.raises(LimitsError, match=f"{name} of b must be above zero, got {value}"):
        limits(**{name: [1.0, value]})


@pytest.mark.parametrize("name", ["q_min", "q_max", "v_max", "a_max", "j_max"])
@pytest.mark.parametrize("value", [[1.0], [1.0, 2.0, 3.0], [[1.0, 2.0]], [1.0, math.nan], None])
def test_rejects_malformed_arrays(name: str, value: object) -> None:
    with pytest.raises(LimitsError, match=name):
        limits(**{name: value})


def test_rejects_infinite_limit() -> None:
    with pytest.raises(LimitsError, match="j_max must be finite"):
        limits(j_max=[math.inf, 20.0])


def test_rejects_empty_range() -> None:
    with pytest.raises(LimitsError, match="b has an empty range: q_min 2 is not below q_max 2"):
        limits(q_min=[-1.0, 2.0])


def test_rejects_no_joints() -> None:
    with pytest.raises(LimitsError, match="at least one joint"):
        limits(names=())


def test_scaling_touches_velocity_alone_and_says_so() -> None:
    scaled = limits().scaled(0.5)
    np.testing.assert_array_equal(scaled.v_max, [0.75, 2.0])
    np.testing.assert_array_equal(scaled.a_max, [2.0, 2.0])
    assert scaled.origins["velocity"].startswith("0.5 x")


@pytest.mark.parametrize("ratio", [0.0, -0.1, 1.1, math.nan, math.inf, "fast", None, True])
def test_rejects_speed_ratio_outside_0_to_1(ratio: object) -> None:
    with pytest.raises(LimitsError, match="speed ratio must be"):
        limits().scaled(ratio)  # type: ignore[arg-type]


def test_check_names_every_joint_outside_with_its_range() -> None:
    with pytest.raises(ConfigurationError) as caught:
        limits().check([1.5, -3.0])
    assert "a = 1.5 rad is outside -1 .. 1" in str(caught.value)
    assert "b = -3 rad is outside -2 .. 2" in str(caught.value)


def test_check_clamps_within_the_tolerance() -> None:
    np.testing.assert_array_equal(limits().check([1.005, 0.0], tolerance=0.01), [1.0, 0.0])


@pytest.mark.parametrize("names", [None, "ab", (1, None), ("a", "a"), ("", "b"), 5])
def test_rejects_names_that_are_none(names: object) -> None:
    with pytest.raises(LimitsError, match="name"):
        limits(names=names)


@pytest.mark.parametrize("tolerance", [math.nan, math.inf, -1.0, "0.1", None, np.zeros(2)], ids=str)
@pytest.mark.parametrize("q", [[0.0, 0.0], np.zeros(2), [9.0, 9.0]], ids=str)
def test_a_tolerance_that_is_none_clamps_nothing(tolerance: Any, q: Any) -> None:
    with pytest.raises(ConfigurationError, match="tolerance must be"):
        limits().check(q, tolerance=tolerance)
    with pytest.raises(ConfigurationError, match="tolerance must be"):
        limits().violations(q, tolerance)


@pytest.mark.parametrize("q", [np.zeros(3), np.full(2, np.nan), "q", None, 5], ids=str)
def test_what_is_no_configuration_violates_no_limit_but_is_refused(q: Any) -> None:
    with pytest.raises(ConfigurationError, match="q "):
        limits().violations(q)


def test_masked_joint_values_are_refused() -> None:
    masked = np.ma.array([0.0, 0.0], mask=[True, False])
    for ask in (limits().check, limits().violations):
        with pytest.raises(ConfigurationError, match="q has masked entries"):
            ask(masked)


@given(st.lists(st.floats(-3, 3), min_size=2, max_size=2), st.floats(0, 1))
def test_what_is_accepted_violates_nothing(q: list[float], tolerance: float) -> None:
    if limits().violations(q, tolerance):
        with pytest.raises(ConfigurationError, match="outside the joint limits"):
            limits().check(q, tolerance=tolerance)
    else:
        assert limits().violations(limits().check(q, tolerance=tolerance)) == ()


@pytest.mark.parametrize("names", [range(10**12), [1, 2], "ab", None, ["a", "a"]], ids=str)
def test_names_that_are_none_are_refused(names: Any) -> None:
    with pytest.raises(LimitsError, match="name"):
        limits(names=names)


def test_joint_values_in_degrees_are_asked_about() -> None:
    with pytest.raises(ConfigurationError, match=r"are these degrees\? .* 45 deg is 0.7854 rad"):
        limits().check([45.0, 30.0])
    with pytest.raises(ConfigurationError, match=r"-1 .. 1$"):
        limits().check([3.5, 0.0])


TORQUE_REACHED = {
    "rad/s^2": [6.3, 7.2, 2.6, 8.1, 7.3, 14.0, 9.9],
    "rad/s^3": [40.0, 44.0, 17.0, 46.0, 41.0, 83.0, 66.0],
}
"""99.9 percentile of the magnitude that real Baxters reached under torque control, s0 to w2."""


class TestPresets:
    """Accelerations and jerks, with what real Baxters did as their evidence."""

    def test_safe_is_what_an_arm_has(self, robot: Baxter) -> None:
        for arm in robot.arms.values():
            found = arm.limits.preset("safe")
            assert found.names == arm.joint_names
            assert set(found.a_max) == {2.0}
            assert set(found.j_max) == {20.0}
            for name in ("q_min", "q_max", "v_max", "a_max", "j_max"):
                np.testing.assert_array_equal(getattr(found, name), getattr(arm.limits, name))
            assert found.origins == arm.limits.origins

    def test_torque_control_is_harder_and_keeps_positions_and_velocities(
        self, robot: Baxter
    ) -> None:
        own = robot.arm("right").limits.scaled(0.5)
        found = own.preset("torque-control")
        assert found.names == own.names
        assert found.a_max.tolist() == [4.0, 4.0, 2.0, 4.0, 6.0, 8.0, 6.0]
        assert set(found.j_max) == {40.0}
        for name in ("q_min", "q_max", "v_max"):
            np.testing.assert_array_equal(getattr(found, name), getattr(own, name))
        assert found.origins["velocity"] == own.origins["velocity"]

    def test_of_the_class_it_is_the_stock_robots_left_arm(self, robot: Baxter) -> None:
        own = robot.arm("left").limits
        for name in PRESETS:
            found, expected = JointLimits.preset(name), own.preset(name)
            assert found.names == expected.names
            assert found.origins == expected.origins
            for array in ("q_min", "q_max", "v_max", "a_max", "j_max"):
                np.testing.assert_allclose(
                    getattr(found, array), getattr(expected, array), rtol=1e-12
                )

    @pytest.mark.parametrize("name", PRESETS)
    def test_accelerations_are_inside_what_real_baxters_did(self, name: str) -> None:
        assert (JointLimits.preset(name).a_max < TORQUE_REACHED["rad/s^2"]).all()

    def test_origins_quote_the_evidence(self) -> None:
        found = JointLimits.preset("torque-control").origins
        assert set(found) == {"position", "velocity", "acceleration", "jerk"}
        for kind, unit in (("acceleration", "rad/s^2"), ("jerk", "rad/s^3")):
            assert " ".join(f"{value:g}" for value in TORQUE_REACHED[unit]) in found[kind]
        assert "902 s" in found["acceleration"]
        assert "MoveIt" in JointLimits.preset("safe").origins["acceleration"]

    def test_another_preset_replaces_the_first(self, robot: Baxter) -> None:
        own = robot.arm("left").limits
        back = own.preset("torque-control").preset("safe")
        np.testing.assert_array_equal(back.a_max, own.a_max)
        assert back.origins == own.origins

    @pytest.mark.parametrize("name", ["fast", "", "Safe", None, 5, ["safe"]])
    def test_unknown_ones_are_refused_with_the_names_that_are_known(self, name: Any) -> None:
        for preset in (JointLimits.preset, limits().preset):
            with pytest.raises(UnknownNameError, match="use one of: safe, torque-control"):
                preset(name)

    def test_other_joints_than_an_arms_have_none(self) -> None:
        with pytest.raises(LimitsError, match="joints of a Baxter's arm, not for a, b"):
            limits().preset("safe")
