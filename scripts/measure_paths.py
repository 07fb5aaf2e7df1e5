"""Measure motions along paths of the tip: `python scripts/measure_paths.py KIND`.

Both arms take turns. Every motion is verified: tolerance, speed and clearance at every instant.

`polylines [--count 40] [--seed 0] [--finer 0]`: random polylines of 10 to 60 waypoints, along which
the hand turns by up to 15 deg; within 0.1 mm and 0.02 deg, and within 1 mm and 0.5 deg. Printed are
the duration relative to the same path with stops at corners, that relative to twice the intervals
(of the first polylines, as many as `--finer` says), and the CPU time per second of motion. The exit
status is 1 when a polyline is neither planned and certified nor refused because a waypoint cannot
be reached.

`speeds [--count 20] [--seed 0]`: circles, squares within 1 mm and polylines within 1 mm, at
0.05 m/s. Printed is the share of the time in which the tip is stated to be slower. The exit status
is 1 when one is not certified.

`obstacles [--count 20] [--seed 0]`: polylines with a ball of 6 cm where the forearm would be.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin import Baxter, pose_from_quaternion
from planner import (
    Arc,
    Body,
    LineTolerance,
    Manipulator,
    Move,
    Part,
    PathMove,
    Plan,
    Polyline,
    Scene,
    Sphere,
    State,
    complete,
    plan_path_move,
    verify,
)
from planner.errors import MotionError
from planner.motion.paths import windows
from planner.motion.paths.path import TipPath

STRICT, LAX = LineTolerance(), LineTolerance(1e-3, math.radians(0.5))
SPEED_M_S, BALL_M, DOWN_XYZW = 0.05, 0.03, (0.0, 1.0, 0.0, 0.0)
HALF_M, STEP_M, MAX_TURN_DEG = 0.12, (0.04, 0.12), 15.0


def main(argv: Sequence[str] | None = None) -> int:
    """Print the figures of one kind of paths; returns the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("kind", choices=KINDS)
    parser.add_argument("--count", type=int, default=0, help="how many paths")
    parser.add_argument("--seed", type=int, default=0, help="seed of the random paths")
    parser.add_argument("--finer", type=int, default=0, help="how many with twice the intervals")
    given = parser.parse_args(argv)
    robot = Baxter.load()
    arms = [Manipulator.of(robot, side) for side in ("left", "right")]
    plan_path_move(arms[0], None, _circle(arms[0]))  # builds what is built once
    return 0 if KINDS[given.kind](arms, given) else 1


class Planned(NamedTuple):
    """The outcome of one path.

    Attributes:
        move: the motion; None where it was refused.
        cpu_s: CPU time of planning.
        is_certified: whether `verify` certifies it.
        reason: why it was refused, or not certified.
    """

    move: PathMove | None
    cpu_s: float
    is_certified: bool
    reason: str

    @property
    def seconds(self) -> float:
        """Duration of the motion."""
        return math.nan if self.move is None else self.move.trajectory.duration

    @property
    def is_unreachable(self) -> bool:
        """Whether it was refused because a waypoint has no solution of inverse kinematics."""
        return self.move is None and "proven" in self.reason

    def __str__(self) -> str:
        if self.move is None:
            return f"refused: {self.reason}"
        said = "certified" if self.is_certified else f"NOT CERTIFIED: {self.reason}"
        return f"{self.seconds:6.2f} s, CPU {self.cpu_s / self.seconds:.2f} s/s, {said}"


def planned(
    arm: Manipulator,
    path: TipPath,
    tolerance: LineTolerance,
    scene: Scene,
    *,
    speed_m_s: float | None = None,
    stop_at_corners: bool = False,
) -> Planned:
    """Plan a motion along a path, and verify it."""
    begun_s = time.process_time()
    try:
        move = plan_path_move(
            arm,
            None,
            path,
            tolerance=tolerance,
            speed_m_s=speed_m_s,
            stop_at_corners=stop_at_corners,
            context=arm.context(scene),
        )
    except MotionError as refused:
        return Planned(None, time.process_time() - begun_s, False, str(refused))
    cpu_s = time.process_time() - begun_s
    start = State.of(arm, scene, q=move.trajectory.q_start)
    plan = Plan(start, (Move("follow", move.trajectory, path=move.path),))
    certificate = verify(complete(plan, manipulator=arm))
    return Planned(move, cpu_s, certificate.is_valid, str(certificate).split("\n", maxsplit=1)[0])


def polylines(arms: Sequence[Manipulator], given: argparse.Namespace) -> bool:
    """Random polylines; returns whether each was certified or refused with a proof."""
    is_good, rows = True, dict[str, list[tuple[float, ...]]]()
    for number, (arm, path) in enumerate(_polylines(arms, given.count or 40, given.seed)):
        for name, tolerance in (("0.1 mm", STRICT), ("1 mm", LAX)):
            found = planned(arm, path, tolerance, Scene.of())
            print(f"{number:3} {arm.arm.side:5} {len(path.poses):2} {name:6} {found}", flush=True)
            is_good &= found.is_certified or found.is_unreachable
            if found.move is None:
                continue
            stopping = planned(arm, path, tolerance, Scene.of(), stop_at_corners=True)
            finer = math.nan
            if number < given.finer:
                with _twice_the_intervals():
                    finer = planned(arm, path, tolerance, Scene.of()).seconds
            row = (
                found.seconds / stopping.seconds,
                found.seconds / finer,
                found.cpu_s / found.seconds,
            )
            rows.setdefault(name, []).append(row)
    for name, figures in rows.items():
        stops, finer, cpu = (np.array(each) for each in zip(*figures, strict=True))
        print(
            f"{name}: {len(figures)} planned; of the time with stops {np.nanmedian(stops):.3f} "
            f"(median), of that with twice the intervals {np.nanmax(finer, initial=0.0):.4f} "
            f"(most); CPU {np.median(cpu):.2f} s/s (median), {cpu.max():.2f} (most)"
        )
    return is_good


