"""What a motion program solves for, and what it is given: where each number stands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from baxter_kin import Arm, JointLimits
from baxter_kin.validation import FloatArray, Indices
from planner.collision.obstacles import JOINTS, PAIRS
from planner.motion.program.nodes import (
    GEOMETRY_NUMBERS,
    LINE_NUMBERS,
    geometry_numbers,
    line_numbers,
)
from planner.motion.program.phases import MotionTask, Phase

GIVEN = 2 * JOINTS
"""Angles of start and goal."""


@dataclass(frozen=True, slots=True, eq=False)
class Unknowns:
    """Which unknown stands where; behind them, as if they were some, the angles of start and goal.

    Attributes:
        count: how many unknowns there are.
        controls: of each phase, shape (n + 3, 7). Where the arm rests, three in a row are one.
        durations: of each phase, shape (phases,).
        fractions: of the line at each knot, shape (n + 1,); None for phases without a line.
        shortfalls: of clearance in each interval of all phases, m, shape (intervals,); none where
            clearance is not asked for.
    """

    count: int
    controls: tuple[Indices, ...]
    durations: Indices
    fractions: tuple[Indices | None, ...]
    shortfalls: Indices

    @classmethod
    def of(cls, phases: Sequence[Phase], *, keeps_clear: bool = False) -> Unknowns:
        """Number them, phase by phase."""
        count = 0

        def new(*shape: int) -> Indices:
            nonlocal count
            first, count = count, count + int(np.prod(shape))
            return np.arange(first, count).reshape(shape)

        controls, durations, fractions = [], [], []
        start, goal = np.split(np.arange(-GIVEN, 0), 2)  # counted from the end
        resting: Indices | None = None if phases[0].enters else start
        for phase in phases:
            begin = _thrice(resting)
            resting = goal if phase.at_goal else new(JOINTS) if phase.rests else None
            end = _thrice(resting)
            inner = new(phase.intervals + 3 - len(begin) - len(end), JOINTS)
            controls.append(np.concatenate([begin, inner, end]))
            durations.append(int(new(1)[0]))
            fractions.append(None if phase.line is None else new(phase.intervals + 1))
        shortfalls = new(sum(phase.intervals for phase in phases) if keeps_clear else 0)
        known = count + GIVEN
        placed = tuple(np.where(where < 0, where + known, where) for where in controls)
        return cls(count, placed, np.array(durations), tuple(fractions), shortfalls)

    @property
    def shape(self) -> tuple[int, int]:
        """Of second derivatives."""
        return self.count, self.count


def _thrice(controls: Indices | None) -> Indices:
    """Three controls that are one, shape (3, 7), or none at all, shape (0, 7)."""
    if controls is None:
        return np.zeros((0, JOINTS), dtype=np.intp)
    return np.tile(controls, (3, 1))


class Numbers:
    """The parameters of a program, as symbols.

    Attributes:
        all: in a column.
        q_ends: angles of start and goal, 14 x 1.
        limits: of velocity, acceleration and jerk, 21 x 1.
        geometry: `geometry_numbers`.
        tolerance: of lines, m and rad, 2 x 1.
        rates: where a line is entered and left at speed, 4 x 1.
        heights: m, one for each phase that keeps one.
        lines: `line_numbers` of each.
        weights: of the controls where clearance is asked for, 4 x intervals.
        clearances: slopes by the joints and offsets, 8 x (`PAIRS` for each interval).
    """

    def __init__(self, phases: Sequence[Phase], clear: int = 0) -> None:
        lines = 1 + max((phase.line for phase in phases if phase.line is not None), default=-1)
        heights = sum(phase.keeps_height for phase in phases)
        fixed = GIVEN, 3 * JOINTS, GEOMETRY_NUMBERS, 2, 4, heights, *[LINE_NUMBERS] * lines
        sizes = *fixed, 4 * clear, (JOINTS + 1) * PAIRS * clear
        self.all = ca.MX.sym("numbers", sum(sizes))
        *parts, weights, clearances = ca.vertsplit(self.all, np.cumsum([0, *sizes]).tolist())
        self.q_ends, self.limits, self.geometry, self.tolerance, self.rates, *parts = parts
        self.heights, *self.lines = parts
        self.weights = ca.reshape(weights, 4, clear)
        self.clearances = ca.reshape(clearances, JOINTS + 1, PAIRS * clear)


def numbers_of(
    task: MotionTask, arm: Arm | None, limits: JointLimits, unit_s: float = 1.0
) -> FloatArray:
    """The parameters themselves; without an arm for a task that asks nothing of its tip.

    Times are in a unit.
    """
    lines = [line_numbers(line, arm) for line in task.lines if arm is not None]
    geometry = np.zeros(GEOMETRY_NUMBERS) if arm is None else geometry_numbers(arm)
    bounds = limits.v_max * unit_s, limits.a_max * unit_s**2, limits.j_max * unit_s**3
    rates = np.array(task.rates) * np.tile([unit_s, unit_s**2], 2)
    few = np.array([*task.tolerance, *rates, *task.heights_m])
    return np.concatenate([*ends_of(task), *bounds, geometry, few, *lines])


def ends_of(task: MotionTask) -> tuple[FloatArray, FloatArray]:
    """Start and goal as they stand behind the unknowns."""
    return task.q_start, task.q_start if task.q_goal is None else task.q_goal
