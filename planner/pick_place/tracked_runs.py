"""Tracking proofs of runs, on an arm of a given response.

A run: consecutive moves between which the arm does not come to rest.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from baxter_kin.display import clear, millimetres, phrase
from baxter_kin.fields import frozen
from baxter_kin.validation import FloatArray, Indices
from planner.clearance import Clearance
from planner.collision.context import CollisionContext
from planner.collision.tube_proof import JointTube, TubeClearance, TubeProofs
from planner.errors import TaskError, TrajectoryError
from planner.motion.path_deviation import PathDeviation
from planner.motion.response import Response
from planner.motion.tracking_tube import JointRange, SettlingTube, tracking_tube
from planner.plan import Move, Step
from planner.trajectory import Trajectory, joined

REST_RAD_S = 1e-6
"""Maximum final speed of a move that ends at rest."""


@frozen(error=TaskError, eq=True)
class MoveTracking:
    """The proof of one move, for all positions of the joints in its tube.

    Attributes:
        label: the move's label.
        clearance_m: lower bound on the distance of the arm, and what it carries, from everything
            except intended contacts; not positive where that could not be proven.
        nearest: the smallest distance found where the arm may be, with its time since the first
            set-point after the last rest; None where nothing can come near.
        deviation_rad: maximum distance of any joint from its planned position at that time.
        tip_m: maximum deviation of the tip from its path.
        allowance_m: maximum deviation of the hand, and what it holds, from their path while
            intended contacts are not proven to be apart; zero where they always are.
        settled_tip_m: maximum distance of the tip from its goal when all joints are measured as
            settled, so when fingers close or open; None where the arm does not rest then.
        failure: why the move is not proven, without its label; None where it is.
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
            return phrase(self.label), str(self.failure)
        allowance = f"{millimetres(self.allowance_m)} allowed" if self.allowance_m else ""
        off = f"tip up to {millimetres(self.tip_m)} off"
        return phrase(self.label), clear(self.clearance_m), off, allowance


class TrackingRequirements(NamedTuple):
    """Requirements on a plan.

    Attributes:
        margin_m: distance that all pairs keep, except intended contacts.
        max_deviation_m: maximum deviation of the hand from its path in moves with such contacts.
        start_rad: maximum distance of measured joints from the plan's start.
    """

    margin_m: float
    max_deviation_m: float
    start_rad: float


class RunTubes(NamedTuple):
    """Tubes of the joints of an arm during a run.

    Attributes:
        response: the arm's response.
        hull: the tube from any of the boxes in which the run may begin.
        by_start: one tube from each of these boxes.
    """

    response: Response
    hull: SettlingTube
    by_start: tuple[SettlingTube, ...]

    @property
    def starts(self) -> tuple[JointRange, ...]:
        """Boxes of joint positions (7,), rad, from which the next run may start."""
        return self.hull.starts


class MoveTubes(NamedTuple):
    """Tubes of the joints of an arm during one move of a run.

    Attributes:
        hull: a tube around all others.
        parts: tubes that together contain the joints.
    """

    hull: JointTube
    parts: list[JointTube]


class MoveDeviation(NamedTuple):
    """Maximum deviations during one move.

    Attributes:
        joint_rad: of any joint from its planned position at that time.
        tip_m: of the tip from its path.
        settled_tip_m: of the tip from its goal when all joints are measured as settled; None where
            the arm does not rest then.
    """

    joint_rad: float
    tip_m: float
    settled_tip_m: float | None


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
    """The runs of a plan's moves, each move with its context, in order."""
    pending: list[tuple[Move, CollisionContext]] = []
    for move, context in zip(moves, contexts, strict=True):
        pending.append((move, context))
        if _rests(move):
            yield TrackedRun(pending)
            pending = []
    if pending:
        yield TrackedRun(pending)


