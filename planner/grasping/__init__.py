"""Hands, what they hold, and how their fingers travel."""

from __future__ import annotations

from typing import TYPE_CHECKING

from baxter_kin.lazy import loader

if TYPE_CHECKING:
    from planner.grasping.grasp import Grasp, Miss, MissKind

__all__ = ["Grasp", "Miss", "MissKind"]

__getattr__ = loader(
    __name__, ("baxter_kin.kinematics.pinocchio_loading", "planner.grasping.grasp")
)
