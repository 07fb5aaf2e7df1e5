"""Runs: moves of a plan without a rest in between, on an arm of a given response."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from baxter_kin.display import clear, millimetres, phrase, sentence
from baxter_kin.fields import frozen
from baxter_kin.validation import FloatArray, Indices
from planner.clearance import Clearance
from planner.collision.context import CollisionContext
from planner.collision.tube_proof import JointTube, TubeClearance, TubeProofs
from planner.errors import TaskError, TrajectoryError
from planner.motion.off_path import CELLS, OffPath
from planner.motion.response import Response
from planner.motion.tracking_tube import JointRange, SettlingTube, tracking_tube
from planner.plan import Move, Step
from planner.trajectory import Trajectory, joined


@frozen(error=TaskError, eq=True)
class MoveTracking:
    """The proof of one move, for all positions of the joints in its tube.

    Attributes:
        label: of the move.
        clearance_m: lower bound on the distance of the arm, and what it carries, from everything
            except intended contacts; not positive where that could not be proven.
        nearest: the smallest distance found where the arm may be, with its time since the first
            set-point after the last rest; None where nothing can come near.
        deviation_rad: maximum distance of any joint from its planned position at that time.
        tip_m: maximum distance of the tip from its path.
        allowance_m: maximum distance of the hand, and what it holds, from their path while intended
            contacts are not proven to be apart; zero where they always are.
        settled_tip_m: maximum distance of the tip from its goal when all joints are measured as
            settled, so when fingers close or open; None where the arm does not rest then.
        failure: why the move is not proven; None where it is.
    """

    label: str
    clearance_m: float
    nearest: Clearance | None
    deviation_rad: float
    tip_m: float
    allowance_m: float
    settled_tip_m: float | None = None
    failure: str | None = None

    def _facts(self) -> tuple[str, ...]:
        if self.failure is not None:
            return phrase(self.label), sentence(self.failure)
        allowance = f"{millimetres(self.allowance_m)} allowed" if self.allowance_m else ""
        off = f"tip up to {millimetres(self.tip_m)} off"
        return phrase(self.label), clear(self.clearance_m), off, allowance


REST_RAD_S = 1e-6
"""A move with a lower final speed ends at rest."""


class TrackingDemands(NamedTuple):
    """Requirements on a plan.

    Attributes:
        margin_m: of all pairs except intended contacts.
        most_off_m: maximum deviation of the hand from its path in moves with such contacts.
        start_rad: maximum distance of measured joints from the plan's start.
    """

    margin_m: float
    most_off_m: float
    start_rad: float


class RunTubes(NamedTuple):
    """Tubes of the joints of an arm during a run.

    Attributes:
        response: of the arm.
        whole: during the whole run.
        several: the same, from each box in which it may begin.
    """

    response: Response
    whole: SettlingTube
    several: tuple[SettlingTube, ...]

    @property
    def starts(self) -> tuple[JointRange, ...]:
        """Boxes that together contain y whenever the next run may begin."""
        return self.whole.starts


def check_rests(steps: Sequence[Step]) -> None:
    """Refuse moves that do not end at rest where fingers act, or at the end of the plan."""
    for number, step in enumerate(steps):
        after = steps[number + 1] if number + 1 < len(steps) else None
        if isinstance(step, Move) and not isinstance(after, Move) and not _rests(step):
            speed = float(np.abs(step.trajectory.v[-1]).max())
            raise TrajectoryError(
                f"{step.label} ends at {speed:.3g} rad/s where the arm must rest, so its further "
                "motion is unknown"
            )


def _rests(move: Move) -> bool:
    return float(np.abs(move.trajectory.v[-1]).max()) < REST_RAD_S


def runs_of(moves: Sequence[Move], contexts: Sequence[CollisionContext]) -> Iterator[TrackedRun]:
    """Moves of a plan in order, with their situations, divided where the arm rests."""
    pending: list[tuple[Move, CollisionContext]] = []
    for each in zip(moves, contexts, strict=True):
        pending.append(each)
        if _rests(each[0]):
            yield TrackedRun(pending)
            pending = []
    if pending:
        yield TrackedRun(pending)


class TrackedRun:
    """One run, with precomputed distances from its path."""

    def __init__(self, moves: Sequence[tuple[Move, CollisionContext]]) -> None:
        self._trajectory = joined(move.trajectory for move, _ in moves)
        ends = np.cumsum([move.trajectory.duration for move, _ in moves])
        self._cuts = [0.0, *ends[:-1].tolist(), np.inf]
        arm, trajectory = moves[0][1].checker.arm, self._trajectory
        self._tip = OffPath(arm, trajectory)
        self._goal = OffPath(arm, Trajectory.stay(trajectory.q_goal, trajectory.limits))
        self._moves = [_TrackedMove(move, context, trajectory) for move, context in moves]

    def tracked(self, response: Response, starts: Sequence[JointRange]) -> RunTubes:
        """Tubes of the joints when the run begins in one of some boxes."""
        whole = tracking_tube(self._trajectory, response, _around(starts))
        several = (tracking_tube(self._trajectory, response, start) for start in starts)
        return RunTubes(response, whole, tuple(several))

    def found(self, tracked: RunTubes, asked: TrackingDemands) -> Iterator[MoveTracking]:
        """The proof of each move."""
        for number, (move, (around, tubes)) in enumerate(
            zip(self._moves, self._tubes(tracked), strict=True)
        ):
            is_last = number == len(self._moves) - 1
            settled_m = self._settled_m(tracked) if is_last else None
            tip_m = max(float(self._tip.over(tube).max()) for tube in tubes)
            off_rad = max(self._deviation_rad(tube, tracked.response.speed) for tube in tubes)
            yield move.found(around, tubes, asked, (off_rad, tip_m, settled_m))

    def keeps(self, tracked: RunTubes, asked: TrackingDemands) -> bool:
        """Whether no move fails."""
        tubes = self._tubes(tracked)
        return all(
            move.keeps(each, asked) for move, (_, each) in zip(self._moves, tubes, strict=True)
        )

    def _tubes(self, tracked: RunTubes) -> Iterator[tuple[JointTube, list[JointTube]]]:
        """For each move the tube around all, and those that together contain the joints."""
        response = tracked.response
        for number in range(len(self._moves)):
            span = [cut / response.speed for cut in self._cuts[number : number + 2]]
            around, *several = (
                each.tube.widened(response.settled_error_rad).between(*span)
                for each in (tracked.whole, *tracked.several)
            )
            yield around, several if number == 0 else [around]

    def _settled_m(self, tracked: RunTubes) -> float:
        """Maximum distance of the tip from its goal when all joints are measured as settled."""
        low, high = (np.array(corners) for corners in zip(*tracked.starts, strict=True))
        error = tracked.response.settled_error_rad
        return float(self._goal.within(low - error, high + error).max())

    def _deviation_rad(self, tube: JointTube, speed: float) -> float:
        """Maximum distance of any joint from its planned position at the same time."""
        q = self._trajectory.sample(speed * tube.times_s).q
        step = float(np.abs(np.diff(q, axis=0)).max())
        return float(np.maximum(tube.highest - q, q - tube.lowest).max()) + step


class _TrackedMove:
    """One move of a run, with precomputed proofs and distances from its path."""

    def __init__(self, move: Move, context: CollisionContext, trajectory: Trajectory) -> None:
        """For a move, its situation, and the motion of the whole run."""
        checker = context.checker
        self._label, self._proofs = move.label, TubeProofs(checker, context.q_others)
        self._free = np.flatnonzero(~checker.may_touch)
        self._touched = np.flatnonzero(checker.may_touch)
        self._hand: OffPath | None = None
        if len(self._touched):
            points = _corners_at_tip(context, self._touched)
            self._hand = OffPath(checker.arm, trajectory, points)

    def found(
        self,
        around: JointTube,
        tubes: Sequence[JointTube],
        asked: TrackingDemands,
        known: tuple[float, float, float | None],
    ) -> MoveTracking:
        """The proof of the move.

        Args:
            around: the tube around all others.
            tubes: that together contain the joints.
            asked: the requirements.
            known: maximum deviations of joints and tip, and of the tip at rest.
        """
        proofs = [
            self._proofs.prove(tube, pairs=self._free, margin_m=asked.margin_m) for tube in tubes
        ]
        worst = min(proofs, key=lambda proof: proof.proven_m)
        off_rad, tip_m, settled_m = known
        allowance_m = hand_m = 0.0
        if self._hand is not None:
            cells = self._proofs.unproven_cells(around, self._touched)
            is_open = np.logical_or.reduceat(cells, np.arange(0, len(cells), CELLS))
            each = [_padded(self._hand.over(tube), len(is_open)) for tube in tubes]
            off_m = np.max(each, axis=0)
            allowance_m, hand_m = float(off_m[is_open].max(initial=0.0)), float(off_m.max())
        nearest = worst.nearest if worst.nearest.first else None
        failure = _unclear(self._label, worst) or _off_path_failure(
            self._label, hand_m, asked.most_off_m
        )
        found = self._label, worst.proven_m, nearest, off_rad, tip_m, allowance_m, settled_m
        return MoveTracking(*found, failure)

    def keeps(self, tubes: Sequence[JointTube], asked: TrackingDemands) -> bool:
        """Whether `found` would report no failure."""
        if self._hand is not None:
            hand_m = max(float(self._hand.over(tube).max()) for tube in tubes)
            if _off_path_failure(self._label, hand_m, asked.most_off_m):
                return False
        margin_m = asked.margin_m
        proofs = (
            self._proofs.prove(tube, pairs=self._free, margin_m=margin_m, is_tight=False)
            for tube in tubes
        )
        return all(proof.is_clear for proof in proofs)


def _around(starts: Sequence[JointRange]) -> JointRange:
    """The bounding box of some boxes."""
    low, high = (np.array(corners) for corners in zip(*starts, strict=True))
    return low.min(axis=0), high.max(axis=0)


def _corners_at_tip(context: CollisionContext, pairs: Indices) -> FloatArray:
    """Corners of a box around the moving shapes of pairs, in the tip's frame, shape (8, 3), m."""
    checker = context.checker
    bounds, covers, arm = checker.motion_bounds, checker.checked.covers, checker.arm
    shapes = np.unique(checker.pairs[pairs])
    shapes = shapes[bounds.moves[shapes].any(axis=1)]
    poses = bounds.place(context.q_others, arm.neutral[None]).shapes[0, shapes]
    at_tip = np.linalg.inv(arm.T_base_tip(arm.neutral).homogeneous) @ poses
    boxes = np.stack([covers.lowest[shapes], covers.highest[shapes]], axis=1)
    corners = np.array([_corners(*box) for box in boxes])
    placed = corners @ at_tip[:, :3, :3].swapaxes(1, 2) + at_tip[:, None, :3, 3]
    points = placed.reshape(-1, 3)
    return _corners(points.min(axis=0), points.max(axis=0))


