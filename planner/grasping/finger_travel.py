"""Finger travel: both fingers open or close while the arm stands, proven clear on the whole way.

On a way of the fingers a shape moves along the closing axis by at most as far as the finger that it
is part of, or that pushes it; seen from a shape that the other finger moves, by twice as much. So a
pair keeps a distance above d - s on a stretch in whose middle its distance is d, when s bounds that
motion over half the stretch; stretches are halved where that is not enough
(`planner.collision.continuous.proof`).

A closing hand goes two stretches. On the first the body stands between the fingers, as it is found.
On the second one finger pushes it along, until the other meets it (`planner.grasping.grasp`). What
a body does when it is let go a little above its support, at most `LONGEST_DROP_M` of fall, is not
part of the proof; that the fingers are clear of it before and after is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pinocchio as pin

from baxter_kin.validation import FloatArray, Indices
from planner.clearance import ContinuousContact, ContinuousProof, ContinuousResult
from planner.collision.continuous.motion import Around
from planner.collision.continuous.proof import contact_of, prove_motion
from planner.collision.shape_pairs import CheckedPairs, ShapePairs
from planner.grasping.grasp import Grasp
from planner.manipulator import Manipulator
from planner.scene.bodies import Scene
from planner.scene.contact import PartContact, part_contacts

FINGER_SPEED_M_S = 0.05
"""Speed of each finger: the whole stroke of 20.8 mm takes 0.42 s. The URDF's 5 m/s is a placeholder
that no hand of this size reaches; Rethink gives no figure for the force-limited default."""

SHORTEST_S = 1e-9
"""A travel of no length is divided by this duration."""

NO_PUSH_M = 1e-9
"""A body pushed by less was not; both pads touch it at once."""


@dataclass(frozen=True, slots=True, eq=False)
class FingerTravel:
    """One stretch of the fingers' way.

    Attributes:
        scene: the bodies that stand still meanwhile.
        begin_m: finger position where it begins, 0 .. stroke.
        end_m: finger position where it ends.
        touchable: name of the body that the pads may press on.
        pushed_m: how far a finger pushes that body along y of the tip meanwhile.
        supports: what that body may touch then.
    """

    scene: Scene
    begin_m: float
    end_m: float
    touchable: str | None = None
    pushed_m: float = 0.0
    supports: frozenset[PartContact] = frozenset()


def closing_travel(
    scene: Scene, name: str, opening_m: float, grasp: Grasp
) -> tuple[FingerTravel, ...]:
    """The stretches on which a hand that is so far open closes on a body, by its name."""
    touch_m = min(opening_m, grasp.finger_m + abs(grasp.push_m))  # may begin pressed in a little
    coming = FingerTravel(scene, opening_m, touch_m, name)
    if abs(grasp.push_m) <= NO_PUSH_M:
        return (coming,)
    supports = part_contacts(scene[name], scene)
    return coming, FingerTravel(scene, touch_m, grasp.finger_m, name, grasp.push_m, supports)


class TravelCheck:
    """The shapes of one stretch, and the pairs of them that the fingers bring nearer."""

    def __init__(self, manipulator: Manipulator, travel: FingerTravel) -> None:
        """Build the geometry.

        Args:
            manipulator: the arm, its hand, and where all other joints stand.
            travel: the stretch.
        """
        self._manipulator, self._travel = manipulator, travel
        shapes, arm = manipulator.shapes, manipulator.arm
        pairs, supports = ShapePairs(shapes, arm), travel.supports
        bodies = pairs.add_scene(travel.scene, travel.touchable, may_press=True, supports=supports)
        self._scene = [index for added in bodies.values() for index in added]
        self._pushed = bodies.pop(travel.touchable) if travel.touchable and travel.pushed_m else []
        signs = np.zeros(len(pairs.made))
        for finger, sign in zip(shapes.of_fingers(arm), (1.0, -1.0), strict=True):
            signs[list(finger)] = sign
        signs[self._pushed] = -np.sign(travel.pushed_m)
        for index in self._pushed:
            pairs.pair_with_all(index, shapes.wholes - shapes.of_arm(arm), bodies, supports)
        self._checked = pairs.built()
        first, second = self._checked.numbers.T
        self._rates = np.abs(signs[first] - signs[second])

    def at(self, q: FloatArray, margin_m: float) -> ContinuousResult:
        """A proof for an arm that stands at `q`, shape (7,), rad, or what speaks against it."""
        motion = self._motion(self._poses(q), self._manipulator.arm.T_base_tip(q))
        return prove_motion(self._checked, motion, margin_m, np.flatnonzero(self._rates > 0.0))

    def contact_above(self, T_base_tip: pin.SE3, margin_m: float) -> ContinuousContact | None:
        """What speaks against it for a hand alone whose tip is there, among the scene's bodies."""
        arm = self._manipulator.arm
        hand = sorted(self._manipulator.shapes.of_hand(arm))
        poses = self._poses(arm.neutral)
        T = T_base_tip.homogeneous @ arm.T_base_tip(arm.neutral).inverse().homogeneous
        poses[:, hand] = T @ poses[:, hand]
        counts = np.isin(self._checked.numbers, [*hand, *self._scene]).all(axis=1)
        motion, counts = self._motion(poses, T_base_tip), counts & (self._rates > 0.0)
        return contact_of(self._checked, motion, margin_m, np.flatnonzero(counts))

    def _motion(self, poses: FloatArray, T_base_tip: pin.SE3) -> _FingerMotion:
        travel = self._travel
        poses[1, self._pushed, :3, 3] += travel.pushed_m * T_base_tip.rotation[:, 1]
        length_m = max(abs(travel.end_m - travel.begin_m), abs(travel.pushed_m))
        return _FingerMotion(poses, length_m, self._rates, self._checked)

    def _poses(self, q: FloatArray) -> FloatArray:
        """Poses of all shapes with the fingers where they begin and end, shape (2, n, 4, 4)."""
        robot, geometry = self._manipulator.robot.model, self._checked.geometry
        data, placed = robot.createData(), geometry.createData()
        poses = np.empty((2, geometry.ngeoms, 4, 4))
        for number, finger_m in enumerate((self._travel.begin_m, self._travel.end_m)):
            full = next(self._manipulator.configurations(q[None], finger_m))
            pin.updateGeometryPlacements(robot, data, geometry, placed, full)
            poses[number] = [T.homogeneous for T in placed.oMg]
        return poses


