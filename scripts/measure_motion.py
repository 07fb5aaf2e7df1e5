"""Measure random motions: `python scripts/measure_motion.py KIND`.

`cycles [--count 40] [--seed 5] [--wall]`: picks and places of blocks on the demo's table with
random positions and yaws, alternating between the arms. Every plan is verified, and compared with
the same program on a grid twice as fine and without obstacles. With `--wall`, only the demo's two
cycles, around a wall between pick and place. The exit status is 1 when a task has no valid plan.

`shelves [--count 20] [--seed 0] [--bins]`: picks out of bins that are open towards the
robot, 10 to 25 cm deep, with a level hand, alternating between the arms; to a table, or with
`--bins` to another bin. The hand lifts the item by 1 cm, then draws it out. Every plan is verified
and executed in the simulation. The exit status is 1 when a task has no plan, is not certified or
fails.

`upright [--count 60] [--seed 5] [--degrees 5]`: picks and places as of `cycles`, of cylinders that
are to stay upright, every third over a wall of 10 to 30 cm, planned with and without; then free
moves, with the hand down and level. Tilts are those at dense samples. The exit status is 1 when a
task that has a plan without has none with, one is not certified, or one leans further.

`paths [--count 50] [--seed 7]`: free moves. A wall of random size stands on the demo's table; start
and goal are tip poses left and right of it, with random IK solutions, and the straight joint line
between them is blocked. Every motion is planned (with a continuous proof of clearance), and checked
by distances computed pair by pair at dense samples. Then all are planned again: the motions must be
equal. Finally the arm reaches into shelves: between two boards 30 cm apart, 20 cm and more behind
their front edge. The exit status is 1 when a sample touches something or motions differ.

`lines [--segments 200] [--count N]`: straight moves, against two optima. One is the least time in
which the path of least norm q(s) can be run through under the same limits on joint velocity,
acceleration and jerk; straight moves may beat it, as the arm's self-motion is theirs to choose. It
is computed independently of the planner: q(s) is a Chebyshev polynomial, s(t) has constant
jerk on equal intervals, its states are unknowns joined by multiple shooting, the joints' rates
follow from three derivatives of q as CasADi expressions and are bounded at both ends of every
interval, and IPOPT solves the nonlinear program with exact second derivatives. Bounds are kept at
the ends of intervals only, so the figure errs to the fast side. The other is the planner's own
program on four times as many intervals.

`recordings [--count 30] [--seed 0]`: recordings as motions at the recorded speed, and as fast as
possible, with a tolerance of 10 mrad. In turn: joint moves that use the limits fully, with pauses;
a guided arm with tremor; the same three times as fast, beyond the limits; each of 20 s, with a lag
of 50 ms and noise of 1 mrad; and a simulated pick and place. Printed are the greatest distance from
what was recorded, the root mean square of the jerk relative to that of the same recording without
noise, and the CPU time for a second of recording. The exit status is 1 when a limit is exceeded, or
a motion is farther from a recording than the tolerance where the limits allow it.
"""

from __future__ import annotations

import argparse
import logging
import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from itertools import count, cycle, islice
from typing import NamedTuple

import casadi as ca
import numpy as np
import pinocchio as pin
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from baxter_kin import Arm, Baxter, IKService, JointLimits, pose_from_quaternion
from baxter_kin.fields import evolve
from baxter_kin.ik import sample_solutions
from planner import (
    Body,
    Box,
    Cylinder,
    Line,
    Manipulator,
    Part,
    PickAndPlace,
    Plan,
    Scene,
    Trajectory,
    Upright,
    plan_joint_move,
    plan_pick_and_place,
    plan_straight_move,
    verify,
)
from planner.collision.context import CollisionContext, looks_clear, sample_times
from planner.errors import FreeMoveError
from planner.motion.free_move import plan_free_move
from planner.motion.paths.pieces import MIN_LENGTH
from planner.motion.paths.straight_line import StraightLine
from planner.motion.program.guess import follow
from planner.motion.recorded.fastest import as_fast_as_possible
from planner.motion.recorded.smoothing import NearMotion, at_recorded_speed
from planner.pick_place import cycle_search
from planner.pick_place.candidates import Candidates
from planner.pick_place.cycles import CycleProgram
from planner.pick_place.task import PlanRequest
from sim import Simulation, World
from sim.demo.options import DEFAULT_POSES_M
from sim.demo.scene import OVERHEAD_XYZW, demo_bodies, obstacles
from sim.recording.recorder import planned_recording

FloatArray = NDArray[np.float64]

TABLE_Z_M = -0.155

SIZE_M, NEAREST_M, FARTHEST_M, MIN_APART_M = 0.045, 0.55, 0.85, 0.12
OUTWARD_M = -0.25, 0.6
WALL = (0.72, 0.075, -0.055, 0.3, 0.02, 0.2)
PAIRS = 8

DENSE_RAD, TRIES = 0.005, 50
SHELVES, SHELF_GAP_M, BOARD_M, SHELF_DEPTH_M, SHELF_REACH_M = 20, 0.30, 0.02, 0.4, 0.2

DESCENT_M, GRASPS_M = 0.15, ((0.70, 0.15, -0.129), (0.75, 0.00, -0.129))
DEGREE, MAX_STEPS, FINER = 32, 400, 4


