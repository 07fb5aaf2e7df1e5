"""Velocity, acceleration and jerk of a pick and place, as shares of their limits."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from docs.figures.demo import demo_plan
from docs.figures.style import GREY, JOINT_COLOURS


def draw() -> Figure:
    """All moves of the demo's first cycle, one after the other, gripper times left out."""
    plan = demo_plan()
    limits = plan.moves[0].trajectory.limits
    figure, rows = plt.subplots(3, 1, figsize=(8, 6.4), sharex=True)
    begin_s = 0.0
    for move in plan.moves:
        motion = move.trajectory
        times_s = np.linspace(0.0, motion.duration, max(20, int(400 * motion.duration)))
        state = motion.sample(times_s)
        steps_s = begin_s + motion.knots_s
        for joint, colour in enumerate(JOINT_COLOURS):
            name = limits.names[joint].removeprefix("left_")
            label = name if begin_s == 0.0 else None
            v, a = state.v[:, joint] / limits.v_max[joint], state.a[:, joint] / limits.a_max[joint]
            rows[0].plot(begin_s + times_s, v, color=colour, label=label)
            rows[1].plot(begin_s + times_s, a, color=colour)
            rows[2].stairs(
                motion.j[:, joint] / limits.j_max[joint], steps_s, color=colour, baseline=None
            )
        begin_s += motion.duration
        rows[0].text(
            begin_s - motion.duration / 2,
            1.22,
            move.label.replace(": ", ":\n"),
            ha="center",
            fontsize=7,
        )
        for axes in rows:
            axes.axvline(begin_s, color=GREY, linewidth=0.6)
    for axes, what in zip(rows, ("velocity", "acceleration", "jerk"), strict=True):
        axes.axhspan(-1.0, 1.0, color=GREY, alpha=0.06)
        axes.set(ylabel=f"{what},\nshare of its limit", ylim=(-1.15, 1.15))
    rows[2].set(xlabel="time [s]")
    rows[0].legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure
