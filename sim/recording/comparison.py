"""Comparison of a plan with the recording of its execution, in numbers.

Measured and planned positions are compared at the samples of the recording during each move. A
recording of `sim.ros1.execute` or of a simulation says when each move began and at what speed.
Then one time shift for all joints, the lag, is fitted in the least-squares sense, and taken out. A
recording of another program does not say so: each move, at the given speed, is then placed where it
fits best after the one before it, and the lag, which is a part of that, is not known.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from baxter_kin import Baxter
from baxter_kin.display import count, side_of
from baxter_kin.fields import array, field, frozen, sequence
from baxter_kin.kinematics.arm import arm_joints
from baxter_kin.kinematics.robot import given_or_stock
from baxter_kin.validation import FloatArray, expect, positive_scalar
from planner import Plan, Trajectory
from sim.errors import RecordingError
from sim.recording.recording import Recording

SAME_RAD = 1e-6
"""Maximum distance of the ends of a planned and a recorded move that are the same."""

MAX_LAG_S, LAG_STEP_S = 1.0, 0.01
"""Greatest time shift, and step of the search, refined by a parabola."""

PLACE_STEP_S, FINE_STEP_S = 0.05, 0.005
"""Steps of the search for the begin of a move, and of its refinement."""


@frozen(error=RecordingError)
class Comparison:
    """How far an arm was from its plan.

    Attributes:
        joint_names: the joints of the arm.
        times_s: of the samples during moves, in the recording's time, shape (k,).
        off_rad: measured minus planned positions there, the lag taken out, shape (k, 7), rad.
        tip_off_m: distance of the tip from where it should be, shape (k,), m.
        planned_moves: number of moves of the plan.
        compared_moves: number of them that are in the recording; the others are not compared.
        lag_s: the time shift of all joints, up to `MAX_LAG_S`; None if it is not known.
    """

    joint_names: tuple[str, ...] = sequence()
    times_s: FloatArray = array(None)
    off_rad: FloatArray = array(None, 7)
    tip_off_m: FloatArray = array(None)
    planned_moves: int
    compared_moves: int
    lag_s: float | None = field(default=None)

    @property
    def rms_rad(self) -> FloatArray:
        """Root mean square of each joint's difference, shape (7,), rad."""
        rms: FloatArray = np.sqrt(np.square(self.off_rad).mean(axis=0))
        return rms

    @property
    def worst_rad(self) -> FloatArray:
        """Greatest difference of each joint, shape (7,), rad."""
        worst: FloatArray = np.abs(self.off_rad).max(axis=0)
        return worst

    @property
    def rms_tip_m(self) -> float:
        """Root mean square of the tip's distance."""
        return float(np.sqrt(np.square(self.tip_off_m).mean()))

    @property
    def worst_tip_m(self) -> float:
        """Greatest distance of the tip."""
        return float(self.tip_off_m.max())

    @property
    def is_lag_at_bound(self) -> bool:
        """Whether the lag is the greatest that was tried, so that the true one may be greater."""
        return self.lag_s is not None and self.lag_s >= MAX_LAG_S - 0.5 * LAG_STEP_S

    def __str__(self) -> str:
        worst_at = np.abs(self.off_rad).argmax(axis=0)
        rows = [f"{'':<10}{'RMS':>12}{'worst':>12}{'at':>10}"]
        table = zip(self.joint_names, self.rms_rad, self.worst_rad, worst_at, strict=True)
        for name, rms, worst, row in table:
            rows.append(
                f"{name:<10}{1e3 * rms:7.2f} mrad{1e3 * worst:7.2f} mrad{self.times_s[row]:8.2f} s"
            )
        tip_s = self.times_s[int(self.tip_off_m.argmax())]
        tip = f"{1e3 * self.rms_tip_m:7.2f} mm  {1e3 * self.worst_tip_m:7.2f} mm  {tip_s:8.2f} s"
        lag = "not known" if self.lag_s is None else f"{self.lag_s:.3f} s, one for all joints"
        if self.is_lag_at_bound:
            lag += "; WARNING: the greatest that was tried, the true one may be greater"
        moves = f"{self.compared_moves} of {self.planned_moves} in the recording"
        if self.compared_moves < self.planned_moves:
            moves += "; WARNING: the others are not compared"
        return "\n".join([*rows, f"{'tip':<10}{tip}", f"lag       {lag}", f"moves     {moves}"])

    def _facts(self) -> tuple[str, ...]:
        worst = f"at most {1e3 * self.worst_rad.max():.2f} mrad, {1e3 * self.worst_tip_m:.2f} mm"
        moves = f"{self.compared_moves} of {count(self.planned_moves, 'move')}"
        return side_of(self.joint_names), moves, count(len(self.times_s), "sample"), worst