def main(argv: Sequence[str] | None = None) -> int:
    """Print the figures of one kind of motion; returns the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("kind", choices=KINDS)
    parser.add_argument("--count", type=int, help="how many motions")
    parser.add_argument("--seed", type=int)
    parser.add_argument("--wall", action="store_true", help="the demo's cycles around a wall")
    parser.add_argument("--bins", action="store_true", help="from bin to bin, not to a table")
    parser.add_argument("--degrees", type=float, default=5.0, help="maximum tilt")
    parser.add_argument("--segments", type=int, default=200, help="of s(t) (default: %(default)s)")
    given = parser.parse_args(argv)
    return 0 if KINDS[given.kind](given) else 1


def _boxed(name: str, size_m: tuple[float, ...], at: tuple[float, ...] | FloatArray) -> Body:
    return Body(name, (Part(Box(size_m), pin.SE3.Identity()),), pin.SE3(np.eye(3), np.array(at)))


# Picks and places


class Cycle(NamedTuple):
    """A pick and place from a configuration of the arm."""

    manipulator: Manipulator
    scene: Scene
    q_start: FloatArray
    task: PickAndPlace

    def plan(self) -> Plan:
        """Plan it."""
        return plan_pick_and_place(self.task, self.manipulator, self.scene, self.q_start)

    def finer_s(self) -> float:
        """Minimum time on a grid twice as fine, over the first pairs of IK solutions."""
        request = PlanRequest(self.manipulator, self.scene, self.q_start)
        program = CycleProgram(request, self.task, fineness=2)
        candidates = Candidates(request, self.task)
        pairs = (candidates.pair(*each) for each in candidates.order[: 2 * PAIRS : PAIRS])
        found = map(program.of, pairs)
        return min((each.duration_s for each in found if each is not None), default=np.inf)


def cycles(given: argparse.Namespace) -> bool:
    """Plan tasks and print a line for each; whether all plans are valid."""
    robot, ratios, times, is_right = Baxter.load(), [], [], True
    drawn = islice(_cycles(robot, 5 if given.seed is None else given.seed), given.count or 40)
    for number, each in enumerate(_walled(robot) if given.wall else drawn, 1):
        began_s = time.process_time()
        plan = each.plan()
        times.append(time.process_time() - began_s)
        is_right &= plan.is_valid and verify(plan).is_valid
        best_s = each.finer_s()
        ratios.append(plan.motion_time_s / best_s if plan.is_valid else np.inf)
        clear_mm = 1e3 * (plan.proven_clearance_m or 0.0)
        told = f"{plan.motion_time_s:.3f} s, optimum {best_s:.3f} s, {clear_mm:.1f} mm clear"
        told = told if plan.failure is None else str(plan.failure)
        print(f"{number:3d} {plan.limb}: {told}, planned in {times[-1]:.2f} s of CPU", flush=True)
    finite = [ratio for ratio in ratios if 0.0 < ratio < np.inf]
    low, middle, high = np.percentile(finite, [0, 50, 100])
    print(f"{len(finite)} of {len(ratios)} tasks have plans")
    print(f"over the optimum: median {middle:.4f}, from {low:.4f} to {high:.4f}")
    print(f"planning: median {np.median(times):.2f} s of CPU, at most {max(times):.2f} s")
    return is_right


def _cycles(robot: Baxter, seed: int) -> Iterator[Cycle]:
    """Tasks on the table within reach, alternating between the arms."""
    rng = np.random.default_rng(seed)
    arms = {side: Manipulator.of(robot, side) for side in ("left", "right")}
    for side in cycle(arms):
        yield next(found for _ in count() if (found := _cycle(arms[side], rng)) is not None)


def _cycle(manipulator: Manipulator, rng: np.random.Generator) -> Cycle | None:
    outward = 1.0 if manipulator.arm.side == "left" else -1.0
    x = rng.uniform(NEAREST_M, FARTHEST_M, 2)
    y = outward * rng.uniform(*OUTWARD_M, 2)
    turns = rng.uniform(-np.pi / 2.0, np.pi / 2.0, 2)
    if np.hypot(x[0] - x[1], y[0] - y[1]) < MIN_APART_M:
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
    found = Cycle(manipulator, scene, manipulator.arm.start, task)
    failure = found.plan().failure
    return None if failure is not None and failure.is_certain else found


def _walled(robot: Baxter) -> Iterator[Cycle]:
    """The demo's two cycles with a wall between pick and place."""
    manipulator = Manipulator.of(robot, "left")
    scene = Scene.of([*demo_bodies("left"), *obstacles([WALL])])
    pick, place = (pose_from_quaternion(p, OVERHEAD_XYZW) for p in DEFAULT_POSES_M)
    first = Cycle(manipulator, scene, manipulator.arm.start, PickAndPlace("block", pick, place))
    yield first
    q, block = first.plan().moves[-1].trajectory.q_goal, scene["block"]
    moved = block.at(place * pick.inverse() * block.T_base_body)
    scene = scene.without("block").with_body(moved)
    yield Cycle(manipulator, scene, q, PickAndPlace("block", place, pick))


# Picks out of bins

BIN_M, BIN_WALL_M, LIFT_M = (0.37, 0.27, 0.22), 0.01, 0.01
"""Depth, width and height inside; how far an item is lifted there."""

