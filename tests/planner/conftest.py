"""What several test modules of the planner use."""

from __future__ import annotations

from typing import Any

import coal
import pinocchio as pin


def distance(first: Any, T_first: pin.SE3, second: Any, T_second: pin.SE3) -> float:
    """Coal's distance between two placed shapes, with coal's own settings."""
    return float(
        coal.distance(
            first,
            coal.Transform3s(T_first.rotation, T_first.translation),
            second,
            coal.Transform3s(T_second.rotation, T_second.translation),
            coal.DistanceRequest(),
            coal.DistanceResult(),
        )
    )
