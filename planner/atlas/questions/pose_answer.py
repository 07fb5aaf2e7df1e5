"""The exact answer for one pose and one arm: its best witness, or why there is none.

A map answers at its cells alone. Here a pose is solved as it is: of all solutions that are found
along its self-motion, the one farthest from the joint limits is the witness.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from baxter_kin import IKService
from baxter_kin.display import position
from baxter_kin.errors import ConfigurationError
from baxter_kin.fields import frozen
from baxter_kin.kinematics.arm import Arm
from baxter_kin.limits import JointLimits
from baxter_kin.validation import FloatArray, finite_array
from planner.errors import AtlasError


@dataclass(frozen=True, slots=True)
class _WidestMargin:
    """An objective: the joint nearest to a limit is as many rad from it as possible.

    Cost: `-min_i min(q_i - q_min_i, q_max_i - q_i)`, in rad, as maps store margins.
    """

    def costs(self, arm: Arm, q: FloatArray) -> FloatArray:
        """Minus the margin of each configuration, shape (n,)."""
        limits = arm.limits
        q = finite_array(q, (None, 7), "q", ConfigurationError)
        return np.array(-np.minimum(q - limits.q_min, limits.q_max - q).min(axis=1))


@frozen(error=AtlasError)
class PoseAnswer:
    """Whether one arm reaches a pose.

    Attributes:
        label: what the pose is called, such as "red: pick".
        side: of the arm.
        T_base_tip: the pose.
        q: the witness, shape (7,), rad; None without one.
        margin_rad: of the witness to the nearest joint limit; None without one.
        nearest_limit: the name of that joint.
        is_proven_unreachable: whether it is proven that there is no witness.
        reason: why there is none, a clause; empty with one.
    """

    label: str
    side: str
    T_base_tip: pin.SE3
    q: FloatArray | None = None
    margin_rad: float | None = None
    nearest_limit: str = ""
    is_proven_unreachable: bool = False
    reason: str = ""

    @property
    def is_reachable(self) -> bool:
        """Whether there is a witness."""
        return self.q is not None

    @property
    def status(self) -> str:
        """In the words of maps: "reachable", "unreachable" (proven so) or "undecided"."""
        if self.is_reachable:
            return "reachable"
        return "unreachable" if self.is_proven_unreachable else "undecided"

    def __str__(self) -> str:
        if self.margin_rad is None:
            return f"the {self.side} arm does not reach it: {self.reason}"
        return (
            f"the {self.side} arm reaches it, {self.margin_rad:.3f} rad from the limit of "
            f"{self.nearest_limit}"
        )

    def _facts(self) -> tuple[str, ...]:
        margin = "" if self.margin_rad is None else f"margin {self.margin_rad:.3f} rad"
        return self.label, self.side, position(self.T_base_tip), self.status, margin


def answer_pose(ik: IKService, T_base_tip: pin.SE3, label: str = "") -> PoseAnswer:
    """Solve a pose for one arm; tens of milliseconds.

    Args:
        ik: of the arm.
        T_base_tip: a valid pose.
        label: what it is called.
    """
    arm = ik.arm
    result = ik.solve(T_base_tip, objective=_WidestMargin())
    if result.failure is not None:
        is_proven = result.failure.beyond_reach_m > 0.0
        return PoseAnswer(
            label,
            arm.side,
            T_base_tip,
            is_proven_unreachable=is_proven,
            reason=result.failure.reason,
        )
    margin_rad, joint = margin_of(arm.limits, result.q)
    return PoseAnswer(label, arm.side, T_base_tip, result.q, margin_rad, joint)


def margin_of(limits: JointLimits, q: FloatArray) -> tuple[float, str]:
    """The distance of a configuration, shape (7,), to the nearest joint limit, rad, and whose."""
    margins = np.minimum(q - limits.q_min, limits.q_max - q)
    nearest = int(margins.argmin())
    return float(margins[nearest]), limits.names[nearest]