class TrackedRun:
    """One run, with precomputed data for its proofs."""

    def __init__(self, moves: Sequence[tuple[Move, CollisionContext]]) -> None:
        self._trajectory = joined(move.trajectory for move, _ in moves)
        ends = np.cumsum([move.trajectory.duration for move, _ in moves])
        self._cuts = [0.0, *ends[:-1].tolist(), np.inf]
        arm, trajectory = moves[0][1].checker.arm, self._trajectory
        self._tip = PathDeviation(arm, trajectory)
        self._goal = PathDeviation(arm, Trajectory.stay(trajectory.q_goal, trajectory.limits))
        self._moves = [TrackedMove(move, context, trajectory) for move, context in moves]

    def tubes_for(self, response: Response, starts: Sequence[JointRange]) -> RunTubes:
        """Tubes of the joints of an arm when the run begins in one of several boxes."""
        hull = tracking_tube(self._trajectory, response, bounding_box(starts))
        by_start = (tracking_tube(self._trajectory, response, start) for start in starts)
        return RunTubes(response, hull, tuple(by_start))

    def track_moves(
        self, run_tubes: RunTubes, required: TrackingRequirements
    ) -> Iterator[MoveTracking]:
        """The proof of each move."""
        for number, (move, tubes) in enumerate(
            zip(self._moves, self._move_tubes(run_tubes), strict=True)
        ):
            is_last = number == len(self._moves) - 1
            speed = run_tubes.response.speed
            deviation = MoveDeviation(
                joint_rad=max(self._deviation_rad(tube, speed) for tube in tubes.parts),
                tip_m=max(float(self._tip.in_tube(tube).max()) for tube in tubes.parts),
                settled_tip_m=self._settled_m(run_tubes) if is_last else None,
            )
            yield move.track(tubes, required, deviation)

    def passes(self, run_tubes: RunTubes, required: TrackingRequirements) -> bool:
        """Whether `track_moves` reports no failure; faster than that."""
        tubes = self._move_tubes(run_tubes)
        return all(
            move.passes(of_move.parts, required)
            for move, of_move in zip(self._moves, tubes, strict=True)
        )

    def _move_tubes(self, run_tubes: RunTubes) -> Iterator[MoveTubes]:
        """The tubes during each move; the last one includes the rest after it.

        The first move is proven from each start alone, which is tighter than their hull. Until the
        next move begins, tubes from different starts have largely converged, so that their hull
        alone is proven: it is nearly as tight, and takes one proof instead of several.
        """
        response = run_tubes.response
        for number in range(len(self._moves)):
            span = [cut / response.speed for cut in self._cuts[number : number + 2]]
            hull, *by_start = (
                settling.tube.widened(response.settled_error_rad).between(*span)
                for settling in (run_tubes.hull, *run_tubes.by_start)
            )
            yield MoveTubes(hull, by_start if number == 0 else [hull])

    def _settled_m(self, run_tubes: RunTubes) -> float:
        """Maximum distance of the tip from its goal when all joints are measured as settled."""
        low, high = (np.array(corners) for corners in zip(*run_tubes.starts, strict=True))
        error = run_tubes.response.settled_error_rad
        return float(self._goal.in_boxes(low - error, high + error).max())

    def _deviation_rad(self, tube: JointTube, speed: float) -> float:
        """Maximum distance of any joint from its planned position at the same time."""
        q = self._trajectory.sample(speed * tube.times_s).q
        step = float(np.abs(np.diff(q, axis=0)).max())
        return float(np.maximum(tube.highest - q, q - tube.lowest).max()) + step


