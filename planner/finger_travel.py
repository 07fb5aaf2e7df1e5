"""Finger travel: both fingers open or close while the arm stands, proven clear on the whole way.

On a way of the fingers a shape moves along the closing axis by at most as far as the finger that it
is part of, or that pushes it; seen from a shape that the other finger moves, by twice as much. So a
pair keeps a distance above d - s on a stretch in whose middle its distance is d, when s bounds that
motion over half the stretch; stretches are halved where that is not enough, as in `planner.swept`.

A closing hand goes two stretches. On the first the body stands between the fingers, as it is found.
On the second one finger pushes it along, until the other finger meets it (`planner.grasp`). What a
body does when it is let go a little above its support, at most `LONGEST_DROP_M` of fall, is not
part of the proof; that the fingers are clear of it before and after is.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import pinocchio as pin

from baxter_kin.arrays import Indices, Vector
from planner.collision import CheckedPairs, Held, ShapePairs
from planner.contact import PRESSING_TOLERANCE_M, touching
from planner.grasp import Grasp
from planner.manipulator import Manipulator
from planner.scene import Scene
from planner.swept import Around, prove_motion
from planner.swept_result import SweptContact, SweptProof, SweptResult

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
        pushed: what a finger pushes along, seen from the tip where the stretch begins.
        pusher: which finger does, 0 for the one on +y of the tip.
    """

    scene: Scene
    begin_m: float
    end_m: float
    touchable: str | None = None
    pushed: Held | None = None
    pusher: int = 0


def closing_travel(
    scene: Scene, name: str, T_base_tip: pin.SE3, opening_m: float, grasp: Grasp
) -> tuple[FingerTravel, ...]:
    """The stretches on which an open hand closes on a body.

    Args:
        scene: all bodies, that one among them.
        name: of the body.
        T_base_tip: where the tip is.
        opening_m: finger position of the open hand.
        grasp: what comes of it.
    """
    touch_m = grasp.finger_m + abs(grasp.push_m)
    coming = FingerTravel(scene, opening_m, touch_m, touchable=name)
    if abs(grasp.push_m) <= NO_PUSH_M:
        return (coming,)
    body = scene[name]
    T_tip_body = T_base_tip.inverse() * body.T_base_body
    pushed = Held(body, T_tip_body, touching(body, scene))
    others = scene.without(name)
    pushing = FingerTravel(
        others, touch_m, grasp.finger_m, pushed=pushed, pusher=int(grasp.push_m > 0.0)
    )
    return coming, pushing


class TravelCheck:
    """The shapes of one stretch, and the pairs of them that come nearer or may."""

    def __init__(self, manipulator: Manipulator, travel: FingerTravel) -> None:
        """Build the geometry.

        Args:
            manipulator: the arm, its hand, and where all other joints stand.
            travel: the stretch.
        """
        self._manipulator, self._travel = manipulator, travel
        shapes, arm = manipulator.shapes, manipulator.arm
        self._pairs = ShapePairs(shapes)
        self._fingers = shapes.of_fingers(arm)
        self._hand, self._pads = shapes.of_hand(arm), shapes.of_pads(arm)
        self._signs = dict.fromkeys(self._fingers[0], 1) | dict.fromkeys(self._fingers[1], -1)
        moving = set(self._signs)
        for first, second in shapes.pairs:
            pair = {first, second}
            if pair & moving and not pair <= self._hand:
                self._pairs.pair(first, second)
        self._of_scene: set[int] = set()
        standing = self._add_scene()
        if travel.pushed is not None:
            self._add_pushed(travel.pushed, standing)
        self._checked = self._pairs.built()
        signs = np.array([self._signs.get(i, 0) for i in range(self._checked.geometry.ngeoms)])
        first, second = self._checked.numbers.T
        self._rates = np.abs(signs[first] - signs[second])

    def at(self, q: Vector, margin_m: float) -> SweptResult:
        """A proof for an arm that stands at `q`, shape (7,), rad, or what speaks against it."""
        return prove_motion(self._checked, self._motion(self._poses(q)), margin_m)

    def above(self, T_base_tip: pin.SE3, margin_m: float) -> SweptResult:
        """The same for a hand alone whose tip is there, among the bodies of the scene."""
        arm = self._manipulator.arm
        poses = self._poses(arm.neutral)
        T = T_base_tip.homogeneous @ arm.T_base_tip(arm.neutral).inverse().homogeneous
        moved = sorted(self._hand | self._signs.keys())
        poses[:, moved] = T @ poses[:, moved]
        is_of_scene = np.isin(self._checked.numbers, sorted(self._of_scene)).any(axis=1)
        among = np.flatnonzero(is_of_scene)
        return prove_motion(self._checked, self._motion(poses), margin_m, among)

    def _motion(self, poses: Vector) -> FingerMotion:
        travel = self._travel
        length_m = abs(travel.end_m - travel.begin_m)
        return FingerMotion(poses, length_m, self._rates, self._checked)

    def _add_scene(self) -> dict[str, list[int]]:
        standing = {}
        shapes = self._manipulator.shapes
        for body in self._travel.scene:
            is_touchable = body.name == self._travel.touchable
            pushed = self._travel.pushed
            in_pieces = is_touchable or (pushed is not None and body.name in pushed.supports)
            added = self._pairs.add(body, 0, body.T_base_body, in_pieces=in_pieces)
            standing[body.name] = added
            self._of_scene.update(added)
            counted = self._signs.keys() & (shapes.details if is_touchable else shapes.wholes)
            for index, finger in product(added, sorted(counted)):
                need_m = self._grasping_need(finger) if is_touchable else None
                self._pairs.pair(finger, index, need_m=need_m)
        return standing

    def _add_pushed(self, pushed: Held, standing: dict[str, list[int]]) -> None:
        """A body that moves with a finger; what it stands on or leans on it may press on."""
        manipulator, travel = self._manipulator, self._travel
        robot, shapes = manipulator.robot.model, manipulator.shapes
        joint = shapes.model.geometryObjects[self._fingers[travel.pusher][0]].parentJoint
        data = robot.createData()
        q = next(manipulator.configurations(manipulator.arm.neutral[None], travel.begin_m))
        pin.framesForwardKinematics(robot, data, q)
        T_base_tip = data.oMf[robot.getFrameId(manipulator.arm.tip_frame)]
        T_joint_body = data.oMi[joint].inverse() * T_base_tip * pushed.T_tip_body
        others = shapes.wholes - self._hand
        fingers = shapes.finger_pieces(manipulator.arm)[1 - travel.pusher]
        added = self._pairs.add(pushed.body, joint, T_joint_body, in_pieces=True)
        for index in added:
            for finger in fingers:
                self._pairs.pair(index, finger, need_m=self._grasping_need(finger))
            for palm in sorted(shapes.of_palm(manipulator.arm) & shapes.details):
                self._pairs.pair(index, palm, need_m=0.0)
            for link in sorted(others):
                self._pairs.pair(index, link)
            for name, parts in standing.items():
                need_m = -PRESSING_TOLERANCE_M if name in pushed.supports else None
                for other in parts:
                    self._pairs.pair(index, other, need_m=need_m)
        self._signs |= dict.fromkeys(added, 1 if travel.pusher == 0 else -1)

    def _grasping_need(self, finger: int) -> float:
        return -PRESSING_TOLERANCE_M if finger in self._pads else 0.0

    def _poses(self, q: Vector) -> Vector:
        """Poses of all shapes with the fingers where they begin and end, shape (2, n, 4, 4)."""
        robot, geometry = self._manipulator.robot.model, self._checked.geometry
        data, placed = robot.createData(), geometry.createData()
        poses = np.empty((2, geometry.ngeoms, 4, 4))
        for number, finger_m in enumerate((self._travel.begin_m, self._travel.end_m)):
            full = next(self._manipulator.configurations(q[None], finger_m))
            pin.updateGeometryPlacements(robot, data, geometry, placed, full)
            poses[number] = [T.homogeneous for T in placed.oMg]
        return poses


