"""The robot's links and the bodies of the scene as trees of clusters, and where they are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from planner.certificate.body import Body, LinkShape
from planner.certificate.clusters import Clusters, Shape, stated_pose
from planner.certificate.errors import require
from planner.certificate.intervals import Array, Interval, Pose
from planner.certificate.robot import ARM_JOINTS, Attached, Robot
from planner.certificate.rows import Mover
from planner.certificate.timeline.touching import DistanceBounds

PRESS_M = 5e-4
"""Maximum depth of an intended contact, and maximum deviation of a stated pose from the derived
one."""

MAX_SKEW_M = 0.5 * PRESS_M
"""Maximum deviation of the fingers' travel from y of the last joint; fingers that deviate are
widened by it."""

STATE_TOLERANCE = 1e-8
"""Maximum difference of joints, velocities and accelerations between successive steps."""

MAX_BODIES = 500
"""Of a scene; also the maximum number of parts of a body."""


@dataclass(frozen=True, eq=False)
class Situation:
    """Where everything is between two steps.

    Attributes:
        arm: positions, velocities and accelerations of the arm, shape (3, 7).
        opening_m: how far its fingers are open.
        at: poses in base of the bodies that stand.
        others: poses in base of the bodies in the other hand.
        held: the body in the hand, and its pose seen from the last joint.
        released: the body that was let go in the previous step.
        taken: whether the hand closed in the previous step, or holds something at first.
        asked: whether the arm stands where a pose of the tip was asked for.
    """

    arm: Array
    opening_m: float
    at: Mapping[str, Pose]
    others: Mapping[str, Pose]
    held: tuple[str, Pose] | None = None
    released: str | None = None
    taken: bool = False
    asked: bool = False


@dataclass(frozen=True, eq=False)
class SceneBody:
    """A body of the scene: its parts, with their poses seen from the body."""

    name: str
    parts: tuple[tuple[Shape, Pose], ...]
    is_movable: bool

    @classmethod
    def of_file(cls, name: str, data: Mapping[str, Any]) -> SceneBody:
        """A body as a plan file states it."""
        parts = data["parts"]
        require(0 < len(parts) <= MAX_BODIES, f"{name} has no parts, or too many")
        return cls(
            name,
            tuple(
                (Shape.of_file(part["shape"], name), stated_pose(part["T_body_part"], name))
                for part in parts
            ),
            bool(data["is_movable"]),
        )


class Bodies:
    """All trees of clusters of one plan, by what carries them.

    Attributes:
        robot: the robot.
        clusters: all trees.
        distances: upper bounds on distances between them.
        scene: the bodies of the scene, by name.
        places: poses of all links seen from their parents, at the start.
        links: shapes of the links, and what carries each.
        arm: links of the arm by the joint that moves them, 1 to 7.
        fingers: roots of the fingers of the arm's hand, by link.
        pads: roots of the tips of these fingers.
        rest: all other links, by the link that carries them.
        insides: links of the arm and others with their enclosed volume, by the same keys.
    """

    def __init__(
        self,
        robot: Robot,
        body: Body,
        scene: Mapping[str, Mapping[str, Any]],
        joints: Mapping[str, float],
        *,
        is_alone: bool = False,
    ) -> None:
        """Read the scene's bodies, and place the robot's links.

        Args:
            robot: the robot.
            body: its shapes.
            scene: the bodies as a plan file states them.
            joints: positions of all joints, rad and m.
            is_alone: whether the links that only the other arm moves are left out.
        """
        self.robot, self.clusters = robot, Clusters()
        self.distances = DistanceBounds(self.clusters)
        self.scene = {name: SceneBody.of_file(name, data) for name, data in scene.items()}
        self.places = robot.places(joints)
        self.pads: dict[str, list[int]] = {finger: [] for finger in robot.fingers}
        self.links: list[tuple[LinkShape, Attached]] = [
            (each, robot.attached(each.link, self.places))
            for each in body.shapes
            if not (is_alone and robot.is_of_other(each.link))
        ]
        self._place_links()

    def _place_links(self) -> None:
        robot, clusters = self.robot, self.clusters
        roots: dict[int | str, list[int]] = {}
        filled: dict[int | str, list[int]] = {}
        skew_m = robot.skew * robot.stroke_m
        require(skew_m <= MAX_SKEW_M, "the fingers slide askew")
        for each, where in self.links:
            key = where.finger or where.level or robot.carrier(each.link)
            shape = each.shape
            if where.finger is not None and skew_m > 0.0:
                shape = replace(shape, ball_m=shape.ball_m + skew_m)
            root = clusters.add(shape, where.T * each.T_link_shape)
            roots.setdefault(key, []).append(root)
            if where.finger is None and each.shape.size > 1:
                solid = clusters.add(each.shape, where.T * each.T_link_shape, is_filled=True)
                filled.setdefault(key, []).append(solid)
            if where.finger is not None and each.link.endswith("_finger_tip"):
                self.pads[where.finger].append(root)
        joined = {key: clusters.joined(found) for key, found in roots.items()}
        self.arm = {
            k: Mover(f"links of {robot.names[k - 1]}", joined[k], k)
            for k in range(1, ARM_JOINTS + 1)
            if k in joined
        }
        self.insides = {
            key: Mover(
                "the inside of a link", clusters.joined(found), key if isinstance(key, int) else 0
            )
            for key, found in filled.items()
        }
        self.fingers = {f: joined[f] for f in robot.fingers if f in joined}
        require(len(self.fingers) == len(robot.fingers), "a finger has no shape")
        self.rest = {
            str(key): Mover(f"links on {key}", root, 0)
            for key, root in joined.items()
            if isinstance(key, str) and key not in robot.fingers
        }

    def finger(self, name: str, begin_m: float, end_m: float) -> Mover:
        """A finger that travels from one opening to another during a step."""
        sign = self.robot.fingers[name]
        return Mover(name, self.fingers[name], ARM_JOINTS, (sign * begin_m, sign * end_m))

    def mover(
        self,
        name: str,
        T: Pose,
        level: int,
        slide_m: tuple[float, float] = (0.0, 0.0),
        wider_m: float = 0.0,
    ) -> Mover:
        """A body of the scene.

        Args:
            name: its name.
            T: its pose seen from the frame that carries it.
            level: number of the joint that carries it, 0 for base.
            slide_m: its displacement along y of the last joint, at the start and end of the step.
            wider_m: by how much it is widened.
        """
        roots = []
        for shape, placed in self.scene[name].parts:
            own = replace(shape, ball_m=shape.ball_m + wider_m) if wider_m else shape
            roots.append(self.clusters.add(own, T * placed))
        return Mover(name, self.clusters.joined(roots), level, slide_m)

    def around(self, now: Situation) -> tuple[dict[str, Mover], list[Mover]]:
        """The bodies that stand by themselves, by name, and those in the other hand."""
        solids = {name: self.mover(name, T, 0) for name, T in now.at.items()}
        return solids, [self.mover(name, T, 0) for name, T in now.others.items()]

    def joint_pose(self, q: Array) -> Pose:
        """Pose of the last joint in base, at a configuration of shape (7,), rad."""
        T = self.robot.tips(Interval(q[None])) * self.robot.tip.inverse()
        return Pose(T.R[0], T.p[0])
