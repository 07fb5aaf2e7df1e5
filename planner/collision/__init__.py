"""The robot's body among others: distances, free configurations, proofs of motions."""

from __future__ import annotations

from typing import TYPE_CHECKING

from baxter_kin.lazy import loader

if TYPE_CHECKING:
    from planner.clearance import Clearance, ContinuousContact, ContinuousProof
    from planner.collision.checker import ClearanceChecker

__all__ = ["Clearance", "ClearanceChecker", "ContinuousContact", "ContinuousProof"]

__getattr__ = loader(
    __name__,
    (
        "baxter_kin.kinematics.pinocchio_loading",
        "planner.clearance",
        "planner.collision.checker",
    ),
)