LEVEL = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""The hand points forwards, and its camera down; it may also be turned over."""


def shelves(given: argparse.Namespace) -> bool:
    """Plan tasks and print a line for each; whether all are planned, certified and executed."""
    stopping = _Counter()
    logging.getLogger(cycle_search.__name__).addHandler(stopping)
    logging.getLogger(cycle_search.__name__).setLevel(logging.INFO)
    robot, rng = Baxter.load(), np.random.default_rng(given.seed or 0)
    arms = cycle([Manipulator.of(robot, side) for side in ("left", "right")])
    number, durations, times, good, by_program = given.count or 20, [], [], 0, 0
    for k, manipulator in zip(range(number), arms, strict=False):
        began_s, plan, failures = time.process_time(), None, list[str]()
        for each in _shelf_cycles(manipulator, rng, to_bin=given.bins):
            stopping.count = 0
            plan = each.plan()
            if plan.failure is None:
                break
            failures.append(str(plan.failure))
        times.append(time.process_time() - began_s)
        if plan is None or plan.failure is not None:
            print(f"{k:3d} {manipulator.arm.side}: {' | '.join(failures)}", flush=True)
            continue
        certificate, world = verify(plan), World.from_state(plan.start, robot)
        is_done = Simulation(world).execute(plan, certificate=certificate).is_success
        good += certificate.is_valid and is_done
        by_program += stopping.count == 0
        durations.append(plan.motion_time_s)
        print(
            f"{k:3d} {plan.limb}: {plan.motion_time_s:.2f} s of motion, "
            f"{1e3 * (plan.proven_clearance_m or 0.0):.1f} mm clear, "
            f"{'certified' if certificate.is_valid else 'NOT CERTIFIED'}, "
            f"{'executed' if is_done else 'NOT EXECUTED'}, {times[-1]:.2f} s of CPU"
            f"{', by the search with stops' if stopping.count else ''}",
            flush=True,
        )
    print(f"{good} of {number} certified and executed, {by_program} by one program")
    print(f"motion: median {np.median(durations):.2f} s, at most {max(durations):.2f} s")
    print(f"planning: median {np.median(times):.2f} s of CPU, at most {max(times):.2f} s")
    return good == number


class _Counter(logging.Handler):
    """Counts messages."""

    count = 0

    def emit(self, record: logging.LogRecord) -> None:  # noqa: ARG002 - all are alike
        """Count one."""
        self.count += 1


def _shelf_cycles(
    manipulator: Manipulator, rng: np.random.Generator, *, to_bin: bool
) -> list[Cycle]:
    """One task, with the hand either way up."""
    outward = 1.0 if manipulator.arm.side == "left" else -1.0
    front, low = rng.uniform(0.74, 0.80), rng.uniform(0.0, 0.25)
    y = outward * (rng.uniform(0.0, 0.15) if to_bin else rng.uniform(-0.05, 0.15))
    depth, height, width = (
        rng.uniform(0.10, 0.25),
        rng.uniform(0.10, 0.18),
        rng.uniform(0.03, 0.054),
    )
    item_y, table_y = y + rng.uniform(-0.04, 0.04), outward * rng.uniform(0.36, 0.42)
    part = Part(Box((width, width, height)), pin.SE3.Identity())
    at = np.array([front + depth, item_y, low + height / 2.0])
    item = Body("item", (part,), pin.SE3(np.eye(3), at), is_movable=True)
    shift = np.array([0.0, outward * (BIN_M[1] + BIN_WALL_M), 0.0])
    bodies = [*_bin("bin", front, y, low), item]
    bodies += _bin("other bin", front, y + shift[1], low) if to_bin else []
    bodies += [] if to_bin else demo_bodies(manipulator.arm.side)[:1]
    grip_m, out_m = max(min(height / 2.0, 0.09), 0.07), depth + 0.06
    into, back = Line((1.0, 0.0, 0.0), out_m), Line("tool", out_m)
    out = Line((0.0, 0.0, 1.0), LIFT_M), back
    to_place = (into, Line((0.0, 0.0, -1.0), LIFT_M)) if to_bin else None
    found = []
    for flip in (1.0, -1.0):
        R = LEVEL @ np.diag([flip, flip, 1.0])
        pick = pin.SE3(R, np.array([front + depth, item_y, low + grip_m]))
        turned = pin.utils.rotate("z", outward * 0.3) @ R
        on_table = pin.SE3(turned, np.array([0.74, table_y, TABLE_Z_M + grip_m]))
        task = PickAndPlace(
            "item",
            pick,
            pin.SE3(R, pick.translation + shift) if to_bin else on_table,
            approach=into,
            retreat=out,
            place_approach=to_place,
            place_retreat=back if to_bin else Line("tool", 0.12),
        )
        found.append(Cycle(manipulator, Scene.of(bodies), manipulator.arm.start, task))
    return found


def _bin(name: str, front: float, y: float, low: float) -> list[Body]:
    """Floor, roof and walls of a bin that is open towards the robot."""
    (depth, width, height), wall = BIN_M, BIN_WALL_M
    middle, beside = front + depth / 2.0, (width + wall) / 2.0
    lid, side = (depth, width + 2.0 * wall, wall), (depth, wall, height)
    return [
        _boxed(f"{name}'s floor", lid, (middle, y, low - wall / 2.0)),
        _boxed(f"{name}'s roof", lid, (middle, y, low + height + wall / 2.0)),
        _boxed(
            f"{name}'s back",
            (wall, width, height),
            (front + depth + wall / 2.0, y, low + height / 2.0),
        ),
        _boxed(f"{name}'s left wall", side, (middle, y + beside, low + height / 2.0)),
        _boxed(f"{name}'s right wall", side, (middle, y - beside, low + height / 2.0)),
    ]


# Upright carries and moves

WALL_HEIGHTS_M, OVER_WALL_M, EVERY = (0.10, 0.30), 0.24, 3
"""Heights of walls, minimum distance of pick and place beside one, and which tasks have one."""

DENSE = 1000
"""Number of samples of a motion."""


def upright(given: argparse.Namespace) -> bool:
    """Plan tasks with and without, print a line for each; whether all with are right."""
    robot, rng = Baxter.load(), np.random.default_rng(5 if given.seed is None else given.seed)
    arms = cycle([Manipulator.of(robot, side) for side in ("left", "right")])
    keep = Upright(max_tilt_rad=math.radians(given.degrees))
    ratios, tilts, number, good = [], [], given.count or 60, 0
    for k, manipulator in zip(range(number), arms, strict=False):
        free = next(found for _ in count() if (found := _standing(manipulator, rng, k)) is not None)
        plans = free.plan(), free._replace(task=evolve(free.task, upright=keep)).plan()
        found = [(plan.motion_time_s, _tilt_deg(manipulator.arm, plan)) for plan in plans]
        print(f"{k:3d} {manipulator.arm.side}{' wall' if k % EVERY == EVERY - 1 else ''}:", end=" ")
        if plans[1].failure is not None:
            print(plans[1].failure, flush=True)
            continue
        is_kept = found[1][1] <= given.degrees and verify(plans[1]).is_valid
        good += is_kept
        tilts.append(found[1][1])
        ratios.append(found[1][0] / found[0][0])
        (free_s, free_deg), (kept_s, kept_deg) = found
        print(f"{free_s:.3f} s at {free_deg:.2f} deg, {kept_s:.3f} s at {kept_deg:.3f} deg", end="")
        print("" if is_kept else ", NOT KEPT", flush=True)
    middle, late, most = np.quantile(ratios, [0.5, 0.9, 1.0])
    print(f"{good} of {number} planned, kept and certified; greatest tilt {max(tilts):.3f} deg")
    print(f"time over without: median {middle:.4f}, nine of ten {late:.4f}, at most {most:.4f}")
    return _upright_moves(robot, rng, given.degrees) and good == number


def _standing(manipulator: Manipulator, rng: np.random.Generator, number: int) -> Cycle | None:
    """A task with a standing cylinder, which has a plan; some beside a wall."""
    outward, has_wall = 1.0 if manipulator.arm.side == "left" else -1.0, number % EVERY == EVERY - 1
    x, y = rng.uniform(NEAREST_M, FARTHEST_M, 2), outward * rng.uniform(*OUTWARD_M, 2)
    way = np.array([x[1] - x[0], y[1] - y[0]])
    if np.linalg.norm(way) < (OVER_WALL_M if has_wall else MIN_APART_M):
        return None
    turns, wall_m = rng.uniform(-np.pi / 2.0, np.pi / 2.0, 2), rng.uniform(*WALL_HEIGHTS_M)
    places = [
        pin.SE3(pin.utils.rotate("z", a), np.array([b, c, TABLE_Z_M + SIZE_M / 2.0]))
        for a, b, c in zip(turns, x, y, strict=True)
    ]
    down = pose_from_quaternion((0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0))
    task = PickAndPlace("block", *(place * down for place in places))
    part = Part(Cylinder(SIZE_M / 2.0, SIZE_M), pin.SE3.Identity())
    bodies = [
        demo_bodies(manipulator.arm.side)[0],
        Body("block", (part,), places[0], is_movable=True),
    ]
    if has_wall:
        R = pin.utils.rotate("z", math.atan2(way[1], way[0]))
        at = np.array([x.mean(), y.mean(), TABLE_Z_M + wall_m / 2.0])
        part = Part(Box((0.02, 0.30, wall_m)), pin.SE3.Identity())
        bodies.append(Body("wall", (part,), pin.SE3(R, at)))
    found = Cycle(manipulator, Scene.of(bodies), manipulator.arm.start, task)
    return found if found.plan().is_valid else None


def _tilt_deg(arm: Arm, plan: Plan) -> float:
    """The greatest tilt of the z axis of what the hand holds."""
    tilts = [0.0]
    for move in plan.moves:
        held = None if move.state is None else move.state.holding(arm.side)
        if held is not None:
            tilts.append(_greatest_deg(arm, move.trajectory, held.T_link_body.rotation[:, 2]))
    return max(tilts)


def _greatest_deg(arm: Arm, motion: Trajectory, axis_tip: FloatArray) -> float:
    q = motion.sample(np.linspace(0.0, motion.duration, DENSE)).q
    up = (arm.T_base_tips(q)[:, :3, :3] @ axis_tip)[:, 2]
    return math.degrees(np.arccos(np.clip(up, -1.0, 1.0)).max())


def _upright_moves(robot: Baxter, rng: np.random.Generator, degrees: float) -> bool:
    """Free moves from a pose to the nearest solution of another; whether all are found and kept."""
    down = pose_from_quaternion((0.0, 0.0, 0.0), OVERHEAD_XYZW).rotation
    is_right = True
    for name, R, turn in (("down", down, 1.0), ("level", LEVEL, 0.6)):
        axis = R.T @ np.array([0.0, 0.0, 1.0])
        keep, ratios, tilts = Upright(tuple(axis), math.radians(degrees)), [], []
        for k in range(40):
            side = ("left", "right")[k % 2]
            manipulator = Manipulator.of(robot, side)
            context, direct, ends = manipulator.context(Scene.of([])), None, list[FloatArray]()
            while direct is None or not context.is_clear(direct):  # of the robot itself
                ends = _nearest_ends(manipulator, context, R, turn, rng)
                direct = plan_joint_move(*ends, manipulator.limits)
            with suppress(FreeMoveError):
                motion = plan_free_move(*ends, manipulator.limits, context, upright=keep)
                ratios.append(motion.duration / direct.duration)
                tilts.append(_greatest_deg(manipulator.arm, motion, axis))
        middle, late = np.quantile(ratios, [0.5, 0.9])
        print(
            f"{len(ratios)} of 40 free moves, hand {name}: at most {max(tilts):.3f} deg; time over "
            f"the direct move: median {middle:.4f}, nine of ten {late:.4f}"
        )
        is_right &= len(ratios) == 40 and max(tilts) <= degrees
    return is_right


def _nearest_ends(
    manipulator: Manipulator,
    context: CollisionContext,
    R: FloatArray,
    turn_rad: float,
    rng: np.random.Generator,
) -> list[FloatArray]:
    """A free solution of one pose, and the nearest one of another."""
    outward, ends = 1.0 if manipulator.arm.side == "left" else -1.0, list[FloatArray]()
    while len(ends) < 2:
        at = rng.uniform((0.55, -0.1, -0.1), (0.85, 0.55, 0.35)) * [1.0, outward, 1.0]
        T = pin.SE3(pin.utils.rotate("z", turn_rad * rng.uniform(-1.0, 1.0)) @ R, at)
        qs = [q for q in sample_solutions(manipulator.ik, T) if context.is_free(q)]
        if ends:
            qs.sort(key=lambda q: float(np.abs(q - ends[0]).max()))
        ends += qs[:1]
    return ends


# Free moves


class Path(NamedTuple):
    """A free move whose straight joint line is blocked."""

    manipulator: Manipulator
    context: CollisionContext
    q_start: FloatArray
    q_goal: FloatArray

    def direct(self) -> Trajectory:
        """The joint move that ignores obstacles."""
        return plan_joint_move(self.q_start, self.q_goal, self.manipulator.limits)

    def plan(self) -> Trajectory | None:
        """Plan it."""
        ends, limits = (self.q_start, self.q_goal), self.manipulator.limits
        with suppress(FreeMoveError):
            return plan_free_move(*ends, limits, self.context, rng=np.random.default_rng(1))
        return None


Draw = Callable[[Manipulator, np.random.Generator], "Path | None"]


def paths(given: argparse.Namespace) -> bool:
    """Solve problems twice and print the figures; whether all are clear and reproducible."""
    seed, number = 7 if given.seed is None else given.seed, given.count or 50
    walls = _paths(number, seed, _past_wall)
    found, is_right = _measured("past a wall", walls)
    again = [path.plan() for path in walls]
    same = sum(_is_same(one, other) for one, other in zip(found, again, strict=True))
    print(f"the same when planned again {same} of {number}")
    shelves = _paths(min(SHELVES, number), seed, _in_shelf)
    return is_right and _measured("into a shelf", shelves)[1] and same == number


def _paths(number: int, seed: int, draw: Draw) -> list[Path]:
    """Problems with free ends and a blocked straight line; the same for the same seed."""
    rng, manipulator = np.random.default_rng(seed), Manipulator.of(Baxter.load(), "left")
    problems: list[Path] = []
    while len(problems) < number:
        path = draw(manipulator, rng)
        if path and not looks_clear(path.direct(), path.context.is_free, DENSE_RAD):
            problems.append(path)
    return problems


def _past_wall(manipulator: Manipulator, rng: np.random.Generator) -> Path | None:
    height, y = rng.uniform(0.15, 0.35), rng.uniform(-0.05, 0.05)
    size = (rng.uniform(0.2, 0.4), 0.04, height)
    wall = _boxed("wall", size, (rng.uniform(0.6, 0.8), y, TABLE_Z_M + height / 2))
    scene = Scene.of([*demo_bodies("left"), wall])
    context = manipulator.context(scene, finger_m=manipulator.hand.stroke_m)

    def beside(side: int) -> FloatArray | None:
        """A free configuration over the table, beside the wall, the hand pointing down."""
        for _ in range(TRIES):
            x, z = rng.uniform(0.55, 0.8), rng.uniform(-0.1, 0.05)
            down = pose_from_quaternion((x, y + side * rng.uniform(0.1, 0.3), z), OVERHEAD_XYZW)
            turn = pin.utils.rotate("z", rng.uniform(-np.pi, np.pi))
            seed = manipulator.arm.random_configuration(rng)
            ik = manipulator.ik.solve(pin.SE3(down.rotation @ turn, down.translation), seed=seed)
            if ik.is_valid and context.is_free(ik.q):
                return ik.q
        return None

    start, goal = beside(1), beside(-1)
    ends_exist = start is not None and goal is not None
    return Path(manipulator, context, start, goal) if ends_exist else None


def _in_shelf(manipulator: Manipulator, rng: np.random.Generator) -> Path | None:
    """A move from in front of a shelf to between its boards, the hand pointing forwards."""
    front, low, y = rng.uniform(0.6, 0.7), rng.uniform(-0.1, 0.2), rng.uniform(0.0, 0.4)
    size, middle = (SHELF_DEPTH_M, 0.8, BOARD_M), front + SHELF_DEPTH_M / 2
    heights = {"lower": low, "upper": low + SHELF_GAP_M}
    boards = [_boxed(name, size, (middle, y, z)) for name, z in heights.items()]
    context = manipulator.context(Scene.of(boards), finger_m=manipulator.hand.stroke_m)
    depth, aside = rng.uniform(SHELF_REACH_M, 0.3), rng.uniform(-0.2, 0.2)
    goal_m = np.array([front + depth, y + aside, low + SHELF_GAP_M / 2 + rng.uniform(-0.04, 0.04)])
    turn = pin.utils.rotate("z", rng.uniform(-0.4, 0.4)) @ pin.utils.rotate("y", np.pi / 2)
    for _ in range(TRIES):
        start = manipulator.arm.random_configuration(rng)
        ik = manipulator.ik.solve(pin.SE3(turn, goal_m), seed=start)
        if not ik.is_valid:
            return None
        if context.is_free(start) and context.is_free(ik.q):
            return Path(manipulator, context, start, ik.q)
    return None


def _measured(title: str, problems: list[Path]) -> tuple[list[Trajectory | None], bool]:
    """Plan problems and print the figures; returns the moves, and whether all samples are clear."""
    moves, spent_s = list[Trajectory | None](), list[tuple[float, float]]()
    for path in problems:
        began_s, busy_s = time.perf_counter(), time.process_time()
        moves.append(path.plan())
        spent_s.append((time.perf_counter() - began_s, time.process_time() - busy_s))
    found = [(path, move) for path, move in zip(problems, moves, strict=True) if move is not None]
    least_m = [
        min(
            path.context.clearance(q).distance_m
            for q in move.sample(sample_times(move, DENSE_RAD)).q
        )
        for path, move in found
    ]
    times = np.array([move.duration for _, move in found])
    direct = np.array([path.direct().duration for path, _ in found])
    over = times / direct
    print(f"\n{title}")
    print(f"solved                      {len(found)} of {len(problems)}")
    print(f"rejected by dense recheck   {sum(distance <= 0.0 for distance in least_m)}")
    print(f"least distance on the way   {1e3 * min(least_m):.2f} mm")
    for what, ms in zip(
        ("planning time", "  of which on the processor"), 1e3 * np.transpose(spent_s), strict=True
    ):
        middle, late, most = np.quantile(ms, [0.5, 0.9, 1.0])
        print(f"{what:<27} {middle:.0f} ms median, {late:.0f} ms in nine of ten, {most:.0f} ms max")
    print(f"motion time                 {np.median(times):.3f} s median, {times.sum():.1f} s sum")
    print(f"  over the blocked line     {times.sum() / direct.sum():.4f} of the sums")
    print(f"                            {np.median(over):.4f} median, {over.max():.4f} max")
    print(f"greatest share of a limit   {max(max(m.peak_ratios()) for _, m in found):.12f}")
    return moves, min(least_m) > 0.0


def _is_same(one: Trajectory | None, other: Trajectory | None) -> bool:
    if one is None or other is None:
        return one is other
    return np.array_equal(one.q, other.q) and np.array_equal(one.knots_s, other.knots_s)


# Straight moves


class StraightMove(NamedTuple):
    """A straight move of the tip, its limits and its speed at the start."""

    label: str
    arm: Arm
    q_start: FloatArray
    T_base_goal: pin.SE3
    limits: JointLimits
    speed_m_s: float = 0.0

    def plan(self, fineness: int = 1) -> Trajectory:
        """Plan it."""
        return plan_straight_move(
            self.arm,
            self.q_start,
            self.T_base_goal,
            self.limits,
            speed_start_m_s=self.speed_m_s,
            fineness=fineness,
        )

    @property
    def line(self) -> StraightLine:
        """The tip's line."""
        return StraightLine(self.arm.T_base_tip(self.q_start), self.T_base_goal)

    @property
    def start(self) -> tuple[float, float, float]:
        """Path parameter at the start and its first two time derivatives."""
        return 0.0, self.speed_m_s / max(self.line.length_m, MIN_LENGTH), 0.0


