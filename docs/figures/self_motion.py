"""The self-motion of one pose: joint angles and manipulability along its longest piece."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from baxter_kin import Baxter, IKService, pose_from_quaternion
from baxter_kin.ik import FarthestFromLimits, MostManipulable, best_on, solutions
from docs.figures.style import GREY, JOINT_COLOURS


def draw() -> Figure:
    """The demo's pick, left arm."""
    arm = Baxter.load().arm("left")
    pick = pose_from_quaternion((0.70, 0.15, -0.129), (0.0, 1.0, 0.0, 0.0))
    pieces = solutions(IKService(arm), pick)
    figure, rows = plt.subplots(2, 1, figsize=(8, 6.2), sharex=True, height_ratios=(2, 1))
    start = 0.0
    for number, piece in enumerate(pieces):
        s = start + piece.s
        for joint, colour in enumerate(JOINT_COLOURS):
            label = arm.joint_names[joint].removeprefix("left_") if number == 0 else None
            rows[0].plot(s, piece.q[:, joint], color=colour, label=label)
        rows[1].plot(s, piece.manipulability, color=GREY)
        start = float(s[-1]) + 0.6
    for objective, marker, text in (
        (FarthestFromLimits(), "o", "farthest from limits of the longest piece"),
        (MostManipulable(), "s", "most manipulable of the longest piece"),
    ):
        s_best, _ = pieces[0].nearest(best_on(pieces[0], objective))
        value = np.interp(s_best, pieces[0].s, pieces[0].manipulability)
        rows[1].plot(s_best, value, marker, color="black", label=text)
        rows[0].axvline(s_best, color=GREY, linewidth=0.8, linestyle=":")
    rows[0].set(ylabel="joint angle [rad]", title=f"One pose, {len(pieces)} pieces of solutions")
    rows[1].set(xlabel="length along the pieces, one after the other [rad]")
    rows[1].set(ylabel=r"$\sqrt{\det J J^\top}$")
    rows[0].legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    rows[1].legend(loc="upper center", bbox_to_anchor=(0.5, -0.35), ncols=2, fontsize=8)
    return figure
