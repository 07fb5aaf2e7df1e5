"""Distances of pairs of shapes at the samples of a stretch.

Shapes are brought to where they are only at the samples, and measured only as far, as somebody
asks.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from baxter_kin.validation import FloatArray, Indices
from planner.verification.body.solid import Solid, distance_request, separation
from planner.verification.body.stretch import IN_HAND, Stretch, relative_arms
from planner.verification.urdf_robot import UrdfRobot


@dataclass(frozen=True, slots=True, eq=False)
class SolidPair:
    """Two shapes, one of them moving.

    Attributes:
        first: on the arm, or in the hand.
        second: any other.
        body: the body that the fingers, or what is held, may touch on purpose in it; None for
            pairs that may never touch.
        is_stated: whether what a plan states of its clearance counts it: not the palm and what the
            hand grasps, which are as near as the grasp has them.
    """

    first: Solid
    second: Solid
    body: str | None = None
    is_stated: bool = True

    def __str__(self) -> str:
        return f"{self.first.name} with {self.second.name}"


class SolidDistances:
    """Measures pairs at samples.

    Attributes:
        pairs: in order; they are named by their numbers.
        arms: how far one of each pair goes at most relative to the other, shape (p, 9).
    """

    def __init__(self, robot: UrdfRobot, stretch: Stretch, pairs: list[SolidPair]) -> None:
        self.pairs, self.stretch, self._robot = pairs, stretch, robot
        self.solids = list({id(s): s for p in pairs for s in (p.first, p.second)}.values())
        number = {id(solid): i for i, solid in enumerate(self.solids)}
        self._numbers = np.array(
            [[number[id(p.first)], number[id(p.second)]] for p in pairs], dtype=np.intp
        ).reshape(-1, 2)
        self._radii = np.array([solid.radius_m for solid in self.solids])
        self._joints = [solid.joint for solid in self.solids]
        self.arms = np.array([relative_arms(robot, p.first, p.second) for p in pairs])
        self._data = robot.model.createData()
        self._poses: dict[int, dict[int, pin.SE3]] = {}
        self._placed: dict[tuple[int, int], Any] = {}
        self._centres: dict[int, FloatArray] = {}
        self._functions: dict[tuple[int, bool], Any] = {}
        self._request, self._result = distance_request(), coal.DistanceResult()
        self._T_wrist_tip = robot.T_wrist_tip()

    def balls_apart(self, pairs: Indices, sample: int) -> FloatArray:
        """Lower bounds on distances at a sample, from the balls around shapes."""
        centres = self._centres_at(sample)
        first, second = self._numbers[pairs].T
        between = np.linalg.norm(centres[first] - centres[second], axis=1)
        apart: FloatArray = between - self._radii[first] - self._radii[second]
        return apart

    def covers_apart(self, pair: int, sample: int) -> float:
        """The distance of the covers, not above that of the shapes; minus infinity without any."""
        both = (self.pairs[pair].first, self.pairs[pair].second)
        if all(solid.cover is solid.shape for solid in both):
            return -np.inf
        return self._measured(pair, sample, None, of_covers=True)

    def shapes_apart(self, pair: int, sample: int, wanted_m: float = np.inf) -> float:
        """The distance, where it is below what is wanted; else a lower bound that is not."""
        return self._measured(pair, sample, wanted_m, of_covers=False)

    def pose(self, solid: Solid, sample: int) -> pin.SE3:
        """Where a shape is, seen from base."""
        return self._frame(solid.joint, sample) * solid.T_joint_shape

    def tip_base(self, sample: int) -> pin.SE3:
        """Where the tip is, seen from base."""
        return self._frame(self._robot.wrist, sample) * self._T_wrist_tip

    def _measured(self, pair: int, sample: int, clip_m: float | None, *, of_covers: bool) -> float:
        """Coal's distance; a clip tells it to leave out all that is farther."""
        function = self._functions.get((pair, of_covers))
        if function is None:
            both = self.pairs[pair]
            function = separation(both.first, both.second, of_covers=of_covers)
            self._functions[pair, of_covers] = function
        self._result.clear()
        if clip_m is not None and clip_m < np.inf:
            self._result.min_distance = clip_m
        first, second = self._numbers[pair].tolist()
        first_at, second_at = self._transform(first, sample), self._transform(second, sample)
        found: float = function(first_at, second_at, self._request, self._result)
        return found

    def _transform(self, solid: int, sample: int) -> Any:
        """Where a shape is, for coal; what stands still is there at every sample."""
        at = sample if self._joints[solid] else 0
        placed = self._placed.get((solid, at))
        if placed is None:
            T = self.pose(self.solids[solid], at)
            placed = coal.Transform3s(T.rotation, T.translation)
            self._placed[solid, at] = placed
        return placed

    def _centres_at(self, sample: int) -> FloatArray:
        centres = self._centres.get(sample)
        if centres is None:
            poses = self._frames(sample)
            centres = np.array(
                [poses[s.joint].act(s.T_joint_shape.act(s.centre)) for s in self.solids]
            )
            self._centres[sample] = centres
        return centres

    def _frame(self, joint: int, sample: int) -> pin.SE3:
        return self._frames(sample)[joint]

    def _frames(self, sample: int) -> dict[int, pin.SE3]:
        """Where each joint is, seen from base."""
        frames = self._poses.get(sample)
        if frames is None:
            pin.forwardKinematics(self._robot.model, self._data, self.stretch.q[sample])
            joints = {*self._joints, self._robot.wrist} - {IN_HAND}
            frames = {joint: pin.SE3(self._data.oMi[joint]) for joint in joints}
            push = pin.SE3(np.eye(3), np.array([0.0, self.stretch.pushed_m[sample], 0.0]))
            frames[IN_HAND] = frames[self._robot.wrist] * self._T_wrist_tip * push
            self._poses[sample] = frames
        return frames
