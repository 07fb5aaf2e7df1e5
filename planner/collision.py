"""Distances between the robot and its scene.

Pinocchio and coal work on one geometry model: the robot's shapes, the bodies of the scene, and the
body in the hand. A model is built for each situation and never changed afterwards, because adding
shapes to one in use corrupts its memory.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from baxter_kin import Arm
from baxter_kin.arrays import Indices, Vector, finite_array, finite_scalar
from baxter_kin.display import OneLine, count, seconds, sentence
from baxter_kin.errors import ConfigurationError, expect
from baxter_kin.fields import Checked
from baxter_kin.frames import checked_pose
from planner.contact import (
    PRESSING_TOLERANCE_M,
    boxed,
    coal_shape,
    convex_pieces,
    has_depth,
)
from planner.distances import UNKNOWN_DEPTH_M, Distances, Enclosure
from planner.errors import SceneError
from planner.lever_arms import Covers, LeverArms
from planner.robot_shapes import LinkShape, RobotShapes
from planner.scene import Body, Scene

__all__ = ["Clearance", "ClearanceChecker", "Held", "RobotShapes", "ShapePairs", "least"]

FARTHEST_JOINT = 1000.0
"""Joint values beyond this, rad or m, are refused; distances would lose digits."""


@dataclass(frozen=True, slots=True, repr=False)
class Clearance(Checked, OneLine, error=SceneError):
    """The least distance that was found, and where.

    Attributes:
        distance_m: negative when the two are inside each other; of a surface of triangles, by at
            least so much; of fingers, whose pieces fill pockets, by at most so much.
        first: link or body.
        second: link or body.
        time_s: when, from the start of the motion; None when it was at no time of one.
    """

    distance_m: float
    first: str
    second: str
    time_s: float | None = None

    @property
    def text(self) -> str:
        """Who is how far from whom, or how deep inside."""
        if self.distance_m <= -SHOWN_M:
            return f"{self.first} is {-1e3 * self.distance_m:.1f} mm inside {self.second}"
        if self.distance_m < SHOWN_M:
            return f"{self.first} touches {self.second}"
        return f"{self.first} is {1e3 * self.distance_m:.1f} mm from {self.second}"

    def too_near(self, needed_m: float) -> str:
        """The same where more is needed: a margin, m, or zero or less for a contact.

        Raises:
            SceneError: when the margin is not a number.
        """
        needed_m = finite_scalar(needed_m, "needed_m", SceneError)
        if self.distance_m > 0.0 and needed_m > 0.0:
            return f"{self.text}, and {1e3 * needed_m:.1f} mm are asked for"
        return self.text

    def _facts(self) -> tuple[str, ...]:
        when = "" if self.time_s is None else f"at {seconds(self.time_s)}"
        return sentence(self.text), when


SHOWN_M = 5e-5
"""Distances and depths below this would be shown as 0.0 mm; they are called a touch."""


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """A body in the hand.

    Attributes:
        body: what is held.
        T_tip_body: its pose seen from the tip.
        supports: names of the bodies it may touch, because it stood or will stand on them.
    """

    body: Body
    T_tip_body: pin.SE3
    supports: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        expect(self.body, Body, "a held body", SceneError)
        object.__setattr__(self, "T_tip_body", checked_pose(self.T_tip_body))
        object.__setattr__(self, "supports", frozenset(self.supports))


class ShapePairs:
    """The shapes of a situation, and the pairs of them that are checked, while it is built.

    Attributes:
        geometry: all shapes, without pairs; the robot's first, as `RobotShapes` numbers them.
        numbers: the shapes of every pair.
        made: all shapes, and what is known of each.
        pieces: of some shapes of triangles, convex ones that contain them.
        needs_m: of the pairs that may be nearer than a margin because that is meant: the number of
            the pair -> the distance that it must exceed, negative for a contact that may press.
    """

    def __init__(self, shapes: RobotShapes) -> None:
        self._robot, self.pieces = shapes, shapes.pieces
        self.geometry: pin.GeometryModel = shapes.model.copy()
        self.numbers: list[tuple[int, int]] = []
        self.made: list[LinkShape] = list(shapes.made)
        self.needs_m: dict[int, float] = {}

    def add(
        self, body: Body, joint: int, T_joint_body: pin.SE3, *, in_pieces: bool = False
    ) -> list[int]:
        """Add a body's shapes; in convex pieces where a depth must be known, as in contacts."""
        added = []
        for part in body.parts:
            placement = T_joint_body * part.T_body_part
            shapes = convex_pieces(part.shape) if in_pieces else (coal_shape(part.shape),)
            for shape in shapes:
                name = f"{body.name}/{len(self.made)}"
                placed = pin.GeometryObject(name, joint, placement, shape)
                added.append(int(self.geometry.addGeometryObject(placed)))
                inside = None if has_depth(shape) else Enclosure.none()
                self.made.append(LinkShape(body.name, shape, inside))
        return added

    def pair(self, first: int, second: int, *, need_m: float | None = None) -> None:
        """Check a pair: against the margin, or against a distance of its own."""
        if need_m is not None:
            self.needs_m[len(self.numbers)] = need_m
        self.numbers.append((first, second))

    def covers(self) -> Covers:
        """Simple shapes around all shapes."""
        added = self.made[len(self._robot.made) :]
        return self._robot.covers.with_those_of([shape.geometry for shape in added])

    def built(self) -> CheckedPairs:
        """What is checked; nothing may be added any more."""
        return CheckedPairs(self)


