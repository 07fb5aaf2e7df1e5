"""Rows at work: the distance of one pair, and what each cell of time is certified to keep."""

from __future__ import annotations

from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from baxter_kin.validation import FloatArray
from docs.figures.demo import demo_arm, demo_plan, demo_scene
from docs.figures.style import BLUE, ORANGE
from planner.certificate.body import Body
from planner.certificate.checking import Witness
from planner.certificate.robot import Robot
from planner.certificate.rows import BY_MIDDLES, Advice, Judge, Tasks
from planner.certificate.timeline import Timeline
from planner.plan_file import plan_document
from planner.trajectory import Trajectory
from planner.verification import certificate_of

FINGER, BODY = "l_gripper_l_finger", "table"
STEPS = 2
"""How many moves of the plan are shown: to the pick, and down."""


class Cell(NamedTuple):
    """A cell of time, how often time was halved for it, and what all its rows keep."""

    start_s: float
    end_s: float
    depth: int
    kept_m: float


def draw() -> Figure:
    """The way from the start to the pick."""
    cells, moves = certified_cells(), [move.trajectory for move in demo_plan().moves[:STEPS]]
    figure, (top, bottom) = plt.subplots(
        2, 1, figsize=(8, 5.6), sharex=True, height_ratios=(3, 1.4)
    )
    times_s, distances_m = measured(moves)
    top.plot(times_s, 1e3 * distances_m, color=BLUE, label="distance of the pair")
    for number, cell in enumerate(cells):
        label = "certified in each cell" if number == 0 else None
        span_s, kept_mm = [cell.start_s, cell.end_s], 1e3 * cell.kept_m
        top.plot(span_s, [kept_mm] * 2, color=ORANGE, linewidth=2.2, label=label)
        width_s = cell.end_s - cell.start_s
        bottom.barh(-cell.depth, width_s, left=cell.start_s, color=ORANGE, edgecolor="white")
    depths = range(max(cell.depth for cell in cells) + 1)
    top.set(ylabel="distance [mm]", title=f"{FINGER} and {BODY}", ylim=(0.0, 420.0))
    top.legend()
    bottom.set(xlabel="time [s]", ylabel="times halved", yticks=[-d for d in depths])
    bottom.set(yticklabels=depths)
    bottom.grid(visible=False)
    return figure


def certified_cells() -> list[Cell]:
    """The cells of the pair, as the checker follows them."""
    plan, text = demo_plan(), demo_arm().robot.description.text
    witness, document = Witness.of_file(certificate_of(plan)), plan_document(plan)
    robot, states = Robot(text, plan.limb), document["states"]
    timeline = Timeline(document["plan"], states, robot, Body(text), witness.steps)
    advice, cells, begin_s = Advice(witness.trace), list[Cell](), 0.0
    labels = [move.label for move in plan.moves[:STEPS]]
    for step in timeline.steps:
        judge = Judge(robot, timeline.clusters, step)
        levels = list(judge.rows(advice))
        if step.label not in labels:
            continue
        pairs = [
            number
            for number, pair in enumerate(step.pairs)
            if (pair.first.name, pair.second.name) == (FINGER, BODY)
        ]
        tasks = Tasks.joined([level[0] for level in levels])
        letters, n = (np.concatenate([level[i] for level in levels]) for i in (1, 2))
        judge.place(np.unique(np.concatenate([tasks.start_s, tasks.end_s])))
        n = np.where((letters == BY_MIDDLES)[:, None], judge.between_middles(tasks), n)
        gaps_m = judge.gaps_m(tasks, n)
        rows = np.flatnonzero(np.isin(tasks.pair, pairs))
        spans = {(float(tasks.start_s[i]), float(tasks.end_s[i])) for i in rows}
        for start_s, end_s in sorted(spans):
            within = rows[(tasks.start_s[rows] <= start_s) & (tasks.end_s[rows] >= end_s)]
            depth = round(np.log2(step.duration_s / (end_s - start_s)))
            kept_m = float(gaps_m[within].min())
            cells.append(Cell(begin_s + start_s, begin_s + end_s, depth, kept_m))
        begin_s += step.duration_s
    return cells


def measured(moves: list[Trajectory]) -> tuple[FloatArray, FloatArray]:
    """Times, and coal's distances of finger and body then."""
    arm = demo_arm()
    checker = arm.context(demo_scene()).checker
    every = range(len(checker.pairs))
    names = {number: checker.checked.between(number, 0.0) for number in every}
    numbers = [
        number
        for number, each in names.items()
        if each.first.startswith(FINGER) and each.second == BODY
    ]
    times_s, distances_m, begin_s = [], [], 0.0
    for move in moves:
        at = np.linspace(0.0, move.duration, 150)
        for time_s, q in zip(at.tolist(), move.sample(at).q, strict=True):
            full = arm.q_others.copy()
            full[checker.motion_bounds.q_index] = q
            times_s.append(begin_s + time_s)
            distances_m.append(min(checker.distances_m(full, numbers)))
        begin_s += move.duration
    return np.array(times_s), np.array(distances_m)
