"""Guesses for motions of a body that both hands hold, and why there are none.

A guess has the configurations of both arms at the knots of a motion. Along a line of the body, each
arm follows by least-norm steps from the start. Where an arm cannot, and the body must stay on that
line, it may be proven that the arm does not reach a place on it.

Other guesses end in sampled solutions of the goal. They go there directly in joint space, and are
corrected at each knot so that the hands keep their relative pose. Most solutions cannot be reached
like this: the wrist of an arm is bent the other way, for example, and would have to be straight in
between. Such guesses are left out, as the motion program hardly ever finds a motion near them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pinocchio as pin

from baxter_kin import Arm, IKService, JointLimits
from baxter_kin.frames import raised
from baxter_kin.ik import IKFailure, sample_solutions
from baxter_kin.ik.reach.bound import ReachBound
from baxter_kin.validation import FloatArray
from planner.collision.context import CollisionContext
from planner.collision.mover import Mover
from planner.errors import FreeMoveError, StraightMoveError
from planner.motion.joint_move import rest_to_rest_s
from planner.motion.paths.straight_line import LineTolerance, StraightLine
from planner.motion.program.guess import follow, stepped
from planner.two_arms.pair_moves.relative_pose import relative_poses

GOALS, MAX_GOALS_TRIED = 4, 16
"""Maximum number of guesses that end in other solutions of the goal, and of clear pairs of
solutions that are tried for them."""

RISES_M = (0.1, 0.2)
"""Heights over which the body is lifted in other guesses."""

MIN_STRIDE = 1.0 / 256.0
"""Minimum step along a line of the body, as a share of it. With much smaller ones, most of the time
of a guess is spent where an arm cannot follow."""

MAX_CORRECTION_RAD, MAX_CORRECTIONS, CLOSED = 0.5, 12, 1e-6
"""Newton's method for the relative pose of the hands: maximum change of a joint and number of steps
at a knot, and error at convergence, m and rad combined."""


@dataclass(frozen=True, slots=True, eq=False)
class CarriedLine:
    """The poses of a tip that carries a body along a line, by the fraction of the way."""

    line: StraightLine
    T_body_tip: pin.SE3

    def at(self, s: float) -> pin.SE3:
        """The pose at a fraction."""
        return self.line.at(s) * self.T_body_tip

    def error(self, s: float, T_base_tip: pin.SE3) -> FloatArray:
        """Twist from a pose to that at s, shape (6,), m and rad, in base."""
        return _twist(T_base_tip, self.at(s))


@dataclass(frozen=True, slots=True, eq=False)
class PairTask:
    """A body in both hands, and where it goes.

    Attributes:
        context: of both arms and the body.
        limits: of 14 joints.
        mover: the arms, with the links that hold the body as their tips.
        q_start: initial configuration, shape (14,), rad.
        T_tips_body: pose of the body, seen from each tip.
        goal: final pose of the body in base.
    """

    context: CollisionContext
    limits: JointLimits
    mover: Mover
    q_start: FloatArray
    T_tips_body: tuple[pin.SE3, ...]
    goal: pin.SE3

    @property
    def start(self) -> pin.SE3:
        """Initial pose of the body in base."""
        return self.mover.arms[0].T_base_tip(self.q_start[:7]) * self.T_tips_body[0]

    @property
    def T_left_right(self) -> pin.SE3:
        """The relative pose of the tips, which is that at the start."""
        return pin.SE3(relative_poses(self.mover, self.q_start[None])[0])


@dataclass(frozen=True, slots=True, eq=False)
class PairGuesses:
    """Guesses for one motion.

    Attributes:
        task: the body and its goal.
        tolerance: of the line, where the body moves on a straight one; otherwise None.
        goals: solutions of the goal of each arm, shape (n, 7) each.
    """

    task: PairTask
    tolerance: LineTolerance | None
    goals: tuple[FloatArray, ...]

    def at(self, intervals: int, reasons: list[str]) -> Iterator[FloatArray]:
        """Configurations at the knots, shape (n + 1, 14), that nearly keep the relative pose.

        Raises FreeMoveError where the straight line is proven out of reach.
        """
        t = np.linspace(0.0, 1.0, intervals + 1)
        eased = t**3 * (10.0 - 15.0 * t + 6.0 * t**2)
        qs = None
        with suppress(StraightMoveError):  # half a turn
            line = StraightLine(self.task.start, self.task.goal)
            qs = self.followed([(line, eased[1:])], reasons)
            if qs is not None:
                yield qs
        if self.tolerance is not None:
            return
        others = [self.lifted(eased), self.to_other_goals(eased, reasons)]
        for guesses in others if qs is not None else reversed(others):
            yield from guesses

    def lifted(self, eased: FloatArray) -> Iterator[FloatArray]:
        """The guesses that lift the body, carry it across, and lower it."""
        top_m = max(T.translation[2] for T in (self.task.start, self.task.goal))
        for rise_m in RISES_M:
            with suppress(StraightMoveError):
                qs = self._lifted_to(top_m + rise_m, eased)
                if qs is not None:
                    yield qs

    def _lifted_to(self, height_m: float, eased: FloatArray) -> FloatArray | None:
        over = [raised(T, height_m - T.translation[2]) for T in (self.task.start, self.task.goal)]
        ends = [self.task.start, *over, self.task.goal]
        lengths = [np.linalg.norm(b.translation - a.translation) for a, b in pairwise(ends)]
        cuts = np.cumsum([0.0, *lengths]) / max(sum(lengths), 1e-9)
        parts = []
        for k in range(3):
            inside = (eased[1:] > cuts[k]) & (eased[1:] <= cuts[k + 1] + (k == 2))
            width = max(cuts[k + 1] - cuts[k], 1e-9)
            parts.append(
                (StraightLine(ends[k], ends[k + 1]), (eased[1:][inside] - cuts[k]) / width)
            )
        return self.followed(parts, [])

    def followed(
        self, parts: list[tuple[StraightLine, FloatArray]], reasons: list[str]
    ) -> FloatArray | None:
        """Both arms along lines of the body; None where one cannot follow."""
        found = []
        for arm, T, limits, q in self._each_arm():
            qs = [q]
            for line, fractions in parts:
                carried, at = CarriedLine(line, T.inverse()), fractions.clip(0.0, 1.0).tolist()
                there = follow(arm, limits, qs[-1], carried, at, min_stride=MIN_STRIDE)
                if len(there.qs) == len(at):
                    qs += there.qs
                    continue
                if self.tolerance is not None:
                    self._refuse_gap(arm, carried, at[len(there.qs) :], self.tolerance.position_m)
                reasons.append(
                    f"the {arm.side} arm can follow the straight line of the body for "
                    f"{there.fraction:.1%} of the way only"
                )
                return None
            found.append(qs)
        return np.concatenate([np.array(qs) for qs in found], axis=1)

    @staticmethod
    def _refuse_gap(
        arm: Arm, line: CarriedLine, fractions: Sequence[float], tolerance_m: float
    ) -> None:
        """Raise FreeMoveError where a line is proven out of reach at one of some fractions.

        The proof is for the exact orientation, and for positions up to the tolerance beside it.
        """
        bound = ReachBound(arm)
        for s in fractions:
            beyond = bound.proof(line.at(s))
            beyond = None if beyond is None else beyond.less(tolerance_m)
            if beyond is not None:
                raise FreeMoveError(
                    f"the straight line is out of reach of the {arm.side} arm after {s:.1%} of the "
                    f"way, in the exact orientation: {beyond}"
                )

    def to_other_goals(self, eased: FloatArray, reasons: list[str]) -> Iterator[FloatArray]:
        """Guesses to the nearest solutions of the goal, of each arm."""
        solutions = []
        for (_, _, limits, q), found in zip(self._each_arm(), self.goals, strict=True):
            times = rest_to_rest_s(found - q, limits)
            solutions.append((found[np.argsort(times)], np.sort(times)))
        (left, left_s), (right, right_s) = solutions
        pairs = [
            (max(left_s[i], right_s[j]), i, j)
            for i in range(0, len(left), max(1, len(left) // 40))
            for j in range(0, len(right), max(1, len(right) // 40))
        ]
        yielded = tried = 0
        for _, i, j in sorted(pairs):
            q_goal = np.concatenate([left[i], right[j]])
            if not self.task.context.is_free(q_goal):
                continue
            tried += 1
            qs = self.held_together(q_goal, eased)
            if qs is not None:
                yield qs
                yielded += 1
            if yielded == GOALS or tried == MAX_GOALS_TRIED:
                break
        if not tried:
            reasons.append("no two solutions of the goal, of those sampled, are clear at once")
        elif not yielded:
            reasons.append(
                f"on the way to each of the {tried} nearest clear solutions of the goal, the hands "
                f"cannot keep their relative pose ({self.farthest_joint()})"
            )

    def farthest_joint(self) -> str:
        """The joint whose start is farthest from its nearest value in any solution of the goal."""
        changes = [
            np.abs(found - q).min(axis=0)
            for found, q in zip(self.goals, np.split(self.task.q_start, 2), strict=True)
        ]
        joint = int(np.concatenate(changes).argmax())
        arm, k = divmod(joint, len(changes[0]))
        solutions = f"{len(self.goals[arm])} sampled solutions"
        name = self.task.limits.names[joint]
        return f"{name} is {changes[arm][k]:.2f} rad or more from all {solutions}"

    def held_together(self, q_goal: FloatArray, eased: FloatArray) -> FloatArray | None:
        """The way to a solution of the goal, corrected at each knot; None where that fails."""
        T_left_right = self.task.T_left_right
        qs = [self.task.q_start]
        for before, s in pairwise(eased.tolist()):
            ahead = qs[-1] + (q_goal - qs[-1]) * (s - before) / (1.0 - before)
            q = self._corrected(ahead, T_left_right)
            if q is None or np.abs(q - ahead).max() > MAX_CORRECTION_RAD:
                return None
            qs.append(q)
        return np.array(qs)

    def _corrected(self, q: FloatArray, T_left_right: pin.SE3) -> FloatArray | None:
        """The configuration nearby in which the hands have a relative pose, by least-norm steps."""
        left, right = self.task.mover.arms
        for _ in range(MAX_CORRECTIONS):
            own, other = np.split(q, 2)
            T_left = left.T_base_tip(own)
            T_right, wanted = right.T_base_tip(other), T_left * T_left_right
            error = _twist(T_right, wanted)
            if np.linalg.norm(error) <= CLOSED:
                return q
            carried = left.jacobian(own)
            carried[:3] -= pin.skew(wanted.translation - T_left.translation) @ carried[3:]
            J = np.concatenate([-carried, right.jacobian(other)], axis=1)
            q = stepped(q, J, error, self.task.limits)
        return None

    def _each_arm(self) -> Iterator[tuple[Arm, pin.SE3, JointLimits, FloatArray]]:
        """Each arm, the pose of the body seen from its tip, its limits and where it starts."""
        task = self.task
        each_limits = task.limits.part(slice(7)), task.limits.part(slice(7, 14))
        yield from zip(
            task.mover.arms, task.T_tips_body, each_limits, np.split(task.q_start, 2), strict=True
        )


def goal_solutions(
    mover: Mover, T_tips_body: Sequence[pin.SE3], goal: pin.SE3
) -> tuple[FloatArray, ...]:
    """Solutions of the goal of each arm, shape (n, 7) each, rad.

    Raises FreeMoveError, with a proof or with how near it comes, when an arm has none.
    """
    each = []
    for arm, T in zip(mover.arms, T_tips_body, strict=True):
        ik, T_base_tip = IKService(arm), goal * T.inverse()
        found = sample_solutions(ik, T_base_tip)
        if not len(found):
            beyond = ReachBound(arm).proof(T_base_tip)
            if beyond is not None:
                raise FreeMoveError(f"the goal is out of reach of the {arm.side} arm: {beyond}")
            result = ik.solve(T_base_tip)
            if result.failure is not None:
                raise FreeMoveError(_not_reached(arm, result.failure))
            found = result.q[None]
        each.append(found)
    return tuple(each)


def _not_reached(arm: Arm, failure: IKFailure) -> str:
    """Why an arm does not reach the goal, which is not proven."""
    searches = sum(failure.starts.values())
    text = (
        f"the {arm.side} arm does not reach the goal: no solution was found in {searches} searches"
    )
    if failure.nearest_m is not None:
        text += f"; the nearest place found is {1e3 * failure.nearest_m:.3g} mm away"
    if failure.limits_violated:
        text += f"; without limits, {' and '.join(failure.limits_violated)} would reach it"
    return text


def _twist(T: pin.SE3, wanted: pin.SE3) -> FloatArray:
    """Twist from a pose to another one, shape (6,), m and rad, in base."""
    turn = T.rotation @ pin.log3(T.rotation.T @ wanted.rotation)
    return np.concatenate([wanted.translation - T.translation, turn])
