"""JointProgram: the fastest motions of both arms that keep clear of each other.

Each arm is a track: the motion program of its own cycle, with its own durations, lines and
obstacles, and a wait, zero or more, before each motion that begins at rest. The makespan M is at
least the sum of durations, waits and gripper actions of each track. The objective is M, plus a
small share of all durations and waits, so that the arm that ends first is determined, too.

The tracks have no common time grid. At instants t of the common clock, the distances of the nearest
pairs of shapes of both arms are constrained,

    s_L . q_L(t) + s_R . q_R(t) + c + shortfall >= 0,     q(t) = W(u) y + v (t - tau),

where y are the controls of an arm; u is the fraction of a phase that the arm has reached at t in
the last solution, and v its velocity there; and tau is the time at which the arm reaches the same
fraction in the new solution: the sum of all previous waits, durations and gripper actions, plus u
times the duration of the phase. So each row is linear in controls, durations and waits of both
arms. The linearised distances are valid only near the motions at which they were measured, so
`planner.two_arms.rounds` solves the program repeatedly.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from baxter_kin.validation import FloatArray, Indices
from planner.collision.obstacles import NearPairs, Obstacles, SampledDistances
from planner.motion.program import motion_program
from planner.motion.program.motion_program import (
    EXTRA_MARGIN_M,
    MAX_DURATION,
    MAX_SHORTFALL_M,
    TRUST_RAD,
    Coupling,
    MotionProgram,
    Motions,
    Track,
    answer,
    solver_of,
)
from planner.motion.program.rows import Clearances, constant
from planner.motion.program.unknowns import Phase
from planner.splines import Sketch, rates_at, trajectory_of, weights_at
from planner.two_arms.across import Across

INSTANTS, PAIRS = 240, 3
"""Number of instants of the clock at which the distance between the arms is constrained, and of the
nearest pairs at each. In motions of 6 to 9 s the instants are 25 to 40 ms apart: hands that pass
each other move by up to 10 cm in between, so the proof may refuse a solution."""

SHORTFALL_PER_M = motion_program.SHORTFALL_PER_M * 140 / INSTANTS
"""Cost per metre of missing distance between the arms at one instant, in units of time. Scaled such
that a shortfall of some duration costs as much as with the 140 instants that it was chosen for."""

OWN_REACH_M = 0.05
"""Distance below which an arm's own obstacles are constrained. It can be short, because the arm's
own cycle is already clear of them, and there are many rounds."""

TOLERATED_M = 0.002
"""Negative excess of a distance that is tolerated when motions are compared: much less than
`EXTRA_MARGIN_M`. A step along linearised distances always loses some tenths of a millimetre."""

OWN_SHARE = 0.02
"""Weight of all durations and waits in the objective."""

OPTIONS = {"ipopt.max_iter": 150, "ipopt.mu_init": 3e-2}
"""Options of the solver. The initial barrier parameter is greater than for one arm, because guesses
are farther from the solution; this saves a quarter of the iterations."""

TRUST_SHARE = 0.35
"""Maximum relative change of a duration; twice that, as a share of the longest phase, is the
maximum change of a wait."""


MIN_INTERVALS = 4
"""Minimum number of intervals of a phase."""


class TrackStep(NamedTuple):
    """A step of a track.

    Attributes:
        phase: number of the phase; None for a gripper action.
        episode: number of the hand's state (`planner.two_arms.across`).
    """

    phase: int | None
    episode: int


@dataclass(frozen=True, slots=True, eq=False)
class ArmTrack:
    """The track of one arm, without a guess.

    Attributes:
        track: its motion program, task, arm and limits.
        obstacles: around each phase.
        steps: phases and gripper actions, in order.
        grip_s: duration of a gripper action.
        strays: in which phases a motion breaks its constraints between knots, so that more
            intervals are needed.
    """

    track: Track
    obstacles: tuple[Obstacles, ...]
    steps: tuple[TrackStep, ...]
    grip_s: float
    strays: Callable[[Motions], Sequence[bool]]

    @property
    def phases(self) -> tuple[Phase, ...]:
        """The phases of its motion."""
        return self.track.program.phases

    @property
    def rests(self) -> list[int]:
        """The numbers of the phases that begin at rest, before which the arm may wait."""
        return [0, *(k + 1 for k, phase in enumerate(self.phases[:-1]) if phase.rests)]

    def with_intervals(self, factors: Sequence[float]) -> ArmTrack:
        """The same track with a multiple of the number of intervals in each phase."""
        phases = tuple(
            phase._replace(intervals=max(MIN_INTERVALS, round(factor * phase.intervals)))
            for phase, factor in zip(self.phases, factors, strict=True)
        )
        program = track_program(phases, len(self.track.limits.names))
        return replace(self, track=self.track._replace(program=program))

    def timed(self, motions: Motions, waits_s: FloatArray) -> Timed:
        """Motions as a guess, with as many intervals as its phases have."""
        intervals = (phase.intervals for phase in self.phases)
        return Timed(tuple(Sketch.of_each(motions, intervals)), waits_s)

    def sampled(self, sketches: Sequence[Sketch]) -> list[SampledDistances]:
        """The distances from its own obstacles along a motion."""
        pairs = zip(self.obstacles, sketches, strict=True)
        return [near.sampled(sketch.controls, OWN_REACH_M) for near, sketch in pairs]


class Timed(NamedTuple):
    """A guess or solution of one track.

    Attributes:
        sketches: of each phase.
        waits_s: before each phase that begins at rest, shape (rests,), s.
    """

    sketches: tuple[Sketch, ...]
    waits_s: FloatArray

    def later(self, delay_s: float) -> Timed:
        """The same after a longer wait at the start."""
        waits_s = self.waits_s.copy()
        waits_s[0] += delay_s
        return self._replace(waits_s=waits_s)

    def towards(self, other: Timed, share: float) -> Timed:
        """A guess between this one and another, which has as many intervals."""
        return Timed(
            tuple(a.towards(b, share) for a, b in zip(self.sketches, other.sketches, strict=True)),
            (1.0 - share) * self.waits_s + share * other.waits_s,
        )


class Near(NamedTuple):
    """Motions of both arms with the distances near them.

    Attributes:
        timed: of the left and the right arm.
        sampled: the distances from each arm's own obstacles, in each phase.
        cost_s: what is minimised: the makespan, and a share of both tracks' durations.
        missing: distances that are missing beyond `TOLERATED_M`, weighted, in units of time.
        excess_m: the smallest excess of all distances, where that is below minus `TOLERATED_M`.
    """

    timed: tuple[Timed, ...]
    sampled: tuple[list[SampledDistances], ...]
    cost_s: float
    missing: float
    excess_m: float

    @property
    def unit_s(self) -> float:
        """The unit of time: the longest phase."""
        return unit_s_of(self.timed)

    def merit_s(self, unit_s: float) -> float:
        """The cost, and that of missing distances, as the program weighs them."""
        return self.cost_s + unit_s * self.missing


class Solution(NamedTuple):
    """Motions of both arms.

    Attributes:
        motions: of the left and the right arm, one for each phase.
        waits_s: of each, before each phase that begins at rest, shape (rests,), s.
        makespan_s: duration of both on the clock.
    """

    motions: tuple[Motions, ...]
    waits_s: tuple[FloatArray, ...]
    makespan_s: float


class Clock:
    """The schedule of one track on the common clock.

    Attributes:
        begins_s: when each phase begins to move, shape (phases,), s.
        durations_s: of each phase, shape (phases,), s.
        end_s: when the track ends.
        grips_s: total duration of the gripper actions.
    """

    def __init__(self, arm: ArmTrack, timed: Timed) -> None:
        waits = dict(zip(arm.rests, timed.waits_s.tolist(), strict=True))
        durations = [sketch.duration_s for sketch in timed.sketches]
        now_s, begins, changes, episodes = 0.0, [], [], []
        for phase, episode in arm.steps:
            changes.append(now_s)
            episodes.append(episode)
            if phase is None:
                now_s += arm.grip_s
            else:
                begins.append(now_s + waits.get(phase, 0.0))
                now_s = begins[-1] + durations[phase]
        self.end_s = now_s
        self.begins_s, self.durations_s = np.array(begins), np.array(durations)
        self.grips_s = arm.grip_s * sum(phase is None for phase, _ in arm.steps)
        self._changes, self._episodes = np.array(changes), np.array(episodes)
        self._controls = np.concatenate([sketch.controls for sketch in timed.sketches])
        self._intervals = np.array([sketch.intervals for sketch in timed.sketches])

    def at(self, times_s: FloatArray) -> tuple[Indices, FloatArray]:
        """The phase at each time, and the fraction of it that has passed, 0 or 1 at rest."""
        phase = np.searchsorted(self.begins_s, times_s, side="right") - 1
        phase = np.clip(phase, 0, None)
        u = ((times_s - self.begins_s[phase]) / self.durations_s[phase]).clip(0.0, 1.0)
        return phase, u

    def episodes_at(self, times_s: FloatArray) -> Indices:
        """The number of the hand's state at each time."""
        number = np.searchsorted(self._changes, times_s, side="right") - 1
        found: Indices = self._episodes[number]
        return found

    def four_at(self, times_s: FloatArray) -> tuple[Indices, FloatArray]:
        """Numbers of the four controls at each time, counted over all phases, and the fractions.

        The fractions are those of the interval that the controls determine; shapes (m, 4) and (m,).
        """
        phase, u = self.at(times_s)
        first, local = _interval(u, self._intervals[phase])
        firsts = np.cumsum(self._intervals + 3) - (self._intervals + 3)
        return (firsts[phase] + first)[:, None] + np.arange(4), local

    def states(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions, rad, and velocities, rad/s, at some times, shape (m, joints) each."""
        phase, u = self.at(times_s)
        numbers, local = self.four_at(times_s)
        four, is_moving = self._controls[numbers], (u > 0.0) & (u < 1.0)
        per_s = np.where(is_moving, self._intervals[phase] / self.durations_s[phase], 0.0)
        q = np.einsum("mk,mkj->mj", weights_at(local), four)
        v = np.einsum("mk,mkj->mj", rates_at(local), four)
        return q, v * per_s[:, None]


def _interval(u: FloatArray, intervals: Indices) -> tuple[Indices, FloatArray]:
    """The interval at fractions of phases, and the fraction of that interval."""
    number = np.minimum((u * intervals).astype(np.intp), intervals - 1)
    return number, u * intervals - number


class JointProgram:
    """The program of both arms, for one pair of tracks.

    Attributes:
        arms: the tracks, left and right.
    """

    def __init__(self, arms: tuple[ArmTrack, ArmTrack], across: Across) -> None:
        """Store the left and right tracks, and the collision geometry of both arms."""
        self.arms, self._across = arms, across
        counts = [each.track.program.unknowns.count for each in arms]
        shortfalls = [sum(phase.intervals for phase in each.phases) for each in arms]
        ends = np.cumsum(np.ravel([counts, shortfalls], order="F"))
        self._firsts = [0, int(ends[1])]
        waits = [len(each.rests) for each in arms]
        self._own = int(ends[-1])
        self._waits = np.split(self._own + np.arange(sum(waits)), [waits[0]])
        self._makespan = self._own + sum(waits)
        self._shortfalls = self._makespan + 1 + np.arange(INSTANTS)
        self._count = self._makespan + 1 + INSTANTS

    def with_intervals(self, factors: Sequence[Sequence[float]]) -> JointProgram:
        """The same program with multiples of the numbers of intervals, by track and phase."""
        left, right = (
            arm.with_intervals(of_arm) for arm, of_arm in zip(self.arms, factors, strict=True)
        )
        return JointProgram((left, right), self._across)

    def timed(self, solution: Solution) -> tuple[Timed, ...]:
        """A solution as a guess."""
        each = zip(self.arms, solution.motions, solution.waits_s, strict=True)
        return tuple(arm.timed(motions, waits_s) for arm, motions, waits_s in each)

    def resampled(self, guess: Sequence[Timed]) -> tuple[Timed, ...]:
        """A guess, resampled to the numbers of intervals of this program."""
        found = []
        for arm, (sketches, waits_s) in zip(self.arms, guess, strict=True):
            limits = arm.track.limits
            motions = tuple(trajectory_of(s.controls, s.duration_s, limits) for s in sketches)
            found.append(arm.timed(motions, waits_s))
        return tuple(found)

    def near(self, guess: Sequence[Timed]) -> Near:
        """The distances near a guess."""
        sampled = tuple(arm.sampled(t.sketches) for arm, t in zip(self.arms, guess, strict=True))
        clocks = self.clocks(guess)
        ends_s = [clock.end_s for clock in clocks]
        times = np.linspace(0.0, max(ends_s), INSTANTS)
        qs = np.concatenate([clock.states(times)[0] for clock in clocks], axis=1)
        numbers = [clock.episodes_at(times) for clock in clocks]
        excess_m = self.least_m(numbers, qs, -TOLERATED_M)
        own = [each for of_arm in sampled for each in of_arm]
        missing = SHORTFALL_PER_M * float(-(excess_m + TOLERATED_M).sum())
        missing += motion_program.SHORTFALL_PER_M * sum(each.missing_m(TOLERATED_M) for each in own)
        least_m = min(float(excess_m.min()), *(each.excess_m for each in own))
        cost_s = max(ends_s) + OWN_SHARE * sum(ends_s)
        return Near(tuple(guess), sampled, cost_s, missing, least_m)

    def least_m(
        self, episodes: Sequence[Indices], qs: FloatArray, within_m: float = 0.0
    ) -> FloatArray:
        """The smallest excess of the distances between both arms, shape (n,), m.

        Args:
            episodes: of the left and the right hand, shape (n,) each.
            qs: both arms' configurations, shape (n, 14), rad.
            within_m: the result where no pair is nearer.
        """
        found = np.zeros(len(qs))
        for near, where in self._by_state(episodes):
            found[where] = near.least_m(qs[where], within_m)
        return found

    def clocks(self, guess: Sequence[Timed]) -> list[Clock]:
        """The schedule of each track on the common clock."""
        return [Clock(arm, timed) for arm, timed in zip(self.arms, guess, strict=True)]

    def _by_state(self, episodes: Sequence[Indices]) -> Iterator[tuple[Obstacles, Indices]]:
        """The obstacles of each pair of hand states, and the indices at which that pair occurs."""
        kinds, kind = np.unique(np.stack(episodes, axis=1), axis=0, return_inverse=True)
        for number, (left, right) in enumerate(kinds.tolist()):
            near = self._across.obstacles((left, right), EXTRA_MARGIN_M)
            yield near, np.flatnonzero(kind.reshape(-1) == number)

    def solved(self, near: Near, trust: float) -> Solution | None:
        """The fastest motions near others, or None.

        Args:
            near: these motions.
            trust: share of the usual maximum changes, above zero, at most one.
        """
        guess, unit_s, trust_share = near.timed, near.unit_s, trust * TRUST_SHARE
        tracks = [arm.track for arm in self.arms]
        clear = [
            Clearances([each.linear for each in of_arm], trust * TRUST_RAD)
            for of_arm in near.sampled
        ]
        parts = [
            track.program.part(timed.sketches, track, unit_s, clearances)
            for track, timed, clearances in zip(tracks, guess, clear, strict=True)
        ]
        x0, low, high = (
            np.concatenate([part.inputs[name] for part in parts]) for name in ("x0", "lbx", "ubx")
        )
        for first, track in zip(self._firsts, tracks, strict=True):
            T = first + track.program.unknowns.durations
            low[T] = np.maximum(low[T], x0[T] / (1.0 + trust_share))
            high[T] = np.minimum(high[T], x0[T] * (1.0 + trust_share))
        clocks, waits = self.clocks(guess), np.concatenate([each.waits_s for each in guess])
        further = np.zeros(self._count - self._own)
        further[: len(waits)] = waits / unit_s
        further[len(waits)] = max(clock.end_s for clock in clocks) / unit_s
        low_further, high_further = np.zeros_like(further), np.full_like(further, MAX_DURATION)
        given = further[: len(waits)]
        low_further[: len(waits)] = np.maximum(0.0, given - 2.0 * trust_share)
        high_further[: len(waits)] = given + 2.0 * trust_share
        high_further[len(waits) + 1 :] = MAX_SHORTFALL_M
        x0 = np.concatenate([x0, further])
        matrix, least = self._coupling(clocks, x0, unit_s)
        weights = np.full(len(further), SHORTFALL_PER_M)
        weights[: len(waits)], weights[len(waits)] = OWN_SHARE, 1.0
        coupling = Coupling(len(further), matrix, weights, OWN_SHARE)
        programs = [track.program for track in tracks]
        x = answer(
            solver_of(programs, [part.rows for part in parts], coupling),
            {
                "x0": x0,
                "p": np.concatenate([part.inputs["p"] for part in parts]),
                "lbx": np.concatenate([low, low_further]),
                "ubx": np.concatenate([high, high_further]),
                "lbg": np.concatenate([*(part.inputs["lbg"] for part in parts), least]),
                "ubg": np.concatenate(
                    [*(part.inputs["ubg"] for part in parts), np.full(len(least), np.inf)]
                ),
            },
        )
        if x is None:
            return None
        motions = tuple(
            track.program.motions(x[first:], track.task, track.limits, unit_s)
            for first, track in zip(self._firsts, tracks, strict=True)
        )
        waits_s = tuple(np.maximum(x[where], 0.0) * unit_s for where in self._waits)
        ends = [
            sum(motion.duration for motion in each) + wait.sum() + clock.grips_s
            for each, wait, clock in zip(motions, waits_s, clocks, strict=True)
        ]
        return Solution(motions, waits_s, float(max(ends)))

    def _coupling(
        self, clocks: Sequence[Clock], x0: FloatArray, unit_s: float
    ) -> tuple[ca.DM, FloatArray]:
        """Rows `matrix @ x >= least`: distances of the arms at instants, and the makespan."""
        times = np.linspace(0.0, max(clock.end_s for clock in clocks), INSTANTS)
        states = [clock.states(times) for clock in clocks]
        near = self._nearest(clocks, times, np.concatenate([q for q, _ in states], axis=1))
        rows, at, count = np.arange(len(near.number)), near.number, len(near.number)
        entries = [(rows, self._shortfalls[at], np.ones(count))]
        for side, (clock, (_, v)) in enumerate(zip(clocks, states, strict=True)):
            slopes = near.slopes[:, 7 * side : 7 * side + 7]
            numbers, local = clock.four_at(times)
            controls = np.concatenate(self.arms[side].track.program.unknowns.controls)[numbers[at]]
            weights = weights_at(local)[at, :, None] * slopes[:, None]
            is_given = controls >= self.arms[side].track.program.unknowns.count
            entries.append((rows, controls + self._firsts[side], np.where(is_given, 0.0, weights)))
            speeds = unit_s * np.einsum("ij,ij->i", slopes, v[at])
            columns, weights = self._passed(side, *clock.at(times[at]))
            entries.append((rows, columns, -speeds[:, None] * weights))
        row, column, weight = _flat(entries)
        used = weight != 0.0
        row, column, weight = row[used], column[used], weight[used]
        least = np.bincount(row, weight * x0[column], count) - near.excess_m
        ends = [(row, column, weight)]
        for side, arm in enumerate(self.arms):
            columns, weights = self._passed(side, np.array([len(arm.phases) - 1]), np.ones(1))
            ends.append((np.array([count + side]), columns, -weights))
            ends.append((np.array([count + side]), np.array([self._makespan]), np.ones(1)))
        matrix = constant(*_flat(ends), (count + 2, self._count))
        return matrix, np.concatenate([least, [clock.grips_s / unit_s for clock in clocks]])

    def _nearest(self, clocks: Sequence[Clock], times: FloatArray, qs: FloatArray) -> NearPairs:
        """The nearest pairs of both arms at times of the clock."""
        found = []
        for near, where in self._by_state([clock.episodes_at(times) for clock in clocks]):
            pairs = near.nearest(qs[where], PAIRS)
            found.append(pairs._replace(number=where[pairs.number]))
        return NearPairs(*map(np.concatenate, zip(*found, strict=True)))

    def _passed(self, side: int, phase: Indices, u: FloatArray) -> tuple[Indices, FloatArray]:
        """Columns of an arm's durations and waits, and the share of each that has passed.

        The columns have shape (k,), the shares at the given fractions of phases shape (m, k).
        """
        arm = self.arms[side]
        T = self._firsts[side] + arm.track.program.unknowns.durations
        of_phases = (phase[:, None] + u[:, None] - np.arange(len(T))).clip(0.0, 1.0)
        of_waits = np.array(arm.rests) <= phase[:, None]
        return np.concatenate([T, self._waits[side]]), np.hstack([of_phases, of_waits])


def _flat(
    entries: Sequence[tuple[Indices, Indices, FloatArray]],
) -> tuple[Indices, Indices, FloatArray]:
    """Rows, columns and weights of entries of a matrix, one after the other.

    Rows are those of the first axis of the weights; columns broadcast.
    """
    rows = [np.repeat(row, np.prod(weight.shape[1:], dtype=int)) for row, _, weight in entries]
    columns = [np.broadcast_to(column, weight.shape).ravel() for _, column, weight in entries]
    weights = [weight.ravel() for _, _, weight in entries]
    return np.concatenate(rows), np.concatenate(columns), np.concatenate(weights)


def unit_s_of(guess: Sequence[Timed]) -> float:
    """The unit of time: the longest phase of a guess."""
    return max(sketch.duration_s for timed in guess for sketch in timed.sketches)


@lru_cache(maxsize=32)
def track_program(phases: tuple[Phase, ...], joints: int) -> MotionProgram:
    """The program of a track; the last ones that were built are kept."""
    return MotionProgram(phases, joints, options=OPTIONS)
