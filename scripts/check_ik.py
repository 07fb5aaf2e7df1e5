"""Check inverse kinematics with random poses in reach, out of reach, and on calibrated robots.

    python scripts/check_ik.py [poses] [--count 200000] [--seed 0] [--limb left|right] [--urdf FILE]
    python scripts/check_ik.py reach [--count 1000] [--grid 0.025]
    python scripts/check_ik.py solutions [--count 500] [--restarts 2000]
    python scripts/check_ik.py calibrations [--count 2000] [--robots 100]

`poses`: solves reachable poses without a seed. The poses come from configurations, mostly hard
ones: uniform, 1 to 7 joints at limits, all 128 corners of the joint ranges and their neighbourhood,
right angles, singular, nearly singular, and the last two with up to four joints at limits. It is an
error if a pose remains unsolved, is "proven" out of reach, or has a solution that is off by more
than 1e-6 m or rad (by Pinocchio on the whole robot's URDF) or outside the limits.

`reach`: from a random reachable pose the tip moves in a random direction with constant orientation
until no search from 256 random seeds succeeds any more; the requested pose lies 1e-6 to 0.06 m
beyond, uniform in the logarithm. It is an error if for more than 1 % of the poses there is no
solution, no proof that they are out of reach and no reachable position within 1 mm, or if a proof
contradicts a solution. With `--grid`, it instead measures the time for a pose out of reach, on a
grid of that spacing (m) around the arm, the gripper pointing down.

`solutions`: each pose is also solved from many random seeds by the searches of the IK service. The
result of `solutions` must contain (within 1e-3 rad) every solution found this way that lies on a
piece longer than 0.05 rad. `solve(objective=...)` must not be worse by 1e-3 than any of these
solutions, nor than points 0.005 rad apart on all pieces, for each kind of objective. No curve may
miss its pose or leave the limits.

`calibrations`: solves reachable poses with randomly calibrated robots, alternating with the stock
robot. Each robot's URDF is made by `served_urdf.py`: origins and axes of all joints are off by up
to 5 mm and 10 mrad. Errors are those of `poses`.

The exit status is 1 when there is an error.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from itertools import product
from time import perf_counter

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from served_urdf import served_urdf

from baxter_kin import Arm, Baxter, IKResult, IKService
from baxter_kin.command_line import urdf_file
from baxter_kin.ik import (
    FarthestFromLimits,
    MostManipulable,
    NearestTo,
    SelfMotion,
    solutions,
    trace_self_motion,
)
from baxter_kin.ik.search.ipopt import IpoptSearcher
from baxter_kin.ik.seeds import NullSpaceMap

FloatArray = NDArray[np.float64]

TOLERANCE = 1e-6
BLOCK = 20_000
SINGULAR = 1e-9
"""Least singular value of a Jacobian that counts as singular."""

NEWTON_STEPS, DIFFERENCE_RAD, LONGEST_STEP_RAD = 8, 1e-6, 0.5
NEAR_CORNER_RAD = 1e-3

BEYOND_M = 1e-6, 0.06
STEP_M, RESOLUTION_M, LONGEST_M = 0.1, 1e-8, 2.5
ROUNDS, RESTARTS = 8, 256
NEAR_ENOUGH_M, MAX_MISSED = 1e-3, 0.01

AT_LIMITS = 0.3
"""Share of the poses of `solutions` with joints at limits."""

MIN_LENGTH_RAD, HELD_RAD = 0.05, 1e-3
WORSE, DENSE_RAD = 1e-3, 0.005
RESIDUAL = 1e-10
"""Maximum error of a point of a curve, norm of m and rad. (Where several joints reach limits at
once, up to rounding, all are set to them.)"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one check for each arm; returns the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("check", nargs="?", choices=CHECKS, default="poses")
    parser.add_argument("--count", type=int, help="poses per arm (default: see above)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--limb", choices=("left", "right"), action="append")
    parser.add_argument("--urdf", type=urdf_file, metavar="FILE", help="of another Baxter")
    parser.add_argument("--grid", type=float, metavar="M", help="time a grid of poses out of reach")
    parser.add_argument("--restarts", type=int, default=2_000, help="seeds per pose")
    parser.add_argument("--robots", type=int, default=100, help="calibrated at random")
    given = parser.parse_args(argv)
    robot = Baxter.load(given.urdf)
    check, given.count = CHECKS[given.check][0], given.count or CHECKS[given.check][1]
    # with equal seeds the poses of one arm would mirror those of the other
    services = {side: IKService(robot.arm(side)) for side in given.limb or ("left", "right")}
    is_right = [
        check(robot, ik, given, np.random.default_rng([given.seed, side == "right"]))
        for side, ik in services.items()
    ]
    return 0 if all(is_right) else 1


