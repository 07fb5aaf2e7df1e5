"""Where bodies seem to be, and acting on it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from baxter_kin.lazy import lazy

if TYPE_CHECKING:
    from sim.perception.closed_loop import Attempt as Attempt
    from sim.perception.closed_loop import LoopResult as LoopResult
    from sim.perception.pose_source import Sighting as Sighting

__all__, __getattr__ = lazy(
    __name__,
    {
        "Attempt": "sim.perception.closed_loop",
        "LoopResult": "sim.perception.closed_loop",
        "Sighting": "sim.perception.pose_source",
    },
)
