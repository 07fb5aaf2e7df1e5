"""The guard: what each move of a plan is clear of, and whether the arm is near enough to its path.

**Clearances.** What each move is clear of is proven once more in the state that its step carries,
completed for the robot as it stands (`planner.completion`), by `planner.collision.proof`:
separately for pairs of which one shape stands still, and for pairs of the arm with itself by the
joint that the inner shape hangs on; seen from there, only the joints beyond it move the other one.
Intended contacts are excluded only for moves whose clearance without them is below `STRICT_M`.

**The path.** Every configuration of the path was proven to keep a distance c from what stands
still. The distance of two shapes changes by no more than the points of the moving one are
displaced. So an arm none of whose points is displaced by more than c - `KEPT_M` from where it is at
*some* configuration of the path keeps `KEPT_M` at least, whatever lag or gravity does to it.
Displacements are measured, not estimated: a displacement between two placements of a rigid shape
is a convex function of the point, so the corners of a box around the shape have the greatest.
Pairs of the arm with itself are judged by the bound of `planner.collision.motion_bounds`, which
holds seen from any inner link.

The path is that of the last `WINDOW_S`: q(t) of the plan, not what is sent ahead of it. Moreover,
no joint may be farther from its own set-point than the clearance of its move states, and once the
set-point stands none may move away from it by more than `MAX_GROWTH_RAD`. A measurement is compared
with the set-point of the time when it arrived; its age has a limit of its own
(`sim.ros1.execution.stops`).

**Both arms.** Where both move on one clock, they were proven to keep a distance c from each other
at every instant. Arms whose points are displaced by a and b from where both are at *one* instant of
their paths keep c - a - b. So the smallest sum of both displacements, over the instants of the last
`WINDOW_S` that both paths cover, must not exceed c - `KEPT_M` (`arms_stop`). Arms that lag alike
are displaced little from an instant in the past, however fast they are.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from baxter_kin.display import clear, phrase
from baxter_kin.fields import frozen
from baxter_kin.validation import FloatArray, Indices
from planner import Manipulator, Move, Plan
from planner.clearance import Clearance, ContinuousProof
from planner.collision.checker import ClearanceChecker
from planner.collision.context import CollisionContext
from planner.collision.distances import Covers, placed_points
from planner.collision.motion_bounds import Placed
from planner.collision.proof import prove_move
from planner.completion import state_of
from sim.errors import SimulationError
from sim.ros1.execution.stops import Stop, StopCause

STRICT_M = 0.005
"""A move that keeps at least this from everything needs no intended contact."""

MAX_OFF_RAD = 0.25
"""How far a joint may be off its set-point where nothing better is known."""

MAX_CLEARANCE_M = 10.0
"""The clearance where there is nothing to keep clear of."""

INTENDED_STEP_S = 0.05
"""Between two measurements of intended contacts, which are only reported."""

WINDOW_S = 1.5
"""How long the path is remembered."""

KEPT_M = 0.003
"""What is left of the clearance when the guard stops the arm."""

MAX_GROWTH_RAD = 0.02
"""Twice what counts as settled, and far above the noise of sensors."""

STANDSTILL_S = 0.1
"""A set-point that has not changed for this long stands still."""

WINDOW_BEFORE, WINDOW_AFTER = 4, 8
"""Configurations before and after the nearest one that are compared first."""


@frozen(error=SimulationError, eq=True)
class MoveClearance:
    """What a move is clear of.

    Attributes:
        label: of the move.
        clear_m: proven distance of the arm, and what it carries, first from all that stands still,
            then from its own shapes that hang on its joint 1, 2 .. 7; m.
        nearest: the smallest of all of these; None if no pair was checked.
        intended: the smallest distance of an intended contact; None where there is none.
        max_off_rad: how far a joint may be off its set-point; smaller where the arm's lag is known.
    """

    label: str
    clear_m: tuple[float, ...]
    nearest: Clearance | None = None
    intended: Clearance | None = None
    max_off_rad: float = MAX_OFF_RAD

    def _facts(self) -> tuple[str, ...]:
        return phrase(self.label), clear(min(self.clear_m))


class NotClearError(SimulationError):
    """A move is not clear in the state as it is."""


def clearances_of(plan: Plan, manipulator: Manipulator) -> tuple[MoveClearance, ...]:
    """What each move of a complete plan is clear of, in order.

    Args:
        plan: the plan, complete, from robot and bodies as they are.
        manipulator: the arm and its hand.
    """
    return tuple(_clearance(move, manipulator) for move in plan.moves)


def _clearance(move: Move, manipulator: Manipulator) -> MoveClearance:
    """Clearance without intended contacts if that is enough, else with those of the step."""
    strict = _clearance_in(move, manipulator.at(state_of(move)))
    if isinstance(strict, MoveClearance) and min(strict.clear_m) >= STRICT_M:
        return strict
    lenient = _clearance_in(move, manipulator.at(state_of(move), move.contacts))
    if isinstance(lenient, MoveClearance):
        return lenient
    if isinstance(strict, MoveClearance):
        return strict
    raise NotClearError(f"{move.label}: {lenient}")


def _clearance_in(move: Move, context: CollisionContext) -> MoveClearance | str:
    """Clearance in one context, or what the move collides with."""
    checker = context.checker
    shared = shared_joints(checker)
    found: list[ContinuousProof] = []
    for count in range(len(checker.mover.joint_names) + 1):
        pairs = np.flatnonzero(shared == count)
        result = prove_move(checker, move.trajectory, context.q_others, 0.0, pairs)
        if not isinstance(result, ContinuousProof):
            return str(result)
        found.append(result)
    nearest = min((proof.nearest for proof in found), key=lambda near: near.distance_m)
    return MoveClearance(
        move.label,
        tuple(min(float(proof.proven_m), MAX_CLEARANCE_M) for proof in found),
        nearest if nearest.first else None,
        min(_intended(move, context), key=lambda each: each.distance_m, default=None),
    )


def shared_joints(checker: ClearanceChecker) -> Indices:
    """How many joints move both shapes of each pair, shape (pairs,); the last holds the inner."""
    shared: Indices = checker.motion_bounds.moves[checker.pairs].all(axis=1).sum(axis=1)
    return shared


def _intended(move: Move, context: CollisionContext) -> Iterator[Clearance]:
    """The nearest intended contact at some instants of a move."""
    checker, full = context.checker, np.array(context.q_others)
    pairs, duration = np.flatnonzero(checker.checked.is_contact), move.trajectory.duration
    if not pairs.size:
        return
    for t in np.linspace(0.0, duration, 2 + int(duration / INTENDED_STEP_S)).tolist():
        full[checker.motion_bounds.q_index] = move.trajectory.sample(t).q
        distances = checker.distances_m(full, pairs.tolist())
        index = int(np.argmin(distances))
        yield checker.checked.clearance_of(int(pairs[index]), distances[index], t)


class _Point(NamedTuple):
    """A configuration of the path."""

    time_s: float
    q: FloatArray
    corners: FloatArray  # (shapes, 8, 3), m, in base
    clearance: MoveClearance


class PathGuard:
    """Checks one arm between two actions of its fingers."""

    def __init__(self, context: CollisionContext, names: tuple[str, ...]) -> None:
        """Guard an arm.

        Args:
            context: the bodies around it, and what it holds.
            names: of its joints.
        """
        checker = context.checker
        self._bounds, self._names = checker.motion_bounds, names
        self._full = context.q_others
        shared = shared_joints(checker)
        shapes = np.unique(checker.pairs[shared == 0])
        self._shapes = shapes[self._bounds.moves[shapes].any(axis=1)]
        self._corners = _corners(checker.checked.covers, self._shapes)
        self._own = checker.pairs[shared > 0]
        self._hangs = shared[shared > 0] == np.arange(1, len(names) + 1)[:, None]  # joint, own pair
        self._path: deque[_Point] = deque()
        self._nearest = 0
        self._last: tuple[FloatArray, Placed, FloatArray] | None = None
        self._stood_since_s: float | None = None
        self._least_off: FloatArray | None = None

    def advance(self, time_s: float, q: FloatArray, clearance: MoveClearance) -> None:
        """Append a configuration of the path, shape (7,), rad, on a move of that clearance."""
        if self._path and np.array_equal(self._path[-1].q, q):
            if self._path[-1].clearance != clearance:  # of the next move, before q changes
                self._path.append(self._path[-1]._replace(time_s=time_s, clearance=clearance))
            if self._stood_since_s is None:
                self._stood_since_s = time_s
            elif time_s - self._stood_since_s >= STANDSTILL_S and self._least_off is None:
                self._least_off = np.full(len(self._names), np.inf)
        else:
            self._stood_since_s, self._least_off = None, None
            self._path.append(_Point(time_s, q, self._placed(q)[1], clearance))
        while len(self._path) > 1 and self._path[1].time_s < time_s - WINDOW_S:
            self._path.popleft()
            self._nearest -= 1

    def path_at(self, time_s: float) -> FloatArray:
        """Where the path was at a time in the last `WINDOW_S`, shape (7,), rad."""
        before = (point.q for point in reversed(self._path) if point.time_s <= time_s)
        return next(before, self._path[0].q)

    def check(self, q: FloatArray, q_path: FloatArray) -> Stop | None:
        """Why an arm must stop, or None.

        Args:
            q: where it is measured, shape (7,), rad.
            q_path: where the path was when that was measured, shape (7,), rad.
        """
        off, bound = np.abs(q - q_path), self._path[-1].clearance.max_off_rad
        if off.max() > bound:
            return self._joint_stop(StopCause.JOINT_OFF, off, bound)
        if self._least_off is not None:
            self._least_off = np.minimum(self._least_off, off)
            growth = off - self._least_off
            if growth.max() > MAX_GROWTH_RAD:
                return self._joint_stop(StopCause.RUNNING_AWAY, growth, MAX_GROWTH_RAD)
        return self._path_stop(q)

    def displacements(
        self, q: FloatArray, *, is_last_alone: bool = False
    ) -> tuple[FloatArray, FloatArray]:
        """How far an arm at q, shape (7,), rad, is off the configurations of its path.

        Of the last one alone if wanted, which is quick.

        Returns:
            When the path came to each configuration, shape (n,), s, and the greatest displacement
            of a point of the arm from there, shape (n,), m.
        """
        points = [self._path[-1]] if is_last_alone else self._path
        times = np.array([point.time_s for point in points])
        return times, _displaced_m(points, self._placed(q)[1])

    def _joint_stop(self, cause: StopCause, off: FloatArray, bound: float) -> Stop:
        worst = int(off.argmax())
        return Stop(cause, subject=self._names[worst], value=float(off[worst]), bound=bound)

    def _path_stop(self, q: FloatArray) -> Stop | None:
        """Compare with the path near where the arm was last, then with all of it."""
        placed, corners = self._placed(q)
        last = len(self._path) - 1
        at = min(max(self._nearest, 0), last)
        begin, end = max(0, at - WINDOW_BEFORE), min(last, at + WINDOW_AFTER) + 1
        around = _displaced_m([self._path[index] for index in range(begin, end)], corners)
        self._nearest = begin + int(around.argmin())
        stop = self._compared(q, corners, placed, range(self._nearest, self._nearest + 1))
        return stop and self._compared(q, corners, placed, range(last + 1))

    def _compared(
        self, q: FloatArray, corners: FloatArray, placed: Placed, indices: range
    ) -> Stop | None:
        """Whether the arm is off all of some configurations of the path; stores the nearest."""
        points = [self._path[index] for index in indices]
        moved = _displaced_m(points, corners)
        turns = np.abs(np.array([point.q for point in points]) - q)
        index, own = np.indices((len(points), len(self._own))).reshape(2, -1)
        motions = self._bounds.motions_m(placed, turns, index, self._own[own])
        motions = np.where(self._hangs, motions.reshape(len(points), 1, -1), 0.0).max(axis=2)
        displaced = np.column_stack([moved, motions])
        allowed = np.array([point.clearance.clear_m for point in points]) - KEPT_M
        excess = displaced - allowed
        best = int(excess.max(axis=1).argmin())
        worst = int(excess[best].argmax())
        self._nearest = indices[int(moved.argmin())]
        if excess[best, worst] <= 0.0:
            return None
        return Stop(
            StopCause.OFF_PATH,
            subject=points[best].clearance.label,
            value=float(displaced[best, worst]),
            bound=float(allowed[best, worst]),
        )

    def _placed(self, q: FloatArray) -> tuple[Placed, FloatArray]:
        """The shapes at a configuration, and the corners around them; the last one is kept."""
        if self._last is None or not np.array_equal(self._last[0], q):
            placed = self._bounds.place(self._full, q[None])
            corners = placed_points(placed.shapes[:, self._shapes], self._corners)[0]
            self._last = q, placed, corners
        return self._last[1:]


def arms_stop(guards: Sequence[PathGuard], qs: Sequence[FloatArray], apart_m: float) -> Stop | None:
    """Why both arms must stop as they may be too near to each other, or None.

    Args:
        guards: of both arms, whose paths were appended at the same times.
        qs: where each arm is measured, shape (7,), rad.
        apart_m: proven distance of both arms from each other at every instant of their paths.
    """
    bound_m, pairs = apart_m - KEPT_M, list(zip(guards, qs, strict=True))
    now = [guard.displacements(q, is_last_alone=True)[1][0] for guard, q in pairs]
    if sum(now) <= bound_m:
        return None
    found = [guard.displacements(q) for guard, q in pairs]
    instants = np.unique(np.concatenate([times for times, _ in found]))
    instants = instants[instants >= max(times[0] for times, _ in found)]
    together = sum(
        moved[np.searchsorted(times, instants, side="right") - 1] for times, moved in found
    )
    least_m = float(np.min(together))
    if least_m <= bound_m:
        return None
    return Stop(StopCause.ARMS_APART, value=least_m, bound=bound_m)


def _displaced_m(points: Iterable[_Point], corners: FloatArray) -> FloatArray:
    """The greatest displacement of corners from those of each configuration, shape (n,), m."""
    paths = np.array([point.corners for point in points])
    moved: FloatArray = np.sqrt(((paths - corners) ** 2).sum(axis=-1).max(axis=(1, 2)))
    return moved


def _corners(covers: Covers, shapes: Indices) -> FloatArray:
    """The corners of boxes around shapes, each in the shape's own frame, shape (n, 8, 3)."""
    is_high = np.array([[number >> axis & 1 for axis in range(3)] for number in range(8)], bool)
    low, high = covers.lowest[shapes], covers.highest[shapes]
    corners: FloatArray = np.where(is_high, high[:, None, :], low[:, None, :])
    return corners
