"""Distances along a stage of the story: moves of the arm, or fingers that close or open.

Each step of the plan gets its own least distance, so that what it states of itself can be compared.
Contacts on purpose are left out of it, but only where they are meant: of the fingers with a body on
the straight line right before they close on it, while they close, hold and open, and on the
straight line right after; of a held body with what it stands on, from when it is taken and until it
is put down. Anywhere else the same shapes must be apart like all others.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from planner.clearance import Clearance
from planner.plan import Grip, Move
from planner.scene.bodies import Scene
from planner.verification.body.distances import SolidDistances, SolidPair
from planner.verification.body.enclosed import is_enclosed
from planner.verification.body.nearest import FARTHEST_M, Nearest, all_touching, is_farther, nearest
from planner.verification.body.pressing import depth_m
from planner.verification.body.stretch import IN_HAND, Section, Stretch
from planner.verification.body.stretches import TRAVELS_M, Stretches
from planner.verification.certificate import Worst, greatest, least
from planner.verification.story import FingerMove, Stage
from planner.verification.tolerances import Tolerances
from planner.verification.urdf_robot import UrdfRobot


@dataclass(frozen=True, slots=True)
class StepFound:
    """The least distance of one step.

    Attributes:
        step: the move or gripper action.
        least: at samples.
        proven: what it is at least in between.
        counted: at samples, of the pairs that a plan's own statements count.
        stated: how much more the move states to have measured, at the moment that it names, than
            there is.
    """

    step: Move | Grip
    least: Worst
    proven: Worst
    counted: Worst
    stated: Worst | None = None

    def is_open(self, clearance_m: float) -> bool:
        """Whether samples keep a clearance, but what is between them is not proven to."""
        return self.proven.value <= clearance_m < self.least.value


@dataclass(frozen=True, slots=True)
class FoundDistance:
    """What was found along one stage.

    Attributes:
        steps: the least distances of pairs that must not touch.
        press: how deep an allowed contact presses.
        slide: how far a held body moves sideways while it touches what it may touch.
        astray: how many contacts are made out of turn.
        enclosed: how many things are inside a link where the stage begins.
        samples: configurations that were looked at.
    """

    steps: tuple[StepFound, ...]
    press: Worst
    slide: Worst
    astray: Worst
    enclosed: Worst
    samples: int


def survey(
    stage: Stage, stretches: Stretches, robot: UrdfRobot, allowed: Tolerances
) -> FoundDistance | None:
    """Measure along a stage; None for a run without moves."""
    if isinstance(stage, FingerMove):
        stretch = stretches.of_travel(stage)
        return _Survey(robot, stretch, stretches.pairs_of_travel(stage, stretch), allowed).found()
    if not stage.moves:
        return None
    for travel_m in TRAVELS_M:
        stretch = stretches.of_run(stage, travel_m)
        survey_ = _Survey(robot, stretch, stretches.pairs_of_run(stage, stretch), allowed)
        found = survey_.found()
        if not any(step.is_open(allowed.clearance_m) for step in found.steps):
            break
    return found


def survey_rest(
    scene: Scene, stretches: Stretches, robot: UrdfRobot, allowed: Tolerances
) -> tuple[Worst, Worst]:
    """The least distance of what the arm does not move, and how many bodies are inside of it."""
    stretch = stretches.of_rest(scene)
    survey_ = _Survey(robot, stretch, stretches.pairs_of_rest(stretch), allowed)
    return survey_.at_start(), survey_.enclosed()


class _Survey:
    """One stage."""

    def __init__(
        self, robot: UrdfRobot, stretch: Stretch, pairs: list[SolidPair], allowed: Tolerances
    ) -> None:
        self._robot, self._stretch, self._allowed = robot, stretch, allowed
        self._pairs = pairs
        self._distances = SolidDistances(robot, stretch, pairs)
        self._press = Worst(0.0, "no allowed contact presses")
        self._slides: list[Worst] = []
        self._astray: list[str] = []

    def found(self) -> FoundDistance:
        steps = tuple(self._section(section) for section in self._stretch.sections)
        astray = self._astray
        return FoundDistance(
            steps,
            self._press,
            greatest(self._slides, "no held body touches anything"),
            Worst(len(astray), astray[0] if astray else "no contact out of turn"),
            self.enclosed(),
            len(self._stretch.q),
        )

    def _section(self, section: Section) -> StepFound:
        touching = [i for i, pair in enumerate(self._pairs) if self._may_touch(section, pair, i)]
        apart = sorted(set(range(len(self._pairs))) - set(touching))
        found, near = nearest(
            self._distances, apart, section.first, section.last, self._allowed.contact_m
        )
        for number, samples in near.items():
            if self._has_turn(number):
                where = self._stretch.where(section, min(samples))
                self._astray.append(f"{where}, {self._pairs[number]}")
        self._contacts(section, touching)
        counted = [number for number in apart if self._pairs[number].is_stated]
        nearest_counted = found
        if found.pair >= 0 and not self._pairs[found.pair].is_stated:
            nearest_counted, _ = nearest(self._distances, counted, section.first, section.last)
        return StepFound(
            section.step,
            self._worst(section, found, found.least_m),
            self._worst(section, found, found.proven_m),
            self._worst(section, nearest_counted, nearest_counted.least_m),
            self._stated(section, counted),
        )

    def _stated(self, section: Section, apart: list[int]) -> Worst | None:
        """A stated distance against the one at the last sample before its moment.

        Since then nothing came nearer by more than the travel between two samples.
        """
        step = section.step
        if isinstance(step, Grip):
            return None
        named = [step.clearance, None if step.proof is None else step.proof.nearest]
        excess = [self._excess(section, near, apart) for near in named if near is not None]
        return greatest(excess, "nothing is stated") if excess else None

    def _excess(self, section: Section, near: Clearance, apart: list[int]) -> Worst:
        times = self._stretch.at[section.first : section.last + 1]
        after = int(np.searchsorted(times, near.time_s or 0.0, side="right"))
        sample, wanted = section.first + max(0, after - 1), near.distance_m - TRAVELS_M[0]
        found = is_farther(self._distances, apart, sample, sample, wanted)
        where = f"{1e3 * near.distance_m:.3f} mm stated, {1e3 * found.least_m:.3f} mm measured"
        return Worst(wanted - found.least_m, f"{self._stretch.where(section, sample)}: {where}")

    def _worst(self, section: Section, found: Nearest, value: float) -> Worst:
        """A distance, with where the nearest pair is."""
        if found.pair < 0:
            return Worst(value, f"{section.step.label}, nothing within {FARTHEST_M:g} m")
        return Worst(
            value, f"{self._stretch.where(section, found.sample)}, {self._pairs[found.pair]}"
        )

    def _has_turn(self, number: int) -> bool:
        """Whether a contact on purpose of that pair is part of the stage."""
        pair, sections = self._pairs[number], self._stretch.sections
        if pair.body is None or pair.first.joint != IN_HAND:
            return pair.body is not None
        return any(self._may_touch(section, pair, number) for section in sections)

    def _may_touch(self, section: Section, pair: SolidPair, number: int) -> bool:
        if pair.body is None:
            return False
        if pair.first.joint != IN_HAND:
            return pair.body in section.touched
        near_m = self._allowed.press_m
        ends = [section.first] * section.is_taken + [section.last] * section.is_put_down
        return any(self._distances.shapes_apart(number, end, 2 * near_m) <= near_m for end in ends)

    def _contacts(self, section: Section, numbers: list[int]) -> None:
        """Depth, slide and turn of every allowed contact."""
        found = all_touching(
            self._distances, numbers, section.first, section.last, self._allowed.contact_m
        )
        for number, distances in found.items():
            pair = self._pairs[number]
            for sample in (s for s, distance in sorted(distances.items()) if distance <= 0.0):
                self._measure_press(section, pair, sample)
            if pair.first.joint == IN_HAND:
                for first, last in _spans(sorted(distances)):
                    self._held_contact(section, pair, first, last)

    def _measure_press(self, section: Section, pair: SolidPair, sample: int) -> None:
        poses = [self._distances.pose(solid, sample) for solid in (pair.first, pair.second)]
        axes = self._distances.tip_base(sample).rotation
        depth = depth_m(
            pair.first, poses[0], pair.second, poses[1], axes, known_m=self._press.value
        )
        if depth > self._press.value:
            self._press = Worst(depth, f"{self._stretch.where(section, sample)}, {pair}")

    def _held_contact(self, section: Section, pair: SolidPair, first: int, last: int) -> None:
        """One contact of a held body with what it stands on: it lasts from or to an end."""
        if isinstance(section.step, Grip):  # it is pushed along its support
            return
        is_in_turn = (section.is_taken and first == section.first) or (
            section.is_put_down and last == section.last
        )
        if not is_in_turn:
            self._astray.append(f"{self._stretch.where(section, first)}, {pair}")
        tips = [self._distances.tip_base(s).translation[:2] for s in range(first, last + 1)]
        slide = float(np.ptp(np.array(tips), axis=0).max())
        self._slides.append(Worst(slide, f"{self._stretch.where(section, last)}, {pair}"))

    def at_start(self) -> Worst:
        """The least distance of all pairs at the first sample."""
        found, _ = nearest(self._distances, list(range(len(self._pairs))), 0, 0)
        where = str(self._pairs[found.pair]) if found.pair >= 0 else "nothing near"
        return Worst(found.least_m, where)

    def enclosed(self) -> Worst:
        """Bodies inside links at the first sample."""
        inside = [str(pair) for pair in self._pairs if self._is_either_enclosed(pair)]
        return Worst(len(inside), inside[0] if inside else "nothing inside a link")

    def _is_either_enclosed(self, pair: SolidPair) -> bool:
        """Between the robot and a body; links of one robot do not fit into each other."""
        bodies = {id(solid) for solid in (*self._stretch.still, *self._stretch.held)}
        both = sorted((pair.first, pair.second), key=lambda solid: id(solid) in bodies)
        link, thing = both
        if id(thing) not in bodies or id(link) in bodies:
            return False
        T_thing, T_link = (self._distances.pose(s, 0) for s in (thing, link))
        return is_enclosed(thing, T_thing, link, T_link)


def _spans(samples: list[int]) -> Iterator[tuple[int, int]]:
    """First and last of each row of samples without a gap."""
    for span in np.split(samples, np.flatnonzero(np.diff(samples) > 1) + 1):
        yield int(span[0]), int(span[-1])


def least_of(found: list[StepFound], none: str) -> tuple[Worst, Worst]:
    """The least distances of several steps, at samples and in between."""
    return least((f.least for f in found), none), least((f.proven for f in found), none)
