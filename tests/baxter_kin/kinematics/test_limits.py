from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Baxter, JointLimits
from baxter_kin.errors import ConfigurationError, LimitsError, UnknownNameError
from baxter_kin.kinematics.limits import PRESETS


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


NAMES = [None, 5, "ab", (), (1, None), ("a", "a"), ("", "b"), range(10**12)]
ARRAYS = [None, [1.0], [1.0, math.nan], [math.inf, 1.0]]
REFUSED: list[dict[str, Any]] = [
    *({"names": names} for names in NAMES),
    *({name: array} for name in ("q_min", "q_max", "v_max", "a_max", "j_max") for array in ARRAYS),
    *({name: [1.0, value]} for name in ("v_max", "a_max", "j_max") for value in (0.0, -1.0)),
    {"q_min": [-1.0, 2.0]},
    {"origins": 5},
]


@pytest.mark.parametrize("changes", REFUSED, ids=str)
def test_malformed_limits_are_refused_by_name(changes: dict[str, Any]) -> None:
    with pytest.raises(LimitsError, match=f"{next(iter(changes))[:4]}|empty range"):
        limits(**changes)


@pytest.mark.parametrize("ratio", [0.0, -0.1, 1.1, math.nan, math.inf, "fast", None, True])
def test_a_speed_ratio_outside_0_to_1_is_refused(ratio: Any) -> None:
    with pytest.raises(LimitsError):
        limits().scaled(ratio)


MASKED = np.ma.array([0.0, 0.0], mask=[True, False])


@pytest.mark.parametrize(
    ("q", "tolerance"),
    [
        *((q, 0.0) for q in (np.zeros(3), np.full(2, np.nan), "q", None, 5, MASKED)),
        *(
            (q, tolerance)
            for q in ([0.0, 0.0], [9.0, 9.0])
            for tolerance in (math.nan, -1.0, "0.1")
        ),
    ],
    ids=str,
)
def test_malformed_joint_values_and_tolerances_are_refused(q: Any, tolerance: Any) -> None:
    for call in (limits().check, limits().violations):
        with pytest.raises(ConfigurationError):
            call(q, tolerance=tolerance)


def test_scaling_touches_velocity_alone_and_says_so() -> None:
    scaled = limits().scaled(0.5)
    np.testing.assert_array_equal(scaled.v_max, [0.75, 2.0])
    np.testing.assert_array_equal(scaled.a_max, [2.0, 2.0])
    assert scaled.origins["velocity"].startswith("0.5 x")


def test_check_names_every_joint_outside_with_its_range() -> None:
    with pytest.raises(ConfigurationError) as caught:
        limits().check([1.5, -3.0])
    assert "a = 1.5 rad is outside -1 .. 1" in str(caught.value)
    assert "b = -3 rad is outside -2 .. 2" in str(caught.value)


def test_check_clamps_within_the_tolerance() -> None:
    np.testing.assert_array_equal(limits().check([1.005, 0.0], tolerance=0.01), [1.0, 0.0])


@given(st.lists(st.floats(-3, 3), min_size=2, max_size=2), st.floats(0, 1))
def test_what_is_accepted_violates_nothing(q: list[float], tolerance: float) -> None:
    if limits().violations(q, tolerance):
        with pytest.raises(ConfigurationError, match="outside the joint limits"):
            limits().check(q, tolerance=tolerance)
    else:
        assert limits().violations(limits().check(q, tolerance=tolerance)) == ()


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
