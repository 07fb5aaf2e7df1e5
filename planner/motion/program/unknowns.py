"""What a motion program solves for, and what it is given: where each number stands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from baxter_kin import Arm, JointLimits
from baxter_kin.validation import FloatArray, Indices
from planner.motion.program.nodes import (
    GEOMETRY_NUMBERS,
    LINE_NUMBERS,
    geometry_numbers,
    line_numbers,
)
from planner.motion.program.phases import MotionTask, Phase


@dataclass(frozen=True, slots=True, eq=False)
class Unknowns:
    """Which unknown stands where; behind them, as if they were some, the angles of start and goal.

    Attributes:
        count: how many unknowns there are.
        controls: of each phase, shape (n + 3, joints). Where the arm rests, three in a row are one.
        durations: of each phase, shape (phases,).
        fractions: of the line at each knot, shape (n + 1,); None for phases without a line.
    """

    count: int
    controls: tuple[Indices, ...]
    durations: Indices
    fractions: tuple[Indices | None, ...]

    @classmethod
    def of(cls, phases: Sequence[Phase], joints: int) -> Unknowns:
        """Number them, phase by phase."""
        count = 0

        def new(*shape: int) -> Indices:
            nonlocal count
            first, count = count, count + int(np.prod(shape))
            return np.arange(first, count).reshape(shape)

        controls, durations, fractions = [], [], []
        start, goal = np.arange(-2 * joints, 0).reshape(2, 1, joints)  # counted from the end
        none = np.zeros((0, joints), dtype=np.intp)
        resting = none if phases[0].enters else start
        for phase in phases:
            begin = np.repeat(resting, 3, axis=0)
            resting = goal if phase.at_goal else new(1, joints) if phase.rests else none
            end = np.repeat(resting, 3, axis=0)
            inner = new(phase.intervals + 3 - len(begin) - len(end), joints)
            controls.append(np.concatenate([begin, inner, end]))
            durations.append(int(new(1)[0]))
            fractions.append(None if phase.line is None else new(phase.intervals + 1))
        known = count + 2 * joints
        placed = tuple(np.where(where < 0, where + known, where) for where in controls)
        return cls(count, placed, np.array(durations), tuple(fractions))

    @property
    def joints(self) -> int:
        """How many joints there are."""
        return int(self.controls[0].shape[1])

    @property
    def shape(self) -> tuple[int, int]:
        """Of second derivatives."""
        return self.count, self.count


class Numbers:
    """The parameters of a program, as symbols.

    Attributes:
        all: in a column.
        q_ends: angles of start and goal, two for each joint.
        limits: of velocity, acceleration and jerk, three for each joint.
        geometry: `geometry_numbers`.
        tolerance: of lines, m and rad, 2 x 1.
        rates: where a line is entered and left at speed, 4 x 1.
        heights: m, one for each phase that keeps one.
        lines: `line_numbers` of each.
    """

    def __init__(self, phases: Sequence[Phase], joints: int) -> None:
        lines = 1 + max((phase.line for phase in phases if phase.line is not None), default=-1)
        heights = sum(phase.keeps_height for phase in phases)
        sizes = [2 * joints, 3 * joints, GEOMETRY_NUMBERS, 2, 4, heights, *[LINE_NUMBERS] * lines]
        self.all = ca.MX.sym("numbers", sum(sizes))
        parts = ca.vertsplit(self.all, np.cumsum([0, *sizes]).tolist())
        self.q_ends, self.limits, self.geometry, self.tolerance, self.rates, *parts = parts
        self.heights, *self.lines = parts


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