def lines(given: argparse.Namespace) -> bool:
    """Compare straight moves with both optima and print a row for each."""
    print(f"{'move':<38}{'ours':>9}{'least norm':>16}{'finer':>16}{'CPU':>9}  intervals")
    ratios = []
    for line in islice(_lines(), given.count):
        line.plan()  # builds the program
        began_s = time.process_time()
        ours = line.plan()
        cost_s = time.process_time() - began_s
        norm_s, finer_s = optimum_s(line, given.segments), line.plan(FINER).duration
        ratios.append((ours.duration / norm_s, ours.duration / finer_s))
        print(
            f"{line.label:<38}{ours.duration:7.4f} s{norm_s:7.4f} s{ratios[-1][0]:7.3f}"
            f"{finer_s:7.4f} s{ratios[-1][1]:7.4f}{1e3 * cost_s:6.1f} ms{len(ours.j):6}"
        )
    for name, column in zip(("least norm", "finer"), np.transpose(ratios), strict=True):
        print(f"over {name}: worst {column.max():.4f}, median {float(np.median(column)):.4f}")
    return True


def optimum_s(line: StraightMove, segments: int) -> float:
    """Minimum duration along the path of least norm."""
    joint_rates, joint_jerks = _rates(line)
    X, U, T = ca.MX.sym("X", 3, segments + 1), ca.MX.sym("U", 1, segments), ca.MX.sym("T")
    h, (s, v, a) = T / segments, ca.vertsplit(X[:, :-1])
    ahead = ca.vertcat(s + h * (v + h * (a / 2 + h * U / 6)), v + h * (a + h * U / 2), a + h * U)
    bounded = [
        ca.vec(joint_rates.map(segments - 1)(X[:, 1:-1])),
        ca.vec(joint_jerks.map(segments)(X[:, :-1], U)),
        ca.vec(joint_jerks.map(segments)(X[:, 1:], U)),
    ]
    defects, ratios = ca.vec(ahead - X[:, 1:]), ca.vertcat(*bounded)
    solver = ca.nlpsol(
        "optimum",
        "ipopt",
        {"x": ca.vertcat(ca.vec(X), ca.vec(U), T), "f": T, "g": ca.vertcat(defects, ratios)},
        {"ipopt": {"print_level": 0, "sb": "yes", "max_iter": 1000}, "print_time": False},
    )
    states = 3 * (segments + 1)
    high = np.full(states + segments + 1, np.inf)
    low = -high
    low[1:states:3] = low[-1] = 0.0  # ds/dt >= 0, T >= 0
    for bound in (low, high):
        bound[:3], bound[states - 3 : states] = line.start, (1.0, 0.0, 0.0)
    bound = np.concatenate([np.zeros(defects.numel()), np.ones(ratios.numel())])
    solution = solver(x0=_guess(segments), lbx=low, ubx=high, lbg=-bound, ubg=bound)
    if not solver.stats()["success"]:
        raise RuntimeError(f"IPOPT on {line.label}: {solver.stats()['return_status']}")
    return float(solution["f"])


