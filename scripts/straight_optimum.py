"""Compare straight moves with their optimum: `python scripts/straight_optimum.py [SEGMENTS]`.

Two optima. One is the least time in which the path of least norm q(s) can be run through under the
same limits on joint velocity, acceleration and jerk; straight moves may beat it, as the arm's
self-motion is theirs to choose. It is computed by other means than the planner's: q(s) is a
Chebyshev polynomial, s(t) has constant jerk on SEGMENTS equal intervals (default 200), its states
are unknowns joined by multiple shooting, the joints' rates follow from three derivatives of q as
CasADi expressions and are bounded at both ends of every interval, and IPOPT solves the nonlinear
program with exact second derivatives. Bounds are kept at the ends of intervals only, so the figure
errs to the fast side. The other is the planner's own program on four times as many intervals.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import NamedTuple

import casadi as ca
import numpy as np
import pinocchio as pin
from numpy.polynomial import chebyshev

from baxter_kin import Arm, Baxter, IKService, JointLimits, pose_from_quaternion
from baxter_kin.command_line import OneSentenceParser, whole_number
from baxter_kin.validation import FloatArray
from planner.motion.program.guess import follow
from planner.motion.straight_line import MIN_LENGTH, StraightLine
from planner.motion.straight_move import plan_straight_move
from planner.trajectory import Trajectory

OVERHEAD_XYZW = (0.0, 1.0, 0.0, 0.0)
SEGMENTS = 200
DESCENT_M = 0.15
GRASPS_M = ((0.70, 0.15, -0.129), (0.75, 0.00, -0.129))
DEGREE, MAX_STEPS, FINER = 32, 400, 4


class Case(NamedTuple):
    """A line and how it is to be run through."""

    label: str
    arm: Arm
    q_start: FloatArray
    T_base_goal: pin.SE3
    limits: JointLimits
    speed_m_s: float = 0.0

    @property
    def line(self) -> StraightLine:
        """Of the tip."""
        return StraightLine(self.arm.T_base_tip(self.q_start), self.T_base_goal)

    @property
    def start(self) -> tuple[float, float, float]:
        """The fraction of the way at first, and its derivatives by time."""
        return 0.0, self.speed_m_s / max(self.line.length_m, MIN_LENGTH), 0.0


def main() -> None:
    """Compute and print."""
    parser = OneSentenceParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument(
        "segments", nargs="?", type=whole_number(1), default=SEGMENTS, help="default: %(default)s"
    )
    segments = parser.parse_args().segments
    print(f"{'move':<38}{'ours':>9}{'least norm':>16}{'finer':>16}{'CPU':>9}  intervals")
    ratios = []
    for case in _cases():
        _planned(case)  # builds the program
        ours, cost_s = _planned(case)
        norm_s, finer_s = optimum_s(case, segments), _planned(case, FINER)[0].duration
        ratios.append((ours.duration / norm_s, ours.duration / finer_s))
        print(
            f"{case.label:<38}{ours.duration:7.4f} s{norm_s:7.4f} s{ratios[-1][0]:7.3f}"
            f"{finer_s:7.4f} s{ratios[-1][1]:7.4f}{1e3 * cost_s:6.1f} ms{len(ours.j):6}"
        )
    for name, column in zip(("least norm", "finer"), np.transpose(ratios), strict=True):
        print(f"over {name}: worst {column.max():.4f}, median {float(np.median(column)):.4f}")


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
    guess = _guess(segments)
    solution = solver(x0=guess, lbx=low, ubx=high, lbg=-bound, ubg=bound)
    if not solver.stats()["success"]:
        raise RuntimeError(f"IPOPT on {case.label}: {solver.stats()['return_status']}")
    return float(solution["f"])


def _rates(case: Case) -> tuple[ca.Function, ca.Function]:
    """Velocity and acceleration over their limits, and jerk over its, of (s, ds/dt, ...)."""
    x, jerk = ca.SX.sym("x", 3), ca.SX.sym("jerk")
    s, v, a = ca.vertsplit(x)
    u = 2 * s - 1
    polynomials = [ca.SX(1), u]
    for _ in range(2, DEGREE + 1):
        polynomials.append(2 * u * polynomials[-1] - polynomials[-2])
    q = ca.DM(_coefficients(case).T) @ ca.vertcat(*polynomials)
    d1 = ca.jacobian(q, s)
    d2 = ca.jacobian(d1, s)
    d3 = ca.jacobian(d2, s)
    limits = case.limits
    rates = ca.vertcat(d1 * v / limits.v_max, (d2 * v**2 + d1 * a) / limits.a_max)
    jerks = (d3 * v**3 + 3 * d2 * v * a + d1 * jerk) / limits.j_max
    return ca.Function("rates", [x], [rates]), ca.Function("jerks", [x, jerk], [jerks])


def _unknown_bounds(case: Case, segments: int) -> tuple[FloatArray, FloatArray]:
    states = 3 * (segments + 1)
    high = np.full(states + segments + 1, np.inf)
    low = -high
    low[1:states:3] = 0.0
    low[:3], low[states - 3 : states] = case.start, (1.0, 0.0, 0.0)
    high[:3], high[states - 3 : states] = case.start, (1.0, 0.0, 0.0)
    low[-1] = 0.0
    return low, high


def _guess(segments: int) -> FloatArray:
    """A minimum-jerk motion of one second."""
    t = np.linspace(0.0, 1.0, segments + 1)
    s = t**3 * (10 - 15 * t + 6 * t**2)
    v, a = 30 * t**2 * (1 - t) ** 2, 60 * t - 180 * t**2 + 120 * t**3
    return np.concatenate([np.stack([s, v, a], axis=1).ravel(), np.diff(a) * segments, [1.0]])


def _coefficients(case: Case) -> FloatArray:
    """The path of least norm as Chebyshev polynomials in 2 s - 1, shape (DEGREE + 1, 7)."""
    s = 0.5 - 0.5 * np.cos(np.pi * np.arange(DEGREE + 1) / DEGREE)
    steps = np.unique(np.concatenate([s[1:], np.linspace(0.0, 1.0, MAX_STEPS + 1)[1:]]))
    found = follow(case.arm, case.limits, case.q_start, case.line, steps.tolist())
    qs = np.array([case.q_start, *found.qs])[np.searchsorted([0.0, *steps], s)]
    vandermonde = chebyshev.chebvander(2.0 * s - 1.0, DEGREE)
    return np.asarray(np.linalg.solve(vandermonde, qs), dtype=np.float64)


def _planned(case: Case, fineness: int = 1) -> tuple[Trajectory, float]:
    started = time.process_time()
    motion = plan_straight_move(
        case.arm,
        case.q_start,
        case.T_base_goal,
        case.limits,
        speed_start_m_s=case.speed_m_s,
        fineness=fineness,
    )
    return motion, time.process_time() - started


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
    q, goal = _solution(arm, ik, hover), pose_from_quaternion(grasp_m, OVERHEAD_XYZW)
    yield Case(f"{where} descend", arm, q, goal, arm.limits)
    q_down = plan_straight_move(arm, q, goal, arm.limits).q_goal
    yield Case(f"{where} retract", arm, q_down, hover, arm.limits)
    yield Case(f"{where} descend from 0.2 m/s", arm, q, goal, arm.limits, 0.2)
    yield Case(f"{where} descend, speed 0.2", arm, q, goal, arm.limits.scaled(0.2))


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
        yield Case(f"{arm.side} {label}", arm, _solution(arm, ik, start), goal, arm.limits)


def _solution(arm: Arm, ik: IKService, T: pin.SE3) -> FloatArray:
    return ik.solve(T, current=arm.start).q


if __name__ == "__main__":
    main()