@lru_cache(maxsize=16)
def travel_check(manipulator: Manipulator, travel: FingerTravel) -> TravelCheck:
    """Made once: what is looked at for the hand alone is proven for the arm afterwards."""
    return TravelCheck(manipulator, travel)


@dataclass(frozen=True, slots=True, eq=False)
class _FingerMotion:
    """Shapes that slide along the closing axis at one speed.

    Attributes:
        ends: poses of all shapes at the begin and at the end, shape (2, n, 4, 4).
        length_m: how far a finger goes.
        rates: how fast each pair comes nearer at most, per speed of a finger, shape (pairs,).
        checked: the pairs.
    """

    ends: FloatArray
    length_m: float
    rates: FloatArray
    checked: CheckedPairs

    @property
    def duration_s(self) -> float:
        """With a finger that goes at `FINGER_SPEED_M_S`."""
        return self.length_m / FINGER_SPEED_M_S

    def around(self, starts_s: FloatArray, ends_s: FloatArray) -> Around:
        """By interpolation."""
        shares = (starts_s + ends_s)[:, None, None] / (2 * max(self.duration_s, SHORTEST_S))
        poses = np.repeat(self.ends[:1], len(starts_s), axis=0)
        poses[..., :3, 3] += shares * (self.ends[1] - self.ends[0])[..., :3, 3]
        travels = FINGER_SPEED_M_S * (ends_s - starts_s) / 2

        def gaps_m(interval: Indices, pair: Indices) -> FloatArray:
            return self.checked.gaps_m(poses, interval, pair)

        def motions_m(interval: Indices, pair: Indices) -> FloatArray:
            moved: FloatArray = travels[interval] * self.rates[pair]
            return moved

        return Around(poses, gaps_m, motions_m)


def prove_travel(
    manipulator: Manipulator,
    travels: Sequence[FingerTravel],
    q: FloatArray,
    *,
    margin_m: float = 0.0,
) -> ContinuousResult:
    """A proof that the fingers' whole way is clear, stretch by stretch, or what speaks against it.

    Args:
        manipulator: the arm, its hand, and where all other joints stand.
        travels: the stretches, at least one.
        q: where the arm stands, shape (7,), rad.
        margin_m: distance that every pair shall keep, all but those of hand and grasped body.
    """
    results = (travel_check(manipulator, travel).at(q, margin_m) for travel in travels)
    proofs = []
    for result in results:
        if isinstance(result, ContinuousContact):
            return result
        proofs.append(result)
    nearest = min((proof.nearest for proof in proofs), key=lambda near: near.distance_m)
    return ContinuousProof(
        min(proof.proven_m for proof in proofs),
        nearest,
        proofs[0].margin_m,
        sum(proof.intervals for proof in proofs),
        sum(proof.evaluations for proof in proofs),
    )
