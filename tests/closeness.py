"""Distances of everything to everything in a recorded run, from URDF, SRDF and coal alone.

Nothing of `planner` is asked, so that it can be judged. Looked at are all pairs of the robot that
the SRDF leaves, the robot with every body, and the bodies among themselves.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import coal
import numpy as np
import pinocchio as pin

from baxter_kin import Baxter
from baxter_kin.validation import FloatArray
from planner import Body
from planner.scene.bodies import Box
from sim import Recording

LEVER_M = 1.5
"""No point of an arm, or of what it holds, is farther from an axis of one of its joints."""


class Closeness:
    """The robot and some bodies made of boxes."""

    def __init__(self, robot: Baxter, bodies: Iterable[Body]) -> None:
        files = robot.description.stock
        self._model = pin.buildModelFromUrdf(str(files.urdf))
        self._shapes = pin.buildGeomFromUrdf(
            self._model,
            str(files.urdf),
            pin.GeometryType.COLLISION,
            package_dirs=[str(files.package_dir)],
        )
        self._mount_paddles()
        self._shapes.addAllCollisionPairs()
        pin.removeCollisionPairs(self._model, self._shapes, str(files.srdf))
        self._parts: list[tuple[int, str, pin.SE3]] = []  # shape, body, where it sits on that
        for body in bodies:
            self._add(body)
        self._names = [self._name(i) for i in range(self._shapes.ngeoms)]

    def _mount_paddles(self) -> None:
        """On the right hand, too, as the stock robot of the toolkit has them."""
        for finger in "lr":
            left, right = (
                self._shapes.geometryObjects[
                    self._shapes.getGeometryId(f"{hand}_gripper_{finger}_finger_tip_0")
                ]
                for hand in "lr"
            )
            right.geometry, right.placement = left.geometry, left.placement

    def along(self, recording: Recording) -> Mapping[tuple[str, str], float]:
        """The least distance of each pair, m, over all snapshots.

        A pair is measured again only when, by what has moved since, it could be nearer than ever.
        """
        assert tuple(self._model.names[1:]) == recording.joint_names
        data, results = self._model.createData(), self._shapes.createData()
        least = np.full(len(self._shapes.collisionPairs), np.inf)
        at_least = np.full_like(least, -np.inf)
        for snapshot, travel_m in enumerate(_travels_m(recording)):
            self._put(recording, snapshot)
            pin.updateGeometryPlacements(
                self._model, data, self._shapes, results, recording.q[snapshot]
            )
            at_least -= 2 * travel_m
            for pair in np.flatnonzero(at_least < least).tolist():
                at_least[pair] = pin.computeDistance(self._shapes, results, pair).min_distance
                least[pair] = min(least[pair], at_least[pair])
        return self._by_name(least.tolist())

    def _put(self, recording: Recording, snapshot: int) -> None:
        for shape, body, T_body_part in self._parts:
            pose = pin.XYZQUATToSE3(recording.body_poses[body][snapshot])
            self._shapes.geometryObjects[shape].placement = pose * T_body_part

    def _by_name(self, distances_m: Iterable[float]) -> Mapping[tuple[str, str], float]:
        """The least of all shapes of two links or bodies."""
        found: dict[tuple[str, str], float] = {}
        for pair, distance in zip(self._shapes.collisionPairs, distances_m, strict=True):
            names = self._names[pair.first], self._names[pair.second]
            found[names] = min(distance, found.get(names, np.inf))
        return found

    def _add(self, body: Body) -> None:
        before = list(range(self._shapes.ngeoms))
        for part in body.parts:
            assert isinstance(part.shape, Box)
            index = self._shapes.addGeometryObject(
                pin.GeometryObject(
                    f"{body.name}#{len(self._parts)}",
                    0,
                    part.T_body_part,
                    coal.Box(*part.shape.size_m),
                )
            )
            self._parts.append((index, body.name, part.T_body_part))
            for other in before:
                self._shapes.addCollisionPair(pin.CollisionPair(other, index))

    def _name(self, shape: int) -> str:
        """The body's name, or that of the robot's link."""
        name: str = self._shapes.geometryObjects[shape].name
        return name.partition("#")[0] if "#" in name else name.rpartition("_")[0]


def _travels_m(recording: Recording) -> FloatArray:
    """How far any point has moved at most since the snapshot before, shape (n,), m."""
    turned = np.abs(np.diff(recording.q, axis=0)).sum(axis=1)
    fallen = [
        np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1)
        for poses in recording.body_poses.values()
    ]
    travels: FloatArray = np.append(0.0, LEVER_M * turned + np.max(fallen, axis=0))
    return travels
