"""How far the tips of two arms can be apart at the same joint angles, whichever these are.

Both arms are chains of a fixed link, a turn about z, a fixed link, and so on. Exchanging one link
of the first for that of the second, `A` for `B`, moves the tip by at most `|p_A - p_B|`, and by
`2 sin(angle / 2)` times its distance from the link's end, of which the sum of the lengths after it
is the most; and it turns the tip by the angle between both. What comes before the link only carries
the tip along. The arms differ by all exchanges, one after the other, so by their sum at most. An
axis that is not z is turned to it, and back after the joint.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from baxter_kin.fields import frozen
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray
from planner.errors import AtlasError

ROUNDING = 1e-12
"""What is added for rounding, m and rad."""


@frozen(error=AtlasError, eq=True)
class TipDeviation:
    """A bound on the distance of two tips at the same joint angles.

    Attributes:
        position_m: between their positions.
        angle_rad: between their orientations.
    """

    position_m: float
    angle_rad: float

    @classmethod
    def of(cls, first: Arm, second: Arm) -> TipDeviation:
        """Between two arms; their limits do not matter."""
        links = zip(_links(first), _links(second), strict=True)
        between = [(a.translation - b.translation, a.actInv(b)) for a, b in links]
        shifts = np.array([np.linalg.norm(shift) for shift, _ in between])
        angles = np.array([np.linalg.norm(pin.log3(off.rotation)) for _, off in between])
        lengths = np.array([np.linalg.norm(link.translation) for link in _links(first)])
        after = lengths[::-1].cumsum()[::-1] - lengths
        position_m = float((shifts + 2.0 * np.sin(0.5 * angles) * after).sum())
        return cls(position_m + ROUNDING, float(angles.sum()) + ROUNDING)

    def __str__(self) -> str:
        return f"at most {1e3 * self.position_m:.1f} mm and {1e3 * self.angle_rad:.1f} mrad"


def _links(arm: Arm) -> list[pin.SE3]:
    """The fixed links between turns about z, and the one before and the one after them."""
    model = arm.model
    tip = model.frames[model.getFrameId(arm.tip_frame)].placement
    turns = [pin.SE3(_from_z(axis), np.zeros(3)) for axis in arm.chain.axes]
    before = [pin.SE3.Identity(), *turns]
    after = [*turns, pin.SE3.Identity()]
    fixed = [*list(model.jointPlacements)[1:], tip]
    return [b.inverse() * T * a for b, T, a in zip(before, fixed, after, strict=True)]


def _from_z(axis: FloatArray) -> FloatArray:
    """The least rotation that takes z to a unit vector not far from it."""
    across = np.cross([0.0, 0.0, 1.0], axis)
    sine = float(np.linalg.norm(across))
    angle = float(np.arctan2(sine, axis[2]))
    return np.array(pin.exp3(across / sine * angle)) if sine > 0.0 else np.eye(3)
