"""Drawing: whether two links of a robot are as the stock robot has them to each other.

What was proven of pairs of links (`RobotBody.skipped_pairs`) was proven for the stock robot, over
the ranges of its joints. It holds for any robot whose joints between the two links are the same and
turn no farther. Of a calibrated robot it holds for fewer pairs. Links that one joint joins are
mounted on each other, and are taken to be so on every robot: calibration says how its parts were
measured to lie, not that their covers touch.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from baxter_kin.arrays import Vector

ROUNDING = 1e-9
"""How far from the drawings, m and of rotations, a joint may be and still count as drawn."""


class Drawing:
    """A robot beside the stock robot."""

    def __init__(self, own: pin.Model, stock: pin.Model) -> None:
        """Compare all joints."""
        self._own, self._stock = own, stock
        self._data = own.createData(), stock.createData()
        names = list(own.names)
        self._other = {joint: stock.getJointId(name) for joint, name in enumerate(names) if joint}
        self._same = frozenset(joint for joint in self._other if self._is_same(joint))

    def is_as_drawn(self, first: str, second: str) -> bool:
        """Whether what was proven of two links of the stock robot is known of this one."""
        between = self._chain(first) ^ self._chain(second)
        if len(between) <= 1:
            return True
        return between <= self._same and self._is_fixed(first) and self._is_fixed(second)

    def _chain(self, link: str) -> set[int]:
        frame = self._own.frames[self._own.getFrameId(link, pin.FrameType.BODY)]
        return set(list(self._own.supports[frame.parentJoint])[1:])

    def _is_fixed(self, link: str) -> bool:
        """Whether a link sits on its joint as it is drawn."""
        own, stock = (
            model.frames[model.getFrameId(link, pin.FrameType.BODY)].placement.homogeneous
            for model in (self._own, self._stock)
        )
        return bool(np.abs(own - stock).max() <= ROUNDING)

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


def _range(model: pin.Model, joint: int) -> Vector:
    at = model.joints[joint].idx_q
    return np.array([model.lowerPositionLimit[at], model.upperPositionLimit[at]])
