"""Meetings: poses in the air at which both hands can hold the body, and which they reach soon.

The unknowns are the configurations of the giver at the pick, at the handover and at the end of its
line away from it; those of the taker at the beginning of its line to the body, at the body and at
the place; and the durations of the four motions between the lines. Each motion is taken as straight
in joint space, from rest to rest. In such a motion of duration t, a joint with limits v, a and j
moves by at most

    D(t) = j t^3 / 32               up to t = 4 a / j,
           a (t/2 - a/j) t / 2      up to t = 2 (v/a + a/j),
           v (t - v/a - a/j)        after that,

or, where v is reached before a is, j t^3 / 32 up to t = 4 sqrt(v/j), and v (t - 2 sqrt(v/j)) then.
So each motion has the rows |q_i' - q_i| <= D_i(t). Further rows fix the poses of the tips, at the
meeting that of the taker relative to the giver, and limit the turn of each joint along a line. The
objective is the time at which both hands are at the meeting, plus the duration of the taker's
motion to the place. The program is small and smooth, and converges from almost any guess in which
both hands are near their poses. It ignores obstacles, so it is solved for several minimum heights,
and the solutions are candidates.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import pinocchio as pin

from baxter_kin import Arm, JointLimits
from baxter_kin.ik import sample_solutions
from baxter_kin.kinematics.arm import JOINTS
from baxter_kin.kinematics.symbolic import SymbolicArm
from baxter_kin.validation import FloatArray
from planner.manipulator import Manipulator
from planner.motion.joint_move import rest_to_rest_s
from planner.motion.program.motion_program import answer

DIRECTIONS = (
    ((0.4, -0.8, -0.3), (0.4, -0.8, -0.3)),
    ((0.0, 0.0, -1.0), (0.4, -0.8, -0.3)),
    ((0.4, -0.8, -0.3), (0.0, 0.0, -1.0)),
    ((1.0, 0.0, 0.0), (0.4, -0.8, -0.3)),
    ((0.0, 0.0, -1.0), (1.0, 0.0, 0.0)),
)
"""Directions of the axes of both hands in guesses, the giver's first, seen from base; y counts away
from the arm's own side. The tips are also turned so that each is towards its own side."""

MIDDLE_M = (0.65, 0.0)
"""x and y of the body in base, in guesses."""

RISES_M = (0.1, 0.25, 0.4)
"""Minimum heights of the body where it is handed over, above its higher end."""

MIN_M = 1e-6
"""Distance of the tips below which they are at one place."""

FRONT_M, FARTHEST_M, WHERE_M = 0.45, 2.0, 1e-4
"""Minimum x of the body: both arms are beside the torso behind that; bound of all coordinates,
beyond the reach of the arms; and maximum distance from a given point, along each axis."""

LINE_RAD = 0.6
"""Maximum turn of a joint along a line."""

SAME_M, SAME_TURN = 0.02, 0.1
"""Maximum differences of two meetings that are the same: of positions, and of any entry of the
rotations."""

MAX_GUESSED_S, MIN_S = 20.0, 0.05
"""Bounds of the durations."""

OWN_SHARE = 0.02
"""Weight of all durations in the objective, so that none of them is undetermined."""


class Meeting(NamedTuple):
    """A candidate.

    Attributes:
        T_base_body: pose of the body.
        q: configurations of the giver and the taker there, each of shape (7,), rad.
        duration_s: of all motions, with lines and gripper actions left out.
    """

    T_base_body: pin.SE3
    q: tuple[FloatArray, FloatArray]
    duration_s: float


class Ends(NamedTuple):
    """Where the arms come from, and go to.

    Attributes:
        q_starts: configurations of the giver and the taker at first, each of shape (7,), rad.
        T_base_body: poses of the body at the pick and at the place.
        T_tips_body: the body seen from the giver's tip, and from the taker's.
        reach_m: length of the lines at the meeting.
    """

    q_starts: tuple[FloatArray, FloatArray]
    T_base_body: tuple[pin.SE3, pin.SE3]
    T_tips_body: tuple[pin.SE3, pin.SE3]
    reach_m: float

    @property
    def T_base_tips(self) -> tuple[pin.SE3, pin.SE3]:
        """The giver's tip at the pick, and the taker's at the place."""
        pick, place = self.T_base_body
        giver, taker = self.T_tips_body
        return pick * giver.inverse(), place * taker.inverse()


