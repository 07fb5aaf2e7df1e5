"""JointProgram: the fastest motions of both arms that keep clear of each other.

Each arm is a track: the motion program of its own cycle, with its own durations, lines and
obstacles, and a wait, zero or more, before each motion that begins at rest. The makespan M is at
least the sum of durations, waits and gripper actions of each track. The objective is M, plus a
small share of all durations and waits, so that the arm that ends first is determined, too.

The tracks share no grid of time. At instants t of the common clock the nearest pairs of both arms
are bounded,

    s_L . q_L(t) + s_R . q_R(t) + c + shortfall >= 0,     q(t) = W(u) y + v (t - tau),

where y are controls of an arm; in the last solution it is at t at the fraction u of a phase, with
velocity v; and tau is the time at which it now is at that fraction: the sum of the waits, durations
and gripper actions before, and u of the phase's own duration. So each row is linear in controls,
durations and waits of both arms. As the distances are linearised, the program is solved in rounds,
each near the last solution (`planner.motion.program.motion_program`).
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from baxter_kin.validation import FloatArray, Indices
from planner.collision.obstacles import LinearBounds, Obstacles
from planner.motion.program.motion_program import (
    EXTRA_MARGIN_M,
    MARGIN_TOLERANCE_M,
    MAX_DURATION,
    MAX_SHORTFALL_M,
    SHORTFALL_PER_M,
    TRUST_DECAY,
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
from planner.splines import Sketch, rates_at, weights_at
from planner.two_arms.across import Across

logger = logging.getLogger(__name__)

INSTANTS, PAIRS = 140, 3
"""Number of instants of the clock at which the arms keep clear of each other, and of pairs at each:
the nearest ones. In motions of 4 to 6 s these are 40 ms apart; with `MARGIN_TOLERANCE_M`, the proof
found no contact in between in any of 24 solutions."""

SETTLED, MAX_IN_VAIN = 0.01, 3
"""Share of its makespan by which a clear solution must change for another round, and maximum number
of rounds after it without another."""

OWN_SHARE = 0.02
"""Weight of all durations and waits in the objective."""

MAX_ROUNDS, MAX_FAILURES, MAX_ITERATIONS = 14, 2, 150
"""Maximum number of rounds, of rounds without a solution, and of IPOPT's iterations in a round."""

TRUST_SHARE = 0.35
"""Maximum relative change of a duration in a round; twice that, as a share of the longest phase, is
the maximum change of a wait."""

