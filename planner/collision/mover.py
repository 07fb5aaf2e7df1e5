"""Mover: the arms that move, as one list of joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from baxter_kin import Arm, JointLimits
from baxter_kin.kinematics.arm import LIMBS


@dataclass(frozen=True, slots=True, eq=False)
class Mover:
    """Arms that move together. Their joints are in a row, the left arm's before the right arm's.

    Attributes:
        arms: in this order.
    """

    arms: tuple[Arm, ...]

    @classmethod
    def of(cls, *arms: Arm) -> Mover:
        """One arm, or both in any order."""
        return cls(tuple(sorted(arms, key=lambda arm: LIMBS.index(arm.side))))

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The names of all joints, n in all."""
        return tuple(name for arm in self.arms for name in arm.joint_names)

    @property
    def limits(self) -> JointLimits:
        """The limits of all joints; their origins are those of the first arm."""
        each = [arm.limits for arm in self.arms]
        q_min, q_max, v_max, a_max, j_max = (
            np.concatenate([getattr(limits, name) for limits in each])
            for name in ("q_min", "q_max", "v_max", "a_max", "j_max")
        )
        origins = each[0].origins
        return JointLimits(self.joint_names, q_min, q_max, v_max, a_max, j_max, origins)
