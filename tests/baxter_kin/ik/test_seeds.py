from __future__ import annotations

import numpy as np
import pytest

from baxter_kin import Arm, Baxter, SeedMode, SeedType
from baxter_kin.errors import UnknownNameError
from baxter_kin.ik.search.searcher import Searcher
from baxter_kin.ik.seeds import NullSpaceMap, starts_around
from baxter_kin.kinematics.arm import MIRROR


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


def test_null_space_map_has_64_setpoints_inside_the_limits(arm: Arm) -> None:
    setpoints = NullSpaceMap(arm).setpoints
    assert setpoints.shape == (64, 7)
    assert not [text for q in setpoints for text in arm.limits.violations(q)]


def test_null_space_maps_mirror_each_other(robot: Baxter) -> None:
    left, right = (NullSpaceMap(robot.arm(side)).setpoints for side in ("left", "right"))
    np.testing.assert_array_equal(left * MIRROR, right)


def test_nearest_setpoints_of_mirrored_poses_mirror_each_other(robot: Baxter) -> None:
    left, right = robot.arm("left"), robot.arm("right")
    qs = [left.random_configuration(np.random.default_rng(i)) for i in range(50)]
    ours = NullSpaceMap(left).nearest(np.array([left.T_base_tip(q).homogeneous for q in qs]))
    theirs = NullSpaceMap(right).nearest(
        np.array([right.T_base_tip(MIRROR * q).homogeneous for q in qs])
    )
    np.testing.assert_array_equal(ours, theirs)


def test_one_search_from_the_nearest_setpoint_solves_nine_of_ten_poses(arm: Arm) -> None:
    """The criterion by which the table was chosen; 0.927 over its own regions, less elsewhere."""
    null_space_map, rng = NullSpaceMap(arm), np.random.default_rng(3)
    qs = [arm.random_configuration(rng) for _ in range(500)]
    Ts = np.array([arm.T_base_tip(q).homogeneous for q in qs])
    starts = null_space_map.setpoints[null_space_map.nearest(Ts)[:, 0]]
    assert Searcher(arm).search(starts, Ts).is_valid.mean() > 0.88


def test_first_start_is_the_seed_itself(arm: Arm) -> None:
    starts = list(starts_around(arm, arm.start[None], 5))
    np.testing.assert_array_equal(starts[0], arm.start[None])
    assert len(starts) == 5


def test_further_starts_are_inside_the_limits_and_the_same_every_time(arm: Arm) -> None:
    seeds = np.array([arm.limits.q_max, arm.limits.q_min])
    once = np.concatenate(list(starts_around(arm, seeds, 8)))
    again = np.concatenate(list(starts_around(arm, seeds, 8)))
    np.testing.assert_array_equal(once, again)
    assert not [text for q in once for text in arm.limits.violations(q)]
