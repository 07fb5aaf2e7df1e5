"""What the search functions know of an arm, as numbers among their inputs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from baxter_kin.kinematics.arm import Arm
from baxter_kin.kinematics.dh_parameters import DHParameters
from baxter_kin.kinematics.symbolic import Shape, dimensions_of
from baxter_kin.validation import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class ArmNumbers:
    """What the search functions know of an arm.

    Attributes:
        shape: the arm's; there is a function for each.
        bounds: lowest and highest joint positions, shape (14,), rad.
        dimensions: those that the shape leaves open, shape (n,), m and rad.
        frames: base seen from the first axis, then the last axis seen from the tip; rotations
            column by column, then positions, shape (24,), m.
        T_last_tip: the tip seen from the last axis.
    """

    shape: Shape
    bounds: FloatArray
    dimensions: FloatArray
    frames: FloatArray
    T_last_tip: pin.SE3

    @classmethod
    def of(cls, arm: Arm) -> ArmNumbers:
        """Those of an arm.

        Raises:
            DescriptionError: when it is not built like Baxter's.
        """
        dh = DHParameters.of(arm)
        dimensions = dimensions_of(dh)
        shape = Shape.of(dimensions)
        frames = dh.T_base_first.inverse(), dh.T_last_tip.inverse()
        return cls(
            shape,
            np.concatenate([arm.limits.q_min, arm.limits.q_max]),
            dimensions[shape.free],
            np.concatenate([np.append(T.rotation.ravel("F"), T.translation) for T in frames]),
            dh.T_last_tip,
        )

    def within(self, bounds: FloatArray | None = None) -> FloatArray:
        """All numbers as the functions take them, with the arm's bounds or others, (14,), rad."""
        given = self.bounds if bounds is None else bounds
        return np.concatenate([given, self.dimensions, self.frames])
