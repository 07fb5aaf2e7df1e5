"""Print the figures of free moves around a wall: `python scripts/measure_paths.py [COUNT] [SEED]`.

A wall of random size stands on the demo's table; start and goal are tip poses left and right of it,
with random IK solutions, and the straight joint line between them is blocked. Every motion is
planned twice, judged by samples and by the swept proof, and checked again afterwards by distances
computed pair by pair at dense samples. Then all are planned again, to see that they are the same.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin import Baxter, pose_from_quaternion
from baxter_kin.demo.scene import OVERHEAD_XYZW, demo_bodies
from planner import (
    Body,
    Box,
    ClearanceChecker,
    Manipulator,
    Part,
    Scene,
    Trajectory,
    plan_joint_move,
)
from planner.free_move import FreeMove, IsClear, plan_free_move
from planner.free_space import FreeSpace
from planner.screening import looks_clear, sample_times
from planner.smoothing import stopping_at
from planner.swept import prove_clear

DENSE_RAD = 0.005
TABLE_TOP_M = -0.155
Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """An arm on one side of a wall that shall go to the other."""

    manipulator: Manipulator
    checker: ClearanceChecker
    q_start: Vector
    q_goal: Vector

    @property
    def finger_m(self) -> float:
        """The fingers are open."""
        return self.manipulator.hand.stroke_m

    def space(self) -> FreeSpace:
        """Where its arm is free."""
        return FreeSpace(self.manipulator, self.checker, finger_m=self.finger_m)

    def sampled(self, space: FreeSpace) -> IsClear:
        """Judges a motion by dense samples."""
        return lambda motion: looks_clear(motion, space.is_free, DENSE_RAD)

    def proven(self) -> IsClear:
        """Judges a motion by a proof."""
        full = next(self.manipulator.configurations(self.q_start[None], self.finger_m))
        return lambda motion: prove_clear(self.checker, motion, full).is_clear

    def least_distance_m(self, motion: Trajectory) -> float:
        """Of all pairs at dense samples, computed one by one."""
        qs = motion.sample(sample_times(motion, DENSE_RAD)).q
        full = self.manipulator.configurations(qs, self.finger_m)
        return min(self.checker.clearance(q).distance_m for q in full)


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """One planned problem."""

    move: FreeMove
    wall_s: float
    cpu_s: float


def main() -> None:
    """Make the problems, solve them, print."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 50
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 7
    problems = made_problems(count, seed)
    sampled = [_planned(problem, is_proven=False) for problem in problems]
    _print("judged by samples", problems, sampled)
    proven = [_planned(problem, is_proven=True) for problem in problems]
    _print("judged by the swept proof", problems, proven)
    again = [_planned(problem, is_proven=False) for problem in problems]
    same = sum(_is_same(one.move, other.move) for one, other in zip(sampled, again, strict=True))
    print(f"\nthe same when planned again {same} of {count}")


def made_problems(count: int, seed: int) -> list[Problem]:
    """Problems whose ends are free and whose straight line is not; the same for the same seed."""
    rng = np.random.default_rng(seed)
    manipulator = Manipulator.of(Baxter.load(), "left")
    problems: list[Problem] = []
    while len(problems) < count:
        problem = _drawn(manipulator, rng)
        if problem is not None:
            problems.append(problem)
    return problems


def _drawn(manipulator: Manipulator, rng: np.random.Generator) -> Problem | None:
    height, y = rng.uniform(0.15, 0.35), rng.uniform(-0.05, 0.05)
    size = (rng.uniform(0.2, 0.4), 0.04, height)
    centre = np.array([rng.uniform(0.6, 0.8), y, TABLE_TOP_M + height / 2])
    parts = (Part(Box(size), pin.SE3.Identity()),)
    wall = Body("wall", parts, pin.SE3(np.eye(3), centre))
    scene = Scene.of([*demo_bodies("left"), wall])
    checker = ClearanceChecker(manipulator.shapes, manipulator.arm, scene)
    space = FreeSpace(manipulator, checker, finger_m=manipulator.hand.stroke_m)
    start, goal = (_beside(manipulator, space, y, side, rng) for side in (1, -1))
    if start is None or goal is None:
        return None
    straight = plan_joint_move(start, goal, manipulator.limits)
    if looks_clear(straight, space.is_free, DENSE_RAD):
        return None
    return Problem(manipulator, checker, start, goal)


def _beside(
    manipulator: Manipulator, space: FreeSpace, y: float, side: int, rng: np.random.Generator
) -> Vector | None:
    """A free configuration over the table, beside a wall at y, the hand down and turned."""
    for _ in range(50):
        x, z = rng.uniform(0.55, 0.8), rng.uniform(-0.1, 0.05)
        down = pose_from_quaternion((x, y + side * rng.uniform(0.1, 0.3), z), OVERHEAD_XYZW)
        turn = pin.utils.rotate("z", rng.uniform(-np.pi, np.pi))
        seed = manipulator.arm.random_configuration(rng)
        ik = manipulator.ik.solve(pin.SE3(down.rotation @ turn, down.translation), seed=seed)
        if ik.is_valid and space.is_free(ik.q):
            return ik.q
    return None


def _planned(problem: Problem, *, is_proven: bool) -> Outcome:
    limits, ends = problem.manipulator.limits, (problem.q_start, problem.q_goal)
    started, busy = time.perf_counter(), time.process_time()
    space = problem.space()
    judge = problem.proven() if is_proven else problem.sampled(space)
    move = plan_free_move(*ends, limits, space, judge, rng=np.random.default_rng(1))
    return Outcome(move, time.perf_counter() - started, time.process_time() - busy)


def _print(title: str, problems: list[Problem], outcomes: list[Outcome]) -> None:
    walls, busy = 1e3 * np.array([(one.wall_s, one.cpu_s) for one in outcomes]).T
    found = [
        (problem, outcome.move.trajectory, outcome.move.corners)
        for problem, outcome in zip(problems, outcomes, strict=True)
        if outcome.move.trajectory is not None
    ]
    least = [problem.least_distance_m(motion) for problem, motion, _ in found]
    times = np.array([motion.duration for _, motion, _ in found])
    stops = np.array([stopping_at(c, p.manipulator.limits).duration for p, _, c in found])
    direct = np.array(
        [plan_joint_move(p.q_start, p.q_goal, p.manipulator.limits).duration for p, _, _ in found]
    )
    print(f"\n{title}")
    print(f"solved                      {len(found)} of {len(problems)}")
    print(f"rejected by dense recheck   {sum(distance <= 0.0 for distance in least)}")
    print(f"least distance on the way   {1e3 * min(least):.2f} mm")
    print(f"planning time               {np.median(walls):.0f} ms median, {walls.max():.0f} ms max")
    print(f"  of which on the processor {np.median(busy):.0f} ms median, {busy.max():.0f} ms max")
    print(f"motion time                 {np.median(times):.3f} s median, {times.sum():.1f} s sum")
    print(f"  over stops at all corners {times.sum() / stops.sum():.3f}")
    print(f"  over the blocked line     {times.sum() / direct.sum():.3f}")
    print(f"greatest share of a limit   {max(max(m.peak_ratios()) for _, m, _ in found):.12f}")


def _is_same(one: FreeMove, other: FreeMove) -> bool:
    if one.trajectory is None or other.trajectory is None:
        return one.trajectory is other.trajectory
    return np.array_equal(one.trajectory.q, other.trajectory.q) and np.array_equal(
        one.trajectory.knots_s, other.trajectory.knots_s
    )


if __name__ == "__main__":
    main()
