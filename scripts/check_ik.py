"""Solve poses that are known to be reachable, without a seed.

    python scripts/check_ik.py [--count 200000] [--seed 0] [--limb left|right]

Poses are made from configurations, the hard ones above all: uniform ones, 1 to 7 joints at limits,
all 128 corners of the joint ranges and what is close to them, right angles, singular ones, nearly
singular ones, and the last two with up to four joints at limits. Every solution is checked by
Pinocchio on the whole robot's URDF. The exit status is 1 when a pose is left unsolved, is proven
out of reach, or has a solution that is off by more than 1e-6 m or rad, or outside the limits.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from itertools import product
from time import perf_counter
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin import Arm, Baxter, IKResult, IKService
from baxter_kin.command_line import urdf_file

FloatArray = NDArray[np.float64]

SHARES = {
    "uniform": 0.1,
    "joints at limits": 0.35,
    "right angles": 0.1,
    "singular": 0.1,
    "nearly singular": 0.1,
    "singular at limits": 0.1,
    "nearly singular at limits": 0.1,
}
"""Of all poses; the rest are corners."""

TOLERANCE = 1e-6
BLOCK = 20_000
SINGULAR = 1e-9
"""Least singular value of a Jacobian that counts as singular."""

NEWTON_STEPS, DIFFERENCE_RAD, LONGEST_STEP_RAD = 8, 1e-6, 0.5

NEAR_CORNER_RAD = 1e-3


class Row(NamedTuple):
    """What came of one family of poses."""

    family: str
    count: int
    unsolved: int
    proven: int
    wrong: int
    worst_m: float
    worst_rad: float
    each_us: float


def main() -> int:
    """Print the table; 1 when something is wrong."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--count", type=int, default=200_000, help="poses per arm")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--limb", choices=("left", "right"), action="append")
    parser.add_argument("--urdf", type=urdf_file, metavar="FILE", help="of another Baxter")
    given = parser.parse_args()
    robot, is_right = Baxter.load(given.urdf), True
    print("| arm | poses | count | unsolved | false proofs | wrong | worst m | worst rad | us |")
    print("|---|---|---:|---:|---:|---:|---:|---:|---:|")
    for side in given.limb or ("left", "right"):
        for row in rows(robot, IKService(robot.arm(side)), given.count, given.seed):
            is_right &= not (row.unsolved or row.proven or row.wrong)
            print(
                f"| {side} | {row.family} | {row.count:,} | {row.unsolved} | {row.proven} | "
                f"{row.wrong} | {row.worst_m:.1e} | {row.worst_rad:.1e} | {row.each_us:.0f} |",
                flush=True,
            )
    return 0 if is_right else 1


def rows(robot: Baxter, ik: IKService, count: int, seed: int) -> Iterator[Row]:
    """One for each family."""
    for family, q in configurations(ik.arm, count, np.random.default_rng(seed)):
        yield row(robot, ik, family, q)


def row(robot: Baxter, ik: IKService, family: str, q_known: FloatArray) -> Row:
    """Solve the poses of known configurations, shape (n, 7), rad."""
    unsolved = proven = wrong = 0
    worst, seconds = np.zeros(2), 0.0
    for at in range(0, len(q_known), BLOCK):
        block = q_known[at : at + BLOCK]
        Ts = [tip(robot, ik.arm, q) for q in block]
        begin = perf_counter()
        results = ik.solve_batch(Ts)
        seconds += perf_counter() - begin
        for T, q, result in zip(Ts, block, results, strict=True):
            if result.is_valid:
                errors = residuals(robot, ik.arm, T, result)
                worst = np.maximum(worst, errors)
                wrong += not (errors <= TOLERANCE).all()
            else:
                unsolved += 1
                proven += result.failure is not None and result.failure.beyond_reach_m > 0.0
                print(f"{ik.arm.side}, {family}: {q.tolist()}: {result.failure}", file=sys.stderr)
    each_us = 1e6 * seconds / len(q_known)
    return Row(family, len(q_known), unsolved, proven, wrong, *worst.tolist(), each_us)


def tip(robot: Baxter, arm: Arm, q: FloatArray) -> pin.SE3:
    """The tip's pose by the whole robot's model."""
    data, full = robot.model.createData(), robot.configuration(arm.joints(q))
    pin.framesForwardKinematics(robot.model, data, full)
    return pin.SE3(data.oMf[robot.model.getFrameId(arm.tip_frame)])


def residuals(robot: Baxter, arm: Arm, T: pin.SE3, result: IKResult) -> FloatArray:
    """Distance (m) and angle (rad) of a solution; infinite outside the limits."""
    if ((result.q < arm.limits.q_min) | (result.q > arm.limits.q_max)).any():
        return np.full(2, np.inf)
    away = T.actInv(tip(robot, arm, result.q))
    return np.array([np.linalg.norm(away.translation), np.linalg.norm(pin.log3(away.rotation))])