def _rates(line: StraightMove) -> tuple[ca.Function, ca.Function]:
    """Joint velocity and acceleration, and jerk, divided by their limits, as functions of s(t)."""
    x, jerk = ca.SX.sym("x", 3), ca.SX.sym("jerk")
    s, v, a = ca.vertsplit(x)
    u = 2 * s - 1
    polynomials = [ca.SX(1), u]
    for _ in range(2, DEGREE + 1):
        polynomials.append(2 * u * polynomials[-1] - polynomials[-2])
    q = ca.DM(_coefficients(line).T) @ ca.vertcat(*polynomials)
    d1 = ca.jacobian(q, s)
    d2 = ca.jacobian(d1, s)
    d3 = ca.jacobian(d2, s)
    limits = line.limits
    rates = ca.vertcat(d1 * v / limits.v_max, (d2 * v**2 + d1 * a) / limits.a_max)
    jerks = (d3 * v**3 + 3 * d2 * v * a + d1 * jerk) / limits.j_max
    return ca.Function("rates", [x], [rates]), ca.Function("jerks", [x, jerk], [jerks])


def _guess(segments: int) -> FloatArray:
    """A minimum-jerk motion of one second."""
    t = np.linspace(0.0, 1.0, segments + 1)
    s = t**3 * (10 - 15 * t + 6 * t**2)
    v, a = 30 * t**2 * (1 - t) ** 2, 60 * t - 180 * t**2 + 120 * t**3
    return np.concatenate([np.stack([s, v, a], axis=1).ravel(), np.diff(a) * segments, [1.0]])


