"""Where the left hand can point down, and where it is proven that it cannot."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from baxter_kin import Baxter, IKService, pose_from_quaternion
from docs.figures.style import GREEN

DOWN = (0.0, 1.0, 0.0, 0.0)
HEIGHT_M = -0.13
X_M, Y_M = np.linspace(-0.2, 1.3, 76), np.linspace(-0.7, 1.3, 101)


def draw() -> Figure:
    """Draw a 2 cm grid, 13 cm below base."""
    ik = IKService(Baxter.load().arm("left"))
    grid = [pose_from_quaternion((x, y, HEIGHT_M), DOWN) for y in Y_M for x in X_M]
    answers = ik.solve_batch(grid)
    shape = len(Y_M), len(X_M)
    is_reached = np.reshape([answer.is_valid for answer in answers], shape)
    missing_mm = np.reshape(
        [1e3 * answer.failure.beyond_reach_m if answer.failure else 0.0 for answer in answers],
        shape,
    )
    figure, axes = plt.subplots(figsize=(6.4, 5.4))
    extent = (X_M[0], X_M[-1], Y_M[0], Y_M[-1])
    proven = np.where(missing_mm > 0.0, missing_mm, np.nan)
    shown = axes.imshow(proven, origin="lower", extent=extent, cmap="Oranges", vmin=0.0)
    reached = np.where(is_reached, 1.0, np.nan)
    axes.imshow(reached, origin="lower", extent=extent, cmap=ListedColormap([GREEN]))
    axes.plot(0.0, 0.0, "k+", markersize=12)
    axes.annotate("base", (0.0, 0.0), (6, -14), textcoords="offset points")
    figure.colorbar(shown, shrink=0.85, label="proven out of reach by [mm]")
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    axes.set_title("Left hand pointing down; green: solved")
    axes.grid(visible=False)
    white = int((~is_reached & ~(missing_mm > 0.0)).sum())
    axes.text(0.02, 0.02, f"without a solution or a proof: {white}", transform=axes.transAxes)
    return figure
