"""Measure picks and places at random: `python scripts/measure_cycles.py [--count 40] [--seed 5]`.

Blocks on the demo's table, turned at random, each arm in turn. Every plan is verified, and compared
with the same program on a grid twice as fine with nothing in the way. With `--wall`, only the
demo's two cycles, around a wall between pick and place. The exit status is 1 when a task has no
plan or a plan is not verified.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from itertools import count, cycle, islice
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin import Baxter, pose_from_quaternion
from planner import (
    Body,
    Box,
    Manipulator,
    Part,
    PickAndPlace,
    Plan,
    Scene,
    plan_pick_and_place,
    verify,
)
from planner.pick_place.candidates import Candidates
from planner.pick_place.cycles import CycleProgram
from planner.pick_place.task import PlanRequest
from sim.demo.options import DEFAULT_POSES_M
from sim.demo.scene import OVERHEAD_XYZW, demo_bodies, obstacles

SIZE_M, TABLE_Z_M = 0.045, -0.155
NEAREST_M, FARTHEST_M, LEAST_APART_M = 0.55, 0.85, 0.12
OUTWARD_M = -0.25, 0.6
WALL = (0.72, 0.075, -0.055, 0.3, 0.02, 0.2)
PAIRS = 8


class Problem(NamedTuple):
    """What is to be planned, from where the arm stands."""

    manipulator: Manipulator
    scene: Scene
    q_start: NDArray[np.float64]
    task: PickAndPlace


def main() -> int:
    """Print a line for each task, then the medians."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--seed", type=int, default=5)
    parser.add_argument("--wall", action="store_true", help="the demo's cycles around a wall")
    given = parser.parse_args()
    robot, ratios, times, is_right = Baxter.load(), [], [], True
    problems = walled(robot) if given.wall else islice(drawn(robot, given.seed), given.count)
    for number, problem in enumerate(problems, 1):
        started_s = time.process_time()
        plan = plan_pick_and_place(
            problem.task, problem.manipulator, problem.scene, problem.q_start
        )
        times.append(time.process_time() - started_s)
        is_right &= plan.is_valid and verify(plan).is_valid
        best_s = finer_s(problem)
        ratios.append(plan.motion_time_s / best_s if plan.is_valid and best_s < np.inf else np.inf)
        print(f"{number:3d} {told(plan, best_s)}, planned in {times[-1]:.2f} s of CPU", flush=True)
    print(f"{np.isfinite(ratios).sum()} of {len(ratios)} tasks have plans")
    low, middle, high = np.percentile([r for r in ratios if np.isfinite(r)], [0, 50, 100])
    print(f"over the optimum: median {middle:.4f}, from {low:.4f} to {high:.4f}")
    print(f"planning: median {np.median(times):.2f} s of CPU, at most {max(times):.2f} s")
    return 0 if is_right else 1


def told(plan: Plan, best_s: float) -> str:
    """A plan in words."""
    if plan.failure is not None:
        return f"{plan.limb}: {plan.failure}"
    clear_mm = 1e3 * (plan.proven_clearance_m or 0.0)
    return (
        f"{plan.limb}: {plan.motion_time_s:.3f} s, optimum {best_s:.3f} s, {clear_mm:.1f} mm clear"
    )


def finer_s(problem: Problem) -> float:
    """The least time of the program on a grid twice as fine, over the first pairs of solutions."""
    request = PlanRequest(problem.manipulator, problem.scene, problem.q_start)
    program = CycleProgram(request, problem.task, fineness=2)
    candidates = Candidates(request, problem.task)
    found = (program.of(candidates.pair(*each)) for each in candidates.order[: 2 * PAIRS : PAIRS])
    return min((each.duration_s for each in found if each is not None), default=np.inf)


def drawn(robot: Baxter, seed: int) -> Iterator[Problem]:
    """Tasks whose poses are within reach and on the table, each arm in turn."""
    rng = np.random.default_rng(seed)
    arms = {side: Manipulator.of(robot, side) for side in ("left", "right")}
    for side in cycle(arms):
        yield next(found for _ in count() if (found := _drawn(arms[side], rng)) is not None)


def _drawn(manipulator: Manipulator, rng: np.random.Generator) -> Problem | None:
    outward = 1.0 if manipulator.arm.side == "left" else -1.0
    x = rng.uniform(NEAREST_M, FARTHEST_M, 2)
    y = outward * rng.uniform(*OUTWARD_M, 2)
    turns = rng.uniform(-np.pi / 2.0, np.pi / 2.0, 2)
    if np.hypot(x[0] - x[1], y[0] - y[1]) < LEAST_APART_M:
        return None
    places = [
        pin.SE3(pin.utils.rotate("z", a), np.array([b, c, TABLE_Z_M + SIZE_M / 2.0]))
        for a, b, c in zip(turns, x, y, strict=True)
    ]
    down = pose_from_quaternion((0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0))
    task = PickAndPlace("block", *(place * down for place in places))
    part = Part(Box((SIZE_M, SIZE_M, SIZE_M)), pin.SE3.Identity())
    table, _ = demo_bodies(manipulator.arm.side)
    scene = Scene.of([table, Body("block", (part,), places[0], is_movable=True)])
    q_start = manipulator.arm.start
    plan = plan_pick_and_place(task, manipulator, scene, q_start)
    if plan.failure is not None and plan.failure.is_certain:
        return None
    return Problem(manipulator, scene, q_start, task)


def walled(robot: Baxter) -> Iterator[Problem]:
    """The demo's two cycles with a wall between."""
    manipulator = Manipulator.of(robot, "left")
    scene = Scene.of([*demo_bodies("left"), *obstacles([WALL])])
    poses = [pose_from_quaternion(p, OVERHEAD_XYZW) for p in DEFAULT_POSES_M]
    task = PickAndPlace("block", poses[0], poses[1])
    first = Problem(manipulator, scene, manipulator.arm.start, task)
    yield first
    plan = plan_pick_and_place(task, manipulator, scene, first.q_start)
    carried = scene["block"].T_base_body
    moved = scene.without("block").with_body(
        scene["block"].at(poses[1] * poses[0].inverse() * carried)
    )
    back = PickAndPlace("block", poses[1], poses[0])
    yield Problem(manipulator, moved, plan.moves[-1].trajectory.q_goal, back)


if __name__ == "__main__":
    sys.exit(main())