# Poses in reach


def poses(
    robot: Baxter, ik: IKService, given: argparse.Namespace, rng: np.random.Generator
) -> bool:
    """Solve poses of each family and print a row for each; whether all are solved correctly."""
    print("| arm | poses | count | unsolved | false proofs | wrong | worst m | worst rad | us |")
    print("|---|---|---:|---:|---:|---:|---:|---:|---:|")
    is_right = True
    for family, q_known in configurations(ik.arm, given.count, rng):
        counts, worst, seconds = Counter[str](), np.zeros(2), 0.0
        for at in range(0, len(q_known), BLOCK):
            block = q_known[at : at + BLOCK]
            Ts = [tip(robot, ik.arm, q) for q in block]
            began_s = perf_counter()
            results = ik.solve_batch(Ts)
            seconds += perf_counter() - began_s
            for T, q, result in zip(Ts, block, results, strict=True):
                if result.failure is not None:
                    counts["unsolved"] += 1
                    counts["proven"] += result.failure.beyond_reach_m > 0.0
                    text = f"{ik.arm.side}, {family}: {q.tolist()}: {result.failure}"
                    print(text, file=sys.stderr)
                    continue
                errors = residuals(robot, ik.arm, T, result)
                worst = np.maximum(worst, errors)
                counts["wrong"] += not (errors <= TOLERANCE).all()
        is_right &= not any(counts.values())
        print(
            f"| {ik.arm.side} | {family} | {len(q_known):,} | {counts['unsolved']} | "
            f"{counts['proven']} | {counts['wrong']} | {worst[0]:.1e} | {worst[1]:.1e} | "
            f"{1e6 * seconds / len(q_known):.0f} |",
            flush=True,
        )
    return is_right


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
    """Names of the families and their configurations, shape (n, 7), rad."""
    tenth, many = round(0.1 * count), round(0.35 * count)
    yield "uniform", uniform(arm, tenth, rng)
    yield "joints at limits", at_limits(arm, uniform(arm, many, rng), rng)
    yield "corners", corners(arm, count - many - 6 * tenth, rng)
    yield "right angles", right_angles(arm, tenth, rng)
    for where, most in (("", 0), (" at limits", 4)):
        yield f"singular{where}", singular(arm, tenth, rng, most)[0]
        q, is_free = singular(arm, tenth, rng, most)
        away = 10.0 ** rng.uniform(-8.0, -1.0, (len(q), 1)) * rng.normal(size=q.shape)
        near = (q + is_free * away).clip(arm.limits.q_min, arm.limits.q_max)
        yield f"nearly singular{where}", near


def uniform(arm: Arm, count: int, rng: np.random.Generator) -> FloatArray:
    """Configurations between the limits, shape (n, 7), rad."""
    return rng.uniform(arm.limits.q_min, arm.limits.q_max, (count, 7))


def at_limits(arm: Arm, q: FloatArray, rng: np.random.Generator, most: int = 7) -> FloatArray:
    """The configurations with one to `most` joints set to a limit."""
    ends = np.where(rng.random(q.shape) < 0.5, arm.limits.q_min, arm.limits.q_max)
    rank = rng.random(q.shape).argsort(axis=1)
    moved: FloatArray = np.where(rank < rng.integers(1, most + 1, (len(q), 1)), ends, q)
    return moved


def corners(arm: Arm, count: int, rng: np.random.Generator) -> FloatArray:
    """All 128 corners, and configurations close to them on the inside."""
    exact = np.array(list(product(*zip(arm.limits.q_min, arm.limits.q_max, strict=True))))
    chosen = exact[rng.integers(len(exact), size=max(count - len(exact), 0))]
    inwards = np.where(chosen == arm.limits.q_min, 1.0, -1.0)
    near: FloatArray = chosen + inwards * rng.uniform(0.0, NEAR_CORNER_RAD, chosen.shape)
    return np.concatenate([exact, near])


def right_angles(arm: Arm, count: int, rng: np.random.Generator) -> FloatArray:
    """Configurations with most joints at multiples of a quarter turn."""
    q = uniform(arm, count, rng)
    angles = 0.5 * np.pi * rng.integers(-2, 3, q.shape)
    is_inside = (angles >= arm.limits.q_min) & (angles <= arm.limits.q_max)
    turned: FloatArray = np.where(is_inside & (rng.random(q.shape) < 0.8), angles, q)
    return turned


