"""The continuous proof at work: one pair, its distance, and what is proven in each interval."""

from __future__ import annotations

from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from baxter_kin.validation import FloatArray
from docs.figures.demo import demo_arm, demo_plan, demo_scene
from docs.figures.style import BLUE, GREY, ORANGE
from planner.collision.continuous.motion import ArmShapeMotion
from planner.collision.continuous.proof import FIRST_INTERVALS
from planner.trajectory import joined

PAIR = ("l_gripper_l_finger_tip", "table")
SHALL_M = 0.018
"""What is to be proven."""

WANTED = "shall be proven"


class Interval(NamedTuple):
    """An interval, and what it says of the pair."""

    start_s: float
    end_s: float
    distance_m: float
    proven_m: float


class Pair:
    """Distances and motions of one pair while the arm comes to the block."""

    def __init__(self) -> None:
        arm, trajectory = demo_arm(), joined(move.trajectory for move in demo_plan().moves[:2])
        checker = arm.context(demo_scene()).checker
        self.motion = ArmShapeMotion(checker, trajectory, arm.q_others)
        self.checked = checker.checked
        clearances = (
            (self.checked.between(number, 0.0), number) for number in range(len(checker.pairs))
        )
        self.numbers = [
            number for each, number in clearances if {each.first, each.second} == set(PAIR)
        ]

    def measured(self, starts_s: FloatArray, ends_s: FloatArray) -> list[Interval]:
        """Distances in the middle of intervals, less what the motion in them may take away."""
        around, found = self.motion.around(starts_s, ends_s), []
        for k, (start_s, end_s) in enumerate(zip(starts_s, ends_s, strict=True)):
            self.checked.distances.place(around.poses[k])
            each = [(self.checked.distances.measure(number), number) for number in self.numbers]
            distance_m = min(each)[0]
            proven_m = min(
                measured - float(around.motions_m(np.array([k]), np.array([number]))[0])
                for measured, number in each
            )
            found.append(Interval(float(start_s), float(end_s), distance_m, proven_m))
        return found

    def halved(self) -> list[list[Interval]]:
        """Level by level, until in each interval enough is proven."""
        cuts = np.linspace(0.0, self.motion.duration_s, FIRST_INTERVALS + 1)
        starts_s, ends_s, levels = cuts[:-1], cuts[1:], []
        while len(starts_s):
            levels.append(self.measured(starts_s, ends_s))
            left = [each for each in levels[-1] if each.proven_m <= SHALL_M]
            middles_s = np.array([(each.start_s + each.end_s) / 2 for each in left])
            starts_s = np.sort(np.concatenate([[each.start_s for each in left], middles_s]))
            ends_s = np.sort(np.concatenate([middles_s, [each.end_s for each in left]]))
        return levels


def draw() -> Figure:
    """The way from the start to the pick."""
    pair = Pair()
    levels = pair.halved()
    figure, (top, bottom) = plt.subplots(
        2, 1, figsize=(8, 5.6), sharex=True, height_ratios=(3, 1.4)
    )
    times_s = np.linspace(0.0, pair.motion.duration_s, 300)
    distance = [each.distance_m for each in pair.measured(times_s, times_s)]
    top.plot(times_s, 1e3 * np.array(distance), color=BLUE, label="distance of the pair")
    enough = [each for level in levels for each in level if each.proven_m > SHALL_M]
    for number, each in enumerate(sorted(enough)):
        label = "proven in each interval" if number == 0 else None
        span_s = [each.start_s, each.end_s]
        top.plot(span_s, [1e3 * each.proven_m] * 2, color=ORANGE, linewidth=2.2, label=label)
    top.axhline(1e3 * SHALL_M, color=GREY, linestyle="--", linewidth=1.0, label=WANTED)
    for depth, level in enumerate(levels):
        for each in level:
            colour = ORANGE if each.proven_m > SHALL_M else "#e8eaed"
            bottom.barh(
                -depth,
                each.end_s - each.start_s,
                left=each.start_s,
                color=colour,
                edgecolor="white",
            )
    top.set(ylabel="distance [mm]", title=f"{PAIR[0]} and {PAIR[1]}", ylim=(0.0, 420.0))
    top.legend()
    bottom.set(xlabel="time [s]", ylabel="times halved", yticks=[-d for d in range(len(levels))])
    bottom.set(yticklabels=range(len(levels)))
    bottom.grid(visible=False)
    return figure
