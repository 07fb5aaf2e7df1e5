"""How many of 72 rotations each arm reaches at each position, 20 cm above base."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

from matplotlib.figure import Figure

from baxter_kin import Baxter
from planner.atlas import PositionGrid, RotationGrid, build_reach_map
from planner.atlas.pictures import plot_reach_map

HEIGHT_M, STEP_M = 0.2, 0.05


def draw() -> Figure:
    """A slice of a map that has no other height."""
    robot = Baxter.load()
    around = PositionGrid.around(robot, STEP_M)
    low, high = ((*end[:2], HEIGHT_M) for end in (around.low_m, around.high_m))
    grid = PositionGrid.within(low, high, STEP_M)
    with TemporaryDirectory() as folder:
        found = build_reach_map(Path(folder, "map"), robot, grid, RotationGrid.hopf(0))
        return plot_reach_map(found, heights_m=[HEIGHT_M], arm="either")
