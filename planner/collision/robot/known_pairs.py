"""Known pairs: the pairs of links for which the proofs on the reference robot hold, too.

`RobotBody.skipped_pairs` was proven for the URDF of example-robot-data, the reference, over the
ranges of its joints. A proof holds for any robot with the same shapes of the two links, the same
joints between them, and no larger ranges of these. So for a calibrated robot, and for one with
other hands, it holds for fewer pairs. A hand of the reference may be on the other arm; then the
proof for that side holds. Links connected by one joint are mounted on each other, and are skipped
for every robot: calibration measures the poses of parts, not whether their covers touch.
"""

from __future__ import annotations

from collections.abc import Collection
from functools import cache

import numpy as np
import pinocchio as pin

from baxter_kin import Baxter
from baxter_kin.description import RobotDescription
from baxter_kin.validation import FloatArray

ROUNDING = 1e-9
"""Maximum difference between equal joints, m, and in entries of rotations."""


class KnownPairs:
    """The pairs of a robot's links that stay apart, or are mounted on each other."""

    def __init__(self, robot: Baxter, skipped: Collection[frozenset[str]]) -> None:
        """Compare the robot with the reference robot.

        Args:
            robot: the robot.
            skipped: the known pairs of the reference robot.
        """
        self._skipped = skipped
        self._same = Comparison(robot, _reference())
        self._swapped = Comparison(robot, _reference(), is_swapped=True)

    def has(self, first: str, second: str) -> bool:
        """Whether two links are a known pair."""
        others = frozenset((other_side(first), other_side(second)))
        return (
            frozenset((first, second)) in self._skipped and self._same.is_alike(first, second)
        ) or (others in self._skipped and self._swapped.is_alike(first, second))


@cache
def _reference() -> Baxter:
    return Baxter.load(RobotDescription.as_in_urdf().text)


_SIDES = (("left_", "right_"), ("l_gripper_", "r_gripper_"))


class Comparison:
    """A robot compared with the reference robot."""

    def __init__(self, own: Baxter, reference: Baxter, *, is_swapped: bool = False) -> None:
        """Compare all joints.

        Args:
            own: the robot.
            reference: the reference robot.
            is_swapped: whether each side is compared with the other one.
        """
        self._own, self._reference = own.model, reference.model
        self._trees = own.description.tree, reference.description.tree
        self._reference_name = other_side if is_swapped else str
        self._data = self._own.createData(), self._reference.createData()
        names = list(self._own.names)
        self._other = {
            joint: self._reference.getJointId(self._reference_name(name))
            for joint, name in enumerate(names)
            if joint
        }
        self._same = frozenset(joint for joint in self._other if self._is_same(joint))

    def is_alike(self, first: str, second: str) -> bool:
        """Whether a proof for the reference's links, or their counterparts, holds for these."""
        between = self._chain(first) ^ self._chain(second)
        if len(between) <= 1:
            return True
        return between <= self._same and self._is_fixed(first) and self._is_fixed(second)

    def _chain(self, link: str) -> set[int]:
        frame = self._own.frames[self._own.getFrameId(link, pin.FrameType.BODY)]
        return set(list(self._own.supports[frame.parentJoint])[1:])

    def _is_fixed(self, link: str) -> bool:
        """Whether a link has the shapes of the reference, at the same pose on its joint."""
        names = link, self._reference_name(link)
        own, reference = (
            model.frames[model.getFrameId(name, pin.FrameType.BODY)].placement.homogeneous
            for model, name in zip((self._own, self._reference), names, strict=True)
        )
        shapes, expected = (
            tree.by_child[name].shapes if name in tree.by_child else ()
            for tree, name in zip(self._trees, names, strict=True)
        )
        return shapes == expected and bool(np.abs(own - reference).max() <= ROUNDING)

    def _is_same(self, joint: int) -> bool:
        other = self._other[joint]
        own, reference = (
            np.append(model.jointPlacements[j].homogeneous, np.asarray(data.joints[j].S))
            for model, data, j in zip(
                (self._own, self._reference), self._data, (joint, other), strict=True
            )
        )
        (low, high), (least, most) = _range(self._own, joint), _range(self._reference, other)
        return bool(np.abs(own - reference).max() <= ROUNDING and (low >= least) and (high <= most))


def other_side(name: str) -> str:
    """The name of a joint's or link's counterpart on the other side; itself where it has none."""
    for one, other in _SIDES:
        for prefix, swapped in ((one, other), (other, one)):
            if name.startswith(prefix):
                return swapped + name.removeprefix(prefix)
    return name


def _range(model: pin.Model, joint: int) -> FloatArray:
    at = model.joints[joint].idx_q
    return np.array([model.lowerPositionLimit[at], model.upperPositionLimit[at]])
