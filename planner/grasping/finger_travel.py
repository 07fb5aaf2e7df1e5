"""Finger travel: both fingers open or close while the arm stands, proven clear on the whole way.

On a way of the fingers shapes slide evenly along the closing axis: those of a finger as far as it
goes, and a body as far as a finger pushes it. So the gap along any direction changes evenly, too,
and rows of separation need no bound on what happens between their ends
(`planner.collision.continuous.proof`).

A closing hand goes two stretches. On the first the body stands between the fingers, as it is found.
On the second one finger pushes it along, until the other meets it (`planner.grasping.grasp`). What
a body does when it is let go a little above its support, at most `MAX_DROP_M` of fall, is not
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
from planner.collision.continuous.proof import Arrangement, Motion
from planner.collision.shape_pairs import ShapePairs
from planner.grasping.grasp import Grasp
from planner.manipulator import Manipulator
from planner.prover.problem import Chain
from planner.scene.bodies import Scene
from planner.scene.contact import PartContact, part_contacts

FINGER_SPEED_M_S = 0.05
"""Speed of each finger: the whole stroke of 20.8 mm takes 0.42 s. The URDF's 5 m/s is a placeholder
that no hand of this size reaches; Rethink gives no figure for the force-limited default."""

MIN_PUSH_M = 1e-9
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
    if abs(grasp.push_m) <= MIN_PUSH_M:
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
        pushed = bodies.pop(travel.touchable) if travel.touchable and travel.pushed_m else []
        for index in pushed:
            pairs.pair_with_all(index, shapes.wholes - shapes.of_arm(arm), bodies, supports)
        self._slides_m = np.zeros(len(pairs.made))
        for finger, sign in zip(shapes.of_fingers(arm), (1.0, -1.0), strict=True):
            self._slides_m[list(finger)] = sign * (travel.end_m - travel.begin_m)
        self._slides_m[pushed] = travel.pushed_m
        slides = np.zeros(len(pairs.made), np.intp)
        for number, finger in enumerate(shapes.of_fingers(arm)):
            slides[list(finger)] = number + 1
        slides[pushed] = 1 if travel.pushed_m < 0.0 else 2  # with the finger that pushes it
        self._levels = np.where(slides > 0, 1, 0)
        self._checked = pairs.built()
        first, second = slides[self._checked.numbers].T
        self._nearing: Indices = np.flatnonzero(first != second)

    def at(self, q: FloatArray, margin_m: float) -> ContinuousResult:
        """A proof for an arm that stands at `q`, shape (7,), rad, or what speaks against it."""
        T_base_tip = self._manipulator.arm.T_base_tip(q)
        return self._result(self._poses(q), T_base_tip, margin_m, self._nearing)

    def contact_above(self, T_base_tip: pin.SE3, margin_m: float) -> ContinuousContact | None:
        """What speaks against it for a hand alone whose tip is there, among the scene's bodies.

        The shapes by which configurations are sampled are somewhat larger than the links; they must
        have room as well.
        """
        arm = self._manipulator.arm
        hand = sorted(self._manipulator.shapes.of_hand(arm))
        poses = self._poses(arm.neutral)
        T = T_base_tip.homogeneous @ arm.T_base_tip(arm.neutral).inverse().homogeneous
        poses[hand] = T @ poses[hand]
        is_asked = np.isin(self._checked.numbers[self._nearing], [*hand, *self._scene]).all(axis=1)
        numbers = self._nearing[is_asked]
        result = self._result(poses, T_base_tip, margin_m, numbers, self._checked.outside_m)
        return result if isinstance(result, ContinuousContact) else None

    def _result(
        self,
        poses: FloatArray,
        T_base_tip: pin.SE3,
        margin_m: float,
        numbers: Indices,
        thicker_m: FloatArray | float = 0.0,
    ) -> ContinuousResult:
        travel, T = self._travel, T_base_tip.homogeneous
        duration_s = max(abs(travel.end_m - travel.begin_m), abs(travel.pushed_m))
        duration_s /= FINGER_SPEED_M_S

        def at(time_s: float) -> FloatArray:
            moved = np.array(poses)
            share = time_s / duration_s if duration_s > 0.0 else 0.0
            moved[:, :3, 3] += share * self._slides_m[:, None] * T[:3, 1]
            return moved

        seen = np.where(self._levels[:, None, None] > 0, np.linalg.inv(T) @ poses, poses)
        arrangement = Arrangement(
            self._checked,
            Chain.of_poses(T[None]),
            self._levels[None],
            seen[None],
            slides_m=self._slides_m,
            thicker_m=thicker_m,
        )
        return arrangement.prove(Motion(np.zeros(1), duration_s, at), margin_m, numbers)

    def _poses(self, q: FloatArray) -> FloatArray:
        """Poses of all shapes where the fingers begin, shape (n, 4, 4)."""
        robot, geometry = self._manipulator.robot.model, self._checked.geometry
        data, placed = robot.createData(), geometry.createData()
        full = next(self._manipulator.configurations(q[None], self._travel.begin_m))
        pin.updateGeometryPlacements(robot, data, geometry, placed, full)
        return np.array([T.homogeneous for T in placed.oMg])


@lru_cache(maxsize=16)
def travel_check(manipulator: Manipulator, travel: FingerTravel) -> TravelCheck:
    """Made once: what is looked at for the hand alone is proven for the arm afterwards."""
    return TravelCheck(manipulator, travel)


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
