"""Ask for poses a little out of reach: each shall be proven, or told how near the arm comes.

    python scripts/check_reach.py [--count 1000] [--seed 0] [--limb left|right] [--grid 0.025]

From a random reachable pose the tip is moved in a random direction, its orientation kept, until no
search from 256 random seeds succeeds any more; the pose asked for lies 1e-6 to 0.06 m beyond,
evenly spread over the logarithm. The exit status is 1 when more than one in a hundred is neither
solved nor proven out of reach nor told a reachable position within 1 mm, or when a proof
contradicts what was found.

With `--grid`, nothing of that: poses with the gripper pointing down, so many metres apart in a box
that holds the arm's reach, are asked for in one batch, and then those without a solution once more;
it prints how long one of them takes.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin import Arm, Baxter, IKResult, IKService
from baxter_kin.ik.search.ipopt import IpoptSearcher
from baxter_kin.ik.seeds import NullSpaceMap

FloatArray = NDArray[np.float64]

NEAREST_M, FARTHEST_M = 1e-6, 0.06
STEP_M, RESOLUTION_M, LONGEST_M = 0.1, 1e-8, 2.5
ROUNDS, RESTARTS = 8, 256
ENOUGH_M = 1e-3
MOST_MISSED = 0.01


def main() -> int:
    """Print what came of the poses; 1 when too many are missed, or a proof is false."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--count", type=int, default=1000, help="poses per arm")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--limb", choices=("left", "right"), action="append")
    parser.add_argument("--grid", type=float, metavar="M", help="time a grid of poses instead")
    given = parser.parse_args()
    robot, is_right = Baxter.load(), True
    for side in given.limb or ("left", "right"):
        arm = robot.arm(side)
        if given.grid is not None:
            print(f"{side}: {cost_of_grid(IKService(arm), given.grid)}")
            continue
        kinds = Counter(kinds_of(arm, given.count, np.random.default_rng(given.seed)))
        is_right &= kinds["missed"] <= MOST_MISSED * given.count and not kinds["false proof"]
        print(f"{side}: " + ", ".join(f"{count} {kind}" for kind, count in kinds.most_common()))
    return 0 if is_right else 1


def kinds_of(arm: Arm, count: int, rng: np.random.Generator) -> list[str]:
    """What came of each pose."""
    ik, nearest = IKService(arm), IpoptSearcher(arm, NullSpaceMap(arm), is_nearest=True)
    found: list[str] = []
    while len(found) < count:
        edge = boundary(ik, rng)
        if edge is None:
            continue
        T, outward = edge
        away_m = np.exp(rng.uniform(np.log(NEAREST_M), np.log(FARTHEST_M)))
        found.append(kind(ik, nearest, moved(T, away_m * outward)))
    return found


def cost_of_grid(ik: IKService, spacing_m: float) -> str:
    """What a pose takes that is out of reach, and how many there are."""
    x, z = (np.arange(low, 1.4, spacing_m) for low in (-0.6, -0.9))
    y = np.arange(-0.8, 1.5, spacing_m) * (1.0 if ik.arm.side == "left" else -1.0)
    points = np.stack(np.meshgrid(x, y, z), axis=-1).reshape(-1, 3)
    Ts = np.tile(np.diag([-1.0, 1.0, -1.0, 1.0]), (len(points), 1, 1))
    Ts[:, :3, 3] = points
    is_out = np.array([not result.is_valid for result in ik.solve_batch(Ts)])
    started_s = time.perf_counter()
    ik.solve_batch(Ts[is_out])
    mean_us = 1e6 * (time.perf_counter() - started_s) / is_out.sum()
    return f"{mean_us:.1f} us for each of {is_out.sum()} of {len(Ts)} poses out of reach"


def boundary(ik: IKService, rng: np.random.Generator) -> tuple[pin.SE3, FloatArray] | None:
    """The last pose within reach on a way out, and the direction (3,); None where none ends it."""
    q = ik.arm.random_configuration(rng)
    T, outward = ik.arm.T_base_tip(q), rng.normal(size=3)
    outward /= np.linalg.norm(outward)
    inside_m = 0.0
    for _ in range(ROUNDS):
        inside_m, q = way_out(ik, T, outward, inside_m, q)
        beyond_m = inside_m + RESOLUTION_M
        if beyond_m > LONGEST_M:
            return None
        beyond = moved(T, beyond_m * outward).homogeneous
        seeds = rng.uniform(ik.arm.limits.q_min, ik.arm.limits.q_max, (RESTARTS, 7))
        found = ik.search.search(seeds, np.repeat(beyond[None], RESTARTS, axis=0))
        if not found.is_valid.any():
            return moved(T, inside_m * outward), outward
        inside_m, q = beyond_m, found.q[found.is_valid][0]
    return None


def way_out(
    ik: IKService, T: pin.SE3, outward: FloatArray, begin_m: float, q: FloatArray
) -> tuple[float, FloatArray]:
    """How far one search after the other gets from a solution, and the last solution."""
    inside_m, step_m = begin_m, STEP_M
    while step_m > RESOLUTION_M and inside_m < LONGEST_M:
        ahead = moved(T, (inside_m + step_m) * outward)
        found = ik.search.search(q[None], ahead.homogeneous[None])
        if found.is_valid[0]:
            inside_m, q = inside_m + step_m, found.q[0]
        else:
            step_m *= 0.5
    return inside_m, q


def moved(T: pin.SE3, by: FloatArray) -> pin.SE3:
    """A pose moved by a vector (3,) of base."""
    return pin.SE3(T.rotation, T.translation + by)


def kind(ik: IKService, nearest: IpoptSearcher, T: pin.SE3) -> str:
    """What came of a pose."""
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
    """Whether the nearest position that is told is one, and near enough."""
    told_m = None if result.failure is None else result.failure.nearest_m
    reached = arm.T_base_tip(result.q)
    away_m = float(np.linalg.norm(reached.translation - T.translation))
    turned = float(np.linalg.norm(pin.log3(T.rotation.T @ reached.rotation)))
    is_told = told_m is not None and abs(told_m - away_m) < 1e-9 and turned < 1e-6
    return is_told and away_m <= ENOUGH_M


if __name__ == "__main__":
    sys.exit(main())
