"""Rows: the proof that clusters keep apart at every instant of a step.

A row is a cell of time, two clusters and a direction n, fixed in the frame that carries the second.
Let G(t) be the gap that n leaves between them: the smallest n . a over the first minus the largest
n . b over the second. For each pair of points, n . (a - b) has a second derivative of at most
|n| M, and the jumps of its slope at kinks add up to at most |n| S. So, by the lemma of `motion`, G
is at least min(G(start), G(end)) - |n| (M h^2 / 8 + S h / 4) at every instant of a cell of length
h, and the distance is at least G / |n|. Any direction is sound, so nothing about a row is trusted.

M bounds the acceleration of any point of the first cluster seen from the frame of the second, and S
the sum of the jumps of its velocity (`motion.carried`).

The witness of a step is a string of letters, level by level: each open task (a pair of clusters and
a cell) is separated, or replaced by both halves of a cluster or of the cell. So no part of a
cluster and no instant can be left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from planner.certificate.clusters import LEAF, Clusters, Nodes
from planner.certificate.errors import NotCertifiedError, require
from planner.certificate.intervals import UNIT, Array, Interval, Pose, norm_bound, product, rotation
from planner.certificate.motion import Polynomials, carried

BY_DIRECTION, BY_FINE_DIRECTION, BY_MIDDLES, CUT_FIRST, CUT_SECOND, CUT_TIME = range(6)
"""Letters of a trace. The first three separate a pair: by a coarse direction, by a fine one, or by
the line between the middles. The others cut the first cluster, the second, or the cell of time."""

MAX_TASKS = 50_000
"""Maximum number of tasks of one level of one step; current plans have some hundreds."""

MAX_LEVELS = 100

MIN_LENGTH = 1e-6
"""Minimum length of a direction."""

MIDDLES_SCALE = 100.0
"""The line between middles is rounded to integers up to this."""


class Joints(Protocol):
    """A serial chain of n joints, such as the arm of a `planner.certificate.robot.Robot`."""

    @property
    def spans(self) -> Sequence[Pose]:
        """Poses of joint i + 1 seen from joint i at position 0, the first seen from base."""

    @property
    def offsets(self) -> Array:
        """Upper bounds on the lengths of their translations, shape (n,), m."""

    @property
    def base(self) -> int:
        """Number of joints before base: 0, or those of an arm that is passed backwards."""


@dataclass(frozen=True, eq=False)
class Mover:
    """Clusters that move as one.

    Attributes:
        name: their name in messages.
        root: number of the root of their tree.
        level: number of the joint that carries them, 0 for the base of the chain.
        slide_m: displacement along y of the last joint's frame at the start and at the end of the
            step; linear in between.
    """

    name: str
    root: int
    level: int
    slide_m: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Pair:
    """Two movers, the gap that they must keep, and when.

    Attributes:
        first: the one carried by the later joint.
        second: the other.
        least_m: the minimum gap, negative where they may press into each other.
        begin_s, end_s: the window of time.
        is_counted: whether the gap counts for the clearance of the step.
    """

    first: Mover
    second: Mover
    least_m: float
    begin_s: float
    end_s: float
    is_counted: bool = True


@dataclass(frozen=True, eq=False)
class Step:
    """A move of the arm, or a travel of the fingers while it stands.

    Attributes:
        label: as in the plan.
        pairs: all pairs that must keep apart.
        motion: the motion of the arm, or None.
        q: position of the joints where there is no motion, shape (n,), rad.
    """

    label: str
    pairs: Sequence[Pair]
    motion: Polynomials | None
    q: Array

    @property
    def duration_s(self) -> float:
        """Duration, s; 1 for travels of fingers, which are parametrised over [0, 1]."""
        return 1.0 if self.motion is None else self.motion.duration_s

    def cuts_s(self, starts_s: Array, ends_s: Array) -> Array:
        """Where cells of time are cut: at a kink of the motion, or in the middle."""
        if self.motion is None:
            return 0.5 * (starts_s + ends_s)
        return self.motion.cuts_s(starts_s, ends_s)

    def reach_m(self, robot: Joints, size_m: float) -> float:
        """Upper bound on the distance of anything of the step from any joint, m.

        Args:
            robot: the arm that moves.
            size_m: maximum distance of clusters from the frames that carry them.
        """
        slides = [m for pair in self.pairs for m in (*pair.first.slide_m, *pair.second.slide_m)]
        return (size_m + float(robot.offsets.sum()) + max(map(abs, slides), default=0.0)) * (
            1.0 + 1e-9
        )


@dataclass(frozen=True, eq=False)
class Tasks:
    """Pairs of clusters and cells of time, as columns of one length."""

    pair: Nodes
    first: Nodes
    second: Nodes
    start_s: Array
    end_s: Array

    def only(self, rows: Any) -> Tasks:
        """The tasks of some rows."""
        return Tasks(
            self.pair[rows],
            self.first[rows],
            self.second[rows],
            self.start_s[rows],
            self.end_s[rows],
        )

    @classmethod
    def joined(cls, parts: Sequence[Tasks]) -> Tasks:
        """The tasks of several."""
        columns = ("pair", "first", "second", "start_s", "end_s")
        return cls(*(np.concatenate([getattr(part, c) for part in parts]) for c in columns))

    def __len__(self) -> int:
        return len(self.pair)


@dataclass(frozen=True, eq=False)
class Trace:
    """Letters and directions that lead through the rows of a step, or of all steps.

    Attributes:
        letters: in order, shape (n,).
        directions: for each letter `BY_DIRECTION`, shape (k, 3), integers up to 127.
        fine: likewise for each letter `BY_FINE_DIRECTION`, up to 32767.
    """

    letters: Nodes
    directions: Array
    fine: Array

    @classmethod
    def of(cls, letters: Nodes, n: Array) -> Trace:
        """A trace of letters with a direction for each; unstated directions are left out."""
        stated = (n[letters == letter] for letter in (BY_DIRECTION, BY_FINE_DIRECTION))
        return cls(letters, *stated)

    @classmethod
    def joined(cls, parts: Sequence[Trace]) -> Trace:
        """Concatenate traces."""
        none = cls(np.zeros(0, np.intp), np.zeros((0, 3)), np.zeros((0, 3)))
        each = (none, *parts)
        columns = ("letters", "directions", "fine")
        return cls(*(np.concatenate([getattr(part, c) for part in each]) for c in columns))


class Advice:
    """A reader of a trace."""

    def __init__(self, trace: Trace) -> None:
        """Start at the first letter."""
        self._trace = trace
        self._at, self._rows = 0, [0, 0]

    @property
    def is_used_up(self) -> bool:
        """Whether all of the trace was read."""
        trace, read = self._trace, [self._at, *self._rows]
        return read == [len(x) for x in (trace.letters, trace.directions, trace.fine)]

    def next(self, count: int) -> tuple[Nodes, Array]:
        """Read the letters of some tasks, and a direction for each, 0 where none is stated.

        Raises:
            NotCertifiedError: when the trace ends too soon.
        """
        letters = self._trace.letters[self._at : self._at + count]
        self._at += count
        require(len(letters) == count, "the certificate ends too soon")
        n = np.zeros((count, 3))
        for letter, of in enumerate((self._trace.directions, self._trace.fine)):
            stated = np.flatnonzero(letters == letter)
            directions = of[self._rows[letter] : self._rows[letter] + len(stated)]
            require(len(directions) == len(stated), "the certificate ends too soon")
            self._rows[letter] += len(stated)
            n[stated] = directions
        return letters, n


class Kinematics:
    """Enclosures of the poses of the arm's joints seen from each other, at times of a step."""

    def __init__(
        self, robot: Joints, step: Step, times_s: Array, wanted: set[tuple[int, int]]
    ) -> None:
        """Compute the poses of joint k seen from joint m, for all wanted (m, k)."""
        self._times_s, self._is_moving = times_s, step.motion is not None
        q = step.motion.at(times_s) if step.motion is not None else Interval(step.q[None])
        turns = rotation(2, q)
        spans = [Pose(product(span.R, turns[:, i]), span.p) for i, span in enumerate(robot.spans)]
        self.error_R = self.error_p = 0.0
        self._row = np.zeros((len(spans) + 1, len(spans) + 1), np.intp)  # 0: the same frame
        all_R, all_p = [np.tile(np.eye(3), (len(turns.low), 1, 1))], [np.zeros((len(turns.low), 3))]
        for m in sorted({m for m, _ in wanted}):
            T = Pose.identity()
            for k in range(m + 1, max(k for of, k in wanted if of == m) + 1):
                T = T * spans[k - 1]
                if (m, k) in wanted:
                    (R, error_R), (p, error_p) = T.R.centred(), T.p.centred()
                    self._row[m, k] = len(all_R)
                    all_R.append(R)
                    all_p.append(np.broadcast_to(p, (len(R), 3)))
                    self.error_R = max(self.error_R, error_R)
                    self.error_p = max(self.error_p, error_p)
        self._R, self._p = np.array(all_R), np.array(all_p)

    def at(self, m: Nodes, k: Nodes, times_s: Array) -> tuple[Array, Array]:
        """Middles of the enclosures, R of shape (n, 3, 3) and p of shape (n, 3)."""
        index = np.searchsorted(self._times_s, times_s) if self._is_moving else 0 * m
        row = self._row[m, k]
        return self._R[row, index], self._p[row, index]