class TrackedMove:
    """One move of a run, with precomputed data for its proofs."""

    def __init__(
        self,
        move: Move,
        context: CollisionContext,
        trajectory: Trajectory,
        since: str = "after it last rested",
    ) -> None:
        """Prepare the proofs of a move.

        Args:
            move: the move.
            context: its context.
            trajectory: the motion of the whole run.
            since: a phrase that says from when the times of its tubes count.
        """
        self._since = since
        checker = context.checker
        self._label, self._proofs = move.label, TubeProofs(checker, context.q_others)
        self._free = np.flatnonzero(~checker.may_touch)
        self._touchable = np.flatnonzero(checker.may_touch)
        self._hand: PathDeviation | None = None
        if len(self._touchable):
            points = corners_at_tip(context, self._touchable)
            self._hand = PathDeviation(checker.arm, trajectory, points)

    def track(
        self, tubes: MoveTubes, required: TrackingRequirements, deviation: MoveDeviation
    ) -> MoveTracking:
        """The proof of the move, with its deviations."""
        proofs = list(self._prove(tubes.parts, required, is_tight=True))
        worst = min(proofs, key=lambda proof: proof.proven_m)
        hand_deviations_m = self._hand_deviations_m(tubes.parts)
        allowance_m = 0.0
        if self._hand is not None:
            may_touch = self._proofs.unproven_cells(tubes.hull, self._touchable)
            allowance_m = float(
                padded(hand_deviations_m, len(may_touch))[may_touch].max(initial=0.0)
            )
        return MoveTracking(
            label=self._label,
            clearance_m=worst.proven_m,
            nearest=worst.nearest if worst.nearest.first else None,
            deviation_rad=deviation.joint_rad,
            tip_m=deviation.tip_m,
            allowance_m=allowance_m,
            settled_tip_m=deviation.settled_tip_m,
            failure=self._failure(worst, float(hand_deviations_m.max()), required),
        )

    def passes(self, tubes: Sequence[JointTube], required: TrackingRequirements) -> bool:
        """Whether `track` reports no failure."""
        enough_m = required.max_deviation_m
        hand_deviation_m = float(self._hand_deviations_m(tubes, enough_m).max())
        proofs = self._prove(tubes, required, is_tight=False)
        return all(self._failure(proof, hand_deviation_m, required) is None for proof in proofs)

    def _prove(
        self, tubes: Sequence[JointTube], required: TrackingRequirements, *, is_tight: bool
    ) -> Iterator[TubeClearance]:
        """The clearance of all pairs except intended contacts, in each tube."""
        margin_m = required.margin_m
        for tube in tubes:
            yield self._proofs.prove(tube, pairs=self._free, margin_m=margin_m, is_tight=is_tight)

    def _hand_deviations_m(self, tubes: Sequence[JointTube], enough_m: float = 0.0) -> FloatArray:
        """Maximum deviation of the hand in each cell of the longest tube; 0 without contacts."""
        if self._hand is None:
            return np.zeros(1)
        in_cells = [self._hand.in_tube(tube, enough_m=enough_m) for tube in tubes]
        longest = max(map(len, in_cells))
        deviations_m: FloatArray = np.max([padded(cells, longest) for cells in in_cells], axis=0)
        return deviations_m

    def _failure(
        self, proof: TubeClearance, hand_deviation_m: float, required: TrackingRequirements
    ) -> str | None:
        """Why the move is not proven; None where it is.

        Args:
            proof: of all pairs except intended contacts, in a tube of the move.
            hand_deviation_m: maximum deviation of the hand from its path; zero without such
                contacts.
            required: the requirements.
        """
        if not proof.is_clear:
            return unclear(proof, self._since)
        if hand_deviation_m <= required.max_deviation_m:
            return None
        return (
            f"the hand may be {1e3 * hand_deviation_m:.1f} mm off its path, where it touches "
            f"something on purpose; at most {1e3 * required.max_deviation_m:.1f} mm are allowed"
        )


def bounding_box(boxes: Sequence[JointRange]) -> JointRange:
    """The smallest box of joint positions around several."""
    low, high = (np.array(corners) for corners in zip(*boxes, strict=True))
    return low.min(axis=0), high.max(axis=0)


def corners_at_tip(context: CollisionContext, pairs: Indices) -> FloatArray:
    """Corners of a box around the moving shapes of pairs, in the tip's frame, shape (8, 3), m."""
    checker = context.checker
    bounds, covers, arm = checker.motion_bounds, checker.checked.covers, checker.arm
    shapes = np.unique(checker.pairs[pairs])
    shapes = shapes[bounds.moves[shapes].any(axis=1)]
    poses = bounds.place(context.q_others, arm.neutral[None]).shapes[0, shapes]
    at_tip = np.linalg.inv(arm.T_base_tip(arm.neutral).homogeneous) @ poses
    boxes = np.stack([covers.lowest[shapes], covers.highest[shapes]], axis=1)
    corners = np.array([box_corners(*box) for box in boxes])
    placed = corners @ at_tip[:, :3, :3].swapaxes(1, 2) + at_tip[:, None, :3, 3]
    points = placed.reshape(-1, 3)
    return box_corners(points.min(axis=0), points.max(axis=0))


def box_corners(low: FloatArray, high: FloatArray) -> FloatArray:
    """The eight corners of a box, shape (8, 3)."""
    return np.array(list(product(*zip(low, high, strict=True))))


def padded(values: FloatArray, length: int) -> FloatArray:
    """The first `length` values; if there are fewer, the last one is repeated."""
    repeated: FloatArray = values[np.minimum(np.arange(length), len(values) - 1)]
    return repeated


def unclear(proof: TubeClearance, since: str) -> str:
    """Why a tube is not clear; `since` says from when its times count."""
    near = proof.nearest
    if near.distance_m <= proof.margin_m:
        text = near.phrase("may be", "may touch")
        margin = f"; {1e3 * proof.margin_m:.1f} mm are required" if proof.margin_m else ""
        return f"{text} {near.time_s or 0.0:.2f} s {since}{margin}"
    return (
        f"{near.first} may be {1e3 * near.distance_m:.1f} mm from {near.second}, and more than "
        f"{1e3 * proof.margin_m:.1f} mm are not proven after {proof.boxes} boxes"
    )
