"""Compare straight moves with their optimum: `python scripts/straight_optimum.py [SEGMENTS]`.

The optimum is the least time in which the same path q(s) can be run through under the same limits
on joint velocity, acceleration and jerk. It is computed by other means than the planner's: s(t) has
constant jerk on SEGMENTS equal intervals (default 200), its states are unknowns joined by multiple
shooting, the joints' rates follow from q', q'' and q''' as CasADi expressions and are bounded at
both ends of every interval, and IPOPT solves the nonlinear program with exact second derivatives.
Bounds are kept at the ends of intervals only, so the figure errs to the fast side.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator
from typing import NamedTuple

import casadi as ca
import numpy as np
import pinocchio as pin

from baxter_kin import Arm, Baxter, IKService, JointLimits, pose_from_quaternion
from baxter_kin.arrays import Vector
from planner.path_timing import plan_path_move
from planner.straight_path import PathState, StraightPath, plan_straight_path
from planner.timing import plan_joint_move
from planner.trajectory import Trajectory

OVERHEAD_XYZW = (0.0, 1.0, 0.0, 0.0)
SEGMENTS = 200
DESCENT_M = 0.15
GRASPS_M = ((0.70, 0.15, -0.129), (0.75, 0.00, -0.129))
SAMPLES = 401


class Case(NamedTuple):
    """A path and how it is to be run through."""

    label: str
    path: StraightPath
    limits: JointLimits
    start: PathState = PathState(0.0)


def main() -> None:
    """Compute and print."""
    segments = int(sys.argv[1]) if len(sys.argv) > 1 else SEGMENTS
    print(f"{'move':<42}{'ours':>9}{'optimum':>9}{'ratio':>8}{'on s':>8}{'CPU':>9}  segments")
    ratios = []
    for case in _cases():
        ours, cost_s = _planned(case)
        best_s = optimum_s(case, segments)
        ratios.append(ours.duration / best_s)
        print(
            f"{case.label:<42}{ours.duration:7.4f} s{best_s:7.4f} s{ratios[-1]:8.4f}"
            f"{_on_parameter(case) / best_s:8.4f}{1e3 * cost_s:6.1f} ms{len(ours.j):6}"
        )
    print(f"worst ratio {max(ratios):.4f}, median {float(np.median(ratios)):.4f}")
    print(
        "on s: ratio of the fastest motion of s under constant limits (Ruckig); CPU: of the timing"
    )


def optimum_s(case: Case, segments: int) -> float:
    """The least duration."""
    joint_rates, joint_jerks = _rates(case)
    X, U, T = ca.MX.sym("X", 3, segments + 1), ca.MX.sym("U", 1, segments), ca.MX.sym("T")
    h, (s, v, a) = T / segments, ca.vertsplit(X[:, :-1])
    ahead = ca.vertcat(s + h * (v + h * (a / 2 + h * U / 6)), v + h * (a + h * U / 2), a + h * U)
    inner = X[:, 1:-1]
    bounded = [
        ca.vec(joint_rates.map(segments - 1)(inner)),
        ca.vec(joint_jerks.map(segments)(X[:, :-1], U)),
        ca.vec(joint_jerks.map(segments)(X[:, 1:], U)),
    ]
    defects, ratios = ca.vec(ahead - X[:, 1:]), ca.vertcat(*bounded)
    unknowns = ca.vertcat(ca.vec(X), ca.vec(U), T)
    solver = ca.nlpsol(
        "optimum",
        "ipopt",
        {"x": unknowns, "f": T, "g": ca.vertcat(defects, ratios)},
        {"ipopt": {"print_level": 0, "sb": "yes", "max_iter": 1000}, "print_time": False},
    )
    low, high = _unknown_bounds(case, segments)
    bound = np.concatenate([np.zeros(defects.numel()), np.ones(ratios.numel())])
    guess = _guess(case, segments)
    solution = solver(x0=guess, lbx=low, ubx=high, lbg=-bound, ubg=bound)
    if not solver.stats()["success"]:
        raise RuntimeError(f"IPOPT on {case.label}: {solver.stats()['return_status']}")
    return float(solution["f"])


def _rates(case: Case) -> tuple[ca.Function, ca.Function]:
    """Velocity and acceleration over their limits, and jerk over its, of (s, ds/dt, ...)."""
    x, jerk = ca.SX.sym("x", 3), ca.SX.sym("jerk")
    s, v, a = ca.vertsplit(x)
    u = 2 * s - 1
    chebyshev = [ca.SX(1), u]
    for _ in range(2, len(case.path.coefficients)):
        chebyshev.append(2 * u * chebyshev[-1] - chebyshev[-2])
    q = ca.DM(case.path.coefficients.T) @ ca.vertcat(*chebyshev)
    d1 = ca.jacobian(q, s)
    d2 = ca.jacobian(d1, s)
    d3 = ca.jacobian(d2, s)
    limits = case.limits
    rates = ca.vertcat(d1 * v / limits.v_max, (d2 * v**2 + d1 * a) / limits.a_max)
    jerks = (d3 * v**3 + 3 * d2 * v * a + d1 * jerk) / limits.j_max
    return ca.Function("rates", [x], [rates]), ca.Function("jerks", [x, jerk], [jerks])


def _unknown_bounds(case: Case, segments: int) -> tuple[Vector, Vector]:
    states = 3 * (segments + 1)
    high = np.full(states + segments + 1, np.inf)
    low = -high
    low[1:states:3] = 0.0
    start = (case.start.s, case.start.speed_per_s, case.start.acceleration_per_s2)
    low[:3], low[states - 3 : states] = start, (1.0, 0.0, 0.0)
    high[:3], high[states - 3 : states] = start, (1.0, 0.0, 0.0)
    low[-1] = 0.0
    return low, high


def _guess(case: Case, segments: int) -> Vector:
    """A minimum-jerk motion of one second."""
    t, way = np.linspace(0.0, 1.0, segments + 1), 1.0 - case.start.s
    s = case.start.s + way * t**3 * (10 - 15 * t + 6 * t**2)
    v, a = way * 30 * t**2 * (1 - t) ** 2, way * (60 * t - 180 * t**2 + 120 * t**3)
    return np.concatenate([np.stack([s, v, a], axis=1).ravel(), np.diff(a) * segments, [1.0]])


def _planned(case: Case) -> tuple[Trajectory, float]:
    started = time.process_time()
    motion = plan_path_move(case.path, case.limits, start=case.start)
    return motion, time.process_time() - started


def _on_parameter(case: Case) -> float:
    """The duration of the fastest motion of s alone, scaled to the limits; nan when in motion."""
    if not case.start.is_at_rest:
        return math.nan
    q = case.path.at(np.linspace(0.0, 1.0, SAMPLES))
    v, a, j = (
        np.array([float((bound / np.abs(q.dq).max(axis=0)).min())])
        for bound in (case.limits.v_max, case.limits.a_max, case.limits.j_max)
    )
    limits = JointLimits(("s",), np.zeros(1), np.ones(1), v, a, j)
    motion = plan_joint_move([0.0], [1.0], limits)
    return motion.duration * _slowing(case, motion)


def _slowing(case: Case, motion: Trajectory) -> float:
    """By what factor the joints make a motion of s last longer."""
    t = np.linspace(0.0, motion.duration, SAMPLES)
    _, v, a = motion.sample(t)
    i = np.searchsorted(motion.knots_s, t[:-1], side="right") - 1
    q = case.path.at(np.clip(motion.sample(t).q[:, 0], 0.0, 1.0))
    jerk = (q.dddq * v**3 + 3 * q.ddq * v * a)[:-1] + q.dq[:-1] * motion.j[i]
    peaks = (
        np.abs(q.dq * v / case.limits.v_max).max(),
        np.abs((q.ddq * v**2 + q.dq * a) / case.limits.a_max).max() ** (1 / 2),
        np.abs(jerk / case.limits.j_max).max() ** (1 / 3),
    )
    return float(max(peaks))


def _cases() -> Iterator[Case]:
    robot = Baxter.load()
    for side in ("left", "right"):
        arm = robot.arm(side)
        ik = IKService(arm)
        for x, y, z in GRASPS_M:
            yield from _pick(arm, ik, (x, y if side == "left" else -y, z))
        yield from _others(arm, ik)


def _pick(arm: Arm, ik: IKService, grasp_m: tuple[float, float, float]) -> Iterator[Case]:
    x, y, z = grasp_m
    where = f"{arm.side} ({x:.2f}, {y:.2f})"
    hover = pose_from_quaternion((x, y, z + DESCENT_M), OVERHEAD_XYZW)
    down = _path(arm, ik, hover, pose_from_quaternion(grasp_m, OVERHEAD_XYZW))
    yield Case(f"{where} descend", down, arm.limits)
    yield Case(f"{where} retract", down.reversed(), arm.limits)
    yield Case(f"{where} descend from 0.2 m/s", down, arm.limits, PathState(0.0, 0.2 / DESCENT_M))
    yield Case(f"{where} descend, speed 0.2", down, arm.limits.scaled(0.2))


def _others(arm: Arm, ik: IKService) -> Iterator[Case]:
    y = 0.25 if arm.side == "left" else -0.25
    start = pose_from_quaternion((0.65, y, 0.05), OVERHEAD_XYZW)
    ways = {
        "sideways 20 cm": ((0.0, -0.2, 0.0), (0.0, 0.0, 0.0)),
        "forward 10 cm": ((0.1, 0.0, 0.0), (0.0, 0.0, 0.0)),
        "on the spot, 60 deg about z": ((0.0, 0.0, 0.0), (0.0, 0.0, math.radians(60.0))),
        "8 cm and 40 deg": ((0.05, 0.05, -0.04), tuple(np.radians([30.0, 20.0, 17.0]))),
        "1 cm": ((0.0, 0.0, 0.01), (0.0, 0.0, 0.0)),
    }
    for label, (shift, turn) in ways.items():
        goal = pin.SE3(
            pin.exp3(np.array(turn)) @ start.rotation, start.translation + np.array(shift)
        )
        yield Case(f"{arm.side} {label}", _path(arm, ik, start, goal), arm.limits)


def _path(arm: Arm, ik: IKService, start: pin.SE3, goal: pin.SE3) -> StraightPath:
    result = ik.solve(start, current=arm.start)
    return plan_straight_path(arm, result.q, goal, arm.limits)


if __name__ == "__main__":
    main()