def meetings(
    manipulators: tuple[Manipulator, Manipulator],
    ends: Ends,
    where: Sequence[float] | None = None,
) -> Iterator[Meeting]:
    """Candidates: those near each guess in the order of their durations.

    Args:
        manipulators: of the giver and the taker.
        ends: where they come from, and go to.
        where: position of the body's frame, shape (3,), m; any when not given.
    """
    solver = _solver(*((each.arm, each.limits) for each in manipulators))
    q_ends = [
        _soonest(each, T, q)
        for each, T, q in zip(manipulators, ends.T_base_tips, ends.q_starts, strict=True)
    ]
    if any(q is None for q in q_ends):
        return
    found: list[Meeting] = []
    high_m = max(T.translation[2] for T in ends.T_base_body)
    rises = RISES_M if where is None else (0.0,)
    for guess in _guesses(manipulators, ends, where, high_m + RISES_M[1]):
        near: list[Meeting] = []
        q_giver, q_taker = guess
        qs = q_ends[0], q_giver, q_giver, q_taker, q_taker, q_ends[1]
        x = np.concatenate([*qs, np.full(5, 2.0)])
        for rise_m in rises:
            solved = solver.solved(x, ends, _bounds(where, high_m + rise_m))
            if solved is None:
                break
            x = solved
            meeting = _meeting(manipulators[0].arm, solved, ends)
            if not any(_are_same(meeting, other) for other in (*found, *near)):
                near.append(meeting)
        yield from sorted(near, key=lambda each: each.duration_s)
        found += near


def _soonest(manipulator: Manipulator, T_base_tip: pin.SE3, q: FloatArray) -> FloatArray | None:
    """Of samples of the solutions of a pose, that which the arm can reach first."""
    found = sample_solutions(manipulator.ik, T_base_tip)
    if not len(found):
        return None
    times: FloatArray = rest_to_rest_s(found - q, manipulator.limits)
    soonest: FloatArray = found[np.argmin(times)]
    return soonest


def _guesses(
    manipulators: tuple[Manipulator, Manipulator],
    ends: Ends,
    where: Sequence[float] | None,
    height_m: float,
) -> Iterator[list[FloatArray]]:
    """Configurations of both arms at a body in the middle, with their hands in some directions."""
    p = np.array([*MIDDLE_M, height_m] if where is None else where)
    outwards = 1.0 if manipulators[0].arm.side == "left" else -1.0
    giver, taker = (T.inverse() for T in ends.T_tips_body)
    across = taker.translation - giver.translation
    axes = [giver.rotation[:, 2], taker.rotation[:, 2], across / max(np.linalg.norm(across), MIN_M)]
    for of_giver, of_taker in DIRECTIONS:
        wanted = [
            np.array(of_giver) * (1.0, outwards, 1.0),
            np.array(of_taker) * (1.0, -outwards, 1.0),
            np.array([0.0, -outwards, 0.0]),
        ]
        T = pin.SE3(_turned(axes, wanted), p)
        q_giver = _soonest(manipulators[0], T * giver, ends.q_starts[0])
        q_taker = _soonest(manipulators[1], T * taker, ends.q_starts[1])
        if q_giver is not None and q_taker is not None:
            yield [q_giver, q_taker]


def _turned(axes: Sequence[FloatArray], wanted: Sequence[FloatArray]) -> FloatArray:
    """The rotation that turns axes as near as possible to others (Kabsch)."""
    U, _, V = np.linalg.svd(sum(np.outer(w, axis) for w, axis in zip(wanted, axes, strict=True)))
    R: FloatArray = U @ np.diag([1.0, 1.0, np.linalg.det(U @ V)]) @ V
    return R


def _bounds(where: Sequence[float] | None, least_m: float) -> tuple[FloatArray, FloatArray]:
    """Bounds of the body's position, each of shape (3,), m."""
    if where is not None:
        return np.array(where) - WHERE_M, np.array(where) + WHERE_M
    return np.array([FRONT_M, -FARTHEST_M, least_m]), np.full(3, FARTHEST_M)


def _meeting(giver: Arm, x: FloatArray, ends: Ends) -> Meeting:
    _, q_giver, _, _, q_taker, _ = np.split(x[: 6 * len(JOINTS)], 6)
    T_base_body = giver.T_base_tip(q_giver) * ends.T_tips_body[0]
    *_, to_place, both = x[6 * len(JOINTS) :]
    return Meeting(T_base_body, (q_giver, q_taker), float(both + to_place))


def _are_same(one: Meeting, other: Meeting) -> bool:
    T, T_other = one.T_base_body, other.T_base_body
    is_near = np.abs(T.translation - T_other.translation).max() < SAME_M
    return bool(is_near and np.abs(T.rotation - T_other.rotation).max() < SAME_TURN)


