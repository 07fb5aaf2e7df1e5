"""Samples of a pose's solution set, quickly."""

from __future__ import annotations

import numpy as np

from baxter_kin.arrays import Vector, whole_scalar
from baxter_kin.errors import RequestError, expect
from baxter_kin.frames import PoseLike, checked_pose
from baxter_kin.ik.geometry.closed_form import ClosedForm
from baxter_kin.ik.service import IKService

SLACK_RAD = 0.05
"""How far outside the limits a nearly exact configuration may be to be worth a search."""

MOST_TURNS = 10_000
"""Angles of s0 that may be asked for: 0.4 mrad apart, and a tenth of a second."""

DIGITS = 4
"""Samples that agree in so many digits of a radian are the same."""


def sample_solutions(ik: IKService, T_base_tip: PoseLike, *, turns: int = 48) -> Vector:
    """Solutions all over the solution set of a pose, one for each branch and angle of s0.

    Unlike `solutions`, which traces the set, this takes about two milliseconds and
    tells nothing of how its members hang together.

    Args:
        ik: the service of the arm.
        T_base_tip: the pose of its tip, as for `IKService.solve`.
        turns: how many angles of s0 are tried, in equal steps over its range.

    Returns:
        Shape (n, 7), rad; empty where none was found.

    Raises:
        PoseError: when the pose is not a valid one.
        RequestError: when `turns` is not a whole number from 1 to `MOST_TURNS`, or `ik` no service.
    """
    count = whole_scalar(turns, "turns", RequestError, least=1, most=MOST_TURNS)
    expect(ik, IKService, "ik", RequestError)
    Ts, arm, limits = checked_pose(T_base_tip).homogeneous[None], ik.arm, ik.arm.limits
    closed_form = ClosedForm(arm.at_gripper, turns=count, rolls=1)
    q, misfit = closed_form.configurations(Ts @ arm.T_gripper_tip.inverse().homogeneous)
    inside = q[0].clip(limits.q_min, limits.q_max)
    is_near = (misfit[0] == 0.0) & (np.abs(q[0] - inside).max(axis=1) <= SLACK_RAD)
    starts: Vector = inside[is_near]
    if not len(starts):
        return starts
    found = ik.search.search(starts, np.repeat(Ts, len(starts), axis=0))
    solved = found.q[found.is_valid]
    _, first = np.unique(solved.round(DIGITS), axis=0, return_index=True)
    samples: Vector = solved[np.sort(first)]
    return samples
