"""The arm as a chain of turns about z, which is all that some peers can be given."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from baxter_kin.kinematics.arm import Arm


def placements_about_z(arm: Arm) -> list[pin.SE3]:
    """Eight fixed poses: before each of seven turns about z, and after the last, up to the tip.

    A calibrated joint turns about another axis than z; the frames on both sides of it are turned so
    that this axis is z of theirs.
    """
    model, data = arm.model, arm.model.createData()
    tip = model.frames[model.getFrameId(arm.tip_frame)].placement
    chain, turned_back = [], pin.SE3.Identity()
    for joint in range(1, model.njoints):
        axis = np.asarray(data.joints[joint].S).reshape(-1)[3:]
        turned = pin.SE3(pin.Quaternion.FromTwoVectors(np.eye(3)[2], axis).matrix(), np.zeros(3))
        chain.append(turned_back * model.jointPlacements[joint] * turned)
        turned_back = turned.inverse()
    return [*chain, turned_back * tip]
