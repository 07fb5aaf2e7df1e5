"""Short runs of the scripts that check kinematics and joint moves by random problems."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

from baxter_kin import Arm, IKService

POSES, MEET_M, OUTSIDE_M = 12, 1e-6, 2e-4
check_ik: Any = importlib.import_module("check_ik")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("script", "words"),
    [
        ("check_joint_moves", "--count 500 --seed 33"),
        ("check_ik", "poses --count 300 --limb right"),
        ("check_ik", "solutions --count 2 --restarts 50 --limb left"),
    ],
)
def test_a_short_run_finds_nothing_wrong(
    script: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    status = importlib.import_module(script).main(words.split())
    assert status == 0, capsys.readouterr().out


@pytest.fixture(scope="module")
def edges(arm: Arm) -> tuple[tuple[pin.SE3, NDArray[np.float64]], ...]:
    """The last poses within reach on some ways out, and their directions."""
    rng, ik = np.random.default_rng(5), IKService(arm)
    found = (check_ik.boundary(ik, rng) for _ in range(2 * POSES))
    return tuple(edge for edge in found if edge is not None)[:POSES]


@pytest.mark.slow
@pytest.mark.parametrize("inside_m", [2e-6, 1e-6, 0.0, -0.9e-6])
def test_poses_are_solved_up_to_the_edge(arm: Arm, edges: Any, inside_m: float) -> None:
    ik = IKService(arm)
    for edge, outward in edges:
        T = check_ik.moved(edge, -inside_m * outward)
        result = ik.solve(T)
        assert result.is_valid, (T, result.failure)
        assert np.linalg.norm(arm.T_base_tip(result.q).translation - T.translation) <= MEET_M


def test_a_little_farther_out_failures_have_numbers(arm: Arm, edges: Any) -> None:
    ik, told = IKService(arm), []
    for edge, outward in edges:
        failure = ik.solve(check_ik.moved(edge, OUTSIDE_M * outward)).failure
        if failure is not None and failure.beyond_reach_m == 0.0:
            told.append(failure.nearest_m)
    assert told
    assert all(
        nearest_m is not None and 0.0 < nearest_m <= OUTSIDE_M + MEET_M for nearest_m in told
    )
