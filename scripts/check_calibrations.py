"""Solve reachable poses with robots as a factory might calibrate them, beside the stock robot.

    python scripts/check_calibrations.py [--robots 100] [--count 2000] [--seed 0]

Each robot's URDF is made by `served_urdf.py`: origins and axes of all joints are off by up to 5 mm
and 10 mrad. Poses come from uniform configurations, and are solved without a seed, in turns with
those of the stock robot; solutions are checked by Pinocchio on the robot's own URDF. The exit
status is 1 when a pose is unsolved, or off by more than 1e-6 m or rad, or outside the limits.
"""

from __future__ import annotations

import argparse
import statistics
import sys
from time import perf_counter

import numpy as np
import pinocchio as pin
from served_urdf import served_urdf

from baxter_kin import Arm, Baxter, IKResult, IKService
from baxter_kin.kinematics.arm import LIMBS

TOLERANCE = 1e-6


def main() -> int:
    """Print what came of it; 1 when a pose is unsolved or a solution wrong."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--robots", type=int, default=100)
    parser.add_argument("--count", type=int, default=2_000, help="poses per arm")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    rng, stock = np.random.default_rng(given.seed), Baxter.load()
    services = {side: IKService(stock.arm(side)) for side in LIMBS}
    bad, ratios, ready_s = 0, [], []
    for number in range(given.robots):
        robot = Baxter.load(served_urdf(rng))
        for side in LIMBS:
            begin = perf_counter()
            own = IKService(robot.arm(side))
            ready_s.append(perf_counter() - begin)
            wrong, ratio = compare(own, services[side], given.count, rng)
            ratios.append(ratio)
            bad += wrong
            if wrong:
                print(f"robot {number}, {side}: {wrong} poses", file=sys.stderr)
    print(
        f"{2 * given.robots:,} arms, {2 * given.robots * given.count:,} poses: {bad} unsolved or "
        f"wrong; median time over that of the stock robot {statistics.median(ratios):.3f} (median "
        f"of arms), {max(ratios):.3f} (most); ready in {statistics.median(ready_s):.2f} s (median),"
        f" {max(ready_s):.2f} s (most)"
    )
    return 1 if bad else 0


def compare(
    own: IKService, stock: IKService, count: int, rng: np.random.Generator
) -> tuple[int, float]:
    """How many poses of an arm are not solved as they should, and its time over the stock arm's."""
    qs = [own.arm.random_configuration(rng) for _ in range(count)]
    pairs = [(own.arm.T_base_tip(q), stock.arm.T_base_tip(q)) for q in qs]
    results, times_s = [], np.empty((count, 2))
    for i, (T, T_stock) in enumerate(pairs):
        requests = [(own, T, 0), (stock, T_stock, 1)]
        for ik, pose, column in requests if i % 2 else reversed(requests):
            begin = perf_counter()
            result = ik.solve(pose)
            times_s[i, column] = perf_counter() - begin
            if ik is own:
                results.append(result)
    own_s, stock_s = np.median(times_s, axis=0)
    bad = sum(
        not is_right(own.arm, T, result) for (T, _), result in zip(pairs, results, strict=True)
    )
    return bad, float(own_s / stock_s)


def is_right(arm: Arm, T: pin.SE3, result: IKResult) -> bool:
    """Whether a result is a solution, by Pinocchio."""
    error = pin.log6(T.actInv(arm.T_base_tip(result.q)))
    is_near = max(np.linalg.norm(error.linear), np.linalg.norm(error.angular)) <= TOLERANCE
    return result.is_valid and is_near and not arm.limits.violations(result.q)


if __name__ == "__main__":
    sys.exit(main())
