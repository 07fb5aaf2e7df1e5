"""Finger travel: proof that fingers which open or close while the arm rests are clear.

While the fingers travel, shapes slide at constant speed along the closing axis: those of a finger
with it, and a body that a finger pushes. So the gap along any direction changes linearly, too, and
rows of separation need no bound on the sag between their ends
(`planner.collision.proof`).

A closing hand has two intervals. In the first, the body stands still between the fingers. In the
second, one finger pushes it until the other touches it (`planner.grasping.grasp`). The fall of a
body that is released a little above its support, of at most `MAX_DROP_M`, is not part of the proof;
the distance of the fingers from it before and after is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pinocchio as pin

from baxter_kin.validation import FloatArray, Indices
from planner.clearance import ContinuousContact, ContinuousProof, ContinuousResult
from planner.collision.proof import Arrangement, Motion
from planner.collision.shape_pairs import ShapePairsBuilder
from planner.grasping.grasp import Grasp
from planner.manipulator import Manipulator
from planner.prover.problem import Chain
from planner.scene.bodies import Scene
from planner.scene.contact import PartContact, part_contacts

FINGER_SPEED_M_S = 0.05
"""Speed of each finger: the whole stroke of 20.8 mm takes 0.42 s. The URDF's 5 m/s is a placeholder
that no hand of this size reaches; Rethink publishes no speed for the force-limited default."""

MIN_PUSH_M = 1e-9
"""Smallest push; below it both pads touch the body at once."""


@dataclass(frozen=True, slots=True, eq=False)
class FingerTravel:
    """One interval of the fingers' travel.

    Attributes:
        scene: all bodies; they stand still, except for a pushed one.
        begin_m: finger position at the beginning, 0 .. stroke.
        end_m: finger position at the end.
        touchable: name of the body that the pads may press on.
        pushed_m: distance that a finger pushes that body along y of the tip.
        supports: the contacts that the pushed body may have.
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
    """The intervals of a hand that closes from an opening on a body, given by its name."""
    touch_m = min(opening_m, grasp.finger_m + abs(grasp.push_m))  # pads may press from the start
    free = FingerTravel(scene, opening_m, touch_m, name)
    if abs(grasp.push_m) <= MIN_PUSH_M:
        return (free,)
    supports = part_contacts(scene[name], scene)
    return free, FingerTravel(scene, touch_m, grasp.finger_m, name, grasp.push_m, supports)


class TravelCheck:
    """The shapes of one interval, and the pairs whose distance changes with the fingers."""

    def __init__(self, manipulator: Manipulator, travel: FingerTravel) -> None:
        """Build the geometry.

        Args:
            manipulator: the arm, its hand, and the positions of all other joints.
            travel: the interval.
        """
        self._manipulator, self._travel = manipulator, travel
        shapes, arm = manipulator.shapes, manipulator.arm
        pairs, supports = ShapePairsBuilder(shapes, arm), travel.supports
        bodies = pairs.add_scene(travel.scene, travel.touchable, may_press=True, supports=supports)
        self._scene = [index for added in bodies.values() for index in added]
        pushed = bodies.pop(travel.touchable) if travel.touchable and travel.pushed_m else []
        for index in pushed:
            pairs.pair_with_all(index, shapes.wholes - shapes.of_arm(arm), bodies, supports)
        self._slides_m = np.zeros(len(pairs.link_shapes))
        for finger, sign in zip(shapes.of_fingers(arm), (1.0, -1.0), strict=True):
            self._slides_m[list(finger)] = sign * (travel.end_m - travel.begin_m)
        self._slides_m[pushed] = travel.pushed_m
        slides = np.zeros(len(pairs.link_shapes), np.intp)
        for track, finger in enumerate(shapes.of_fingers(arm), start=1):
            slides[list(finger)] = track
        slides[pushed] = 1 if travel.pushed_m < 0.0 else 2  # with the finger that pushes
        self._levels = np.where(slides > 0, 1, 0)
        self._checked = pairs.build()
        first, second = slides[self._checked.pairs].T
        self._nearing: Indices = np.flatnonzero(first != second)

    def at(self, q: FloatArray, margin_m: float) -> ContinuousResult:
        """A proof for an arm that rests at `q`, shape (7,), rad, or what prevents it."""
        T_base_tip = self._manipulator.arm.T_base_tip(q)
        return self._result(self._poses(q), T_base_tip, margin_m, self._nearing)

    def contact_above(self, T_base_tip: pin.SE3, margin_m: float) -> ContinuousContact | None:
        """The contact of a hand alone, its tip at a pose, with the scene's bodies, if there is one.

        The hand is as thick as the shapes of sampled configurations, which are slightly larger than
        the links.
        """
        arm = self._manipulator.arm
        hand = sorted(self._manipulator.shapes.of_hand(arm))
        poses = self._poses(arm.neutral)
        T = T_base_tip.homogeneous @ arm.T_base_tip(arm.neutral).inverse().homogeneous
        poses[hand] = T @ poses[hand]
        shapes = self._checked.pairs[self._nearing]
        pairs = self._nearing[np.isin(shapes, [*hand, *self._scene]).all(axis=1)]
        result = self._result(poses, T_base_tip, margin_m, pairs, self._checked.overshoot_m)
        return result if isinstance(result, ContinuousContact) else None

    def _result(
        self,
        poses: FloatArray,
        T_base_tip: pin.SE3,
        margin_m: float,
        pairs: Indices,
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

        in_level = np.where(self._levels[:, None, None] > 0, np.linalg.inv(T) @ poses, poses)
        arrangement = Arrangement(
            self._checked,
            Chain.of_poses(T[None]),
            self._levels[None],
            in_level[None],
            slides_m=self._slides_m,
            thicker_m=thicker_m,
        )
        return arrangement.prove(Motion(np.zeros(1), duration_s, at), margin_m, pairs)

    def _poses(self, q: FloatArray) -> FloatArray:
        """Poses of all shapes at the beginning, seen from base, shape (n, 4, 4)."""
        robot, geometry = self._manipulator.robot.model, self._checked.geometry
        data, placed = robot.createData(), geometry.createData()
        full = next(self._manipulator.configurations(q[None], self._travel.begin_m))
        pin.updateGeometryPlacements(robot, data, geometry, placed, full)
        return np.array([T.homogeneous for T in placed.oMg])


@lru_cache(maxsize=16)
def travel_check(manipulator: Manipulator, travel: FingerTravel) -> TravelCheck:
    """The check of an interval, made once for the hand alone and for the arm."""
    return TravelCheck(manipulator, travel)


def prove_travel(
    manipulator: Manipulator,
    travels: Sequence[FingerTravel],
    q: FloatArray,
    *,
    margin_m: float = 0.0,
) -> ContinuousResult:
    """A proof that the fingers' whole travel is clear, or the contact that prevents it.

    Args:
        manipulator: the arm, its hand, and the positions of all other joints.
        travels: the intervals, at least one.
        q: configuration of the arm, shape (7,), rad.
        margin_m: distance that all pairs must keep, except those of the hand and the grasped body.
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