def _corners(low: FloatArray, high: FloatArray) -> FloatArray:
    """Corners of a box, shape (8, 3)."""
    return np.array(list(product(*zip(low, high, strict=True))))


def _padded(values: FloatArray, length: int) -> FloatArray:
    """The values repeated at the end up to a length."""
    some: FloatArray = values[np.minimum(np.arange(length), len(values) - 1)]
    return some


def _unclear(label: str, proof: TubeClearance) -> str | None:
    """Why a tube is not clear; None where it is."""
    if proof.is_clear:
        return None
    near = proof.nearest
    if near.distance_m <= proof.margin_m:
        text = near.phrase("may be", "may touch")
        asked = f"; {1e3 * proof.margin_m:.1f} mm are asked for" if proof.margin_m else ""
        return f"{label}: {text} {near.time_s or 0.0:.2f} s after it last rested{asked}"
    return (
        f"{label}: {near.first} may be {1e3 * near.distance_m:.1f} mm from {near.second}, and more "
        f"than {1e3 * proof.margin_m:.1f} mm are not proven after {proof.boxes} boxes"
    )


def _off_path_failure(label: str, hand_m: float, most_m: float) -> str | None:
    """Why a hand with intended contacts is too far from its path; None where it is not."""
    if hand_m <= most_m:
        return None
    return (
        f"{label}: the hand may be {1e3 * hand_m:.1f} mm off its path, where it touches something "
        f"on purpose; at most {1e3 * most_m:.1f} mm are allowed"
    )