def configurations(
    arm: Arm, count: int, rng: np.random.Generator
) -> Iterator[tuple[str, FloatArray]]:
    """The families, each with known configurations of shape (n, 7), rad."""
    counts = {family: round(share * count) for family, share in SHARES.items()}
    yield "uniform", uniform(arm, counts["uniform"], rng)
    yield "joints at limits", at_limits(arm, uniform(arm, counts["joints at limits"], rng), rng)
    yield "corners", corners(arm, count - sum(counts.values()), rng)
    yield "right angles", right_angles(arm, counts["right angles"], rng)
    for where, most in (("", 0), (" at limits", 4)):
        yield f"singular{where}", singular(arm, counts[f"singular{where}"], rng, most)[0]
        q, is_free = singular(arm, counts[f"nearly singular{where}"], rng, most)
        away = 10.0 ** rng.uniform(-8.0, -1.0, (len(q), 1)) * rng.normal(size=q.shape)
        near = (q + is_free * away).clip(arm.limits.q_min, arm.limits.q_max)
        yield f"nearly singular{where}", near


def uniform(arm: Arm, count: int, rng: np.random.Generator) -> FloatArray:
    """Between the limits."""
    return rng.uniform(arm.limits.q_min, arm.limits.q_max, (count, 7))


def at_limits(arm: Arm, q: FloatArray, rng: np.random.Generator, most: int = 7) -> FloatArray:
    """The same with one to `most` joints at a limit, either one."""
    ends = np.where(rng.random(q.shape) < 0.5, arm.limits.q_min, arm.limits.q_max)
    rank = rng.random(q.shape).argsort(axis=1)
    moved: FloatArray = np.where(rank < rng.integers(1, most + 1, (len(q), 1)), ends, q)
    return moved


def corners(arm: Arm, count: int, rng: np.random.Generator) -> FloatArray:
    """All 128, and configurations close to them on the inside."""
    exact = np.array(list(product(*zip(arm.limits.q_min, arm.limits.q_max, strict=True))))
    chosen = exact[rng.integers(len(exact), size=max(count - len(exact), 0))]
    inwards = np.where(chosen == arm.limits.q_min, 1.0, -1.0)
    near: FloatArray = chosen + inwards * rng.uniform(0.0, NEAR_CORNER_RAD, chosen.shape)
    return np.concatenate([exact, near])


def right_angles(arm: Arm, count: int, rng: np.random.Generator) -> FloatArray:
    """Most joints at multiples of a quarter turn, the others anywhere."""
    q = uniform(arm, count, rng)
    angles = 0.5 * np.pi * rng.integers(-2, 3, q.shape)
    is_inside = (angles >= arm.limits.q_min) & (angles <= arm.limits.q_max)
    turned: FloatArray = np.where(is_inside & (rng.random(q.shape) < 0.8), angles, q)
    return turned


def singular(
    arm: Arm, count: int, rng: np.random.Generator, most_at_limits: int
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Configurations where the Jacobian has lost a rank, and which of their joints are inside.

    By Newton's method on the products of the Jacobian with its last left singular vector and its
    last two right ones, from random configurations; joints at limits stay there.
    """
    found: list[tuple[FloatArray, NDArray[np.bool_]]] = []
    while sum(len(q) for q, _ in found) < count:
        q = uniform(arm, max(count // 2, 50), rng)
        if most_at_limits:
            q = at_limits(arm, q, rng, most_at_limits)
        is_free = (q > arm.limits.q_min) & (q < arm.limits.q_max)
        for _ in range(NEWTON_STEPS):
            q = q + is_free * towards_singularity(arm, q, is_free)
        is_inside = ((q >= arm.limits.q_min) & (q <= arm.limits.q_max)).all(axis=1)
        kept = is_inside & (least_singular_value(arm, q) <= SINGULAR)
        found.append((q[kept], is_free[kept]))
    q, is_free = (np.concatenate(each)[:count] for each in zip(*found, strict=True))
    return q, is_free


def towards_singularity(arm: Arm, q: FloatArray, is_free: NDArray[np.bool_]) -> FloatArray:
    """A Newton step, of least norm and not too long, shape (n, 7), rad."""
    J = jacobians(arm, q)
    U, _, Vt = np.linalg.svd(J)
    w, N = U[:, :, -1], Vt[:, 5:]
    residual = np.einsum("nij,ni,nkj->nk", J, w, N)
    slopes = np.empty((len(q), 2, 7))
    for joint in range(7):
        moved = jacobians(arm, q + DIFFERENCE_RAD * np.eye(7)[joint])
        slopes[:, :, joint] = np.einsum("nij,ni,nkj->nk", moved, w, N) - residual
    slopes *= is_free[:, None] / DIFFERENCE_RAD
    step = -np.einsum("njk,nk->nj", np.linalg.pinv(slopes, rcond=1e-6), residual)
    length = np.linalg.norm(step, axis=1, keepdims=True).clip(min=LONGEST_STEP_RAD)
    shortened: FloatArray = step * (LONGEST_STEP_RAD / length)
    return shortened


def least_singular_value(arm: Arm, q: FloatArray) -> FloatArray:
    """Of the Jacobians at configurations, shape (n, 7): shape (n,)."""
    values: FloatArray = np.linalg.svd(jacobians(arm, q), compute_uv=False)[:, -1]
    return values


def jacobians(arm: Arm, q: FloatArray) -> FloatArray:
    """At configurations, shape (n, 7): shape (n, 6, 7)."""
    return np.array([arm.jacobian(each) for each in q]).reshape(-1, 6, 7)


if __name__ == "__main__":
    sys.exit(main())
