"""Where bodies seem to be, and acting on it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from baxter_kin.lazy import loader

if TYPE_CHECKING:
    from sim.perception.pose_log import LoggedPoses, Look, ReplayedPoses, read_looks
    from sim.perception.pose_source import Sighting
    from sim.perception.transfer import Attempt, LoopResult

__all__ = [
    "Attempt",
    "LoggedPoses",
    "Look",
    "LoopResult",
    "ReplayedPoses",
    "Sighting",
    "read_looks",
]

__getattr__ = loader(
    __name__,
    (
        "sim.perception.pose_log",
        "sim.perception.pose_source",
        "sim.perception.transfer",
    ),
)
