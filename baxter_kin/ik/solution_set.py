"""The distinct ways to reach a pose: connected pieces of its self-motion.

Two configurations of a pose are the same way of reaching it when the arm can move from one to the
other with the tip at rest and every joint inside its limits: when one lies on the curve through the
other. With the limits ignored, the pieces join to a few loops: 4 for 17 of 40 random poses of
Baxter, 15 at most; at most 16 for any arm of seven joints (Burdick, "On the inverse kinematics of
redundant manipulators", 1989). So one candidate leads to every piece of its loop, however small.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import islice

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin.errors import ConfigurationError, RequestError
from baxter_kin.frames import PoseLike, checked_pose
from baxter_kin.ik.reach.closed_form import ClosedForm
from baxter_kin.ik.self_motion.pieces import STARTS, all_pieces, pieces_through
from baxter_kin.ik.self_motion.solution_curve import POSE_MISMATCH, SolutionCurve
from baxter_kin.ik.self_motion.tracing import STEP_RAD, SelfMotion, checked_step
from baxter_kin.ik.service import IKService
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray, expect, whole_scalar

MAX_CANDIDATES = 2_000
"""How many candidates may come, and so how many starts: a second or two of work."""


def distinct_solutions(
    arm: Arm,
    candidates: Iterable[ArrayLike],
    *,
    T_base_tip: PoseLike | None = None,
    step_rad: float = STEP_RAD,
) -> tuple[SelfMotion, ...]:
    """The distinct connected pieces of one pose's self-motion, found from candidates.

    All pieces on which candidates lie, and all others of the same loops
    (`baxter_kin.ik.self_motion.continuation`); loops without a candidate are missed.

    Ordered by length, the longest first, then by the lowest joint values on them, joint by joint
    from the shoulder: the same order whatever the order of the candidates.

    Args:
        arm: whose joints move.
        candidates: configurations that reach the pose inside the limits, shape (7,) each, rad; no
            candidates, no pieces.
        T_base_tip: the pose; without it, the one that the first candidate reaches.
        step_rad: longest step along the curves.

    Raises:
        ConfigurationError: when a candidate has another shape, is not finite, is outside the limits
            or misses the pose by more than `POSE_MISMATCH`; by index.
        RequestError: when the step is not allowed, candidates are no iterable or more than
            `MAX_CANDIDATES`, or `arm` is no arm.
        PoseError: when `T_base_tip` is no pose.
    """
    expect(arm, Arm, "arm", RequestError)
    step_rad = checked_step(step_rad)
    given = _listed(candidates)
    checked = [arm.limits.check(q, f"candidates[{i}]") for i, q in enumerate(given)]
    if not checked:
        return ()
    pose = arm.T_base_tip(checked[0]) if T_base_tip is None else checked_pose(T_base_tip)
    solution_curve = SolutionCurve(arm, pose)
    _check_same_pose(solution_curve, checked)
    return pieces_through(solution_curve, np.array(checked), step_rad)


def solutions(
    ik: IKService,
    T_base_tip: PoseLike,
    *,
    starts: int = STARTS,
    rng: np.random.Generator | None = None,
    step_rad: float = STEP_RAD,
) -> tuple[SelfMotion, ...]:
    """The distinct ways to reach a pose; ordered as `distinct_solutions`.

    Found from a sweep of closed forms over s0 (`baxter_kin.ik.reach.closed_form`), which visits
    all loops near the limits, and from random seeds besides. Nothing is found when the pose has no
    solution.

    Args:
        ik: the service of the arm; its searches start from the random seeds, drawn uniformly inside
            the limits.
        T_base_tip: the pose.
        starts: how many seeds.
        rng: draws the seeds; without it, the same ones every time.
        step_rad: longest step along the curves.

    Raises:
        RequestError: when `starts` is not a whole number from 1 to `MAX_CANDIDATES`, the step is
            not allowed, or `ik` or `rng` is of another class.
        PoseError: when `T_base_tip` is no pose.
    """
    step_rad = checked_step(step_rad)
    count = whole_scalar(starts, "starts", RequestError, least=1, most=MAX_CANDIDATES)
    expect(ik, IKService, "ik", RequestError)
    pose = checked_pose(T_base_tip)
    generator = np.random.default_rng(0) if rng is None else rng
    expect(generator, np.random.Generator, "rng", RequestError)
    return all_pieces(ik.arm, ik.search, pose, step_rad, starts=count, rng=generator)


def _listed(candidates: Iterable[ArrayLike]) -> list[ArrayLike]:
    """All candidates, unless they are too many or never end."""
    if not isinstance(candidates, Iterable):
        raise RequestError(f"candidates must be an iterable, got {type(candidates).__name__}")
    given = list(islice(candidates, MAX_CANDIDATES + 1))
    if len(given) > MAX_CANDIDATES:
        raise RequestError(f"at most {MAX_CANDIDATES} candidates may come, got more")
    return given


def _check_same_pose(solution_curve: SolutionCurve, candidates: list[FloatArray]) -> None:
    for i, q in enumerate(candidates):
        miss = float(np.linalg.norm(solution_curve.error(q)))
        if miss > POSE_MISMATCH:
            raise ConfigurationError(
                f"candidates[{i}] misses the pose by {miss:.3g} (m and rad together); allowed is "
                f"{POSE_MISMATCH:g}: all candidates must reach one pose"
            )


SLACK_RAD = 0.05
"""How far outside the limits a nearly exact configuration may be to be worth a search."""

MAX_TURNS = 10_000
"""Angles of s0 that may be asked for: 0.4 mrad apart, and a tenth of a second."""

DIGITS = 4
"""Samples that agree in so many digits of a radian are the same."""


def sample_solutions(ik: IKService, T_base_tip: PoseLike, *, turns: int = 48) -> FloatArray:
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
        RequestError: when `turns` is not a whole number from 1 to `MAX_TURNS`, or `ik` no service.
    """
    count = whole_scalar(turns, "turns", RequestError, least=1, most=MAX_TURNS)
    expect(ik, IKService, "ik", RequestError)
    Ts, arm, limits = checked_pose(T_base_tip).homogeneous[None], ik.arm, ik.arm.limits
    closed_form = ClosedForm(arm.at_gripper, turns=count, rolls=1)
    q, misfit = closed_form.configurations(Ts @ arm.T_gripper_tip.inverse().homogeneous)
    inside = q[0].clip(limits.q_min, limits.q_max)
    is_near = (misfit[0] == 0.0) & (np.abs(q[0] - inside).max(axis=1) <= SLACK_RAD)
    starts: FloatArray = inside[is_near]
    if not len(starts):
        return starts
    found = ik.search.search(starts, np.repeat(Ts, len(starts), axis=0))
    solved = found.q[found.is_valid]
    _, first = np.unique(solved.round(DIGITS), axis=0, return_index=True)
    samples: FloatArray = solved[np.sort(first)]
    return samples
