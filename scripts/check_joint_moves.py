"""Plan random motions between moving states and look for one that is slower than it has to be.

    python scripts/check_joint_moves.py --count 1000000 --seed 0

Each problem moves one joint, from a state at rest, inside the limits or on their boundary, or
between two states sampled from such a motion. A plan has to exist, to begin and end as asked, to
stay inside the limits, and to take no longer, by more than 1e-6 s, than

- what remains of the motion that the states were sampled from, and
- what Ruckig itself plans from a neighbour, whose velocities are smaller by 1e-9 or 1e-12 of them.

The exit status is 1 when a plan is slower or wrong. Progress goes to stderr.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import ruckig
from tqdm import tqdm

from baxter_kin import JointLimits
from planner import Trajectory, plan_joint_move
from planner.errors import MotionError
from planner.motion.joint_move import RATIO_TOLERANCE

SLOWER_S = 1e-6
BRIEF_S = 1e-3
"""Plans that take less are not judged by their duration: from rest to rest they move by less than
6e-9 rad at 200 rad/s^3, and Ruckig's own motions may miss by 1e-8.
"""
NEIGHBOURS = (1e-9, 0.0), (1e-12, 0.0), (0.0, 1e-9), (0.0, 1e-12), (1e-9, 3e-10)
"""By which shares the velocities of start and goal are smaller.

Never the same share for both: from a state to its mirror image Ruckig 0.19 may write past the end
of an array and crash.
"""
MISS = 1e-13
"""By how much a motion of Ruckig's may miss its end, which itself allows 1e-8: then it may take no
time at all for states that differ by so much."""

SAME_RAD = 1e-11
"""States that differ by less may be joined by a motion of no duration, which stays at its goal."""

Q_MAX_RAD = 1e3
"""Wide, so that limits on positions refuse nothing."""


Three = tuple[float, ...]


class Problem(NamedTuple):
    """One joint between two states (q, v, a) under limits on (v, a, j)."""

    rates: Three
    start: Three
    goal: Three
    remaining_s: float = np.inf
    """A motion of this duration exists, with the time that it takes to correct rounding."""

    @property
    def limits(self) -> JointLimits:
        """As `plan_joint_move` takes them."""
        q_max, v, a, j = (np.array([x]) for x in (Q_MAX_RAD, *self.rates))
        return JointLimits(("joint",), -q_max, q_max, v, a, j)

    def plan(self) -> Trajectory:
        """The motion to judge."""
        (q, v, a), (q_goal, v_goal, a_goal) = self.start, self.goal
        return plan_joint_move(
            [q], [q_goal], self.limits, v_start=[v], a_start=[a], v_goal=[v_goal], a_goal=[a_goal]
        )


def random_rates(rng: np.random.Generator) -> Three:
    """Half of the time Baxter's, else over one to two orders of magnitude."""
    if rng.random() < 0.5:
        return float(rng.choice([1.5, 4.0])), 2.0, 20.0
    v, a, j = np.exp(rng.uniform(np.log([0.1, 0.2, 1.0]), np.log([5.0, 20.0, 200.0]))).tolist()
    return v, a, j


def random_rate(rng: np.random.Generator, rates: Three, *, is_start: bool) -> tuple[float, float]:
    """Velocity and acceleration: at rest, inside the limits, on their boundary, or tiny."""
    v_max, a_max, j_max = rates
    kind = rng.choice(
        ["rest", "inside", "lowest", "highest", "tiny"], p=[0.2, 0.25, 0.2, 0.2, 0.15]
    )
    if kind == "rest":
        return 0.0, 0.0
    if kind == "tiny":
        scale = 10.0 ** rng.uniform(-18.0, -6.0, 2) * rng.choice([-1.0, 0.0, 1.0], 2)
        return float(scale[0] * v_max), float(scale[1] * a_max)
    a_max = min(a_max, float(np.sqrt(2 * v_max * j_max)))
    a = a_max * float(rng.choice([0.0, 1.0, -1.0]) if rng.random() < 0.3 else rng.uniform(-1, 1))
    towards = a if is_start else -a
    low = -v_max + (a * a / (2 * j_max) if towards < 0 else 0.0)
    high = v_max - (a * a / (2 * j_max) if towards > 0 else 0.0)
    share = {"lowest": 0.0, "highest": 1.0}.get(str(kind), rng.random())
    return (low if share == 0.0 else high if share == 1.0 else low + share * (high - low)), a


def random_problem(rng: np.random.Generator) -> Problem:
    """Any states, far apart, next to each other or in the same place."""
    rates = random_rates(rng)
    way = rng.choice([3.0, 0.3, 0.03, 1e-3, 1e-6, 1e-9, 0.0]) * rng.uniform(-1, 1)
    begin = float(rng.uniform(-1, 1)) if rng.random() < 0.5 else 0.0
    return Problem(
        rates,
        (begin, *random_rate(rng, rates, is_start=True)),
        (begin + float(way), *random_rate(rng, rates, is_start=False)),
    )