SCAN_STEP_S, SCAN_INSTANTS = 0.25, 70
"""Step of the delays of a start that are tried, and number of instants of each."""


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
    """

    track: Track
    obstacles: tuple[Obstacles, ...]
    steps: tuple[TrackStep, ...]
    grip_s: float

    @property
    def phases(self) -> tuple[Phase, ...]:
        """The phases of its motion."""
        return self.track.program.phases

    @property
    def rests(self) -> list[int]:
        """The numbers of the phases that begin at rest, before which the arm may wait."""
        return [0, *(k + 1 for k, phase in enumerate(self.phases[:-1]) if phase.rests)]

    def bounds(self, sketches: Sequence[Sketch]) -> list[LinearBounds]:
        """Bounds on the distances from its own obstacles near a motion."""
        pairs = zip(self.obstacles, sketches, strict=True)
        return [near.bounds(sketch.controls) for near, sketch in pairs]


class Timed(NamedTuple):
    """A guess or solution of one track.

    Attributes:
        sketches: of each phase.
        waits_s: before each phase that begins at rest, shape (rests,), s.
    """

    sketches: tuple[Sketch, ...]
    waits_s: FloatArray


class Solution(NamedTuple):
    """Motions of both arms that look clear.

    Attributes:
        motions: of the left and the right arm, one for each phase.
        waits_s: of each, before each phase that begins at rest, shape (rests,), s.
        makespan_s: duration of both on the clock.
    """

    motions: tuple[Motions, ...]
    waits_s: tuple[FloatArray, ...]
    makespan_s: float


class _Clock:
    """When one track is where.

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
        self._controls = [sketch.controls for sketch in timed.sketches]

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

    def states(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions, rad, and velocities, rad/s, at some times, shape (m, joints) each."""
        q, v = [], []
        for k, u in zip(*self.at(times_s), strict=True):
            controls = self._controls[k]
            first, local = _interval(u, len(controls) - 3)
            four = controls[first : first + 4]
            q.append(weights_at(local)[0] @ four)
            rate = rates_at(local)[0] @ four * (len(controls) - 3) / self.durations_s[k]
            v.append(rate if 0.0 < u < 1.0 else np.zeros_like(rate))
        return np.array(q), np.array(v)


def _interval(u: float, intervals: int) -> tuple[int, FloatArray]:
    """The interval at a fraction of a phase, and the fraction of that interval, shape (1,)."""
    number = min(int(u * intervals), intervals - 1)
    return number, np.array([u * intervals - number])


class JointProgram:
    """The program of both arms, for one pair of tracks."""

    def __init__(self, arms: tuple[ArmTrack, ArmTrack], across: Across) -> None:
        """Store the tracks, left and right, and what both keep from each other."""
        self._arms, self._across = arms, across
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

    def merit_s(self, guess: Sequence[Timed]) -> float:
        """Makespan of a guess plus the cost of missing distances, as the program weighs them."""
        clocks = self._clocks(guess)
        end_s = max(clock.end_s for clock in clocks)
        times = np.linspace(0.0, end_s, SCAN_INSTANTS)
        qs = np.concatenate([clock.states(times)[0] for clock in clocks], axis=1)
        missing_m = 0.0
        for near, where in self._by_state(clocks, times):
            missing_m -= float(near.least_m(qs[where], 0.0).sum())
        return end_s + SHORTFALL_PER_M * missing_m * INSTANTS / SCAN_INSTANTS * _unit_s(guess)

    def excess_m(self, guess: Sequence[Timed]) -> float:
        """The smallest excess of the distances between both arms at the instants, m."""
        clocks = self._clocks(guess)
        times = np.linspace(0.0, max(clock.end_s for clock in clocks), INSTANTS)
        qs = np.concatenate([clock.states(times)[0] for clock in clocks], axis=1)
        return min(
            float(near.least_m(qs[where], 0.1).min())
            for near, where in self._by_state(clocks, times)
        )

    def solutions(self, guess: Sequence[Timed]) -> Iterator[Solution]:
        """Solutions near a guess that look clear, each found from the one before.

        It ends when the makespan has settled, or after too many rounds.
        """
        timed, trust, share = tuple(guess), TRUST_RAD, TRUST_SHARE
        failures, last_s, last_clear = 0, np.inf, MAX_ROUNDS
        bounds = [arm.bounds(t.sketches) for arm, t in zip(self._arms, timed, strict=True)]
        for number in range(1, MAX_ROUNDS + 1):
            solved = self._solved(timed, bounds, trust, share)
            if solved is None:
                failures += 1
                trust, share = TRUST_DECAY * trust, TRUST_DECAY * share
                if failures > MAX_FAILURES:
                    return
                continue
            timed = tuple(
                Timed(tuple(Sketch.of_each(motions, (p.intervals for p in arm.phases))), waits)
                for arm, motions, waits in zip(
                    self._arms, solved.motions, solved.waits_s, strict=True
                )
            )
            bounds = [arm.bounds(t.sketches) for arm, t in zip(self._arms, timed, strict=True)]
            own_m = min(each.excess_m for of_arm in bounds for each in of_arm)
            between_m = self.excess_m(timed)
            logger.debug(
                "round %d: %.3f s, excess %.1f mm between the arms, %.1f mm elsewhere",
                *(number, solved.makespan_s, 1e3 * between_m, 1e3 * own_m),
            )
            excess_m = min(own_m, between_m)
            if number > MAX_ROUNDS // 2:
                trust, share = TRUST_DECAY * trust, TRUST_DECAY * share
            if excess_m > -MARGIN_TOLERANCE_M:
                yield solved
                if abs(solved.makespan_s - last_s) < SETTLED * solved.makespan_s:
                    return
                last_s, last_clear = solved.makespan_s, number
            if number >= last_clear + MAX_IN_VAIN:
                return

    def _clocks(self, guess: Sequence[Timed]) -> list[_Clock]:
        return [_Clock(arm, timed) for arm, timed in zip(self._arms, guess, strict=True)]

    def _by_state(
        self, clocks: Sequence[_Clock], times_s: FloatArray
    ) -> Iterator[tuple[Obstacles, Indices]]:
        """Numbers of the times at which both hands have the same states, with the obstacles."""
        episodes = np.stack([clock.episodes_at(times_s) for clock in clocks], axis=1)
        kinds, kind = np.unique(episodes, axis=0, return_inverse=True)
        for number, (left, right) in enumerate(kinds.tolist()):
            near = self._across.obstacles((left, right), EXTRA_MARGIN_M)
            yield near, np.flatnonzero(kind.reshape(-1) == number)

    def _solved(
        self,
        guess: Sequence[Timed],
        bounds: Sequence[Sequence[LinearBounds]],
        trust_rad: float,
        trust_share: float,
    ) -> Solution | None:
        """The fastest motions near a guess, or None."""
        unit_s, tracks = _unit_s(guess), [arm.track for arm in self._arms]
        parts = [
            track.program.part(timed.sketches, track, unit_s, Clearances(near, trust_rad))
            for track, timed, near in zip(tracks, guess, bounds, strict=True)
        ]
        x0, low, high = (
            np.concatenate([part.inputs[name] for part in parts]) for name in ("x0", "lbx", "ubx")
        )
        for first, track in zip(self._firsts, tracks, strict=True):
            T = first + track.program.unknowns.durations
            low[T] = np.maximum(low[T], x0[T] / (1.0 + trust_share))
            high[T] = np.minimum(high[T], x0[T] * (1.0 + trust_share))
        clocks, waits = self._clocks(guess), np.concatenate([each.waits_s for each in guess])
        further = np.zeros(self._count - self._own)
        further[: len(waits)] = waits / unit_s
        further[len(waits)] = max(clock.end_s for clock in clocks) / unit_s
        low_further, high_further = np.zeros_like(further), np.full_like(further, MAX_DURATION)
        near = further[: len(waits)]
        low_further[: len(waits)] = np.maximum(0.0, near - 2.0 * trust_share)
        high_further[: len(waits)] = near + 2.0 * trust_share
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
        self, clocks: Sequence[_Clock], x0: FloatArray, unit_s: float
    ) -> tuple[ca.DM, FloatArray]:
        """Rows `matrix @ x >= least`: distances of the arms at instants, and the makespan."""
        times = np.linspace(0.0, max(clock.end_s for clock in clocks), INSTANTS)
        states = [clock.states(times) for clock in clocks]
        qs = np.concatenate([q for q, _ in states], axis=1)
        places = [clock.at(times) for clock in clocks]
        rows = _LinearRows()
        for near, where in self._by_state(clocks, times):
            for i, found in zip(where.tolist(), near.nearest(qs[where], PAIRS), strict=True):
                for excess, slope in found:
                    row = rows.new(excess)
                    rows.add(row, self._shortfalls[i : i + 1], np.ones(1))
                    for side, (phase, u) in enumerate(places):
                        s = slope[7 * side : 7 * side + 7]
                        at, weights = self._position(side, int(phase[i]), float(u[i]))
                        rows.add_change(row, at, weights * s, x0)
                        speed = float(s @ states[side][1][i]) * unit_s
                        if speed:
                            at, weights = self._time(side, int(phase[i]), float(u[i]))
                            rows.add_change(row, at, -speed * weights, x0)
        for side, (arm, clock) in enumerate(zip(self._arms, clocks, strict=True)):
            row = rows.new(-clock.grips_s / unit_s)
            at, weights = self._time(side, len(arm.phases) - 1, 1.0)
            rows.add(row, at, -weights)
            rows.add(row, np.array([self._makespan]), np.ones(1))
        return rows.of(self._count)

    def _position(self, side: int, phase: int, u: float) -> tuple[Indices, FloatArray]:
        """The controls of an arm at a fraction of a phase, and their weights: (4, 7), (4, 1).

        Those that are given are -1.
        """
        unknowns = self._arms[side].track.program.unknowns
        first, local = _interval(u, self._arms[side].phases[phase].intervals)
        controls = unknowns.controls[phase][first : first + 4]
        at = np.where(controls < unknowns.count, controls + self._firsts[side], -1)
        return at, weights_at(local)[0][:, None]

    def _time(self, side: int, phase: int, u: float) -> tuple[Indices, FloatArray]:
        """The unknown waits and durations before a fraction of a phase, and their weights."""
        T = self._firsts[side] + self._arms[side].track.program.unknowns.durations
        waits = self._waits[side][: sum(rest <= phase for rest in self._arms[side].rests)]
        weights = np.concatenate([np.ones(phase), [u], np.ones(len(waits))])
        return np.concatenate([T[: phase + 1], waits]), weights


class _LinearRows:
    """Rows of a sparse linear system, `sum of weights x >= least`."""

    def __init__(self) -> None:
        self._rows: list[Indices] = []
        self._columns: list[Indices] = []
        self._weights: list[FloatArray] = []
        self._least: list[float] = []

    def new(self, constant_term: float) -> int:
        """A new row, whose sum plus a constant is at least zero."""
        self._least.append(-constant_term)
        return len(self._least) - 1

    def add(self, row: int, at: Indices, weights: FloatArray) -> None:
        """Add weights of unknowns to a row."""
        self._rows.append(np.full(at.size, row))
        self._columns.append(at.ravel())
        self._weights.append(np.asarray(weights, float).ravel())

    def add_change(self, row: int, at: Indices, weights: FloatArray, x0: FloatArray) -> None:
        """Add weights of the changes of unknowns from a guess; unknowns -1 do not change."""
        at, weights = np.broadcast_arrays(at, weights)
        is_unknown = at >= 0
        at, weights = at[is_unknown], weights[is_unknown]
        self._least[row] += float(weights @ x0[at])
        self.add(row, at, weights)

    def of(self, unknowns: int) -> tuple[ca.DM, FloatArray]:
        """The matrix and the minimum of each row of the product."""
        rows, columns = np.concatenate(self._rows), np.concatenate(self._columns)
        shape = len(self._least), unknowns
        return constant(rows, columns, np.concatenate(self._weights), shape), np.array(self._least)


def _unit_s(guess: Sequence[Timed]) -> float:
    """The unit of time: the longest phase of a guess."""
    return max(sketch.duration_s for timed in guess for sketch in timed.sketches)


@lru_cache(maxsize=16)
def track_program(phases: tuple[Phase, ...], joints: int) -> MotionProgram:
    """The program of a track; the last ones that were built are kept."""
    return MotionProgram(phases, joints, options={"ipopt.max_iter": MAX_ITERATIONS})