def compare_run(
    plan: Plan, recording: Recording, *, robot: Baxter | None = None, speed: float = 1.0
) -> Comparison:
    """How far an arm was from its plan during its moves.

    Where the recording says which moves were carried out, only these are compared; the result says
    how many of the plan's moves they are.

    Args:
        plan: what was executed.
        recording: of the execution.
        robot: which one it was, for the tip; by default the stock robot.
        speed: of the execution relative to the plan, where the recording does not say it.

    Raises:
        RecordingError: when an argument is invalid, the arm was not recorded, or the recording is
            too short for the moves.
    """
    expect(plan, Plan, "plan", RecordingError)
    expect(recording, Recording, "recording", RecordingError)
    ratio = positive_scalar(speed, "speed", RecordingError)
    if plan.limb not in recording.limbs or not plan.moves:
        raise RecordingError(f"there is no move of the {plan.limb} arm to compare")
    names = arm_joints(plan.limb)
    q = recording.q[:, [recording.joint_names.index(name) for name in names]]
    measured = _Measured(recording.times_s, q)
    motions = [_ordered(move.trajectory, names) for move in plan.moves]
    spans = list(_recorded_spans(motions, recording, plan.limb))
    lag_s = measured.lag_s(spans) if spans else None
    if not spans:
        spans = list(_placed_spans(motions, measured, ratio))
    times_s, planned = measured.samples(spans)
    found = measured.at(times_s + (lag_s or 0.0))
    arm = given_or_stock(robot, RecordingError).arm(plan.limb)
    tips = [
        [arm.T_base_tip(q).translation for q in pair] for pair in zip(found, planned, strict=True)
    ]
    tip_off_m = np.linalg.norm(np.diff(tips, axis=1)[:, 0], axis=1)
    compared = sum(measured.during(span).size > 0 for span in spans)
    return Comparison(names, times_s, found - planned, tip_off_m, len(motions), compared, lag_s)


class _Motion(NamedTuple):
    """A planned motion with its joints from shoulder to wrist."""

    trajectory: Trajectory
    columns: list[int]

    @property
    def ends(self) -> FloatArray:
        """Positions at start and goal, shape (2, 7), rad."""
        return self.at(np.array([0.0, self.trajectory.duration]))

    def at(self, times_s: FloatArray) -> FloatArray:
        """Positions at times, at its ends before and after it, shape (k, 7), rad."""
        inside = times_s.clip(0.0, self.trajectory.duration)
        q: FloatArray = self.trajectory.sample(inside).q[:, self.columns]
        return q


def _ordered(trajectory: Trajectory, names: Sequence[str]) -> _Motion:
    return _Motion(trajectory, [trajectory.limits.names.index(name) for name in names])


class _Span(NamedTuple):
    """When a motion was carried out, in the recording's time."""

    motion: _Motion
    start_s: float
    speed: float

    @property
    def end_s(self) -> float:
        """When it ended."""
        return self.start_s + self.motion.trajectory.duration / self.speed

    def at(self, times_s: FloatArray) -> FloatArray:
        """Planned positions at times of the recording."""
        return self.motion.at(self.speed * (times_s - self.start_s))


