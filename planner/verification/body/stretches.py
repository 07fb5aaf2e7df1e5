"""A stage of the story as a stretch: its samples, its shapes, and the pairs that are checked.

What is rigid to each other during the stage is left out: what stands still with what stands still,
and the hand with what it holds. A contact is possible on purpose between the fingers and a body
that is grasped or released, and between a held body and what it stands on.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from itertools import combinations, product

import numpy as np

from baxter_kin.validation import FloatArray
from planner.plan import GripperAction
from planner.scene.bodies import Body, Scene
from planner.verification.body import links
from planner.verification.body.distances import SolidPair
from planner.verification.body.solid import Solid, solids_of
from planner.verification.body.stretch import (
    FINGER,
    IN_HAND,
    PUSH,
    Section,
    Stretch,
    arm_level,
    lever_arms,
)
from planner.verification.motion.cubics import Cubics
from planner.verification.motion.sampled_path import SampledPath, sampled_path
from planner.verification.story import Carried, FingerMove, Run
from planner.verification.urdf_robot import UrdfRobot

TRAVELS_M = (1e-3, 1e-4)
"""Bounds on the travel of anything between two samples; the next where one leaves open whether
things touch."""

PUSHED_M = 1e-9
"""A body that is pushed by less is not; both pads touch it at once."""

FINGER_STEP_M = 1e-4
"""The same for fingers that close and open, and what they push."""

MOST_SAMPLES = 100_000
"""Samples of one move; a way so long that this is not dense enough stays unproven."""


class Stretches:
    """Makes stretches of one robot's stages."""

    def __init__(
        self,
        robot: UrdfRobot,
        solids: Iterable[Solid],
        q_standing: FloatArray,
        elsewhere: Iterable[Body],
        straight: Collection[str],
    ) -> None:
        self._robot, self._q_standing, self._straight = robot, q_standing, straight
        self._elsewhere = tuple(_placed(elsewhere))
        self._pairs = links.OwnPairs(robot.model, robot.stock, robot.reshaped)
        everything = list(solids)
        self._arm = [s for s in everything if arm_level(robot, s.joint)]
        self.rest = [s for s in everything if not arm_level(robot, s.joint)]
        self._fingers = [s for s in self._arm if s.joint in robot.fingers]
        self._palm = [s for s in self._arm if s.joint == robot.wrist]
        self._inner = [s for s in self._arm if s.joint not in {robot.wrist, *robot.fingers}]
        among = [*product(self._arm, self.rest), *combinations(self._arm, 2)]
        self._own = [SolidPair(a, b) for a, b in among if self._pairs.is_checked(a, b)]

    def of_run(self, run: Run, travel_m: float) -> Stretch:
        """The samples of moves, of which there is one at least."""
        held = _held(run.carried)
        arms = [lever_arms(self._robot, solid) for solid in (*self._arm, *held)]
        reach_m = np.max(arms, axis=0)[:FINGER]
        paths = [
            sampled_path(Cubics(move.trajectory), reach_m, travel_m, MOST_SAMPLES)
            for move in run.moves
        ]
        qs = np.concatenate([path.q for path in paths])
        turned = np.concatenate([path.turned for path in paths])
        gone = np.pad(np.cumsum(turned, axis=0), ((0, 0), (0, PUSH + 1 - FINGER)))
        return Stretch(
            self._robot.configurations(self._q_standing, qs, run.finger_m),
            gone,
            np.zeros(len(qs)),
            np.concatenate([path.times_s for path in paths]),
            tuple(self._sections(run, paths)),
            (*_placed(run.scene), *self._elsewhere),
            held,
        )

    def _sections(self, run: Run, paths: list[SampledPath]) -> Iterator[Section]:
        """Fingers may touch a body on the straight line right before they close on it, or after."""
        begin, last = 0, len(paths) - 1
        for number, (move, path) in enumerate(zip(run.moves, paths, strict=True)):
            names = {
                run.released if number == 0 else None,
                run.wanted if number == last else None,
            } - {None}
            is_line = move.is_straight or move.label in self._straight
            yield Section(
                move,
                begin,
                begin + len(path.times_s) - 1,
                frozenset(str(name) for name in names) if is_line else frozenset(),
                is_taken=run.carried is not None and number == 0,
                is_put_down=run.is_put_down and number == last,
            )
            begin += len(path.times_s)

    def pairs_of_run(self, run: Run, stretch: Stretch) -> list[SolidPair]:
        """All that are checked."""
        near = {run.released, run.wanted} - {None}
        found = list(self._own)
        for link, solid in product(self._arm, stretch.still):
            is_near = solid.name in near
            is_touched = is_near and link in self._fingers
            is_stated = not (is_near and link in self._palm)
            found.append(SolidPair(link, solid, solid.name if is_touched else None, is_stated))
        found += [
            SolidPair(part, link) for part, link in product(stretch.held, self.rest + self._inner)
        ]
        found += [
            SolidPair(h, solid, solid.name) for h, solid in product(stretch.held, stretch.still)
        ]
        return found

    def of_rest(self, scene: Scene) -> Stretch:
        """The one sample of what the arm does not move."""
        still = (*_placed(scene), *self._elsewhere)
        one = np.zeros(1)
        gone = np.zeros((1, PUSH + 1))
        return Stretch(self._q_standing[None], gone, one, one, (), still)

    def pairs_of_rest(self, stretch: Stretch) -> list[SolidPair]:
        """The head and the other arm, with everything but the arm that moves."""
        jointed = [solid for solid in self.rest if solid.joint]
        among = combinations(self.rest, 2)
        found = [SolidPair(a, b) for a, b in among if self._pairs.is_checked(a, b)]
        in_hand = {body.name for body in self._elsewhere}
        hand = set(self._robot.other_hand)
        for link, solid in product(jointed, stretch.still):
            if not (link.joint in hand and solid.name in in_hand):
                found.append(SolidPair(link, solid))
        return found

    def of_travel(self, travel: FingerMove) -> Stretch:
        """The samples of fingers that close or open."""
        ways = [(travel.begin_m, travel.touch_m, 0.0, 0.0)]
        ways += [(travel.touch_m, travel.end_m, 0.0, travel.push_m)]
        fingers, pushed = (np.concatenate(x) for x in zip(*map(_steps, ways), strict=True))
        count = len(fingers)
        gone = np.zeros((count, PUSH + 1))
        gone[:, FINGER] = np.cumsum(np.abs(np.diff(fingers, prepend=fingers[:1])))
        gone[:, PUSH] = np.cumsum(np.abs(np.diff(pushed, prepend=pushed[:1])))
        between = travel.between
        name = frozenset() if between is None else frozenset([between.body.name])
        q = self._robot.finger_configurations(self._q_standing, travel.q_arm, fingers)
        section = Section(travel.grip, 0, count - 1, name, is_taken=True)
        still = (*_placed(travel.scene), *self._elsewhere)
        return Stretch(q, gone, pushed, fingers, (section,), still, _held(between))

    def pairs_of_travel(self, travel: FingerMove, stretch: Stretch) -> list[SolidPair]:
        """Fingers with everything; what they push too; the palm with what they close on."""
        among = product(self._fingers, self.rest + self._inner)
        found = [SolidPair(a, b) for a, b in among if self._pairs.is_checked(a, b)]
        found += [
            SolidPair(finger, solid) for finger, solid in product(self._fingers, stretch.still)
        ]
        held = stretch.held
        found += [SolidPair(f, part, part.name) for f, part in product(self._fingers, held)]
        if travel.grip.action is GripperAction.CLOSE:
            among = product(held, self._palm)
            found += [SolidPair(part, palm, is_stated=False) for part, palm in among]
        if abs(travel.push_m) > PUSHED_M:
            links_ = self.rest + self._inner
            found += [SolidPair(part, link) for part, link in product(held, links_)]
            found += [
                SolidPair(part, solid, solid.name) for part, solid in product(held, stretch.still)
            ]
        return found


def _placed(bodies: Iterable[Body]) -> list[Solid]:
    return [solid for body in bodies for solid in solids_of(body, 0, body.T_base_body)]


def _held(carried: Carried | None) -> tuple[Solid, ...]:
    if carried is None:
        return ()
    return tuple(solids_of(carried.body, IN_HAND, carried.T_tip_body))


def _steps(way: tuple[float, float, float, float]) -> tuple[FloatArray, FloatArray]:
    """Finger positions and pushes from one to another, in small steps."""
    finger_begin, finger_end, push_begin, push_end = way
    longest = max(abs(finger_end - finger_begin), abs(push_end - push_begin))
    count = 1 + int(np.ceil(longest / FINGER_STEP_M))
    return (
        np.linspace(finger_begin, finger_end, count),
        np.linspace(push_begin, push_end, count),
    )
