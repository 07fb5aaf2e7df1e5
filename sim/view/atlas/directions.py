"""Names for the directions that a tool can point to, as its page lists them."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np

from baxter_kin.validation import FloatArray

SECTORS = (
    "forward",
    "forward left",
    "left",
    "back left",
    "back",
    "back right",
    "right",
    "forward right",
)
"""Of azimuths, an eighth of a turn each, from base's x axis towards y."""

UPRIGHT_DEG = 0.5
"""What is called "up" or "down" deviates from it by less."""


def direction_names(R_base_tips: FloatArray) -> list[str]:
    """A name for where each tool points, such as "down" or "forward left, 42° down".

    Names that would be the same get the azimuth in degrees.

    Args:
        R_base_tips: shape (d, 3, 3); the tool points along z.
    """
    tools = R_base_tips[:, :, 2]
    names = [_name(tool) for tool in tools]
    counts = Counter(names)
    return [
        name if counts[name] == 1 else f"{name}, azimuth {_azimuth_deg(tool):.0f}°"
        for name, tool in zip(names, tools, strict=True)
    ]


def _azimuth_deg(tool: FloatArray) -> float:
    return math.degrees(math.atan2(tool[1], tool[0])) % 360.0


def _name(tool: FloatArray) -> str:
    elevation = math.degrees(math.asin(float(np.clip(tool[2], -1.0, 1.0))))
    if abs(elevation) > 90.0 - UPRIGHT_DEG:
        return "up" if elevation > 0.0 else "down"
    sector = SECTORS[round(_azimuth_deg(tool) / 45.0) % len(SECTORS)]
    if abs(elevation) < UPRIGHT_DEG:
        return sector
    return f"{sector}, {abs(elevation):.0f}° {'up' if elevation > 0.0 else 'down'}"
