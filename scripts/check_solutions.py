"""Compare all solutions of poses, and the best of them, with solutions from random restarts.

    python scripts/check_solutions.py [--count 500] [--seed 0] [--restarts 2000] [--limb SIDE]
        [--urdf FILE]

Poses are made from configurations: uniform ones, and ones with one to four joints at limits. Each
pose is solved from so many random seeds, one by one, by the searches of the IK service. What
`solutions` returns must hold every solution found this way that lies on a piece longer than
0.05 rad; one counts as held within 1e-3 rad of a piece. `solve(objective=...)` must not be worse by
1e-3 than any of them, nor than points 0.005 rad apart on all pieces, for each kind of objective.
The exit status is 1 when a piece is missing, a curve misses its pose or leaves the limits, or an
objective has a better solution elsewhere.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from time import perf_counter
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin import Arm, Baxter, IKService
from baxter_kin.command_line import urdf_file
from baxter_kin.ik import (
    FarthestFromLimits,
    MostManipulable,
    NearestTo,
    SelfMotion,
    solutions,
    trace_self_motion,
)
from baxter_kin.ik.self_motion.objectives import Objective

FloatArray = NDArray[np.float64]

AT_LIMITS = 0.3
"""Share of the poses that have joints at limits."""

LEAST_LENGTH_RAD, HELD_RAD = 0.05, 1e-3
WORSE, DENSE_RAD = 1e-3, 0.005

RESIDUAL = 1e-10
"""Of a point of a curve, m and rad together: where several joints reach limits at once, up to
rounding, all are put on them."""


class CollisionSummary(NamedTuple):
    """What came of one pose."""

    pieces: int
    missing: int
    residual: float
    outside: int
    solutions_ms: float
    worse: tuple[float, ...]
    solve_ms: tuple[float, ...]


def main() -> int:
    """Print the tables; 1 when something is wrong."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--count", type=int, default=500, help="poses per arm")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--restarts", type=int, default=2_000, help="seeds per pose")
    parser.add_argument("--limb", choices=("left", "right"), action="append")
    parser.add_argument("--urdf", type=urdf_file, metavar="FILE", help="of another Baxter")
    given = parser.parse_args()
    robot, is_right = Baxter.load(given.urdf), True
    for side in given.limb or ("left", "right"):
        rng = np.random.default_rng([given.seed, side == "right"])  # or they would be mirrored
        ik = IKService(robot.arm(side))
        tallies = [
            summary(ik, q, given.restarts, rng) for q in configurations(ik.arm, given.count, rng)
        ]
        is_right &= report(side, tallies, objectives(ik.arm, rng))
    return 0 if is_right else 1


def report(side: str, tallies: list[CollisionSummary], kinds: list[Objective]) -> bool:
    """Print what came of one arm's poses; whether all is right."""
    columns = CollisionSummary(*zip(*tallies, strict=True))  # type: ignore[arg-type]
    middle, late = np.percentile(columns.solutions_ms, [50, 95])
    print("| arm | poses | pieces | missing | worst residual | outside limits | ms | p95 ms |")
    print("|---|---:|---:|---:|---:|---:|---:|---:|")
    pieces, missing, outside = (
        np.sum(c) for c in (columns.pieces, columns.missing, columns.outside)
    )
    residual = np.max(columns.residual)
    print(
        f"| {side} | {len(tallies):,} | {pieces:,} | {missing} | {residual:.1e} | {outside} | "
        f"{middle:.1f} | {late:.1f} |\n"
    )
    print("| arm | objective | worse by | poses worse by 1e-3 | ms | p95 ms |")
    print("|---|---|---:|---:|---:|---:|")
    worse, each_ms = np.array(columns.worse), np.array(columns.solve_ms)
    for kind, by, ms in zip(kinds, worse.T, each_ms.T, strict=True):
        middle, late = np.percentile(ms, [50, 95])
        print(
            f"| {side} | {type(kind).__name__} | {by.max():.1e} | {(by > WORSE).sum()} | "
            f"{middle:.1f} | {late:.1f} |"
        )
    print(flush=True)
    return not (missing or outside or residual > RESIDUAL or (worse > WORSE).any())


