from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Arm, Baxter
from baxter_kin.frames import angle_between
from baxter_kin.ik.reach.closed_form import BLOCK, ClosedForm

SUBSTITUTED_M = 0.020
SUBSTITUTED_RAD = 0.06
"""The most that an undecided w0 can do: twice the wrist's offset of 10 mm, and that over the length
of the forearm. The median is 2e-6 m."""


@pytest.fixture(scope="module")
def closed_form(arm: Arm) -> ClosedForm:
    return ClosedForm(arm, turns=16, rolls=4)


def poses_of(arm: Arm, qs: np.ndarray) -> np.ndarray:
    return np.array([arm.T_base_tip(q).homogeneous for q in qs])


def turned(q: np.ndarray, other: np.ndarray) -> np.ndarray:
    """The largest difference of angles, up to full turns."""
    difference: np.ndarray = np.abs((q - other + np.pi) % (2 * np.pi) - np.pi).max(axis=-1)
    return difference


def test_configurations_that_nothing_was_clipped_for_nearly_reach_the_pose(
    arm: Arm, closed_form: ClosedForm
) -> None:
    rng = np.random.default_rng(1)
    Ts = poses_of(arm, np.array([arm.random_configuration(rng) for _ in range(40)]))
    qs, misfits = closed_form.configurations(Ts)
    offsets = []
    for T, q_row, misfit in zip(Ts, qs, misfits, strict=True):
        for q in q_row[misfit == 0.0][::7]:
            reached = arm.T_base_tip(q)
            offsets.append(np.linalg.norm(reached.translation - T[:3, 3]))
            assert offsets[-1] < SUBSTITUTED_M
            assert angle_between(reached.rotation, T[:3, :3]) < SUBSTITUTED_RAD
    assert len(offsets) > 500
    assert np.median(offsets) < 1e-5


@pytest.mark.parametrize("side", ["left", "right"])
@given(seed=st.integers(0, 2**32 - 1), turn=st.integers(0, 15))
def test_the_configuration_that_made_a_pose_is_among_them(
    robot: Baxter, side: str, seed: int, turn: int
) -> None:
    arm = robot.arm(side)
    q = arm.random_configuration(np.random.default_rng(seed))
    q[0] = np.linspace(arm.limits.q_min[0], arm.limits.q_max[0], 16)[turn]
    q[5] = np.copysign(max(abs(q[5]), 0.3), q[5])  # a straight wrist leaves w0 undecided
    found, _ = ClosedForm(arm, turns=16, rolls=4).configurations(poses_of(arm, q[None]))
    assert turned(found[0], q).min() < 0.1


def test_starts_are_inside_the_limits_and_best_first(arm: Arm, closed_form: ClosedForm) -> None:
    rng = np.random.default_rng(2)
    Ts = poses_of(arm, np.array([arm.random_configuration(rng) for _ in range(BLOCK + 3)]))
    starts = closed_form.starts(Ts, 10)
    assert starts.shape == (BLOCK + 3, 10, 7)
    assert (starts >= arm.limits.q_min).all()
    assert (starts <= arm.limits.q_max).all()
    offsets = np.array(
        [
            [np.linalg.norm(arm.T_base_tip(q).translation - T[:3, 3]) for q in row]
            for T, row in zip(Ts, starts, strict=True)
        ]
    )
    assert np.median(offsets[:, 0]) < 1e-4
    assert offsets[:, 0].sum() <= offsets[:, -1].sum()


def test_starts_of_a_pose_do_not_depend_on_the_others(arm: Arm, closed_form: ClosedForm) -> None:
    rng = np.random.default_rng(3)
    Ts = poses_of(arm, np.array([arm.random_configuration(rng) for _ in range(BLOCK + 3)]))
    together = closed_form.starts(Ts, 5)
    for i in (0, BLOCK - 1, BLOCK):
        np.testing.assert_array_equal(together[i], closed_form.starts(Ts[i : i + 1], 5)[0])


def test_poses_out_of_reach_get_starts_that_point_there(arm: Arm, closed_form: ClosedForm) -> None:
    far = np.eye(4)
    far[:3, 3] = 3.0, 0.0, 1.0
    starts = closed_form.starts(far[None], 3)
    assert np.isfinite(starts).all()
    tip = arm.T_base_tip(starts[0, 0]).translation
    assert np.linalg.norm(tip - far[:3, 3]) < 2.6