@dataclass(frozen=True, slots=True, eq=False)
class FingerMotion:
    """Shapes that slide along the closing axis at one speed.

    Attributes:
        ends: poses of all shapes at the begin and at the end, shape (2, n, 4, 4).
        length_m: how far a finger goes.
        rates: how fast each pair comes nearer at most, per speed of a finger, shape (pairs,).
        checked: the pairs.
    """

    ends: Vector
    length_m: float
    rates: Vector
    checked: CheckedPairs

    @property
    def duration_s(self) -> float:
        """With a finger that goes at `FINGER_SPEED_M_S`."""
        return self.length_m / FINGER_SPEED_M_S

    def around(self, starts_s: Vector, ends_s: Vector) -> Around:
        """By interpolation."""
        shares = (starts_s + ends_s)[:, None, None] / (2 * max(self.duration_s, SHORTEST_S))
        poses = np.repeat(self.ends[:1], len(starts_s), axis=0)
        poses[..., :3, 3] += shares * (self.ends[1] - self.ends[0])[..., :3, 3]
        travels = FINGER_SPEED_M_S * (ends_s - starts_s) / 2

        def gaps_m(interval: Indices, pair: Indices) -> Vector:
            return self.checked.gaps_m(poses, interval, pair)

        def motions_m(interval: Indices, pair: Indices) -> Vector:
            moved: Vector = travels[interval] * self.rates[pair]
            return moved

        return Around(poses, gaps_m, motions_m)


def prove_travel(
    manipulator: Manipulator,
    travels: Sequence[FingerTravel],
    q: Vector,
    *,
    margin_m: float = 0.0,
) -> SweptResult:
    """A proof that the fingers' whole way is clear, stretch by stretch, or what speaks against it.

    Args:
        manipulator: the arm, its hand, and where all other joints stand.
        travels: the stretches, at least one.
        q: where the arm stands, shape (7,), rad.
        margin_m: distance that every pair shall keep, all but those of hand and grasped body.
    """
    return combined(TravelCheck(manipulator, travel).at(q, margin_m) for travel in travels)


def combined(results: Iterable[SweptResult]) -> SweptResult:
    """The proof of several stretches together, or the first contact."""
    proofs = []
    for result in results:
        if isinstance(result, SweptContact):
            return result
        proofs.append(result)
    nearest = min((proof.nearest for proof in proofs), key=lambda near: near.distance_m)
    return SweptProof(
        min(proof.proven_m for proof in proofs),
        nearest,
        proofs[0].margin_m,
        sum(proof.intervals for proof in proofs),
        sum(proof.evaluations for proof in proofs),
    )
