"""The robot's body among others: distances, free configurations, proofs of motions."""

from __future__ import annotations

from typing import TYPE_CHECKING

from baxter_kin.lazy import lazy

if TYPE_CHECKING:
    from planner.clearance import Clearance as Clearance
    from planner.clearance import ContinuousContact as ContinuousContact
    from planner.clearance import ContinuousProof as ContinuousProof
    from planner.collision.checker import ClearanceChecker as ClearanceChecker

__all__, __getattr__ = lazy(
    __name__,
    {
        "Clearance": "planner.clearance",
        "ClearanceChecker": "planner.collision.checker",
        "ContinuousContact": "planner.clearance",
        "ContinuousProof": "planner.clearance",
    },
)
