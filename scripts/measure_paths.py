"""Print the figures of free moves: `python scripts/measure_paths.py [COUNT] [SEED]`.

A wall of random size stands on the demo's table; start and goal are tip poses left and right of it,
with random IK solutions, and the straight joint line between them is blocked. Every motion is
planned, judged by the continuous proof, and checked again afterwards by distances computed pair by
pair at dense samples. Then all are planned again, to see that they are the same. After that the arm
reaches into shelves: between two boards 30 cm apart, 20 cm and more behind their front edge.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin import Baxter, pose_from_quaternion
from baxter_kin.command_line import OneSentenceParser, whole_number
from planner import Body, Box, Manipulator, Part, Scene, Trajectory, plan_joint_move
from planner.collision.context import CollisionContext, looks_clear, sample_times
from planner.errors import FreeMoveError
from planner.motion.free_move import plan_free_move
from sim.demo.scene import OVERHEAD_XYZW, demo_bodies

DENSE_RAD = 0.005
SHELVES, SHELF_GAP_M, BOARD_M, SHELF_DEPTH_M, SHELF_REACH_M = 20, 0.30, 0.02, 0.4, 0.2
TABLE_TOP_M = -0.155
FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """An arm on one side of a wall that shall go to the other."""

    manipulator: Manipulator
    context: CollisionContext
    q_start: FloatArray
    q_goal: FloatArray

    def least_distance_m(self, motion: Trajectory) -> float:
        """Of all pairs at dense samples, computed one by one."""
        qs = motion.sample(sample_times(motion, DENSE_RAD)).q
        return min(self.context.clearance(q).distance_m for q in qs)


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """One planned problem."""

    move: Trajectory | None
    wall_s: float
    cpu_s: float


def main() -> None:
    """Make the problems, solve them, print."""
    parser = OneSentenceParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("count", nargs="?", type=whole_number(1), default=50, help="default: 50")
    parser.add_argument("seed", nargs="?", type=whole_number(0), default=7, help="default: 7")
    options = parser.parse_args()
    problems = made_problems(options.count, options.seed)
    proven = [_planned(problem) for problem in problems]
    _print("past a wall", problems, proven)
    again = [_planned(problem) for problem in problems]
    same = sum(_is_same(one.move, other.move) for one, other in zip(proven, again, strict=True))
    print(f"the same when planned again {same} of {options.count}")
    shelves = made_problems(SHELVES, options.seed, _in_shelf)
    _print("into a shelf", shelves, [_planned(problem) for problem in shelves])


def made_problems(count: int, seed: int, draw: Draw | None = None) -> list[Problem]:
    """Problems whose ends are free and whose straight line is not; the same for the same seed."""
    rng = np.random.default_rng(seed)
    manipulator = Manipulator.of(Baxter.load(), "left")
    problems: list[Problem] = []
    while len(problems) < count:
        problem = (_past_wall if draw is None else draw)(manipulator, rng)
        if problem is not None and _is_blocked(problem):
            problems.append(problem)
    return problems


Draw: TypeAlias = Callable[[Manipulator, np.random.Generator], Problem | None]


def _is_blocked(problem: Problem) -> bool:
    straight = plan_joint_move(problem.q_start, problem.q_goal, problem.manipulator.limits)
    return not looks_clear(straight, problem.context.is_free, DENSE_RAD)


def _past_wall(manipulator: Manipulator, rng: np.random.Generator) -> Problem | None:
    height, y = rng.uniform(0.15, 0.35), rng.uniform(-0.05, 0.05)
    size = (rng.uniform(0.2, 0.4), 0.04, height)
    centre = np.array([rng.uniform(0.6, 0.8), y, TABLE_TOP_M + height / 2])
    parts = (Part(Box(size), pin.SE3.Identity()),)
    wall = Body("wall", parts, pin.SE3(np.eye(3), centre))
    scene = Scene.of([*demo_bodies("left"), wall])
    context = manipulator.context(scene, finger_m=manipulator.hand.stroke_m)
    start, goal = (_beside(manipulator, context, y, side, rng) for side in (1, -1))
    if start is None or goal is None:
        return None
    return Problem(manipulator, context, start, goal)


def _in_shelf(manipulator: Manipulator, rng: np.random.Generator) -> Problem | None:
    """From before a shelf to between its boards, the hand level, pointing forwards and turned."""
    front, low, y = rng.uniform(0.6, 0.7), rng.uniform(-0.1, 0.2), rng.uniform(0.0, 0.4)
    size, middle = (SHELF_DEPTH_M, 0.8, BOARD_M), front + SHELF_DEPTH_M / 2
    boards = [
        Body(name, (Part(Box(size), pin.SE3.Identity()),), pin.SE3(np.eye(3), np.array(at)))
        for name, at in (("lower", (middle, y, low)), ("upper", (middle, y, low + SHELF_GAP_M)))
    ]
    opening_m = manipulator.hand.stroke_m
    context = manipulator.context(Scene.of(boards), finger_m=opening_m)
    depth, aside = rng.uniform(SHELF_REACH_M, 0.3), rng.uniform(-0.2, 0.2)
    goal_m = np.array([front + depth, y + aside, low + SHELF_GAP_M / 2 + rng.uniform(-0.04, 0.04)])
    turn = pin.utils.rotate("z", rng.uniform(-0.4, 0.4)) @ pin.utils.rotate("y", np.pi / 2)
    for _ in range(50):
        start = manipulator.arm.random_configuration(rng)
        ik = manipulator.ik.solve(pin.SE3(turn, goal_m), seed=start)
        if not ik.is_valid:
            return None
        if context.is_free(start) and context.is_free(ik.q):
            return Problem(manipulator, context, start, ik.q)
    return None


def _beside(
    manipulator: Manipulator,
    context: CollisionContext,
    y: float,
    side: int,
    rng: np.random.Generator,
) -> FloatArray | None:
    """A free configuration over the table, beside a wall at y, the hand down and turned."""
    for _ in range(50):
        x, z = rng.uniform(0.55, 0.8), rng.uniform(-0.1, 0.05)
        down = pose_from_quaternion((x, y + side * rng.uniform(0.1, 0.3), z), OVERHEAD_XYZW)
        turn = pin.utils.rotate("z", rng.uniform(-np.pi, np.pi))
        seed = manipulator.arm.random_configuration(rng)
        ik = manipulator.ik.solve(pin.SE3(down.rotation @ turn, down.translation), seed=seed)
        if ik.is_valid and context.is_free(ik.q):
            return ik.q
    return None


def _planned(problem: Problem) -> Outcome:
    limits, ends = problem.manipulator.limits, (problem.q_start, problem.q_goal)
    started, busy = time.perf_counter(), time.process_time()
    move = None
    with suppress(FreeMoveError):
        move = plan_free_move(*ends, limits, problem.context, rng=np.random.default_rng(1))
    return Outcome(move, time.perf_counter() - started, time.process_time() - busy)


def _print(title: str, problems: list[Problem], outcomes: list[Outcome]) -> None:
    walls, busy = 1e3 * np.array([(one.wall_s, one.cpu_s) for one in outcomes]).T
    found = [
        (problem, outcome.move)
        for problem, outcome in zip(problems, outcomes, strict=True)
        if outcome.move is not None
    ]
    least = [problem.least_distance_m(motion) for problem, motion in found]
    times = np.array([motion.duration for _, motion in found])
    direct = np.array(
        [plan_joint_move(p.q_start, p.q_goal, p.manipulator.limits).duration for p, _ in found]
    )
    print(f"\n{title}")
    print(f"solved                      {len(found)} of {len(problems)}")
    print(f"rejected by dense recheck   {sum(distance <= 0.0 for distance in least)}")
    print(f"least distance on the way   {1e3 * min(least):.2f} mm")
    print(f"planning time               {_spread(walls)}")
    print(f"  of which on the processor {_spread(busy)}")
    print(f"motion time                 {np.median(times):.3f} s median, {times.sum():.1f} s sum")
    over = times / direct
    print(f"  over the blocked line     {times.sum() / direct.sum():.4f} of the sums")
    print(f"                            {np.median(over):.4f} median, {over.max():.4f} max")
    print(f"greatest share of a limit   {max(max(m.peak_ratios()) for _, m in found):.12f}")


def _spread(times: FloatArray) -> str:
    return (
        f"{np.median(times):.0f} ms median, {np.quantile(times, 0.9):.0f} ms in nine of ten, "
        f"{times.max():.0f} ms max"
    )


def _is_same(one: Trajectory | None, other: Trajectory | None) -> bool:
    if one is None or other is None:
        return one is other
    return np.array_equal(one.q, other.q) and np.array_equal(one.knots_s, other.knots_s)


if __name__ == "__main__":
    main()
