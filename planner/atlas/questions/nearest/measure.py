"""How far apart two poses are, and what may differ between them."""

from __future__ import annotations

from enum import Enum

import numpy as np
import pinocchio as pin

from baxter_kin.fields import frozen, scalar
from baxter_kin.validation import FloatArray, member_of
from planner.errors import AtlasError

M_PER_RAD = 0.3
"""What a radian counts for where nothing else is said: about what it moves a hand's wrist by."""


class Keep(str, Enum):
    """What of a pose must stay."""

    ORIENTATION = "orientation"
    POSITION = "position"
    NOTHING = "nothing"

    @classmethod
    def of(cls, keep: str | Keep) -> Keep:
        """The member of that name.

        Raises:
            UnknownNameError: when there is none.
        """
        return member_of(cls, "part of a pose to keep", keep)


@frozen(error=AtlasError, eq=True)
class PoseMeasure:
    """A distance of poses: m where the orientation is kept, rad where the position is.

    Where nothing is kept, the root of the squares of metres and of `m_per_rad` times radians, m.

    Attributes:
        keep: what must stay.
        m_per_rad: what a radian counts for, above zero.
    """

    keep: Keep
    m_per_rad: float = scalar(above=0.0, default=M_PER_RAD)

    @property
    def weights(self) -> tuple[float, float]:
        """Of metres and of radians."""
        if self.keep is Keep.ORIENTATION:
            return 1.0, 0.0
        return (0.0, 1.0) if self.keep is Keep.POSITION else (1.0, self.m_per_rad)

    @property
    def unit(self) -> str:
        """Of the distance."""
        return "rad" if self.keep is Keep.POSITION else "m"

    def distance(self, offset_m: FloatArray, angle_rad: FloatArray) -> FloatArray:
        """Of positions so far apart and rotations so far apart."""
        metres, radians = self.weights
        return np.hypot(metres * offset_m, radians * angle_rad)

    def between(self, T_a: pin.SE3, T_b: pin.SE3) -> float:
        """Of two poses; what is kept counts for nothing."""
        offset = np.linalg.norm(T_a.translation - T_b.translation)
        angle = np.linalg.norm(pin.log3(T_a.rotation.T @ T_b.rotation))
        return float(self.distance(np.asarray(offset), np.asarray(angle)))