def speeds(arms: Sequence[Manipulator], given: argparse.Namespace) -> bool:
    """Paths at a set speed; returns whether all were certified."""
    is_good, shares = True, dict[str, list[float]]()
    lines = _polylines(arms, given.count or 20, given.seed)
    for number, (arm, polyline) in enumerate(lines):
        kind = ("circle", "square", "polyline")[number // 2 % 3]
        paths: dict[str, TipPath] = {"circle": _circle(arm), "square": _square(arm)}
        path = paths.get(kind, polyline)
        tolerance = STRICT if kind == "circle" else LAX
        found = planned(arm, path, tolerance, Scene.of(), speed_m_s=SPEED_M_S)
        is_good &= found.is_certified or found.is_unreachable
        share = math.nan
        if found.move is not None:
            share = float(np.diff(found.move.path.slower_s, axis=1).sum() / found.seconds)
            shares.setdefault(kind, []).append(share)
        print(f"{arm.arm.side:5} {kind:8} slower {100 * share:.1f} %, {found}", flush=True)
    for kind, each in shares.items():
        print(f"{kind}: {len(each)} planned, slower {100 * max(each):.1f} % (most)")
    return is_good


def beside_obstacles(arms: Sequence[Manipulator], given: argparse.Namespace) -> bool:
    """Polylines with a ball in the way; returns whether all that were planned are certified."""
    is_good, cpu, slower = True, list[float](), list[float]()
    for arm, path in _polylines(arms, given.count or 20, given.seed):
        alone = planned(arm, path, LAX, Scene.of())
        if alone.move is None:
            continue
        scene = Scene.of([_ball(arm, alone.move)])
        found = planned(arm, path, LAX, scene)
        print(f"{arm.arm.side:5} {len(path.poses):2} {found}", flush=True)
        if found.move is not None:
            is_good &= found.is_certified
            cpu.append(found.cpu_s / found.seconds)
            slower.append(found.seconds / alone.seconds)
    print(
        f"{len(cpu)} planned; CPU {np.median(cpu):.2f} s/s (median); duration "
        f"{np.median(slower):.3f} of that without the ball (median)"
    )
    return is_good


@contextmanager
def _twice_the_intervals() -> Iterator[None]:
    few, many, most = windows.FEW, windows.MANY, windows.MAX_INTERVALS
    windows.FEW, windows.MANY, windows.MAX_INTERVALS = 2 * few, 2 * many, 2 * most
    try:
        yield
    finally:
        windows.FEW, windows.MANY, windows.MAX_INTERVALS = few, many, most


def _polylines(
    arms: Sequence[Manipulator], count: int, seed: int
) -> Iterator[tuple[Manipulator, Polyline]]:
    """Random waypoints in front of an arm; the hand is down but for up to `MAX_TURN_DEG`."""
    for number in range(count):
        rng, arm = np.random.default_rng([seed, number]), arms[number % 2]
        middle = np.array([*_middle(arm), 0.05])
        poses, position = list[pin.SE3](), middle
        waypoints = int(rng.integers(10, 61))
        while len(poses) < waypoints:
            axis = rng.normal(size=3)
            turn = math.radians(rng.uniform(0.0, MAX_TURN_DEG)) * axis / np.linalg.norm(axis)
            poses.append(pin.SE3(pin.exp3(turn) @ _down(0.0, 0.0).rotation, position))
            step = rng.normal(size=3)
            moved = position + rng.uniform(*STEP_M) * step / np.linalg.norm(step)
            while np.abs(moved - middle).max() > HALF_M:
                step = rng.normal(size=3)
                moved = position + rng.uniform(*STEP_M) * step / np.linalg.norm(step)
            position = moved
        yield arm, Polyline(poses)


def _middle(arm: Manipulator) -> tuple[float, float]:
    return 0.70, 0.15 if arm.arm.side == "left" else -0.15


def _down(x: float, y: float) -> pin.SE3:
    return pose_from_quaternion((x, y, 0.0), DOWN_XYZW)


def _circle(arm: Manipulator) -> Arc:
    x, y = _middle(arm)
    up = np.array([0.0, 0.0, 1.0])
    return Arc(_down(x + 0.06, y), np.array([x, y, 0.0]), up, 2.0 * math.pi)


def _square(arm: Manipulator) -> Polyline:
    (x, y), half = _middle(arm), 0.06
    corners = (half, half), (-half, half), (-half, -half), (half, -half), (half, half)
    return Polyline([_down(x + dx, y + dy) for dx, dy in corners])


def _ball(arm: Manipulator, move: PathMove) -> Body:
    """A ball on the way of the middle of the forearm."""
    q: NDArray[np.float64] = move.trajectory.sample(0.5 * move.trajectory.duration).q
    poses = arm.arm.chain.poses(q[None])[0]
    elbow, wrist = (pin.SE3(poses[k]).translation for k in (3, 5))
    place = pin.SE3(np.eye(3), 0.5 * (elbow + wrist) + np.array([0.0, 0.0, -0.08]))
    return Body("ball", (Part(Sphere(BALL_M), pin.SE3.Identity()),), place)


KINDS = {"polylines": polylines, "speeds": speeds, "obstacles": beside_obstacles}

if __name__ == "__main__":
    sys.exit(main())