class Judge:
    """Concludes gaps from rows; no other code concludes a separation."""

    def __init__(self, robot: Joints, clusters: Clusters, step: Step) -> None:
        """Prepare to judge one step."""
        self._robot, self._clusters, self.step = robot, clusters, step
        pairs = step.pairs
        self._k, self._m = (
            np.array([getattr(pair, side).level for pair in pairs], np.intp)
            for side in ("first", "second")
        )
        require(self._k >= self._m, f"{step.label}: a pair in the wrong order")
        if step.motion is not None:
            is_seen = (self._k > self._m) | (self._k == 0)
            require(is_seen, f"{step.label}: a pair of one frame")
        sliding = [
            abs(x) > 0.0
            for p in pairs
            for side in (p.first, p.second)
            for x in side.slide_m
            if side.level != len(robot.spans)
        ]
        require(not any(sliding), f"{step.label}: only what the last joint carries slides")
        self.least_m = np.array([pair.least_m for pair in pairs])
        self._slides = np.array(
            [[pair.first.slide_m, pair.second.slide_m] for pair in pairs], np.float64
        ).reshape(-1, 2, 2)
        self._reach_m = step.reach_m(robot, clusters.reach_m)
        self._slack_m = 0.0 if step.motion is None else step.motion.slack_m(self._reach_m)
        self._kinematics: Kinematics | None = None
        self._error_m = np.inf

    def tasks(self) -> Tasks:
        """Both roots of every pair over its whole window."""
        pairs = self.step.pairs
        first, second = (
            np.array([getattr(pair, side).root for pair in pairs], np.intp)
            for side in ("first", "second")
        )
        begin, end = (np.array([getattr(p, key) for p in pairs]) for key in ("begin_s", "end_s"))
        return Tasks(np.arange(len(pairs)), first, second, begin, end)

    def rows(self, advice: Advice) -> Iterator[tuple[Tasks, Nodes, Array]]:
        """The rows that a witness asks for, level by level; no geometry is computed.

        Raises:
            NotCertifiedError: when the witness is malformed, or asks for too many rows.
        """
        tasks, levels = self.tasks(), 0
        while len(tasks):
            levels += 1
            is_small = len(tasks) <= MAX_TASKS and levels <= MAX_LEVELS
            require(is_small, f"{self.step.label}: more rows than are checked")
            letters, n = advice.next(len(tasks))
            is_letter = (letters >= BY_DIRECTION) & (letters <= CUT_TIME)
            require(is_letter, f"{self.step.label}: the certificate is malformed")
            done = np.flatnonzero(letters <= BY_MIDDLES)
            yield tasks.only(done), letters[done], n[done]
            tasks = self.cut(tasks, letters)

    def cut(self, tasks: Tasks, letters: Nodes) -> Tasks:
        """The halves of the tasks that are cut.

        Raises:
            NotCertifiedError: when a leaf is cut, or a cell too short to be cut.
        """
        parts = []
        firsts, seconds, times = (
            tasks.only(np.flatnonzero(letters == letter))
            for letter in (CUT_FIRST, CUT_SECOND, CUT_TIME)
        )
        middle = self.step.cuts_s(times.start_s, times.end_s)
        is_inside = (times.start_s < middle) & (middle < times.end_s)
        require(is_inside, f"{self.step.label}: a cell too short to be cut")
        of_first = self._clusters.children(firsts.first)
        of_second = self._clusters.children(seconds.second)
        leaves = (of_first == LEAF).any() or (of_second == LEAF).any()
        require(not leaves, f"{self.step.label}: a cluster that cannot be cut")
        for side in (0, 1):
            parts += [
                replace(firsts, first=of_first[:, side]),
                replace(seconds, second=of_second[:, side]),
                replace(times, end_s=middle) if side == 0 else replace(times, start_s=middle),
            ]
        return Tasks.joined(parts)

    def place(self, times_s: Array) -> None:
        """Compute the poses of the arm's joints at some times, in increasing order."""
        wanted = {(m, k) for m, k in zip(self._m.tolist(), self._k.tolist(), strict=True) if m < k}
        self._kinematics = seen = Kinematics(self._robot, self.step, times_s, wanted)
        clusters = self._clusters
        self._error_m = (
            clusters.rounding_m
            + self._reach_m * (9.0 * seen.error_R + 128.0 * UNIT)
            + 3.0 * seen.error_p
            + 1e-12
        )

    def between_middles(self, tasks: Tasks) -> Array:
        """The direction between the middles of the clusters at the start of each cell."""
        R, p = self._frames(tasks, tasks.start_s)
        first, second = (self._clusters.middles(nodes) for nodes in (tasks.first, tasks.second))
        first[:, 1] += self._slide(tasks, tasks.start_s, 0)
        second[:, 1] += self._slide(tasks, tasks.start_s, 1)
        x = np.einsum("kij,kj->ki", R, first) + p - second
        longest = np.abs(x).max(axis=1, keepdims=True).clip(1e-9)
        n = np.rint(MIDDLES_SCALE * x / longest)
        return np.where((n == 0.0).all(axis=1, keepdims=True), [0.0, 0.0, 1.0], n)

    def gaps_m(self, tasks: Tasks, n: Array) -> Array:
        """The conclusion of each row: a lower bound on the distance in its cell, shape (k,), m.

        The error of the sum of four supports and translations is at most 4 |n|_1 times the error of
        one; see `Clusters.rounding_m`.
        """
        ends = []
        highest = self._clusters.lowest(tasks.second, -n)
        for times_s in (tasks.start_s, tasks.end_s):
            R, p = self._frames(tasks, times_s)
            seen = np.einsum("kij,ki->kj", R, n)
            lowest = self._clusters.lowest(tasks.first, seen)
            of_slides = seen[:, 1] * self._slide(tasks, times_s, 0)
            of_slides -= n[:, 1] * self._slide(tasks, times_s, 1)
            ends.append(np.einsum("ki,ki->k", n, p) + lowest + of_slides + highest)
        error = 4.0 * np.abs(n).sum(axis=1) * self._error_m
        length = norm_bound(n)
        found = np.minimum(*ends) - error - self.sag_m(tasks) * length
        shorter = length * (1.0 - 24.0 * UNIT)  # a gap below zero is divided by less
        divisor = np.where(found > 0.0, length, shorter)
        is_long = length > MIN_LENGTH
        return np.where(is_long, found / np.where(is_long, divisor, 1.0) - 1e-15, -np.inf)

    def sag_m(self, tasks: Tasks) -> Array:
        """Maximum sag of a gap in each cell: M h^2 / 8 + S h / 4 and the motion's slack, m."""
        step = self.step
        if step.motion is None:
            return np.zeros(len(tasks))
        V, A, jumps = step.motion.peaks(tasks.start_s, tasks.end_s)
        k, m = self._k[tasks.pair], self._m[tasks.pair]
        rho = self._clusters.reaches_m(tasks.first)
        rho = rho + np.abs(self._slides[tasks.pair, 0]).max(axis=1)
        number = np.arange(1, V.shape[1] + 1)
        between = (number <= k[:, None]) & (number > m[:, None])
        _, w = carried(V, A, rho, self._robot.offsets, between)
        length_s = tasks.end_s - tasks.start_s
        sag: Array = w * length_s**2 / 8.0
        if len(step.motion.kinks_s):
            S, _ = carried(jumps, np.zeros_like(jumps), rho, self._robot.offsets, between)
            sag = sag + S * length_s / 4.0
        return sag * (1.0 + 1e-9) + self._slack_m

    def supports(self, tasks: Tasks, n: Array) -> tuple[tuple[Array, Array], Array]:
        """Lowest points of the first clusters along directions, and highest points of the second.

        The former at both ends of each cell; all of shape (k, 3), seen from the second's frame.
        They guide a search and conclude nothing.
        """
        ends = []
        for times_s in (tasks.start_s, tasks.end_s):
            R, p = self._frames(tasks, times_s)
            x = self._clusters.lowest_points(tasks.first, np.einsum("kij,ki->kj", R, n))
            x = x + self._slide(tasks, times_s, 0)[:, None] * np.eye(3)[1]
            ends.append(np.einsum("kij,kj->ki", R, x) + p)
        far = self._clusters.lowest_points(tasks.second, -n)
        far = far + self._slide(tasks, tasks.start_s, 1)[:, None] * np.eye(3)[1]
        return (ends[0], ends[1]), far

    def rotations(self, tasks: Tasks, times_s: Array) -> Array:
        """Rotations of the first clusters' frames seen from the second's, shape (k, 3, 3)."""
        return self._frames(tasks, times_s)[0]

    def _slide(self, tasks: Tasks, times_s: Array, side: int) -> Array:
        share = times_s / self.step.duration_s
        begin, end = self._slides[tasks.pair, side].T
        slide: Array = begin * (1.0 - share) + end * share
        return slide

    def _frames(self, tasks: Tasks, times_s: Array) -> tuple[Array, Array]:
        if self._kinematics is None:
            raise NotCertifiedError("the poses of the joints are not known")
        return self._kinematics.at(self._m[tasks.pair], self._k[tasks.pair], times_s)