def _coefficients(line: StraightMove) -> FloatArray:
    """The path of least norm as Chebyshev polynomials in 2 s - 1, shape (DEGREE + 1, 7)."""
    s = 0.5 - 0.5 * np.cos(np.pi * np.arange(DEGREE + 1) / DEGREE)
    steps = np.unique(np.concatenate([s[1:], np.linspace(0.0, 1.0, MAX_STEPS + 1)[1:]]))
    found = follow(line.arm, line.limits, line.q_start, line.line, steps.tolist())
    qs = np.array([line.q_start, *found.qs])[np.searchsorted([0.0, *steps], s)]
    vandermonde = chebyshev.chebvander(2.0 * s - 1.0, DEGREE)
    return np.asarray(np.linalg.solve(vandermonde, qs), dtype=np.float64)


def _lines() -> Iterator[StraightMove]:
    robot = Baxter.load()
    ways = {
        "sideways 20 cm": ((0.0, -0.2, 0.0), (0.0, 0.0, 0.0)),
        "forward 10 cm": ((0.1, 0.0, 0.0), (0.0, 0.0, 0.0)),
        "on the spot, 60 deg about z": ((0.0, 0.0, 0.0), (0.0, 0.0, math.radians(60.0))),
        "8 cm and 40 deg": ((0.05, 0.05, -0.04), tuple(np.radians([30.0, 20.0, 17.0]))),
        "1 cm": ((0.0, 0.0, 0.01), (0.0, 0.0, 0.0)),
    }
    for arm, sign in ((robot.arm("left"), 1.0), (robot.arm("right"), -1.0)):
        ik, limits = IKService(arm), arm.limits
        for x, y, z in GRASPS_M:
            where = f"{arm.side} ({x:.2f}, {sign * y:.2f})"
            hover, goal = (_down(x, sign * y, height) for height in (z + DESCENT_M, z))
            q = ik.solve(hover, current=arm.start).q
            yield StraightMove(f"{where} descend", arm, q, goal, limits)
            q_down = plan_straight_move(arm, q, goal, limits).q_goal
            yield StraightMove(f"{where} retract", arm, q_down, hover, limits)
            yield StraightMove(f"{where} descend from 0.2 m/s", arm, q, goal, limits, 0.2)
            yield StraightMove(f"{where} descend, speed 0.2", arm, q, goal, limits.scaled(0.2))
        start = _down(0.65, sign * 0.25, 0.05)
        q = ik.solve(start, current=arm.start).q
        for label, (shift, turn) in ways.items():
            R = pin.exp3(np.array(turn)) @ start.rotation
            goal = pin.SE3(R, start.translation + np.array(shift))
            yield StraightMove(f"{arm.side} {label}", arm, q, goal, limits)


