"""Distances along a run of moves, sampled densely and bounded in between.

Between two samples no point of the arm, or of what it holds, travels further than a bound: the sum
over the joints of how far each turns times its greatest lever arm. Samples are put where a joint
turns back, so how far it turns is the difference of its positions. A pair's distance changes by no
more than that travel, therefore a pair is measured again only when it could have become the nearest
(as conservative advancement does: Mirtich 1996), and between samples nothing comes nearer than half
the travel.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from baxter_kin.arrays import Indices, Vector
from planner.verification.certificate import Worst, greatest
from planner.verification.cubics import Cubics
from planner.verification.geometry import Pair, RunGeometry
from planner.verification.story import Run
from planner.verification.tolerances import Tolerances
from planner.verification.urdf_robot import UrdfRobot

TRAVELS_M = (2e-3, 2.5e-4)
"""Bounds on travel between two samples; the next where one leaves open whether things touch."""

MOST_SAMPLES = 200_000
"""Samples of one move; a motion so long that this is not dense enough stays unproven."""


@dataclass(frozen=True, slots=True, eq=False)
class Sampled:
    """Configurations along a run.

    Attributes:
        qs: of the arm, shape (k, n).
        travels_m: bounds on the travel from the sample before, shape (k,).
        moves: number of the move of each sample, shape (k,).
        labels: that move's label.
        times_s: time within that move, shape (k,).
    """

    qs: Vector
    travels_m: Vector
    moves: Indices
    labels: tuple[str, ...]
    times_s: Vector

    def where(self, sample: int) -> str:
        """Move and time."""
        return f"{self.labels[sample]}, {self.times_s[sample]:.4f} s"


@dataclass(frozen=True, slots=True)
class Found:
    """What was found along one run.

    Attributes:
        least: the least distance of pairs that must not touch.
        proven: what that distance is at least between samples.
        press: how deep an allowed contact presses.
        slide: how far a held body moves sideways while it touches what it may touch.
        astray: how many contacts are made out of turn. In turn are those of the fingers with a
            body in the move right before they close on it and right after they let it go, and those
            of a held body that last from when it is taken, or until it is put down.
        samples: configurations looked at.
    """

    least: Worst
    proven: Worst
    press: Worst
    slide: Worst
    astray: Worst
    samples: int


def clearance_of(
    run: Run, geometry: RunGeometry, robot: UrdfRobot, q_standing: Vector, allowed: Tolerances
) -> Found:
    """Distances along a run that has moves, sampled as densely as the proof needs."""
    for travel_m in TRAVELS_M:
        sampled = _sampled(run, geometry.reach_m, travel_m)
        full = robot.configurations(q_standing, sampled.qs, run.finger_m)
        found = _Sweep(run, geometry, sampled, allowed).over(full)
        is_open = found.proven.value <= allowed.clearance_m < found.least.value
        if not is_open or sampled.travels_m.max() > travel_m:  # a jump, which nothing refines
            break
    return found


class _Sweep:
    """One pass along the samples."""

    def __init__(
        self, run: Run, geometry: RunGeometry, sampled: Sampled, allowed: Tolerances
    ) -> None:
        self._run, self._geometry, self._sampled, self._allowed = run, geometry, sampled, allowed
        self._may_touch = np.zeros(len(geometry.pairs), dtype=np.bool_)
        self._touches: dict[int, list[int]] = {}
        self._tips: dict[int, Vector] = {}  # where the tip is while something touches
        self._least, self._least_at = np.inf, (0, 0)
        self._press, self._press_at = 0.0, "no allowed contact presses"

    def over(self, full: Vector) -> Found:
        """Measure along full configurations, shape (k, 19)."""
        self._find_contacts(full[0], full[-1])
        bounds = np.full(len(self._geometry.pairs), -np.inf)
        for sample, (q, travel) in enumerate(zip(full, self._sampled.travels_m, strict=True)):
            self._geometry.place(q)
            bounds -= travel
            for number in self._due(bounds):
                bounds[number] = self._measured(sample, number)
        return self._found()

    def _find_contacts(self, q_first: Vector, q_last: Vector) -> None:
        """Fingers may touch their body; a held body only what it touches at first or at last."""
        candidates = [pair for pair in self._geometry.pairs if pair.body is not None]
        for q in (q_first, q_last):
            self._geometry.place(q)
            for pair in candidates:
                is_near = self._geometry.distance_m(pair) <= self._allowed.press_m
                if is_near or self._run.carried is None:
                    self._may_touch[pair.number] = True

    def _due(self, bounds: Vector) -> list[int]:
        nearest = np.where(self._may_touch, self._allowed.contact_m, self._least)
        due: list[int] = np.flatnonzero(bounds <= nearest).tolist()
        return due

    def _measured(self, sample: int, number: int) -> float:
        pair = self._geometry.pairs[number]
        distance = self._geometry.distance_m(pair)
        if not self._may_touch[number]:
            if distance < self._least:
                self._least, self._least_at = distance, (sample, number)
        elif distance <= self._allowed.contact_m:
            self._touches.setdefault(number, []).append(sample)
            self._tips[sample] = self._geometry.tip_base()
            if -distance > self._press:
                self._press = -distance
                self._press_at = f"{self._sampled.where(sample)}, {pair}"
        return distance

    def _found(self) -> Found:
        sample, number = self._least_at
        where = f"{self._sampled.where(sample)}, {self._geometry.pairs[number]}"
        travel = float(self._sampled.travels_m.max())
        return Found(
            least=Worst(self._least, where),
            proven=Worst(self._least - travel / 2, f"{1e3 * travel:.3f} mm of travel, {where}"),
            press=Worst(self._press, self._press_at),
            slide=self._slide(),
            astray=self._astray(),
            samples=len(self._sampled.qs),
        )

    def _astray(self) -> Worst:
        """Contacts out of turn, and the first of them."""
        astray = []
        for number, span in self._spans():
            pair = self._geometry.pairs[number]
            if not self._is_in_turn(pair, span[0], span[-1]):
                astray.append(f"{self._sampled.where(span[0])}, {pair}")
        return Worst(len(astray), astray[0] if astray else "no contact out of turn")

    def _slide(self) -> Worst:
        """How far apart, sideways, the tip is within one contact of a held body."""
        slides = []
        for number, span in self._spans() if self._run.carried is not None else []:
            tips = np.array([self._tips[sample][:2] for sample in span])
            pair, moved = self._geometry.pairs[number], float(np.ptp(tips, axis=0).max())
            slides.append(Worst(moved, f"{self._sampled.where(span[-1])}, {pair}"))
        return greatest(slides, "no held body touches anything")

    def _spans(self) -> Iterator[tuple[int, list[int]]]:
        """Each contact: its pair and the samples, one after the other, that it lasts."""
        for number, samples in self._touches.items():
            for span in np.split(samples, np.flatnonzero(np.diff(samples) > 1) + 1):
                yield number, span.tolist()

    def _is_in_turn(self, pair: Pair, first: int, last: int) -> bool:
        """Whether a contact from one sample to another is one of those allowed on purpose."""
        run, end = self._run, len(self._sampled.qs) - 1
        if run.carried is not None:
            return first == 0 or (last == end and run.is_put_down)
        move_first, move_last = self._sampled.moves[[first, last]].tolist()
        is_leaving = pair.body == run.released and move_last == 0
        is_coming = pair.body == run.wanted and move_first == len(run.moves) - 1
        return is_leaving or is_coming


def _sampled(run: Run, reach_m: Vector, travel_m: float) -> Sampled:
    parts = list(_moves(run, reach_m, travel_m))
    qs = np.concatenate([q for _, _, q in parts])
    turned = np.abs(np.diff(qs, axis=0, prepend=qs[:1]))
    labels = tuple(label for label, times, _ in parts for _ in times)
    numbers = np.concatenate([np.full(len(q), number) for number, (_, _, q) in enumerate(parts)])
    return Sampled(
        qs, turned @ reach_m, numbers, labels, np.concatenate([times for _, times, _ in parts])
    )


def _moves(run: Run, reach_m: Vector, travel_m: float) -> Iterator[tuple[str, Vector, Vector]]:
    """Label, times and configurations of each move."""
    for move in run.moves:
        cubics = Cubics(move.trajectory)
        fastest = float(np.abs(cubics.critical_states().v).max(axis=0) @ reach_m)
        count = 2 + int(min(MOST_SAMPLES, 2 * cubics.duration_s * fastest / travel_m))
        grid = np.linspace(0.0, cubics.duration_s, count)
        times = np.union1d(grid, cubics.turning_times())
        q = cubics.positions(times)
        kept = _thinned(np.abs(np.diff(q, axis=0)) @ reach_m, travel_m)
        yield move.label, times[kept], q[kept]


def _thinned(travels_m: Vector, travel_m: float) -> Indices:
    """Numbers of the samples to keep, first and last among them, so that travels add up to less."""
    kept, since = [0], 0.0
    for sample, travel in enumerate(travels_m.tolist(), start=1):
        if since + travel > travel_m and since > 0.0:
            kept.append(sample - 1)
            since = 0.0
        since += travel
    return np.array([*kept, len(travels_m)]) if len(travels_m) else np.array(kept)
