from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest

from baxter_kin import Arm, BaxterError, IKService, SeedMode, SeedType
from baxter_kin.errors import ConfigurationError, PoseError, RequestError, UnknownNameError
from baxter_kin.ik.requests import BLOCK, Requests
from tests.conftest import overhead


@pytest.mark.parametrize("count", [0, 1, 3])
def test_batch_with_another_number_of_seeds_is_refused(
    left: Arm, ik: IKService, count: int
) -> None:
    with pytest.raises(RequestError, match=f"2 poses came with {count} seeds"):
        ik.solve_batch([overhead(0.7, 0.0, 0.0)] * 2, seeds=[left.start] * count)


@pytest.mark.parametrize("poses", [None, 3, "pose", {"a": 1}])
def test_batch_of_what_is_no_sequence_is_refused(ik: IKService, poses: object) -> None:
    with pytest.raises(RequestError, match="poses must be a sequence"):
        ik.solve_batch(poses)  # type: ignore[arg-type]


def test_batch_names_the_bad_seed(left: Arm, ik: IKService) -> None:
    with pytest.raises(ConfigurationError, match=r"seeds\[1\] has shape \(3,\)"):
        ik.solve_batch([overhead(0.7, 0.0, 0.0)] * 2, seeds=[left.start, np.zeros(3)])


@pytest.mark.parametrize("seed", [np.zeros(6), [math.nan] * 7, [math.inf] * 7, "seed", {}])
def test_malformed_seed_is_refused(ik: IKService, seed: object) -> None:
    with pytest.raises(ConfigurationError, match="seed"):
        ik.solve(overhead(0.7, 0.0, 0.0), seed=seed)  # type: ignore[arg-type]


def test_seed_far_outside_the_limits_is_refused_by_name(left: Arm, ik: IKService) -> None:
    with pytest.raises(ConfigurationError, match=r"left_e1 = -0\.5 rad is outside -0\.05"):
        ik.solve(overhead(0.7, 0.0, 0.0), current=left.start * [1, 1, 1, 0, 1, 1, 1] - 0.5 * E1)


E1 = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])


def test_seed_a_little_outside_the_limits_is_clamped(left: Arm, ik: IKService) -> None:
    """Arms at rest report a little more than their limits."""
    q = np.array(left.start)
    q[3] = left.limits.q_max[3] + 0.01
    assert ik.solve(overhead(0.7, 0.15, -0.129), current=q).is_valid


def test_seed_with_a_joint_of_the_other_arm_is_refused(ik: IKService) -> None:
    with pytest.raises(UnknownNameError, match="right_s0"):
        ik.solve(overhead(0.7, 0.0, 0.0), seed={"right_s0": 0.0})


def test_seed_may_be_given_by_joint_name(left: Arm, ik: IKService) -> None:
    T = overhead(0.70, 0.15, -0.129)
    by_name = ik.solve(T, seed=left.joints(left.start))
    np.testing.assert_array_equal(by_name.q, ik.solve(T, seed=left.start).q)


@pytest.mark.parametrize("pose", [None, np.eye(3), np.diag([1.0, 1.0, -1.0, 1.0]), "here", []])
def test_malformed_pose_is_refused(ik: IKService, pose: Any) -> None:
    with pytest.raises(PoseError):
        ik.solve(pose)


def test_unknown_mode_is_refused(ik: IKService) -> None:
    with pytest.raises(BaxterError, match="unknown seed mode 9"):
        ik.solve(overhead(0.7, 0.0, 0.0), mode=9)  # type: ignore[arg-type]


def test_a_batch_without_a_length_is_told_of_the_stream(ik: IKService, left: Arm) -> None:
    endless = itertools.repeat(left.T_base_tip(left.neutral))
    with pytest.raises(RequestError, match="solve_stream takes any iterable"):
        ik.solve_batch(endless)  # type: ignore[arg-type]
    with pytest.raises(RequestError, match="a batch takes up to"):
        ik.solve_batch(range(10**12))


def test_masked_seeds_are_refused(ik: IKService, left: Arm) -> None:
    T, q = left.T_base_tip(left.neutral), np.ma.array(left.neutral, mask=[True] + [False] * 6)
    for ask in (
        lambda: ik.solve(T, q),
        lambda: ik.solve(T, current=q),
        lambda: ik.solve_batch([T], [q]),
        lambda: ik.solve_batch([T, T], [left.neutral, q]),
    ):
        with pytest.raises(ConfigurationError, match="masked"):
            ask()


def test_bad_pose_far_on_in_a_batch_is_named_by_its_number(left: Arm, ik: IKService) -> None:
    poses: list[Any] = [left.T_base_tip(left.start)] * (BLOCK + 3)
    poses[BLOCK + 1] = np.zeros((4, 4))
    with pytest.raises(PoseError, match=rf"^poses\[{BLOCK + 1}\]: "):
        ik.solve_batch(poses)


def test_blocks_hold_every_pose_and_its_seed_once_and_in_order(left: Arm) -> None:
    count = 2 * BLOCK + 3
    whole = Requests(list(range(count)), list(range(count)), left.start, SeedMode.AUTO)
    blocks = list(whole.blocks())
    assert [len(block.poses) for block in blocks] == [BLOCK, BLOCK, 3]
    assert [block.first for block in blocks] == [0, BLOCK, 2 * BLOCK]
    for each in (
        [pose for block in blocks for pose in block.poses],
        [seed for block in blocks if block.seeds is not None for seed in block.seeds],
    ):
        assert each == list(range(count))
    assert {block.mode for block in blocks} == {SeedMode.AUTO}


def test_a_table_of_seeds_has_no_number_where_there_is_no_seed(left: Arm) -> None:
    seeds = [left.start, None, left.joints(left.neutral)]
    table = Requests([None] * 3, seeds, left.start, SeedMode.AUTO).seed_table(left)
    np.testing.assert_array_equal(table[SeedType.USER][[0, 2]], [left.start, left.neutral])
    assert np.isnan(table[SeedType.USER][1]).all()
    np.testing.assert_array_equal(table[SeedType.CURRENT], [left.start] * 3)
    assert Requests([None], None, None, SeedMode.AUTO).seed_table(left) == {}


def test_arrays_are_taken_together_as_they_are_one_by_one(left: Arm) -> None:
    rng = np.random.default_rng(1)
    arrays = [left.random_configuration(rng) for _ in range(20)]
    together, apart = (
        Requests([None] * 20, seeds, None, SeedMode.AUTO).seed_table(left)[SeedType.USER]
        for seeds in (arrays, [q.tolist() for q in arrays])
    )
    np.testing.assert_array_equal(together, apart)


def test_a_seed_a_little_outside_the_limits_is_clamped_whatever_its_form(
    left: Arm, ik: IKService
) -> None:
    """Of a pose that nothing is searched for, the seed itself is the answer's configuration."""
    q, far = np.array(left.neutral), overhead(3.0, 0.0, 0.0)
    q[3] = left.limits.q_max[3] + 0.01
    for seed in (q, q.tolist()):
        assert ik.solve(far, seed=seed, mode=SeedMode.NS_MAP).q[3] == left.limits.q_max[3]