class CheckedPairs:
    """Pairs of shapes whose distances count in one situation.

    Attributes:
        geometry: all shapes, without pairs.
        covers: simple shapes around them.
        numbers: the shapes of every pair, shape (n, 2).
        needs_m: what the distance of a pair must exceed where that is not the margin, shape (n,);
            NaN for all others.
        padding_m: what is subtracted from the distance of a pair, shape (n,), because its shapes
            count as thicker than they are.
        distances: of the pairs, less the padding.
    """

    def __init__(self, built: ShapePairs) -> None:
        self.geometry, self._made = built.geometry, tuple(built.made)
        self.covers = built.covers()
        self.numbers: Indices = np.array(built.numbers, dtype=np.intp).reshape(-1, 2)
        self.needs_m: Vector = np.full(len(self.numbers), np.nan)
        self.needs_m[list(built.needs_m)] = list(built.needs_m.values())
        outside, thicker = (
            np.array([getattr(each, name) for each in built.made])[self.numbers].sum(axis=1)
            for name in ("margin_m", "padding_m")
        )
        self.padding_m: Vector = outside + np.where(self.is_contact, 0.0, thicker)
        self.distances = Distances(
            self.geometry,
            [each.enclosure for each in built.made],
            built.pieces,
            built.numbers,
            self.padding_m.tolist(),
        )

    @property
    def is_contact(self) -> NDArray[np.bool_]:
        """Whether a pair need not keep a margin, shape (n,)."""
        return ~np.isnan(self.needs_m)

    def needed_m(self, margin_m: float) -> Vector:
        """What the distance of every pair must exceed when a margin is asked for, shape (n,)."""
        return np.where(self.is_contact, self.needs_m, margin_m)

    def gaps_m(self, poses: Vector, number: Indices, pair: Indices) -> Vector:
        """Lower bounds on distances, less the padding, shape (k,), m.

        Args:
            poses: of all shapes in base, shape (m, n, 4, 4).
            number: which of the m, shape (k,).
            pair: which pair there, shape (k,).
        """
        return self.covers.gaps_m(poses, number, *self.numbers[pair].T) - self.padding_m[pair]

    def between(self, pair: int, distance_m: float, time_s: float | None = None) -> Clearance:
        """A distance of a pair, by its names."""
        first, second = (self._made[number].link for number in self.numbers[pair])
        return Clearance(float(distance_m), first, second, time_s)


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
    """

    def __init__(
        self,
        shapes: RobotShapes,
        arm: Arm,
        scene: Scene,
        *,
        touchable: str | None = None,
        may_press: bool = True,
        held: Held | None = None,
    ) -> None:
        """Build the geometry of that situation.

        Args:
            shapes: the robot's.
            arm: the arm that moves.
            scene: bodies that stand still; not the held one.
            touchable: name of the body that the hand grasps, is about to, or has let go.
            may_press: whether the pads may touch that body.
            held: what the hand carries.

        Raises:
            SceneError: when the touchable body is not in the scene, or the held one is, or an
                argument is of another class.
        """
        expect(shapes, RobotShapes, "shapes", SceneError)
        expect(arm, Arm, "arm", SceneError)
        expect(may_press, bool, "may_press", SceneError)
        _check_situation(scene, touchable, held)
        self.arm = arm
        self._made_by = partial(
            ClearanceChecker,
            shapes,
            arm,
            scene,
            touchable=touchable,
            may_press=may_press,
            held=held,
        )
        self.robot: pin.Model = shapes.robot.model
        self.shapes, self._pairs = shapes, ShapePairs(shapes)
        self._add_pairs_of_arm()
        supports = self._add_scene(scene, touchable, may_press=may_press, held=held)
        if held is not None:
            self._add_held(held, supports)
        self.checked = self._pairs.built()
        self.geometry = self.checked.geometry

    def __reduce__(self) -> tuple[partial[ClearanceChecker], tuple[()]]:
        return self._made_by, ()

    @cached_property
    def levers(self) -> LeverArms:
        """Bounds on distances and motions of the shapes while the arm moves."""
        return LeverArms(self.robot, self.geometry, self.arm, self.checked.covers)

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

    def clearance(self, q: ArrayLike) -> Clearance:
        """The least distance at a full configuration, shape (19,).

        Pairs that may come near each other count where they are nearer than they may.

        Raises:
            ConfigurationError: when `q` has another shape or is not finite.
        """
        full = self.configuration(q)
        pair, distance_m = self._nearest(full)
        return self.between(pair, distance_m)

    def configuration(self, q: ArrayLike) -> Vector:
        """A full configuration, shape (19,), known to be one that distances can be measured in.

        Raises:
            ConfigurationError: when it has another shape, is not finite or beyond `FARTHEST_JOINT`.
        """
        full = finite_array(q, (self.robot.nq,), "q", ConfigurationError)
        if np.abs(full).max() > FARTHEST_JOINT:
            raise ConfigurationError(
                f"a joint stands at {np.abs(full).max():g}; up to {FARTHEST_JOINT:g} is measured"
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
        self, full: Vector, pairs: Iterable[int], within_m: float = np.inf
    ) -> list[float]:
        """The distances of some pairs at a checked full configuration, shape (19,).

        Where one is not less than `within_m`, that or more is given.
        """
        distances = self.checked.distances
        distances.place(self.levers.place(full, full[self.levers.q_index][None]).shapes[0])
        return [distances.measure(pair, within_m) for pair in pairs]

    def between(self, pair: int, distance_m: float, time_s: float | None = None) -> Clearance:
        """A distance of a pair, by its names."""
        return self.checked.between(pair, distance_m, time_s)

    def _facts(self) -> tuple[str, ...]:
        return repr(self.arm), f"{count(len(self.pairs), 'pair')} of shapes"

    def _nearest(self, full: Vector) -> tuple[int, float]:
        """The nearest pair and its distance.

        Bounds below zero say nothing of how deep two are inside each other.
        """
        levers, distances = self.levers, self.checked.distances
        poses = levers.place(full, full[levers.q_index][None]).shapes
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

    def _add_pairs_of_arm(self) -> None:
        moving, hand = self.shapes.of_arm(self.arm), self.shapes.of_hand(self.arm)
        for first, second in self.shapes.pairs:
            is_moved = first in moving or second in moving
            if is_moved and not (first in hand and second in hand):
                self._pairs.pair(first, second)

    def _add_scene(
        self, scene: Scene, touchable: str | None, *, may_press: bool, held: Held | None
    ) -> set[int]:
        """Add the bodies; returns the shapes of those that the held body may touch."""
        supports = set()
        arm = self.shapes.of_arm(self.arm)
        hand, pads = self.shapes.of_hand(self.arm), self.shapes.of_pads(self.arm)
        for body in scene:
            carries = held is not None and body.name in held.supports
            in_pieces = carries or body.name == touchable
            counted = self.shapes.details if body.name == touchable else self.shapes.wholes
            of_arm = sorted(arm & counted)
            for index in self._pairs.add(body, 0, body.T_base_body, in_pieces=in_pieces):
                if carries:
                    supports.add(index)
                for other in of_arm:
                    need_m = None
                    if body.name == touchable and other in hand:
                        presses = may_press and other in pads
                        need_m = -PRESSING_TOLERANCE_M if presses else 0.0
                    self._pairs.pair(other, index, need_m=need_m)
        return supports

    def _add_held(self, held: Held, supports: set[int]) -> None:
        tip = self.robot.frames[self.robot.getFrameId(self.arm.tip_frame)]
        bodies = set(range(len(self.shapes.links), self._pairs.geometry.ngeoms))
        others = sorted((self.shapes.wholes - self.shapes.of_hand(self.arm)) | bodies)
        T_joint_body = tip.placement * held.T_tip_body
        added = self._pairs.add(held.body, tip.parentJoint, T_joint_body, in_pieces=bool(supports))
        for index in added:
            for other in others:
                need_m = -PRESSING_TOLERANCE_M if other in supports else None
                self._pairs.pair(index, other, need_m=need_m)


def least(clearances: Iterable[Clearance]) -> Clearance | None:
    """The smallest of several, or None of none."""
    return min(clearances, key=lambda clearance: clearance.distance_m, default=None)


def _check_situation(scene: Scene, touchable: str | None, held: Held | None) -> None:
    expect(scene, Scene, "scene", SceneError)
    if touchable is not None:
        _ = scene[touchable]  # says what there is
    if held is not None and expect(held, Held, "held", SceneError).body.name in scene.bodies:
        raise SceneError(f"{held.body.name!r} is in the hand; take it out of the scene")
