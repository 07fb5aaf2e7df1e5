"""Motion programs: their phases, their task, their unknowns, and the layout of their parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from baxter_kin import Arm, JointLimits
from baxter_kin.kinematics.dh_parameters import DHParameters
from baxter_kin.kinematics.symbolic import dimensions_of
from baxter_kin.validation import FloatArray, Indices
from planner.motion.straight_line import StraightLine

LINE_NUMBERS = 19
"""Initial position and rotation, displacement, axis and angle of the rotation."""

TILT_NUMBERS = 4
"""An axis seen from the tip, and 1 - cos of its maximum tilt."""

GEOMETRY_NUMBERS = 31 + 9 + 4
"""Dimensions of the chain, rotation of the tip, direction and offset of the vertical."""


@dataclass(frozen=True, slots=True, eq=False)
class Unknowns:
    """Indices of the unknowns; the joint angles of start and goal follow them.

    Attributes:
        count: number of unknowns.
        controls: of each phase, shape (n + 3, joints). Where the arm rests, three successive ones
            are the same.
        durations: of each phase, shape (phases,).
        fractions: of the line at each knot, shape (n + 1,); None for phases without a line.
    """

    count: int
    controls: tuple[Indices, ...]
    durations: Indices
    fractions: tuple[Indices | None, ...]

    @classmethod
    def of(cls, phases: Sequence[Phase], joints: int) -> Unknowns:
        """Number the unknowns, phase by phase."""
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
        total = count + 2 * joints  # with the angles of start and goal
        placed = tuple(np.where(where < 0, where + total, where) for where in controls)
        return cls(count, placed, np.array(durations), tuple(fractions))

    @property
    def joints(self) -> int:
        """Number of joints."""
        return int(self.controls[0].shape[1])

    @property
    def shape(self) -> tuple[int, int]:
        """Shape of the Hessian."""
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
        heights: m, one for each phase with a minimum height.
        tilt: the axis that stays upright and 1 - cos of its maximum tilt, 4 x 1.
        lines: `line_numbers` of each.
    """

    def __init__(self, phases: Sequence[Phase], joints: int) -> None:
        lines = 1 + max((phase.line for phase in phases if phase.line is not None), default=-1)
        heights = sum(phase.keeps_height for phase in phases)
        few = GEOMETRY_NUMBERS, 2, 4, heights, TILT_NUMBERS
        sizes = [2 * joints, 3 * joints, *few, *[LINE_NUMBERS] * lines]
        self.all = ca.MX.sym("numbers", sum(sizes))
        parts = ca.vertsplit(self.all, np.cumsum([0, *sizes]).tolist())
        self.q_ends, self.limits, self.geometry, self.tolerance, self.rates, *parts = parts
        self.heights, self.tilt, *self.lines = parts


def numbers_of(
    task: MotionTask, arm: Arm | None, limits: JointLimits, unit_s: float = 1.0
) -> FloatArray:
    """The values of the parameters; without an arm for a task without constraints on its tip.

    Times are in units of `unit_s`.
    """
    lines = [line_numbers(line, arm) for line in task.lines if arm is not None]
    geometry = np.zeros(GEOMETRY_NUMBERS) if arm is None else geometry_numbers(arm)
    bounds = limits.v_max * unit_s, limits.a_max * unit_s**2, limits.j_max * unit_s**3
    rates = np.array(task.rates) * np.tile([unit_s, unit_s**2], 2)
    few = np.array([*task.tolerance, *rates, *task.heights_m, *task.tilt])
    return np.concatenate([*ends_of(task), *bounds, geometry, few, *lines])


def ends_of(task: MotionTask) -> tuple[FloatArray, FloatArray]:
    """Start and goal, as they follow the unknowns."""
    return task.q_start, task.q_start if task.q_goal is None else task.q_goal


class Phase(NamedTuple):
    """One phase of a motion.

    Attributes:
        intervals: of its spline.
        line: number of the line that the tip follows; None where it is free.
        ends: fractions of the line at the start and at the end.
        rests: whether the arm rests at the end.
        at_goal: whether it rests there at the given configuration; its height on the way is then
            not bounded.
        enters: whether the tip has a given speed along its line at the start; for the first phase.
        leaves: the same at the end; for the last phase.
        may_sink: whether a phase without a line has no minimum height.
        keeps_upright: whether the axis of the task stays upright at the knots in between.
    """

    intervals: int
    line: int | None = None
    ends: tuple[float, float] = (0.0, 1.0)
    rests: bool = False
    at_goal: bool = False
    enters: bool = False
    leaves: bool = False
    may_sink: bool = False
    keeps_upright: bool = False

    @property
    def keeps_height(self) -> bool:
        """Whether its tip stays above a height."""
        return self.line is None and not self.at_goal and not self.may_sink


@dataclass(frozen=True, slots=True, eq=False)
class MotionTask:
    """The parameters of a problem.

    Attributes:
        q_start: initial configuration, shape (7,), rad.
        lines: those of the phases, by their numbers.
        tolerance: of the lines, at the knots, along and about each axis, m and rad.
        heights_m: minimum height of the tip in base, for each phase that keeps one.
        q_goal: final configuration at rest, if given, shape (7,), rad.
        rates: first and second time derivative of the fraction of the line where it is entered at
            speed, then where it is left.
        tilt: of the phases that keep upright: the axis that does, a unit vector seen from the tip,
            and 1 - cos of its maximum tilt.
    """

    q_start: FloatArray
    lines: tuple[StraightLine, ...] = ()
    tolerance: tuple[float, float] = (1.0, 1.0)
    heights_m: tuple[float, ...] = ()
    q_goal: FloatArray | None = None
    rates: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    tilt: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 1.0)


def line_numbers(line: StraightLine, arm: Arm) -> FloatArray:
    """The parameters of a line of the tip, shape (19,)."""
    first = _parameters(arm).T_base_first.inverse()
    start, way, turn = first * line.T_base_start, *np.split(line.twist, 2)
    angle = np.linalg.norm(turn)
    axis = turn / angle if angle > 0.0 else np.array([0.0, 0.0, 1.0])
    parts = start.translation, start.rotation.ravel("F"), first.rotation @ way
    return np.concatenate([*parts, first.rotation @ axis, [angle]])


_parameters = lru_cache(maxsize=8)(DHParameters.of)


def geometry_numbers(arm: Arm) -> FloatArray:
    """The parameters of an arm, shape (44,)."""
    dh = _parameters(arm)
    up = np.append(dh.T_base_first.rotation[2], dh.T_base_first.translation[2])
    return np.concatenate([dimensions_of(dh), dh.T_last_tip.rotation.ravel("F"), up])