def _down(x: float, y: float, z: float) -> pin.SE3:
    return pose_from_quaternion((x, y, z), (0.0, 1.0, 0.0, 0.0))


# Recordings

TOLERANCE_RAD, NOISE_RAD, LAG_S, RECORDED_S, TICK_S = 0.01, 1e-3, 0.05, 20.0, 0.01
TREMOR_RAD, TREMOR_HZ = 5e-4, 8.0


def recordings(given: argparse.Namespace) -> bool:
    """Make motions of recordings and print a row for each; whether all are as they should be."""
    print(f"{'recording':<12}{'off':>9}{'jerk':>8}{'CPU':>12}{'fastest':>16}{'off':>9}{'CPU':>12}")
    robot, is_right = Baxter.load(), True
    drawn = islice(cycle(_RECORDED.items()), given.count or 30)
    for number, (name, make) in enumerate(drawn, given.seed or 0):
        arm, rng = robot.arm(("left", "right")[number % 2]), np.random.default_rng(number)
        clean = make(robot, arm, rng)
        is_noisy = make is not _simulated
        q = clean + NOISE_RAD * is_noisy * rng.normal(size=clean.shape)
        recorded_s = TICK_S * (len(q) - 1)
        found, cost_s = _timed(at_recorded_speed, arm, q)
        least, _ = _timed(at_recorded_speed, arm, clean)
        fastest, more_s = _timed(as_fast_as_possible, arm, q)
        jerks = [np.sqrt(np.square(each.trajectory.j).mean()) for each in (found, least)]
        print(
            f"{name:<12}{1e3 * found.deviation_rad:5.1f} mrad{jerks[0] / jerks[1]:7.3f}"
            f"{cost_s / recorded_s:8.3f} s/s"
            f"{fastest.trajectory.duration:7.2f} of {recorded_s:5.2f} s"
            f"{1e3 * fastest.deviation_rad:5.1f} mrad{more_s / recorded_s:8.3f} s/s",
            flush=True,
        )
        near = [fastest] if make is _hurried else [found, fastest]
        is_right &= all(each.deviation_rad <= TOLERANCE_RAD for each in near)
        is_right &= all(_keeps_limits(each.trajectory) for each in (found, fastest))
    return is_right


