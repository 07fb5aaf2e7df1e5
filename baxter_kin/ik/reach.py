"""How far the arm can reach, by the triangle inequality: a bound that is never wrong."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from baxter_kin.model import Arm


class ReachBound:
    """A ball around the first joint that the tip cannot leave.

    The distance from the first joint's origin to the tip is at most the sum of the distances
    between successive joint origins, whatever the angles.

    Attributes:
        radius_m: that sum.
        joint_name: the joint at the centre.
    """

    def __init__(self, arm: Arm) -> None:
        """Add up the links of that arm."""
        placements = arm.model.jointPlacements
        tip = arm.model.frames[arm.model.getFrameId(arm.tip_frame)].placement
        links = [placements[joint].translation for joint in range(2, arm.model.njoints)]
        self.radius_m = float(sum(np.linalg.norm(link) for link in [*links, tip.translation]))
        self.joint_name = arm.joint_names[0]
        self._centre_base = np.array(placements[1].translation)

    def excess_m(self, T_base_tip: pin.SE3) -> float:
        """How far the pose lies outside the ball, in metres; zero when inside."""
        distance = float(np.linalg.norm(T_base_tip.translation - self._centre_base))
        return max(0.0, distance - self.radius_m)
