"""Drawing: whether two links of a robot are to each other as the URDF draws them.

What was proven of pairs of links (`RobotBody.skipped_pairs`) was proven for the URDF of
example-robot-data, over the ranges of its joints. It holds for any robot of which the two links
have the same shapes, and the joints between them are the same and turn no farther. So of a
calibrated robot, and of one with other hands, it holds for fewer pairs. What one hand is drawn with
may be on the other: then what was proven on that side counts. Links that one joint joins are
mounted on each other, and are taken to be so on every robot: calibration says how its parts were
measured to lie, not that their covers touch.
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
"""How far from the drawings, m and of rotations, a joint may be and still count as drawn."""


class KnownPairs:
    """The pairs of a robot's links that stay apart, or are mounted on each other."""

    def __init__(self, robot: Baxter, skipped: Collection[frozenset[str]]) -> None:
        """Compare the robot with the drawing.

        Args:
            robot: the robot.
            skipped: the pairs of which that is known as they are drawn.
        """
        self._skipped = skipped
        self._same = Drawing(robot, _drawn())
        self._swapped = Drawing(robot, _drawn(), is_swapped=True)

    def has(self, first: str, second: str) -> bool:
        """Whether it is known of two links."""
        others = frozenset((other_side(first), other_side(second)))
        return (
            frozenset((first, second)) in self._skipped and self._same.is_as_drawn(first, second)
        ) or (others in self._skipped and self._swapped.is_as_drawn(first, second))


@cache
def _drawn() -> Baxter:
    return Baxter.load(RobotDescription.drawn().text)


_SIDES = (("left_", "right_"), ("l_gripper_", "r_gripper_"))


class Drawing:
    """A robot beside the one that is drawn."""

    def __init__(self, own: Baxter, drawn: Baxter, *, is_swapped: bool = False) -> None:
        """Compare all joints.

        Args:
            own: the robot.
            drawn: what the URDF draws.
            is_swapped: whether each side is compared with the other one.
        """
        self._own, self._stock = own.model, drawn.model
        self._trees = own.description.tree, drawn.description.tree
        self._drawn_name = other_side if is_swapped else str
        self._data = self._own.createData(), self._stock.createData()
        names = list(self._own.names)
        self._other = {
            joint: self._stock.getJointId(self._drawn_name(name))
            for joint, name in enumerate(names)
            if joint
        }
        self._same = frozenset(joint for joint in self._other if self._is_same(joint))

    def is_as_drawn(self, first: str, second: str) -> bool:
        """Whether what was proven of two links, or their counterparts, is known of this robot's."""
        between = self._chain(first) ^ self._chain(second)
        if len(between) <= 1:
            return True
        return between <= self._same and self._is_fixed(first) and self._is_fixed(second)

    def _chain(self, link: str) -> set[int]:
        frame = self._own.frames[self._own.getFrameId(link, pin.FrameType.BODY)]
        return set(list(self._own.supports[frame.parentJoint])[1:])

    def _is_fixed(self, link: str) -> bool:
        """Whether a link looks as it is drawn, and sits so on its joint."""
        names = link, self._drawn_name(link)
        own, stock = (
            model.frames[model.getFrameId(name, pin.FrameType.BODY)].placement.homogeneous
            for model, name in zip((self._own, self._stock), names, strict=True)
        )
        shapes, drawn = (
            tree.by_child[name].shapes if name in tree.by_child else ()
            for tree, name in zip(self._trees, names, strict=True)
        )
        return shapes == drawn and bool(np.abs(own - stock).max() <= ROUNDING)

    def _is_same(self, joint: int) -> bool:
        other = self._other[joint]
        own, stock = (
            np.append(model.jointPlacements[j].homogeneous, np.asarray(data.joints[j].S))
            for model, data, j in zip(
                (self._own, self._stock), self._data, (joint, other), strict=True
            )
        )
        (low, high), (least, most) = _range(self._own, joint), _range(self._stock, other)
        return bool(np.abs(own - stock).max() <= ROUNDING and (low >= least) and (high <= most))


def other_side(name: str) -> str:
    """The name of a joint's or link's counterpart on the other side; its own where it has none."""
    for one, other in _SIDES:
        for prefix, swapped in ((one, other), (other, one)):
            if name.startswith(prefix):
                return swapped + name.removeprefix(prefix)
    return name


def _range(model: pin.Model, joint: int) -> FloatArray:
    at = model.joints[joint].idx_q
    return np.array([model.lowerPositionLimit[at], model.upperPositionLimit[at]])
