"""The tube of a lagging joint, and responses inside it."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from baxter_kin.validation import FloatArray
from docs.figures.demo import demo_plan
from docs.figures.style import BLUE, GREEN, GREY, ORANGE, RED
from planner import Response, Trajectory
from planner.motion.tracking_tube import tracking_tube
from planner.trajectory import joined

LAG_S = (0.2, 0.5)
SPEED = 1.0
JOINT = 1
STEP_S = 1e-3


def draw() -> Figure:
    """Draw the second joint, from the start to the pick."""
    motion = joined(move.trajectory for move in demo_plan().moves[:2])
    response = Response(lag_s=LAG_S, speed=SPEED)
    start = motion.q_start
    tube = tracking_tube(motion, response, (start, start)).tube
    times_s = np.arange(0.0, tube.times_s[-1], STEP_S)
    sent = _sent(motion, response, times_s)
    figure, axes = plt.subplots(figsize=(8, 3.8))
    axes.fill_between(
        tube.times_s,
        tube.lowest[:, JOINT],
        tube.highest[:, JOINT],
        color=BLUE,
        alpha=0.18,
        linewidth=0,
        label=f"tube, lags of {LAG_S[0]:g} to {LAG_S[1]:g} s",
    )
    axes.plot(times_s, sent, color=GREY, label="set-points")
    mean_s, half_s = sum(LAG_S) / 2, (LAG_S[1] - LAG_S[0]) / 2
    for lag_s, colour, label in (
        (np.full(len(times_s), LAG_S[0]), GREEN, f"response, lag {LAG_S[0]:g} s"),
        (np.full(len(times_s), LAG_S[1]), ORANGE, f"response, lag {LAG_S[1]:g} s"),
        (mean_s + half_s * np.sin(9.0 * times_s), RED, "response, varying lag"),
    ):
        axes.plot(times_s, _response(sent, lag_s), color=colour, linewidth=1.1, label=label)
    axes.set(xlabel="time [s]", ylabel="left_s1 [rad]", xlim=(0.0, 4.0))
    axes.legend()
    return figure


def _sent(motion: Trajectory, response: Response, times_s: FloatArray) -> FloatArray:
    """The set-points of the joint, shape (n,); the joint rests after the motion."""
    return np.asarray(response.command(motion, times_s).q[:, JOINT])


def _response(sent: FloatArray, lag_s: FloatArray) -> FloatArray:
    """The response of a first-order joint with this lag, shape (n,)."""
    y = np.empty(len(sent))
    y[0] = sent[0]
    for i in range(1, len(sent)):
        share = np.exp(-STEP_S / lag_s[i])
        y[i] = sent[i - 1] + (y[i - 1] - sent[i - 1]) * share
    return y
