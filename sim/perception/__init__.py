"""Where bodies seem to be, and acting on it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from baxter_kin.lazy import lazy

if TYPE_CHECKING:
    from sim.perception.pose_source import Sighting as Sighting
    from sim.perception.transfer import Attempt as Attempt
    from sim.perception.transfer import LoopResult as LoopResult

__all__, __getattr__ = lazy(
    __name__,
    {
        "Attempt": "sim.perception.transfer",
        "LoopResult": "sim.perception.transfer",
        "Sighting": "sim.perception.pose_source",
    },
)
