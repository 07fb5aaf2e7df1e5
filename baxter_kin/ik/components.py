"""The distinct ways to reach a pose: connected pieces of its self-motion.

Two configurations of a pose are the same way of reaching it when the arm can move from one to the
other with the tip at rest and every joint inside its limits: when one lies on the curve through the
other. With the limits ignored, the pieces join to a few loops: 2 or 4 for most poses of Baxter, at
most 16 for any arm of seven joints (Burdick, "On the inverse kinematics of redundant manipulators",
1989). So one candidate leads to every piece of its loop, however small.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import islice

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin.arrays import Vector, whole_scalar
from baxter_kin.errors import ConfigurationError, RequestError, expect
from baxter_kin.frames import PoseLike, checked_pose
from baxter_kin.ik.fibre import PoseFibre
from baxter_kin.ik.loop import inside_limits
from baxter_kin.ik.self_motion import (
    POSE_MISMATCH,
    STEP_RAD,
    SelfMotion,
    checked_step,
    trace_self_motion,
)
from baxter_kin.ik.service import IKService
from baxter_kin.model import Arm

SAME_CURVE_RAD = 1e-4
"""How near to a curve a candidate lies on it. Candidates reach the pose to 1e-6 only, which moves
them up to 100 times as far where the Jacobian is weak; pieces are much farther apart."""

STARTS = 64
"""Random seeds from which `solutions` gathers its candidates."""

MOST_CANDIDATES = 2_000
"""How many candidates may come, and so how many starts: a second or two of work."""


def distinct_solutions(
    arm: Arm,
    candidates: Iterable[ArrayLike],
    *,
    T_base_tip: PoseLike | None = None,
    step_rad: float = STEP_RAD,
) -> tuple[SelfMotion, ...]:
    """The distinct connected pieces of one pose's self-motion, found from candidates.

    All pieces on which candidates lie, and all others of the same loops (`baxter_kin.ik.loop`);
    loops without a candidate are missed.

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
            `MOST_CANDIDATES`, or `arm` is no arm.
        PoseError: when `T_base_tip` is no pose.
    """
    expect(arm, Arm, "arm", RequestError)
    step_rad = checked_step(step_rad)
    given = _listed(candidates)
    checked = [arm.limits.check(q, f"candidates[{i}]") for i, q in enumerate(given)]
    if not checked:
        return ()
    pose = arm.T_base_tip(checked[0]) if T_base_tip is None else checked_pose(T_base_tip)
    _check_same_pose(arm, pose, checked)
    curves: list[SelfMotion] = []
    for q in checked:
        if not _is_known(curves, q):
            curves.append(_traced(arm, q, pose, step_rad))
            _add_pieces_of_loop(curves, step_rad)
    return tuple(sorted(curves, key=_order))


def solutions(
    ik: IKService,
    T_base_tip: PoseLike,
    *,
    starts: int = STARTS,
    rng: np.random.Generator | None = None,
    step_rad: float = STEP_RAD,
) -> tuple[SelfMotion, ...]:
    """The distinct ways to reach a pose, found from random seeds; ordered as `distinct_solutions`.

    A loop of which only a small share is inside the limits may be missed; more starts find more.
    Nothing is found when the pose has no solution.

    Args:
        ik: solves for the candidates; each request has one seed, drawn uniformly inside the limits.
        T_base_tip: the pose.
        starts: how many seeds.
        rng: draws the seeds; without it, the same ones every time.
        step_rad: longest step along the curves.

    Raises:
        RequestError: when `starts` is not a whole number from 1 to `MOST_CANDIDATES`, the step is
            not allowed, or `ik` or `rng` is of another class.
        PoseError: when `T_base_tip` is no pose.
    """
    count = whole_scalar(starts, "starts", RequestError, least=1, most=MOST_CANDIDATES)
    expect(ik, IKService, "ik", RequestError)
    pose = checked_pose(T_base_tip)
    generator = np.random.default_rng(0) if rng is None else rng
    expect(generator, np.random.Generator, "rng", RequestError)
    candidates = _gathered(ik, pose, count, generator)
    return distinct_solutions(ik.arm, candidates, T_base_tip=pose, step_rad=step_rad)


def _gathered(
    ik: IKService, pose: pin.SE3, starts: int, rng: np.random.Generator
) -> Iterator[Vector]:
    for _ in range(starts):
        result = ik.solve(pose, seed=ik.arm.random_configuration(rng))
        if result.is_valid:
            yield result.q


def _listed(candidates: Iterable[ArrayLike]) -> list[ArrayLike]:
    """All candidates, unless they are too many or never end."""
    if not isinstance(candidates, Iterable):
        raise RequestError(f"candidates must be an iterable, got {type(candidates).__name__}")
    given = list(islice(candidates, MOST_CANDIDATES + 1))
    if len(given) > MOST_CANDIDATES:
        raise RequestError(f"at most {MOST_CANDIDATES} candidates may come, got more")
    return given


def _check_same_pose(arm: Arm, pose: pin.SE3, candidates: list[Vector]) -> None:
    fibre = PoseFibre(arm, pose)
    for i, q in enumerate(candidates):
        miss = float(np.linalg.norm(fibre.error(q)))
        if miss > POSE_MISMATCH:
            raise ConfigurationError(
                f"candidates[{i}] misses the pose by {miss:.3g} (m and rad together); allowed is "
                f"{POSE_MISMATCH:g}: all candidates must reach one pose"
            )


def _traced(arm: Arm, q: Vector, pose: pin.SE3, step_rad: float) -> SelfMotion:
    """The curve through `q`; of the pose that `q` itself reaches where it cannot reach `pose`.

    That happens to pieces shorter than the candidates are exact, cornered between limits.
    """
    try:
        return trace_self_motion(arm, q, T_base_tip=pose, step_rad=step_rad)
    except ConfigurationError:
        return trace_self_motion(arm, q, step_rad=step_rad)


def _add_pieces_of_loop(curves: list[SelfMotion], step_rad: float) -> None:
    """Add what else there is of the loop of the last curve."""
    last = curves[-1]
    for q in inside_limits(last):
        if not _is_known(curves, q):
            piece = trace_self_motion(last.arm, q, T_base_tip=last.T_base_tip, step_rad=step_rad)
            curves.append(piece)


def _is_known(curves: list[SelfMotion], q: Vector) -> bool:
    return any(_may_hold(c, q) and c.nearest(q)[1] <= SAME_CURVE_RAD for c in curves)


def _may_hold(curve: SelfMotion, q: Vector) -> bool:
    """Whether a point of the curve is so near that `q` may lie between it and the next."""
    gap = float(np.diff(curve.s, append=curve.s[-1]).max())
    return bool(np.square(curve.q - q).sum(axis=1).min() <= (gap + SAME_CURVE_RAD) ** 2)


def _order(curve: SelfMotion) -> tuple[float, ...]:
    lowest = np.round(curve.q.min(axis=0), 3)
    return (-round(curve.length_rad, 3), *lowest.tolist())
