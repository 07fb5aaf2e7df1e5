"""The distinct ways to reach a pose: the connected pieces of its self-motion.

Two configurations of a pose belong to the same piece if the arm can move from one to the other with
the tip at rest and every joint inside its limits: if one lies on the curve through the other. With
the limits ignored, the pieces join to a few loops: 4 for 17 of 40 random poses of Baxter, 15 at
most; at most 16 for any arm of seven joints (Burdick, "On the inverse kinematics of redundant
manipulators", 1989). So one candidate leads to every piece of its loop, however small.
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
"""Maximum number of candidates, and of starts: a second or two of work."""

SLACK_RAD = 0.05
"""How far outside the limits a nearly exact configuration may be to start a search."""

MAX_TURNS = 10_000
"""Maximum number of angles of s0: 0.4 mrad apart, a tenth of a second of work."""

DIGITS = 4
"""Samples that agree in so many digits of a radian count as equal."""


def distinct_solutions(
    arm: Arm,
    candidates: Iterable[ArrayLike],
    *,
    T_base_tip: PoseLike | None = None,
    step_rad: float = STEP_RAD,
) -> tuple[SelfMotion, ...]:
    """The distinct connected pieces of one pose's self-motion, found from candidates.

    These are all pieces that contain candidates, and all others of the same loops
    (`baxter_kin.ik.self_motion.continuation`); loops without a candidate are missed.

    Ordered by length, the longest first, then by the lowest joint values on them, joint by joint
    from the shoulder. The order does not depend on that of the candidates.

    Args:
        arm: the arm.
        candidates: configurations that reach the pose inside the limits, shape (7,) each, rad; may
            be empty.
        T_base_tip: the pose; by default the one that the first candidate reaches.
        step_rad: longest step along the curves.
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
    """The distinct ways to reach a pose, in the order of `distinct_solutions`.

    They are found from a sweep of closed forms over s0 (`baxter_kin.ik.reach.closed_form`), which
    visits all loops near the limits, and from random seeds. The result is empty if the pose has no
    solution.

    Args:
        ik: the service of the arm; its searches start from the random seeds, drawn uniformly inside
            the limits.
        T_base_tip: the pose.
        starts: number of seeds.
        rng: draws the seeds; by default they are the same every time.
        step_rad: longest step along the curves.
    """
    step_rad = checked_step(step_rad)
    count = whole_scalar(starts, "starts", RequestError, least=1, most=MAX_CANDIDATES)
    expect(ik, IKService, "ik", RequestError)
    pose = checked_pose(T_base_tip)
    generator = np.random.default_rng(0) if rng is None else rng
    expect(generator, np.random.Generator, "rng", RequestError)
    return all_pieces(ik.arm, ik.search, pose, step_rad, starts=count, rng=generator)


def _listed(candidates: Iterable[ArrayLike]) -> list[ArrayLike]:
    """The candidates as a list; refused if they are too many or never end."""
    if not isinstance(candidates, Iterable):
        raise RequestError(f"candidates must be an iterable, got {type(candidates).__name__}")
    given = list(islice(candidates, MAX_CANDIDATES + 1))
    if len(given) > MAX_CANDIDATES:
        raise RequestError(f"at most {MAX_CANDIDATES} candidates are allowed, got more")
    return given


def _check_same_pose(solution_curve: SolutionCurve, candidates: list[FloatArray]) -> None:
    for i, q in enumerate(candidates):
        miss = float(np.linalg.norm(solution_curve.error(q)))
        if miss > POSE_MISMATCH:
            raise ConfigurationError(
                f"candidates[{i}] misses the pose by {miss:.3g} (m and rad together); allowed is "
                f"{POSE_MISMATCH:g}: all candidates must reach one pose"
            )


def sample_solutions(ik: IKService, T_base_tip: PoseLike, *, turns: int = 48) -> FloatArray:
    """A sample of the solution set of a pose: one solution for each branch and angle of s0.

    Unlike `solutions`, which traces the set, this takes about two milliseconds and does not show
    how the solutions are connected.

    Args:
        ik: the service of the arm.
        T_base_tip: the pose of its tip, as for `IKService.solve`.
        turns: number of angles of s0 that are tried, in equal steps over its range.

    Returns:
        Shape (n, 7), rad; empty if none was found.
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
