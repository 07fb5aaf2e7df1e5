"""World, base and tip frames, with the left arm between them."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pinocchio as pin
from matplotlib.figure import Figure

from baxter_kin import Baxter
from baxter_kin.frames import BASE_HEIGHT_M
from docs.figures.style import BLUE, GREEN, GREY, LIGHT, RED

AXES = ((RED, "x"), (GREEN, "y"), (BLUE, "z"))


def draw() -> Figure:
    """The arm in neutral."""
    arm = Baxter.load().arm("left")
    figure = plt.figure(figsize=(7, 6.2), layout="none")
    axes: Any = figure.add_subplot(projection="3d")
    figure.subplots_adjust(left=0.0, right=1.0, bottom=-0.04, top=1.06)
    T_base_world = pin.SE3(np.eye(3), np.array([0.0, 0.0, -BASE_HEIGHT_M]))
    T_base_tip = arm.T_base_tip(arm.neutral)
    pin.forwardKinematics(arm.model, data := arm.model.createData(), arm.neutral)
    joints = np.array([T.translation for T in data.oMi[1:]])
    way = np.vstack([np.zeros(3), joints, T_base_tip.translation])
    axes.plot([0, 0], [0, 0], [-BASE_HEIGHT_M, 0], color=LIGHT, linewidth=9, zorder=0)
    axes.plot(*way.T, color=GREY, linewidth=5, alpha=0.45)
    axes.plot(*joints.T, "o", color=GREY, markersize=6)
    for number, point in enumerate(joints):
        if number in {0, 1, 3, 5}:
            name = arm.joint_names[number].removeprefix("left_")
            x, y, z = point
            axes.text(x, y + 0.03, z + 0.06, name, fontsize=9, color=GREY)
    for T, name, length_m in (
        (T_base_world, "world", 0.3),
        (pin.SE3.Identity(), "base", 0.3),
        (T_base_tip, "tip", 0.2),
    ):
        _triad(axes, T, name, length_m)
    axes.text(0.06, 0.0, -0.5, f"{BASE_HEIGHT_M:g} m", fontsize=9, color=GREY)
    axes.set(xlim=(0.0, 1.05), ylim=(-0.1, 0.95), zlim=(-0.95, 0.7))
    axes.set_box_aspect((1.05, 1.05, 1.65), zoom=1.2)
    axes.view_init(elev=18, azim=-62)
    axes.set_axis_off()
    return figure


def _triad(axes: Any, T: pin.SE3, name: str, length_m: float) -> None:
    """The axes of a frame, and its name."""
    for column, (colour, letter) in enumerate(AXES):
        ahead = T.rotation[:, column]
        axes.quiver(*T.translation, *(length_m * ahead), color=colour, linewidth=2.2)
        axes.text(*(T.translation + 1.12 * length_m * ahead), letter, color=colour, fontsize=10)
    beside = (0.05, 0.0, -0.02) if name == "tip" else (-0.13, 0.0, 0.02)
    axes.text(*(T.translation + beside), name, fontsize=12, weight="bold")