def certified_m(robot: Joints, clusters: Clusters, step: Step, advice: Advice) -> float:
    """The distance that all counted pairs of a step keep at every instant; inf without any.

    Raises:
        NotCertifiedError: when a row does not conclude the minimum gap of its pair.
    """
    if not step.pairs:
        return np.inf
    judge = Judge(robot, clusters, step)
    levels = list(judge.rows(advice))
    tasks = Tasks.joined([level[0] for level in levels])
    letters, n = (np.concatenate([level[i] for level in levels]) for i in (1, 2))
    judge.place(np.unique(np.concatenate([tasks.start_s, tasks.end_s])))
    by_middles = np.flatnonzero(letters == BY_MIDDLES)
    n[by_middles] = judge.between_middles(tasks.only(by_middles))
    gaps_m = judge.gaps_m(tasks, n)
    least_m = judge.least_m[tasks.pair]
    short = np.flatnonzero(~(gaps_m > least_m))
    if len(short):
        worst = short[np.argmin((gaps_m - least_m)[short])]
        pair = step.pairs[tasks.pair[worst]]
        raise NotCertifiedError(
            f"{step.label}: from {tasks.start_s[worst]:.4f} s to {tasks.end_s[worst]:.4f} s, "
            f"{pair.first.name} and {pair.second.name} are proven only "
            f"{1e3 * gaps_m[worst]:.3f} mm apart; {1e3 * pair.least_m:.3f} mm is required"
        )
    is_counted = np.array([pair.is_counted for pair in step.pairs])[tasks.pair]
    return float(gaps_m[is_counted].min(initial=np.inf))
