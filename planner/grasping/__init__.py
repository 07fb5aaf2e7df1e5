"""Hands, the grasps they make, and the travel of their fingers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from baxter_kin.lazy import lazy

if TYPE_CHECKING:
    from planner.grasping.grasp import Grasp as Grasp
    from planner.grasping.grasp import Miss as Miss
    from planner.grasping.grasp import MissKind as MissKind

__all__, __getattr__ = lazy(
    __name__,
    {
        "Grasp": "planner.grasping.grasp",
        "Miss": "planner.grasping.grasp",
        "MissKind": "planner.grasping.grasp",
    },
)
