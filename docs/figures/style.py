"""How all figures look: sizes, colours that also people with colour blindness tell apart."""

from __future__ import annotations

from typing import Any

BLUE, ORANGE, GREEN, RED, PURPLE, SKY, YELLOW = (
    "#0072b2",
    "#d55e00",
    "#009e73",
    "#b2182b",
    "#8e5a9e",
    "#56b4e9",
    "#c8a200",
)
"""After Okabe and Ito, "Color Universal Design" (2008); red, purple and yellow darker."""

JOINT_COLOURS = (BLUE, ORANGE, GREEN, RED, PURPLE, SKY, YELLOW)
GREY, LIGHT = "#5f6368", "#dadce0"

SETTINGS: dict[str, Any] = {
    "figure.facecolor": "white",
    "figure.constrained_layout.use": True,
    "svg.hashsalt": "baxter-kin",
    "svg.fonttype": "path",
    "font.size": 10,
    "axes.titlesize": 11,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": LIGHT,
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.6,
    "legend.frameon": False,
}
"""Matplotlib's."""
