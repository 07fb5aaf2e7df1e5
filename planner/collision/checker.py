"""ClearanceChecker: the distances of one arm, or of both, from everything they must not touch."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property, partial

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from baxter_kin import Arm
from baxter_kin.display import OneLine, count, quoted, shortened
from baxter_kin.errors import ConfigurationError
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import (
    FloatArray,
    Indices,
    expect,
    expect_all,
    finite_array,
    whole_scalar,
)
from planner.clearance import Clearance
from planner.collision.distances import UNKNOWN_DEPTH_M
from planner.collision.motion_bounds import MotionBounds
from planner.collision.mover import Mover, Walk
from planner.collision.robot.robot_shapes import RobotShapes
from planner.collision.shape_pairs import ShapePairsBuilder
from planner.errors import SceneError
from planner.scene.bodies import Attachment, Scene
from planner.scene.coal_shapes import hull
from planner.scene.contact import Contact, PartContact, checked_supports

MAX_JOINT = 1000.0
"""Largest joint value, rad or m; distances at larger ones would lose digits."""


class ClearanceChecker(OneLine):
    """The distances of one arm or both from everything they must not touch, in one situation.

    The arms' shapes are checked against the rest of the robot, against each other and against the
    bodies of the scene, and a held body against everything except the hands that hold it. Pairs
    whose distance does not change with the arms are not checked, nor are those of links that cannot
    meet (`RobotShapes`). A body that both hands hold moves with the left one.

    A hand must come near a body to grasp it: all shapes of the hand may come nearer to that body
    than a margin, as long as they do not touch it. Its pads may press on the body if `may_press`,
    and a held body on its supports, by up to `PRESSING_TOLERANCE_M`.

    Attributes:
        arms: the arms that move: one, or the left and the right.
        shapes: the robot's shapes.
        robot: the model of the whole robot.
        checked: the pairs of shapes that are checked.
        geometry: all shapes, without pairs.
        contacts: the intended contacts.
    """

    def __init__(
        self,
        shapes: RobotShapes,
        arm: Arm | Mover,
        scene: Scene,
        *,
        touchable: str | None = None,
        may_press: bool = True,
        held: Attachment | Iterable[Attachment] | None = None,
        supports: Iterable[PartContact | str] = (),
    ) -> None:
        """Build the geometry of a situation.

        Args:
            shapes: the robot's shapes.
            arm: the arm that moves, or both arms.
            scene: all bodies; only held ones move.
            touchable: name of the body that the hand grasps, is about to grasp, or has released.
            may_press: whether the pads may touch that body.
            held: the body in the hand, or what is in the hands; both may hold one body, also where
                only one of their arms moves.
            supports: what held bodies stood or will stand on, and may touch: pairs of parts, as
                `part_contacts` gives them, or names of bodies, any part of which they may touch.

        Raises:
            SceneError: when the touchable or the held body is not in the scene, another hand holds
                it, or an argument is of another class.
        """
        expect(shapes, RobotShapes, "shapes", SceneError)
        self.arms = arm.arms if isinstance(arm, Mover) else (expect(arm, Arm, "arm", SceneError),)
        expect(may_press, bool, "may_press", SceneError)
        if held is None or isinstance(held, Attachment):
            held = () if held is None else (held,)
        attached = expect_all(held, Attachment, "held", SceneError)
        _check_situation(self.arms, scene, touchable, attached)
        touched = checked_supports(supports)
        self._held, self._supports, self._scene = attached, touched, scene
        self._made_by = partial(
            ClearanceChecker,
            shapes,
            arm,
            scene,
            touchable=touchable,
            may_press=may_press,
            held=attached,
            supports=touched,
        )
        near = (
            ()
            if touchable is None
            else Contact.of_hand(self.arm.side, touchable, may_press=may_press)
        )
        hands: dict[str, list[Attachment]] = {}
        sides = [arm.side for arm in self.arms]
        for each in sorted(attached, key=lambda e: (e.side not in sides, LIMBS.index(e.side))):
            hands.setdefault(each.body, []).append(each)
        own = [contact for body in hands for contact in Contact.of_supports(body, touched)]
        self.contacts: tuple[Contact, ...] = (*near, *own)
        self.robot: pin.Model = shapes.robot.model
        self.shapes, pairs = shapes, ShapePairsBuilder(shapes, *self.arms)
        still = scene
        for body in hands:
            still = still.without(body)
        bodies = pairs.add_scene(still, touchable, may_press=may_press, supports=touched)
        for body, of_body in hands.items():
            holding = [self._arm(each.side) for each in of_body]
            T_tip_body = of_body[0].T_link_body
            bodies[body] = pairs.add_held(scene[body], T_tip_body, bodies, touched, holding)
        self.checked = pairs.build()
        self.geometry = self.checked.geometry
        self._hulls: dict[int, coal.CollisionGeometry] = {}

    def __reduce__(self) -> tuple[partial[ClearanceChecker], tuple[()]]:
        return self._made_by, ()

    @property
    def arm(self) -> Arm:
        """The arm that moves; of both, the left one."""
        return self.arms[0]

    @cached_property
    def mover(self) -> Mover:
        """The arms that move, as the robot of the shapes has them, with which they move."""
        return Mover.of(*(self.shapes.robot.arm(arm.side) for arm in self.arms))

    def alone(self, side: str, q_other: FloatArray | None = None) -> ClearanceChecker:
        """The checker of one of two arms, as if the robot did not have the other.

        What the other hand holds is left out, too. Or, where `q_other` is given, the other arm
        stands there with what it holds.

        Args:
            side: of the arm that moves.
            q_other: configuration of the other arm, shape (7,), rad.

        Raises:
            SceneError: when only one arm moves anyway, the arm has another name, or both hands hold
                the same body.
            ConfigurationError: when `q_other` has another shape or is not finite.
        """
        if side not in [arm.side for arm in self.arms] or len(self.arms) == 1:
            names = " and ".join(arm.side for arm in self.arms)
            raise SceneError(f"of the arms that move, {names}, {quoted(side)} cannot be alone")
        if q_other is not None:
            q_other = finite_array(q_other, (7,), "q_other", ConfigurationError)
        own = [each for each in self._held if each.side == side]
        others, scene = [each for each in self._held if each.side != side], self._scene
        (other,) = (arm for arm in self.arms if arm.side != side)
        for each in others:
            if any(each.body == mine.body for mine in own):
                raise SceneError(f"both hands hold {each.body!r}: no arm can move alone")
            if q_other is None:
                scene = scene.without(each.body)
            else:
                T_base_link = other.with_tip(each.link).T_base_tip(q_other)
                scene = scene.moved(each.body, T_base_link * each.T_link_body)
        return ClearanceChecker(
            self.shapes.without(other.side) if q_other is None else self.shapes,
            self._arm(side),
            scene,
            held=own,
            supports=self._supports,
        )

    def _arm(self, side: str) -> Arm:
        own = [arm for arm in self.arms if arm.side == side]
        return own[0] if own else self.shapes.robot.arm(side)

    @cached_property
    def walk(self) -> Walk:
        """The serial chain of the mover."""
        return Walk.of(self.mover)

    @cached_property
    def motion_bounds(self) -> MotionBounds:
        """Poses of the shapes, and bounds on their motions, while the mover moves."""
        return MotionBounds(self.robot, self.geometry, self.mover, self.checked.covers)

    @cached_property
    def for_contacts(self) -> pin.GeometryModel:
        """A geometry model of the pairs and their shapes alone, made for finding contacts fast."""
        geometry = pin.GeometryModel()
        kept = np.unique(self.pairs)
        for number in kept.tolist():
            placed = pin.GeometryObject(self.geometry.geometryObjects[number])
            geometry.addGeometryObject(placed)
        for first, second in np.searchsorted(kept, self.pairs).tolist():
            geometry.addCollisionPair(pin.CollisionPair(first, second))
        return geometry

    def hull(self, shape: int) -> coal.CollisionGeometry:
        """The convex hull of a shape, made once, as coal's functors hold bare pointers to it.

        Raises:
            SceneError: when there is no shape of this number.
        """
        most = self.geometry.ngeoms - 1
        shape = whole_scalar(shape, "number of a shape", SceneError, least=0, most=most)
        if shape < len(self.shapes.links):
            return self.shapes.hull(shape)
        if shape not in self._hulls:
            self._hulls[shape] = hull(self.geometry.geometryObjects[shape].geometry)
        return self._hulls[shape]

    def clearance(self, q: ArrayLike) -> Clearance:
        """The smallest distance at a full configuration, shape (19,).

        Intended contacts count only where the two are nearer than allowed.

        Raises:
            ConfigurationError: when `q` has another shape or is not finite.
        """
        full = self.configuration(q)
        pair, distance_m = self.nearest(full)
        return self.checked.clearance_of(pair, distance_m)

    def configuration(self, q: ArrayLike, what: str = "q") -> FloatArray:
        """A full configuration, shape (19,), refused where distances cannot be measured.

        Args:
            q: the configuration, rad and m.
            what: the subject of error messages.

        Raises:
            ConfigurationError: when `q` has another shape, is not finite or beyond `MAX_JOINT`.
        """
        full = finite_array(q, (self.robot.nq,), shortened(str(what)), ConfigurationError)
        if np.abs(full).max() > MAX_JOINT:
            raise ConfigurationError(
                f"a joint is at {np.abs(full).max():g}; at most {MAX_JOINT:g} can be measured"
            )
        return full

    @property
    def is_between_arms(self) -> NDArray[np.bool_]:
        """Whether a pair is one of shapes that different arms move, shape (n,)."""
        moves = self.motion_bounds.moves[self.pairs]  # n, 2, joints
        by_arm = [part.any(axis=2) for part in np.split(moves, len(self.arms), axis=2)]
        first, second = np.array(by_arm).transpose(2, 0, 1)  # arms, n
        apart: NDArray[np.bool_] = (
            first.any(axis=0) & second.any(axis=0) & ~(first & second).any(axis=0)
        )
        return apart

    @property
    def pairs(self) -> Indices:
        """The two shapes of every pair, shape (n, 2)."""
        return self.checked.pairs

    @property
    def may_touch(self) -> NDArray[np.bool_]:
        """Whether a pair need not keep a margin, shape (n,)."""
        return self.checked.is_contact

    def distances_m(
        self, full: FloatArray, pairs: Iterable[int], within_m: float = np.inf
    ) -> list[float]:
        """The distances of some pairs at a valid full configuration, shape (19,).

        Where a distance is not less than `within_m`, the result is that or a larger value.
        """
        bounds, distances = self.motion_bounds, self.checked.distances
        distances.place(bounds.place(full, full[bounds.q_index][None]).shapes[0])
        return [distances.measure(pair, within_m) for pair in pairs]

    def nearest(
        self, full: FloatArray, among: Indices | None = None, below_m: float = np.inf
    ) -> tuple[int, float]:
        """The nearest pair at a valid full configuration, and its distance.

        Intended contacts count only where the two are nearer than allowed.

        Args:
            full: the configuration, shape (19,).
            among: numbers of the pairs that count, at least one; all by default.
            below_m: the result is this distance where no pair is nearer.
        """
        placing, distances = self.motion_bounds, self.checked.distances
        poses = placing.place(full, full[placing.q_index][None]).shapes
        distances.place(poses[0])
        pairs = np.arange(len(self.pairs)) if among is None else among
        bounds = self.checked.gaps_m(poses, np.zeros_like(pairs), pairs)
        nearest, least_m = int(pairs[0]), below_m
        for number in np.argsort(bounds).tolist():
            # lower bounds below zero are no bounds on a depth
            if bounds[number] >= max(least_m, 0.0):
                break
            pair = int(pairs[number])
            distance_m = distances.measure(pair, max(least_m, 0.0))
            if distance_m > 0.0 and distances.is_within(pair):
                distance_m = UNKNOWN_DEPTH_M
            need_m = self.checked.min_distances_m[pair]
            if distance_m < least_m and not distance_m > need_m:  # NaN: without an own need
                nearest, least_m = pair, distance_m
        return nearest, least_m

    def _facts(self) -> tuple[str, ...]:
        return *map(repr, self.arms), f"{count(len(self.pairs), 'pair')} of shapes"


def _check_situation(
    arms: tuple[Arm, ...], scene: Scene, touchable: str | None, held: tuple[Attachment, ...]
) -> None:
    expect(scene, Scene, "scene", SceneError)
    sides = [arm.side for arm in arms]
    if touchable is not None:
        _ = scene[touchable]  # refuses an unknown body
        if len(sides) > 1:
            raise SceneError(f"both arms move; only the hand of one may touch {touchable!r}")
    carried = {each.body for each in held if each.side in sides}
    for each in held:
        _ = scene[each.body]
        if each.side not in sides and each.body not in carried:
            raise SceneError(
                f"{each.body!r} is in the {each.side} hand; the {sides[0]} arm cannot carry it"
            )
        if touchable == each.body:
            raise SceneError(
                f"{each.body!r} is in the hand; it cannot be the touchable body as well"
            )
    if len({each.side for each in held}) < len(held):
        raise SceneError("a hand holds one body at most")