def summary(
    ik: IKService, q_known: FloatArray, restarts: int, rng: np.random.Generator
) -> CollisionSummary:
    """Compare for the pose of a known configuration, shape (7,), rad."""
    arm = ik.arm
    T = arm.T_base_tip(q_known)
    begin = perf_counter()
    curves = solutions(ik, T)
    seconds = perf_counter() - begin
    reference = np.concatenate([q_known[None], restarted(ik, T, restarts, rng)])
    lengths = missing_lengths(arm, curves, reference)
    for length in lengths:
        print(f"{arm.side}: {q_known.tolist()}: missed {length:.3g} rad", file=sys.stderr)
    outside = sum(
        int((c.q < arm.limits.q_min).any() or (c.q > arm.limits.q_max).any()) for c in curves
    )
    residual = max((worst_residual(arm, T, curve) for curve in curves), default=0.0)
    dense = np.concatenate([reference, *(c.q for c in solutions(ik, T, step_rad=DENSE_RAD))])
    compared = [compare(ik, T, kind, dense) for kind in objectives(arm, rng)]
    worse, each_ms = zip(*compared, strict=True)
    return CollisionSummary(
        len(curves), len(lengths), residual, outside, 1e3 * seconds, worse, each_ms
    )


def objectives(arm: Arm, rng: np.random.Generator) -> list[Objective]:
    """One of each kind."""
    return [NearestTo(arm.random_configuration(rng)), FarthestFromLimits(), MostManipulable()]


def compare(ik: IKService, T: pin.SE3, kind: Objective, dense: FloatArray) -> tuple[float, float]:
    """By how much the best of dense samples, shape (n, 7), is better; and the time, ms."""
    begin = perf_counter()
    result = ik.solve(T, objective=kind)
    each_ms = 1e3 * (perf_counter() - begin)
    found = kind.costs(ik.arm, result.q[None])[0] if result.is_valid else np.inf
    return max(float(found - kind.costs(ik.arm, dense).min()), 0.0), each_ms


def restarted(ik: IKService, T: pin.SE3, restarts: int, rng: np.random.Generator) -> FloatArray:
    """Solutions from random seeds, shape (n, 7), rad."""
    limits = ik.arm.limits
    seeds = rng.uniform(limits.q_min, limits.q_max, (restarts, 7))
    found = ik.search.search(seeds, np.repeat(T.homogeneous[None], restarts, axis=0))
    valid: FloatArray = found.q[found.is_valid]
    return valid


def missing_lengths(arm: Arm, curves: tuple[SelfMotion, ...], reference: FloatArray) -> list[float]:
    """Of long pieces that hold solutions, shape (n, 7), and are not among the curves; rad."""
    lengths, left = [], reference
    for curve in curves:
        left = left[distances(curve, left) > HELD_RAD]
    while len(left):
        curve = trace_self_motion(arm, left[0], step_rad=0.05)
        if curve.length_rad > LEAST_LENGTH_RAD:
            lengths.append(curve.length_rad)
        left = left[1:][distances(curve, left[1:]) > HELD_RAD]
    return lengths


def distances(curve: SelfMotion, q: FloatArray) -> FloatArray:
    """From configurations, shape (n, 7), to the polygon through a curve, shape (n,), rad."""
    chords = np.diff(curve.q, axis=0)
    if not len(chords):
        return np.linalg.norm(q - curve.q[0], axis=1)
    squares = np.square(chords).sum(axis=1)
    along = (q @ chords.T - (curve.q[:-1] * chords).sum(axis=1)) / squares
    share = along.clip(0.0, 1.0)
    starts = np.square(q).sum(axis=1)[:, None] - 2.0 * q @ curve.q[:-1].T
    starts += np.square(curve.q[:-1]).sum(axis=1)
    off = starts + squares * share * (share - 2.0 * along)
    nearest: FloatArray = np.sqrt(off.min(axis=1).clip(min=0.0))
    return nearest


def worst_residual(arm: Arm, T: pin.SE3, curve: SelfMotion) -> float:
    """By Pinocchio, of its points and a few between them, m and rad together."""
    between = [curve.at(s) for s in np.linspace(0.0, curve.length_rad, 7)]
    if curve.length_rad == 0.0:  # a solution as its search left it, cornered between limits
        T = curve.T_base_tip
    misses = (pin.log6(T.actInv(arm.T_base_tip(q))).vector for q in [*curve.q[::5], *between])
    return max(float(np.linalg.norm(miss)) for miss in misses)


def configurations(arm: Arm, count: int, rng: np.random.Generator) -> Iterator[FloatArray]:
    """Known ones, shape (7,) each, rad."""
    for i in range(count):
        q = arm.random_configuration(rng)
        if i < AT_LIMITS * count:
            held = rng.permutation(7)[: rng.integers(1, 5)]
            ends = np.where(rng.random(7) < 0.5, arm.limits.q_min, arm.limits.q_max)
            q = np.where(np.isin(np.arange(7), held), ends, q)
        yield q


if __name__ == "__main__":
    sys.exit(main())
