"""Where bodies seem to be, and acting on it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from baxter_kin.lazy import lazy

if TYPE_CHECKING:
    from sim.perception.pose_log import LoggedPoses as LoggedPoses
    from sim.perception.pose_log import Look as Look
    from sim.perception.pose_log import ReplayedPoses as ReplayedPoses
    from sim.perception.pose_log import read_looks as read_looks
    from sim.perception.pose_source import Sighting as Sighting
    from sim.perception.transfer import Attempt as Attempt
    from sim.perception.transfer import LoopResult as LoopResult

__all__, __getattr__ = lazy(
    __name__,
    {
        "Attempt": "sim.perception.transfer",
        "LoggedPoses": "sim.perception.pose_log",
        "Look": "sim.perception.pose_log",
        "LoopResult": "sim.perception.transfer",
        "ReplayedPoses": "sim.perception.pose_log",
        "Sighting": "sim.perception.pose_source",
        "read_looks": "sim.perception.pose_log",
    },
)
