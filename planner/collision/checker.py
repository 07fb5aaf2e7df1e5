"""Distances between one arm and what it must not touch."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property, partial

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from baxter_kin import Arm
from baxter_kin.display import OneLine, count
from baxter_kin.errors import ConfigurationError
from baxter_kin.validation import FloatArray, Indices, expect, finite_array
from planner.clearance import Clearance
from planner.collision.continuous.motion_bounds import MotionBounds
from planner.collision.distances import UNKNOWN_DEPTH_M
from planner.collision.mover import Mover, Walk
from planner.collision.robot.robot_shapes import RobotShapes
from planner.collision.shape_pairs import ShapePairs
from planner.errors import SceneError
from planner.scene.bodies import Attachment, Scene
from planner.scene.contact import Contact, PartContact, boxed, has_depth, hull

MAX_JOINT = 1000.0
"""Joint values beyond this, rad or m, are refused; distances would lose digits."""


class ClearanceChecker(OneLine):
    """How close one arm comes to anything it must not touch, in one situation.

    Checked are the arm's shapes against the rest of the robot, against themselves and against the
    bodies of the scene, and a held body against all but the hand. Not checked are pairs that no
    motion of the arm brings nearer, and those of links that cannot meet (`RobotShapes`).

    Where a hand grasps, it must come near what it grasps: all shapes of the hand may come nearer to
    that body than a margin, as long as they do not touch it; its pads may press on it, if asked
    for, as may a held body on what it stood or will stand on, by up to `PRESSING_TOLERANCE_M`.

    Attributes:
        arm: the arm that moves.
        shapes: the robot's.
        robot: the model of the whole robot.
        checked: the pairs of shapes that are checked.
        geometry: all shapes, without pairs.
        contacts: what may come near or touch, because that is meant.
    """

    def __init__(
        self,
        shapes: RobotShapes,
        arm: Arm,
        scene: Scene,
        *,
        touchable: str | None = None,
        may_press: bool = True,
        held: Attachment | None = None,
        supports: Iterable[PartContact | str] = (),
    ) -> None:
        """Build the geometry of that situation.

        Args:
            shapes: the robot's.
            arm: the arm that moves.
            scene: all bodies; they stand still, but for the held one.
            touchable: name of the body that the hand grasps, is about to, or has let go.
            may_press: whether the pads may touch that body.
            held: what the hand carries.
            supports: what the held body may touch, because it stood or will stand on it: pairs of
                parts, as `part_contacts` gives them, or names of bodies, any part of which it may
                touch.

        Raises:
            SceneError: when the touchable or the held body is not in the scene, another hand holds
                it, or an argument is of another class.
        """
        expect(shapes, RobotShapes, "shapes", SceneError)
        expect(arm, Arm, "arm", SceneError)
        expect(may_press, bool, "may_press", SceneError)
        _check_situation(arm, scene, touchable, held)
        touched = frozenset(supports)
        self.arm = arm
        self._made_by = partial(
            ClearanceChecker,
            shapes,
            arm,
            scene,
            touchable=touchable,
            may_press=may_press,
            held=held,
            supports=touched,
        )
        near = (
            () if touchable is None else Contact.of_hand(arm.side, touchable, may_press=may_press)
        )
        own = () if held is None else Contact.of_supports(held.body, touched)
        self.contacts: tuple[Contact, ...] = (*near, *own)
        self.robot: pin.Model = shapes.robot.model
        self.shapes, pairs = shapes, ShapePairs(shapes, arm)
        still = scene if held is None else scene.without(held.body)
        bodies = pairs.add_scene(still, touchable, may_press=may_press, supports=touched)
        if held is not None:
            pairs.add_held(scene[held.body], held.T_link_body, bodies, touched)
        self.checked = pairs.built()
        self.geometry = self.checked.geometry
        self._hulls: dict[int, coal.CollisionGeometry] = {}

    def __reduce__(self) -> tuple[partial[ClearanceChecker], tuple[()]]:
        return self._made_by, ()

    @cached_property
    def mover(self) -> Mover:
        """The arm that moves, as the robot of the shapes has it: they move as theirs does."""
        return Mover.of(self.shapes.robot.arm(self.arm.side))

    @cached_property
    def walk(self) -> Walk:
        """The serial chain of the mover."""
        return Walk.of(self.mover)

    @cached_property
    def motion_bounds(self) -> MotionBounds:
        """Bounds on distances and motions of the shapes while the mover moves."""
        return MotionBounds(self.robot, self.geometry, self.mover, self.checked.covers)

    @cached_property
    def for_contacts(self) -> pin.GeometryModel:
        """The shapes of the pairs and no others, with those pairs, made to find contacts fast."""
        geometry, surfaces = pin.GeometryModel(), self.shapes.for_contacts
        kept = np.unique(self.pairs)
        for number in kept.tolist():
            placed = pin.GeometryObject(self.geometry.geometryObjects[number])
            if number in surfaces:
                placed.geometry = surfaces[number]
            elif not has_depth(placed.geometry):
                placed.geometry = boxed(placed.geometry)
            geometry.addGeometryObject(placed)
        for first, second in np.searchsorted(kept, self.pairs).tolist():
            geometry.addCollisionPair(pin.CollisionPair(first, second))
        return geometry

    def hull(self, shape: int) -> coal.CollisionGeometry:
        """The convex hull of a shape, made once; coal's functors hold bare pointers to it."""
        if shape < len(self.shapes.links):
            return self.shapes.hull(shape)
        if shape not in self._hulls:
            self._hulls[shape] = hull(self.geometry.geometryObjects[shape].geometry)
        return self._hulls[shape]

    def clearance(self, q: ArrayLike) -> Clearance:
        """The least distance at a full configuration, shape (19,).

        Pairs that may come near each other count where they are nearer than they may.

        Raises:
            ConfigurationError: when `q` has another shape or is not finite.
        """
        full = self.configuration(q)
        pair, distance_m = self._nearest(full)
        return self.checked.between(pair, distance_m)

    def configuration(self, q: ArrayLike) -> FloatArray:
        """A full configuration, shape (19,), known to be one that distances can be measured in.

        Raises:
            ConfigurationError: when it has another shape, is not finite or beyond `MAX_JOINT`.
        """
        full = finite_array(q, (self.robot.nq,), "q", ConfigurationError)
        if np.abs(full).max() > MAX_JOINT:
            raise ConfigurationError(
                f"a joint stands at {np.abs(full).max():g}; up to {MAX_JOINT:g} is measured"
            )
        return full

    @property
    def pairs(self) -> Indices:
        """The shapes of every pair, shape (n, 2)."""
        return self.checked.numbers

    @property
    def may_touch(self) -> NDArray[np.bool_]:
        """Whether a pair need not keep a margin, shape (n,)."""
        return self.checked.is_contact

    def distances_m(
        self, full: FloatArray, pairs: Iterable[int], within_m: float = np.inf
    ) -> list[float]:
        """The distances of some pairs at a checked full configuration, shape (19,).

        Where one is not less than `within_m`, that or more is given.
        """
        bounds, distances = self.motion_bounds, self.checked.distances
        distances.place(bounds.place(full, full[bounds.q_index][None]).shapes[0])
        return [distances.measure(pair, within_m) for pair in pairs]

    def _facts(self) -> tuple[str, ...]:
        return repr(self.arm), f"{count(len(self.pairs), 'pair')} of shapes"

    def _nearest(self, full: FloatArray) -> tuple[int, float]:
        """The nearest pair and its distance.

        Bounds below zero say nothing of how deep two are inside each other.
        """
        placing, distances = self.motion_bounds, self.checked.distances
        poses = placing.place(full, full[placing.q_index][None]).shapes
        distances.place(poses[0])
        pairs = np.arange(len(self.pairs))
        bounds = self.checked.gaps_m(poses, np.zeros_like(pairs), pairs)
        nearest, least_m = 0, np.inf
        for pair in np.argsort(bounds).tolist():
            if bounds[pair] >= max(least_m, 0.0):
                break
            distance_m = distances.measure(pair, max(least_m, 0.0))
            if distance_m > 0.0 and distances.is_within(pair):
                distance_m = UNKNOWN_DEPTH_M
            need_m = self.checked.needs_m[pair]
            if distance_m < least_m and not distance_m > need_m:  # NaN: any distance counts
                nearest, least_m = pair, distance_m
        return nearest, least_m


def _check_situation(
    arm: Arm, scene: Scene, touchable: str | None, held: Attachment | None
) -> None:
    expect(scene, Scene, "scene", SceneError)
    if touchable is not None:
        _ = scene[touchable]  # says what there is
    if held is None:
        return
    _ = scene[expect(held, Attachment, "held", SceneError).body]
    if held.side != arm.side:
        raise SceneError(
            f"{held.body!r} is in the {held.side} hand; the {arm.side} arm cannot carry it"
        )
    if touchable == held.body:
        raise SceneError(f"{held.body!r} is in the hand; it cannot stand there to be touched")
