"""Reach maps as figures for papers (Matplotlib enters here)."""

from planner.atlas.pictures.figures import plot_difference, plot_profile, plot_reach_map

__all__ = ["plot_difference", "plot_profile", "plot_reach_map"]