class _Solver:
    """The program of two arms with their limits, for any bodies and poses."""

    def __init__(self, arms: tuple[Arm, Arm], limits: tuple[JointLimits, JointLimits]) -> None:
        names = "pick", "giver", "back", "before", "taker", "place"
        q = [ca.SX.sym(name, len(JOINTS)) for name in names]
        t, starts = ca.SX.sym("t", 5), ca.SX.sym("starts", 2 * len(JOINTS))
        poses = [ca.SX.sym(name, 3, 4) for name in ("T_pick", "T_giver_taker", "T_place")]
        giver_body, reach_m = ca.SX.sym("giver_body", 3), ca.SX.sym("reach")
        pick, giver, back, before, taker, place = (
            _tip(arms[number // 3], at) for number, at in enumerate(q)
        )
        p_giver, R_giver = giver
        handed = p_giver + R_giver @ poses[1][:, 3], R_giver @ poses[1][:, :3]
        exact = [
            _apart(pick, (poses[0][:, 3], poses[0][:, :3])),
            _apart(handed, taker),
            _apart(_behind(giver, reach_m), back),
            _apart(_behind(taker, reach_m), before),
            _apart(place, (poses[2][:, 3], poses[2][:, :3])),
        ]
        least = [t[4] - t[0] - t[1], t[4] - t[2]]
        first, other = ca.vertsplit(starts, len(JOINTS))
        ways = ((first, q[0]), (q[0], q[1]), (other, q[3]), (q[4], q[5]))
        for number, (begin, end) in enumerate(ways):
            for way, reach in zip(
                ca.vertsplit(end - begin), _reaches(t[number], limits[number // 2]), strict=True
            ):
                least += [reach - way, reach + way]
        for begin, end in ((q[1], q[2]), (q[3], q[4])):
            least += [LINE_RAD - (end - begin), LINE_RAD + (end - begin)]
        g = ca.vertcat(*exact, *least, p_giver + R_giver @ giver_body)
        nlp = {
            "x": ca.vertcat(*q, t),
            "p": ca.vertcat(starts, *map(ca.vec, poses), giver_body, reach_m),
            "f": t[4] + t[3] + OWN_SHARE * ca.sum1(t),
            "g": g,
        }
        options: dict[str, Any] = {
            "ipopt.print_level": 0,
            "ipopt.sb": "yes",
            "print_time": False,
            "ipopt.max_iter": 60,
            "ipopt.tol": 1e-4,
            "ipopt.mu_strategy": "adaptive",
        }
        self._solver = ca.nlpsol("meeting", "ipopt", nlp, options)
        zeros, count = 6 * len(exact), ca.vertcat(*least).numel()
        self._low = np.zeros(zeros + count)
        self._high = np.concatenate([np.zeros(zeros), np.full(count, np.inf)])
        of_q = [
            [getattr(limits[k], name) for k in (0, 0, 0, 1, 1, 1)] for name in ("q_min", "q_max")
        ]
        self._lbx = np.concatenate([*of_q[0], np.full(5, MIN_S)])
        self._ubx = np.concatenate([*of_q[1], np.full(5, MAX_GUESSED_S)])

    def solved(
        self, x0: FloatArray, ends: Ends, bounds: tuple[FloatArray, FloatArray]
    ) -> FloatArray | None:
        """The unknowns of the solution near a guess, shape (47,); None where there is none."""
        pick, place = ends.T_base_tips
        giver, taker = ends.T_tips_body
        poses = pick, giver * taker.inverse(), place
        numbers = [T.homogeneous[:3].ravel("F") for T in poses]
        inputs = {
            "x0": x0.clip(self._lbx, self._ubx),
            "p": np.concatenate([*ends.q_starts, *numbers, giver.translation, [ends.reach_m]]),
            "lbx": self._lbx,
            "ubx": self._ubx,
            "lbg": np.concatenate([self._low, bounds[0]]),
            "ubg": np.concatenate([self._high, bounds[1]]),
        }
        return answer(self._solver, inputs)


@lru_cache(maxsize=4)
def _solver(giver: tuple[Arm, JointLimits], taker: tuple[Arm, JointLimits]) -> _Solver:
    return _Solver((giver[0], taker[0]), (giver[1], taker[1]))


def _tip(arm: Arm, q: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Position and rotation of a tip in base."""
    own = SymbolicArm.of(arm)
    position, rotation = ca.Function("tip", [own.q], [own.p_base_tip, own.R_base_tip])(q)
    return position, rotation


def _behind(tip: tuple[ca.SX, ca.SX], reach_m: ca.SX) -> tuple[ca.SX, ca.SX]:
    """The pose of a tip that has gone back along its axis."""
    return tip[0] - reach_m * tip[1][:, 2], tip[1]


def _apart(one: tuple[ca.SX, ca.SX], other: tuple[ca.SX, ca.SX]) -> ca.SX:
    """Six numbers that are zero for two equal poses, or for some that are half a turn apart."""
    E = one[1].T @ other[1]
    turn = ca.vertcat(E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1])
    return ca.vertcat(other[0] - one[0], turn)


def _reaches(t: ca.SX, limits: JointLimits) -> Iterator[ca.SX]:
    """D(t) of each joint."""
    for v, a, j in zip(limits.v_max, limits.a_max, limits.j_max, strict=True):
        cubic = j * t**3 / 32.0
        if v * j < a * a:
            ramp_s = 2.0 * np.sqrt(v / j)
            yield ca.if_else(t < 2.0 * ramp_s, cubic, v * (t - ramp_s))
            continue
        ramp_s = v / a + a / j
        uniform = a * (t / 2.0 - a / j) * t / 2.0
        after = ca.if_else(t < 2.0 * ramp_s, uniform, v * (t - ramp_s))
        yield ca.if_else(t < 4.0 * a / j, cubic, after)