def _timed(make: Callable[..., NearMotion], arm: Arm, q: FloatArray) -> tuple[NearMotion, float]:
    times_s = TICK_S * np.arange(len(q))
    began_s = time.process_time()
    return make(times_s, q, arm.limits, TOLERANCE_RAD), time.process_time() - began_s


def _keeps_limits(motion: Trajectory) -> bool:
    low, high = motion.position_extrema()
    inside = (low >= motion.limits.q_min).all() and (high <= motion.limits.q_max).all()
    return bool(inside) and max(motion.peak_ratios()) <= 1.0


def _moved(robot: Baxter, arm: Arm, rng: np.random.Generator) -> FloatArray:  # noqa: ARG001
    """Time-optimal joint moves near the start, some followed by a pause."""
    q, samples = arm.start, list[FloatArray]()
    while sum(map(len, samples)) * TICK_S < RECORDED_S:
        goal = arm.start + rng.uniform(-0.5, 0.5, 7)
        goal = goal.clip(arm.limits.q_min + 0.05, arm.limits.q_max - 0.05)
        move = plan_joint_move(q, goal, arm.limits)
        samples.append(move.sample(np.arange(0.0, move.duration, TICK_S)).q)
        samples.append(np.tile(goal, (60 * (rng.uniform() < 0.4), 1)))
        q = goal
    return _lagged(np.concatenate(samples))


def _guided(
    robot: Baxter,  # noqa: ARG001
    arm: Arm,
    rng: np.random.Generator,
    speed: float = 1.0,
) -> FloatArray:
    """Smooth wandering that begins gently, and tremor."""
    t = np.arange(0.0, RECORDED_S, TICK_S)[:, None]
    q = np.tile(arm.start, (len(t), 1))
    for hertz in (0.07, 0.15, 0.31, 0.6):
        wave = np.sin(2.0 * np.pi * hertz * speed * t + rng.uniform(0.0, 2.0 * np.pi, 7))
        q += 0.12 / (hertz / 0.15 + 0.5) * wave * np.sin(0.5 * np.pi * t.clip(max=1.0)) ** 2
    q += TREMOR_RAD * np.sin(2.0 * np.pi * TREMOR_HZ * t + rng.uniform(0.0, 2.0 * np.pi, 7))
    return _lagged(q.clip(arm.limits.q_min + 0.01, arm.limits.q_max - 0.01))


def _hurried(robot: Baxter, arm: Arm, rng: np.random.Generator) -> FloatArray:
    return _guided(robot, arm, rng, 3.0)


def _simulated(robot: Baxter, arm: Arm, rng: np.random.Generator) -> FloatArray:
    """The free and straight moves of a random pick and place, as a simulation records them."""
    manipulator = Manipulator.of(robot, arm.side)
    cycle_ = next(each for each in iter(lambda: _cycle(manipulator, rng), 0) if each is not None)
    recording = planned_recording(cycle_.plan())
    columns = [recording.joint_names.index(name) for name in arm.joint_names]
    return np.array(recording.q[:, columns])


def _lagged(q: FloatArray) -> FloatArray:
    """Measured positions of an arm that follows with a lag of first order."""
    measured = q.copy()
    for i in range(1, len(q)):
        measured[i] = measured[i - 1] + TICK_S / LAG_S * (q[i] - measured[i - 1])
    return measured


_RECORDED: dict[str, Callable[[Baxter, Arm, np.random.Generator], FloatArray]] = {
    "joint moves": _moved,
    "guided": _guided,
    "hurried": _hurried,
    "simulated": _simulated,
}

KINDS: dict[str, Callable[[argparse.Namespace], bool]] = {
    "cycles": cycles,
    "shelves": shelves,
    "upright": upright,
    "paths": paths,
    "lines": lines,
    "recordings": recordings,
}

if __name__ == "__main__":
    sys.exit(main())
