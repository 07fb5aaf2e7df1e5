from __future__ import annotations

import numpy as np
import pytest

from baxter_kin import Arm, Baxter, SeedMode, SeedType, UnknownNameError
from baxter_kin.ik.seeds import STARTS_PER_TYPE, NullSpaceMap, starts_around
from baxter_kin.model import MIRROR


def test_numbers_and_labels_are_those_of_the_original_service() -> None:
    assert {t.name: t.value for t in SeedType} == {
        "INVALID": 0,
        "USER": 1,
        "CURRENT": 2,
        "NS_MAP": 3,
    }
    assert {m.name: m.value for m in SeedMode} == {"AUTO": 0, "USER": 1, "CURRENT": 2, "NS_MAP": 3}
    assert SeedType.USER.label == "User Provided Seed"
    assert SeedType.CURRENT.label == "Current Joint Angles"
    assert SeedType.NS_MAP.label == "Nullspace Setpoints"


@pytest.mark.parametrize("mode", [4, -1, "AUTO", None])
def test_unknown_mode_names_the_known_ones(mode: object) -> None:
    with pytest.raises(UnknownNameError, match=r"unknown seed mode .* SeedMode\.AUTO"):
        SeedMode.of(mode)


def test_null_space_map_has_27_setpoints_inside_the_limits(arm: Arm) -> None:
    setpoints = NullSpaceMap(arm).setpoints
    assert setpoints.shape == (27, 7)
    assert not [text for q in setpoints for text in arm.limits.violations(q)]


def test_null_space_maps_mirror_each_other(robot: Baxter) -> None:
    left, right = (NullSpaceMap(robot.arm(side)).setpoints for side in ("left", "right"))
    np.testing.assert_array_equal(left * MIRROR, right)


def test_null_space_map_is_chosen_by_the_pose(arm: Arm) -> None:
    null_space_map = NullSpaceMap(arm)
    for q in null_space_map.setpoints:
        first = next(null_space_map.starts(arm.T_base_tip(q)))
        np.testing.assert_array_equal(first.q_start, q)


def test_first_start_is_the_seed_itself(arm: Arm) -> None:
    starts = list(starts_around(arm, SeedType.USER, arm.start))
    np.testing.assert_array_equal(starts[0].q_start, arm.start)
    assert len(starts) == STARTS_PER_TYPE


def test_further_starts_are_inside_the_limits_and_the_same_every_time(arm: Arm) -> None:
    once = [start.q_start for start in starts_around(arm, SeedType.CURRENT, arm.limits.q_max)]
    again = [start.q_start for start in starts_around(arm, SeedType.CURRENT, arm.limits.q_max)]
    np.testing.assert_array_equal(once, again)
    assert not [text for q in once for text in arm.limits.violations(q)]