def part_of(problem: Problem, motion: Trajectory, rng: np.random.Generator) -> Problem | None:
    """From one sample of a motion to another, or to its end; None where that would be refused.

    The velocity of such a start has to exceed its limit, or that of such a goal had to before.
    """
    since, until = np.sort(rng.uniform(0.0, motion.duration, 2)).tolist()
    if rng.random() < 0.5:
        until = motion.duration
    start, goal = (tuple(float(x[0]) for x in motion.sample(t)) for t in (since, until))
    (_, v, a), (_, v_goal, a_goal) = start, goal
    v_max, _, j_max = problem.rates
    peaks = v + a * abs(a) / (2 * j_max), v_goal - a_goal * abs(a_goal) / (2 * j_max)
    if max(map(abs, peaks)) > v_max * (1.0 + RATIO_TOLERANCE):
        return None
    off = jump(motion) + 1e-15 * (1.0 + abs(start[0]))
    return Problem(
        problem.rates, start, goal, until - since + 4 * float(np.cbrt(off / (2 * j_max)))
    )


def by_ruckig_s(problem: Problem, smaller: tuple[float, float]) -> float:
    """Duration of Ruckig's motion from a neighbour; infinite when it finds none that fits."""
    asked = ruckig.InputParameter(1)
    (q, v, a), (q_goal, v_goal, a_goal) = problem.start, problem.goal
    asked.current_position, asked.target_position = [q], [q_goal]
    asked.current_velocity = [v * (1.0 - smaller[0])]
    asked.target_velocity = [v_goal * (1.0 - smaller[1])]
    asked.current_acceleration, asked.target_acceleration = [a], [a_goal]
    v_max, a_max, j_max = problem.rates
    asked.max_velocity, asked.max_acceleration, asked.max_jerk = [v_max], [a_max], [j_max]
    found = ruckig.Trajectory(1)
    try:
        ruckig.Ruckig(1).calculate(asked, found)
    except (ruckig.RuckigError, ValueError):
        return np.inf
    end = found.at_time(found.duration)
    asked_end = asked.target_position, asked.target_velocity, asked.target_acceleration
    miss = max(abs(x[0] - y[0]) for x, y in zip(end, asked_end, strict=True))
    return float(found.duration) if miss <= MISS * max(1.0, found.duration) ** 2 else np.inf


def fault(problem: Problem, motion: Trajectory) -> str | None:
    """What is wrong with a plan, or None."""
    ends = (problem.start, motion.sample(0.0)), (problem.goal, motion.sample(motion.duration))
    for asked, state in ends:
        rounding = SAME_RAD, *(RATIO_TOLERANCE * rate for rate in problem.rates[:2])
        if any(abs(x - y[0]) > e for x, y, e in zip(asked, state, rounding, strict=True)):
            return "other ends"
    if max(motion.peak_ratios()) > 1.0 + RATIO_TOLERANCE:
        return "over a limit"
    shortest_s = min(problem.remaining_s, *(by_ruckig_s(problem, x) for x in NEIGHBOURS))
    slower_s = motion.duration - shortest_s
    is_slower = slower_s > SLOWER_S and motion.duration > BRIEF_S
    return f"slower: by {slower_s:.3g} s" if is_slower else None


def jump(motion: Trajectory) -> float:
    """The largest difference of q, v or a between a knot and the segment that ends there."""
    before = np.maximum(np.diff(motion.knots_s), 0.0)[:, None]
    q, v, a, j = motion.q[:-1], motion.v[:-1], motion.a[:-1], motion.j
    end = (
        q + before * (v + before * (a / 2 + before * j / 6)),
        v + before * (a + before * j / 2),
        a + before * j,
    )
    after = motion.q[1:], motion.v[1:], motion.a[1:]
    return max(float(np.abs(x - y).max(initial=0.0)) for x, y in zip(end, after, strict=True))


def main(argv: Sequence[str] | None = None) -> int:
    """Plan and judge; the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=10_000, help="how many problems (10000)")
    parser.add_argument("--seed", type=int, default=0, help="of the first problem (0)")
    arguments = parser.parse_args(argv)
    found: Counter[tuple[str, str]] = Counter()
    largest_jump = 0.0
    parent: tuple[Problem, Trajectory] | None = None
    for i in tqdm(range(arguments.count), disable=None, mininterval=5.0):
        rng = np.random.default_rng((arguments.seed, i))
        part = None if parent is None else part_of(*parent, rng)
        kind = "random" if part is None else "part of a motion"
        problem = part or random_problem(rng)
        parent = None
        try:
            motion = problem.plan()
        except MotionError as refusal:
            result = f"refused: {refusal}"
        else:
            result = fault(problem, motion) or "good"
            largest_jump = max(largest_jump, jump(motion))
            if kind == "random" and motion.duration > 0.0:
                parent = problem, motion
        found[kind, result.split(":")[0]] += 1
        if result != "good":
            print(f"seed {arguments.seed}, problem {i}, {kind}: {result}; {problem}", flush=True)
    for (kind, result), times in sorted(found.items()):
        print(f"{kind:<18}{result:<14}{times:>9}")
    print(f"largest jump at a knot: {largest_jump:.2g} (rad, rad/s, rad/s^2)")
    return int(any(result != "good" for _, result in found))


if __name__ == "__main__":
    sys.exit(main())