def singular(
    arm: Arm, count: int, rng: np.random.Generator, most_at_limits: int
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Configurations where the Jacobian is rank deficient, and which joints are off their limits.

    By Newton's method on the products of the Jacobian with its last left singular vector and its
    last two right ones, from random configurations; joints at limits stay there.
    """
    found: list[tuple[FloatArray, NDArray[np.bool_]]] = []
    while sum(len(q) for q, _ in found) < count or not found:
        q = uniform(arm, max(count // 2, 50), rng)
        if most_at_limits:
            q = at_limits(arm, q, rng, most_at_limits)
        is_free = (q > arm.limits.q_min) & (q < arm.limits.q_max)
        for _ in range(NEWTON_STEPS):
            q = q + is_free * towards_singularity(arm, q, is_free)
        is_inside = ((q >= arm.limits.q_min) & (q <= arm.limits.q_max)).all(axis=1)
        lowest = np.linalg.svd(jacobians(arm, q), compute_uv=False)[:, -1]
        kept = is_inside & (lowest <= SINGULAR)
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


def jacobians(arm: Arm, q: FloatArray) -> FloatArray:
    """At configurations, shape (n, 7): shape (n, 6, 7)."""
    return np.array([arm.jacobian(each) for each in q]).reshape(-1, 6, 7)


# Poses out of reach


def reach(_: Baxter, ik: IKService, given: argparse.Namespace, rng: np.random.Generator) -> bool:
    """Request poses a little out of reach; whether few are missed and no proof is false."""
    if given.grid is not None:
        print(f"{ik.arm.side}: {cost_of_grid(ik, given.grid)}")
        return True
    nearest = IpoptSearcher(ik.arm, NullSpaceMap(ik.arm), is_nearest=True)
    kinds: Counter[str] = Counter()
    while kinds.total() < given.count:
        edge = boundary(ik, rng)
        if edge is not None:
            away_m = np.exp(rng.uniform(*np.log(BEYOND_M)))
            kinds[kind(ik, nearest, moved(edge[0], away_m * edge[1]))] += 1
    print(f"{ik.arm.side}: " + ", ".join(f"{n} {each}" for each, n in kinds.most_common()))
    return kinds["missed"] <= MAX_MISSED * given.count and not kinds["false proof"]


def cost_of_grid(ik: IKService, spacing_m: float) -> str:
    """The time for a pose out of reach on a grid, as text."""
    x, z = (np.arange(low, 1.4, spacing_m) for low in (-0.6, -0.9))
    y = np.arange(-0.8, 1.5, spacing_m) * (1.0 if ik.arm.side == "left" else -1.0)
    points = np.stack(np.meshgrid(x, y, z), axis=-1).reshape(-1, 3)
    Ts = np.tile(np.diag([-1.0, 1.0, -1.0, 1.0]), (len(points), 1, 1))
    Ts[:, :3, 3] = points
    is_out = np.array([not result.is_valid for result in ik.solve_batch(Ts)])
    began_s = perf_counter()
    ik.solve_batch(Ts[is_out])
    mean_us = 1e6 * (perf_counter() - began_s) / is_out.sum()
    return f"{mean_us:.1f} us for each of {is_out.sum()} of {len(Ts)} poses out of reach"


def boundary(ik: IKService, rng: np.random.Generator) -> tuple[pin.SE3, FloatArray] | None:
    """The last reachable pose in a random direction, and the direction (3,); None if not found."""
    q = ik.arm.random_configuration(rng)
    T, outward = ik.arm.T_base_tip(q), rng.normal(size=3)
    outward /= np.linalg.norm(outward)
    inside_m = 0.0
    for _ in range(ROUNDS):
        step_m = STEP_M  # single searches, each from the last solution
        while step_m > RESOLUTION_M and inside_m < LONGEST_M:
            found = ik.search.search(
                q[None], moved(T, (inside_m + step_m) * outward).homogeneous[None]
            )
            if found.is_valid[0]:
                inside_m, q = inside_m + step_m, found.q[0]
            else:
                step_m *= 0.5
        beyond_m = inside_m + RESOLUTION_M
        if beyond_m > LONGEST_M:
            return None
        others = restarted(ik, moved(T, beyond_m * outward), RESTARTS, rng)
        if not len(others):
            return moved(T, inside_m * outward), outward
        inside_m, q = beyond_m, others[0]
    return None


def moved(T: pin.SE3, by: FloatArray) -> pin.SE3:
    """A pose translated by a vector (3,) in base."""
    return pin.SE3(T.rotation, T.translation + by)


def restarted(ik: IKService, T: pin.SE3, count: int, rng: np.random.Generator) -> FloatArray:
    """Solutions from random seeds, shape (n, 7), rad."""
    Ts = np.repeat(T.homogeneous[None], count, axis=0)
    found = ik.search.search(uniform(ik.arm, count, rng), Ts)
    valid: FloatArray = found.q[found.is_valid]
    return valid


def kind(ik: IKService, nearest: IpoptSearcher, T: pin.SE3) -> str:
    """The kind of the service's answer for a pose."""
    result = ik.solve(T)
    if result.failure is None:
        return "solved"
    if result.failure.beyond_reach_m > 0.0:
        found = nearest.search(result.q[None], T.homogeneous[None])
        within_m = float(found.position_error_m[0])
        is_false = found.orientation_error_rad[0] < 1e-9 and (
            within_m < result.failure.beyond_reach_m
        )
        return "false proof" if is_false else "proven"
    if is_near(ik.arm, T, result):
        return "within 1 mm"
    numbers = np.append(T.translation, pin.Quaternion(T.rotation).coeffs()).tolist()
    print(f"{ik.arm.side} missed {numbers}: {result.failure}", file=sys.stderr)
    return "missed"


def is_near(arm: Arm, T: pin.SE3, result: IKResult) -> bool:
    """Whether the reported nearest position is correct and near enough."""
    told_m = None if result.failure is None else result.failure.nearest_m
    reached = arm.T_base_tip(result.q)
    away_m = float(np.linalg.norm(reached.translation - T.translation))
    turned = float(np.linalg.norm(pin.log3(T.rotation.T @ reached.rotation)))
    is_told = told_m is not None and abs(told_m - away_m) < 1e-9 and turned < 1e-6
    return is_told and away_m <= NEAR_ENOUGH_M


# All solutions of a pose


def all_solutions(
    _: Baxter, ik: IKService, given: argparse.Namespace, rng: np.random.Generator
) -> bool:
    """Compare complete solution sets with random restarts; whether nothing is missing or worse."""
    arm, rows, worse = ik.arm, [], []
    for i in range(given.count):
        q_known = uniform(arm, 1, rng)
        q_known = at_limits(arm, q_known, rng, 4) if i < AT_LIMITS * given.count else q_known
        T = arm.T_base_tip(q_known[0])
        began_s = perf_counter()
        curves = solutions(ik, T)
        took_s = perf_counter() - began_s
        reference = np.concatenate([q_known, restarted(ik, T, given.restarts, rng)])
        missing = missing_lengths(arm, curves, reference)
        for length in missing:
            print(f"{arm.side}: {q_known[0].tolist()}: missed {length:.3g} rad", file=sys.stderr)
        is_out = [((c.q < arm.limits.q_min) | (c.q > arm.limits.q_max)).any() for c in curves]
        residual = max((worst_residual(arm, T, curve) for curve in curves), default=0.0)
        rows.append((len(curves), len(missing), residual, sum(is_out), took_s))
        dense = np.concatenate([reference, *(c.q for c in solutions(ik, T, step_rad=DENSE_RAD))])
        worse.append([by_how_much_worse(ik, T, each, dense) for each in objectives(arm, rng)])
    pieces, missing_, residuals_, outside, took = np.array(rows).T
    print(
        f"{arm.side}: {given.count:,} poses, {pieces.sum():,.0f} pieces, {missing_.sum():.0f} "
        f"missing, worst residual {residuals_.max():.1e}, {outside.sum():.0f} outside the limits, "
        f"{spread(took)}"
    )
    for each, values in zip(objectives(arm, rng), np.array(worse).swapaxes(0, 1), strict=True):
        by, seconds = values.T
        count = (by > WORSE).sum()
        name = type(each).__name__
        print(f"  {name}: worse by {by.max():.1e}, by {WORSE:g} {count} times, {spread(seconds)}")
    is_complete = not (missing_.any() or outside.any() or residuals_.max() > RESIDUAL)
    return bool(is_complete and np.max(worse, axis=0)[:, 0].max() <= WORSE)


def spread(seconds: FloatArray) -> str:
    """Median and 95 % quantile of times, as text."""
    middle, late = 1e3 * np.percentile(seconds, [50, 95])
    return f"{middle:.1f} ms (median), {late:.1f} ms (95 %)"


def objectives(arm: Arm, rng: np.random.Generator) -> tuple[NearestTo | FarthestFromLimits, ...]:
    """One objective of each kind."""
    return NearestTo(arm.random_configuration(rng)), FarthestFromLimits(), MostManipulable()


def by_how_much_worse(
    ik: IKService, T: pin.SE3, kind: NearestTo | FarthestFromLimits, dense: FloatArray
) -> tuple[float, float]:
    """How much better the best of dense samples, shape (n, 7), is; and the service's time, s."""
    began_s = perf_counter()
    result = ik.solve(T, objective=kind)
    took_s = perf_counter() - began_s
    found = kind.costs(ik.arm, result.q[None])[0] if result.is_valid else np.inf
    return max(float(found - kind.costs(ik.arm, dense).min()), 0.0), took_s


def missing_lengths(arm: Arm, curves: tuple[SelfMotion, ...], reference: FloatArray) -> list[float]:
    """Lengths (rad) of long pieces through solutions, shape (n, 7), that the curves miss."""
    lengths, left = [], reference
    for curve in curves:
        left = left[distances(curve, left) > HELD_RAD]
    while len(left):
        curve = trace_self_motion(arm, left[0], step_rad=0.05)
        if curve.length_rad > MIN_LENGTH_RAD:
            lengths.append(curve.length_rad)
        left = left[1:][distances(curve, left[1:]) > HELD_RAD]
    return lengths


def distances(curve: SelfMotion, q: FloatArray) -> FloatArray:
    """From configurations, shape (n, 7), to the polygon through a curve, shape (n,), rad."""
    if len(curve.q) == 1:
        return np.linalg.norm(q - curve.q[0], axis=1)
    nearest = np.full(len(q), np.inf)
    for start, chord in zip(curve.q, np.diff(curve.q, axis=0), strict=False):
        share = ((q - start) @ chord / (chord @ chord)).clip(0.0, 1.0)
        off = np.linalg.norm(q - start - share[:, None] * chord, axis=1)
        nearest = np.minimum(nearest, off)
    return nearest


def worst_residual(arm: Arm, T: pin.SE3, curve: SelfMotion) -> float:
    """Largest error of points on a curve, by Pinocchio: norm of m and rad."""
    between = [curve.at(s) for s in np.linspace(0.0, curve.length_rad, 7)]
    if curve.length_rad == 0.0:  # an isolated solution, as a search returned it
        T = curve.T_base_tip
    misses = (pin.log6(T.actInv(arm.T_base_tip(q))).vector for q in [*curve.q[::5], *between])
    return max(float(np.linalg.norm(miss)) for miss in misses)


# Calibrated robots


def calibrations(
    robot: Baxter, stock: IKService, given: argparse.Namespace, rng: np.random.Generator
) -> bool:
    """Solve poses of calibrated robots and of the stock robot; whether all are solved correctly."""
    bad, ratios, ready_s, side = 0, [], [], stock.arm.side
    for number in range(given.robots):
        robot = Baxter.load(served_urdf(rng))
        began_s = perf_counter()
        own = IKService(robot.arm(side))
        ready_s.append(perf_counter() - began_s)
        wrong, times_s = 0, np.empty((given.count, 2))
        for i, q in enumerate(uniform(own.arm, given.count, rng)):
            for column in (0, 1) if i % 2 else (1, 0):
                ik = (own, stock)[column]
                T = ik.arm.T_base_tip(q)
                began_s = perf_counter()
                result = ik.solve(T)
                times_s[i, column] = perf_counter() - began_s
                if ik is own:
                    errors = residuals(robot, own.arm, T, result)
                    wrong += not (result.is_valid and (errors <= TOLERANCE).all())
        own_s, stock_s = np.median(times_s, axis=0)
        ratios.append(own_s / stock_s)
        bad += wrong
        if wrong:
            print(f"robot {number}, {side}: {wrong} poses", file=sys.stderr)
    print(
        f"{side}: {given.robots:,} robots, {given.robots * given.count:,} poses: {bad} unsolved or "
        f"wrong; median time over that of the stock robot {np.median(ratios):.3f} (median of "
        f"robots), {max(ratios):.3f} (most); ready in {np.median(ready_s):.2f} s (median), "
        f"{max(ready_s):.2f} s (most)"
    )
    return not bad


Check = Callable[[Baxter, IKService, argparse.Namespace, np.random.Generator], bool]

CHECKS: dict[str, tuple[Check, int]] = {
    "poses": (poses, 200_000),
    "reach": (reach, 1_000),
    "solutions": (all_solutions, 500),
    "calibrations": (calibrations, 2_000),
}
"""The checks, and their default numbers of poses."""

if __name__ == "__main__":
    sys.exit(main())
