"""Witnesses that were rounded for a page are found again."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter
from baxter_kin.ik.result import ORIENTATION_TOLERANCE_RAD, POSITION_TOLERANCE_M
from baxter_kin.parallel import Serial
from baxter_kin.validation import FloatArray
from planner.atlas import PositionGrid, ReachMap, RotationGrid, build_reach_map
from sim.view.atlas.shown_map import ShownMap, shown_part
from sim.view.atlas.witnesses import (
    FIRST_BITS,
    OTHER_BITS,
    SAME_RAD,
    PackedWitnesses,
    pack,
    polished,
    tip_errors,
    wrapped,
)

EXACT = 1e-9
"""Metres and rad: rounding of numbers of order 1."""


@pytest.fixture(scope="module")
def shown(small_map: ReachMap) -> ShownMap:
    return shown_part(small_map)


def test_the_chain_is_pinocchios(robot: Baxter) -> None:
    rng = np.random.default_rng(1)
    for side in robot.arms:
        arm = robot.arm(side)
        q = arm.random_configuration(rng)
        T = arm.T_base_tip(q)
        error, jacobian = tip_errors(arm, q[None], T.homogeneous[None])
        assert np.abs(error).max() < EXACT
        assert jacobian[0] == pytest.approx(arm.jacobian(q), abs=EXACT)
        small = pin.SE3(pin.exp3(np.array([1e-3, -2e-3, 3e-3])), np.zeros(3))
        moved = pin.SE3(small.rotation @ T.rotation, T.translation + np.array([1e-3, 0.0, 0.0]))
        error, _ = tip_errors(arm, q[None], moved.homogeneous[None])
        assert error[0] == pytest.approx([1e-3, 0, 0, 1e-3, -2e-3, 3e-3], abs=EXACT)


def test_every_packed_witness_is_found_again(small_map: ReachMap, shown: ShownMap) -> None:
    """Unpacked in the plainest way, cell by cell, and judged by Pinocchio."""
    q_near = np.array(list(read_one_by_one(small_map, shown)))
    Ts = np.tile(np.eye(4), (len(q_near), 1, 1))
    Ts[:, :3, 3] = shown.points(shown.cells)
    Ts[:, :3, :3] = small_map.rotations.matrices[shown.cells[4]]
    for number, side in enumerate(small_map.arms):
        own, arm = shown.cells[0] == number, small_map.robot.arm(side)
        q, _ = polished(arm, q_near[own], Ts[own])
        for each, T in zip(q[::7], Ts[own][::7], strict=True):
            reached = arm.T_base_tip(each)
            assert np.linalg.norm(reached.translation - T[:3, 3]) < POSITION_TOLERANCE_M
            turn = np.linalg.norm(pin.log3(reached.rotation @ T[:3, :3].T))
            assert turn < ORIENTATION_TOLERANCE_RAD
        assert (q >= arm.limits.q_min).all()
        assert (q <= arm.limits.q_max).all()
        assert np.abs(q - shown.q[own]).max() <= SAME_RAD


def read_one_by_one(small_map: ReachMap, shown: ShownMap) -> Iterator[FloatArray]:
    """What is packed for each reachable cell, before it is polished."""
    packed, rolls = pack(small_map, shown), small_map.rotations.rolls
    begun = following = 0
    last: tuple[int, ...] = ()
    for (*position, rotation), of_roll in zip(shown.cells.T.tolist(), packed.of_roll, strict=True):
        direction, roll = divmod(rotation, len(rolls))
        if (*position, direction) != last:
            begun, last = following, (*position, direction)
        index = begun + int(of_roll)
        following = max(following, index + 1)
        q = unpacked(small_map, packed, small_map.arms[position[0]], index)
        q[6] = wrapped(q[6] + rolls[roll])
        yield q
    assert following == len(packed.first)


def unpacked(small_map: ReachMap, packed: PackedWitnesses, side: str, index: int) -> FloatArray:
    if index in packed.kept:
        kept: FloatArray = packed.q_kept[packed.kept == index][0]
        return kept.copy()
    limits = small_map.robot.arm(side).limits
    low, high = limits.q_min.copy(), limits.q_max.copy()
    low[6], high[6] = -math.pi, math.pi
    steps = np.array([packed.first[index], *packed.others[:, index]], float)
    q: FloatArray = low + steps / (2.0 ** np.array([FIRST_BITS] + [OTHER_BITS] * 6) - 1) * (
        high - low
    )
    return q


def test_rolls_share_witnesses(small_map: ReachMap, shown: ShownMap) -> None:
    packed = pack(small_map, shown)
    assert len(packed.first) < 0.5 * len(shown.q)
    assert len(packed.kept) < 0.05 * len(packed.first)


def test_rotations_without_rolls_are_packed_too(robot: Baxter, tmp_path: Path) -> None:
    grid = PositionGrid(0.1, (7, 3, 0), (1, 1, 1))
    turns = RotationGrid.of([np.diag([1.0, -1.0, -1.0]), np.diag([-1.0, 1.0, -1.0]), np.eye(3)])
    found = build_reach_map(tmp_path / "list", robot, grid, turns, engine=Serial())
    shown = shown_part(found)
    assert (pack(found, shown).of_roll == 0).all()
    assert len(list(read_one_by_one(found, shown))) == (shown.codes >= 0).sum() > 0