class _Measured(NamedTuple):
    """What was measured: times, shape (n,), and positions, shape (n, 7)."""

    times_s: FloatArray
    q: FloatArray

    def at(self, times_s: FloatArray) -> FloatArray:
        """Positions at times, by linear interpolation, shape (k, 7), rad."""
        return np.column_stack([np.interp(times_s, self.times_s, column) for column in self.q.T])

    def during(self, span: _Span) -> FloatArray:
        """The times of the samples in a span."""
        times_s = self.times_s
        return times_s[(times_s >= span.start_s) & (times_s <= span.end_s)]

    def samples(self, spans: Sequence[_Span]) -> tuple[FloatArray, FloatArray]:
        """The times of the samples in spans, (k,), and the planned positions, (k, 7)."""
        each = [self.during(span) for span in spans]
        times_s = np.concatenate(each)
        if not times_s.size:
            raise RecordingError("the recording has no samples during the moves of the plan")
        planned = [span.at(own) for span, own in zip(spans, each, strict=True)]
        return times_s, np.concatenate(planned)

    def lag_s(self, spans: Sequence[_Span]) -> float:
        """The time shift with the least squares of the differences."""
        times_s, planned = self.samples(spans)
        lags_s = np.arange(0.0, MAX_LAG_S + LAG_STEP_S, LAG_STEP_S)
        squares = [np.square(self.at(times_s + lag) - planned).mean() for lag in lags_s]
        best = int(np.argmin(squares))
        if not 0 < best < len(lags_s) - 1:
            return float(lags_s[best])
        before, here, after = squares[best - 1 : best + 2]
        curvature = before - 2.0 * here + after
        step = 0.5 * (before - after) / curvature if curvature > 0.0 else 0.0
        return float(lags_s[best] + step * LAG_STEP_S)


def _recorded_spans(motions: Sequence[_Motion], recording: Recording, limb: str) -> Iterator[_Span]:
    """The moves that the recording names, in order, found by their ends."""
    names, waiting = arm_joints(limb), list(motions)
    for move in recording.moves:
        if not waiting or move.limb != limb:
            continue
        recorded, planned = _ordered(move.trajectory, names), waiting[0]
        lengths = [motion.trajectory.duration for motion in (recorded, planned)]
        off_rad = np.abs(recorded.ends - planned.ends).max()
        if off_rad <= SAME_RAD and min(lengths) > 0.0:
            yield _Span(waiting.pop(0), move.start_s, lengths[1] / lengths[0])


def _placed_spans(motions: Sequence[_Motion], measured: _Measured, speed: float) -> Iterator[_Span]:
    """Each move where it fits best after the one before it."""
    first_s, last_s = float(measured.times_s[0]), float(measured.times_s[-1])
    for motion in motions:
        duration_s = motion.trajectory.duration / speed
        if first_s + duration_s > last_s + PLACE_STEP_S:
            raise RecordingError(
                f"the recording ends at {last_s:.2f} s, before the moves of the plan at speed "
                f"{speed:g}; give the speed at which it was executed"
            )
        coarse = np.arange(first_s, max(last_s - duration_s, first_s) + PLACE_STEP_S, PLACE_STEP_S)
        near_s = _best_start(coarse, motion, measured, speed)
        fine = near_s + np.arange(-PLACE_STEP_S, PLACE_STEP_S + FINE_STEP_S, FINE_STEP_S)
        span = _Span(motion, _best_start(fine, motion, measured, speed), speed)
        yield span
        first_s = span.end_s - PLACE_STEP_S


def _best_start(starts_s: FloatArray, motion: _Motion, measured: _Measured, speed: float) -> float:
    spans = [_Span(motion, start, speed) for start in starts_s.tolist()]
    squares = []
    for span in spans:
        times_s = np.arange(span.start_s, span.end_s, LAG_STEP_S)
        squares.append(np.square(measured.at(times_s) - span.at(times_s)).mean())
    return float(starts_s[int(np.argmin(squares))])
