"""Detour: the sideways motions of a pick and place, around what stands in the way.

First over it: up the line above one pose, straight in joint space to the line above the other, and
down, at the least of a few heights where that is clear. Else a free move (`planner.free_move`)
leads from line to line. Then the whole is cut short wherever that is clear: above the height from
which the arm may move sideways, nothing holds it to the lines. So it stops nowhere between grasp
and release unless there is no room for anything else.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Protocol, TypeAlias

import numpy as np
import pinocchio as pin

from baxter_kin import JointLimits
from baxter_kin.arrays import Vector
from planner.cycle import Cycle, StageError, at_stage
from planner.errors import MotionError
from planner.free_move import MARGIN_M, plan_free_move
from planner.lines import Lines, raised
from planner.manipulator import Manipulator
from planner.path_timing import plan_path_move
from planner.smoothing import blended
from planner.splicing import joined, section
from planner.straight_path import PathState, StraightPath, plan_straight_path
from planner.surroundings import Surroundings
from planner.timing import plan_joint_move
from planner.trajectory import Trajectory

TIMEOUT_S = 2.0
"""When to give up the search for one way around; a wall on the table takes a tenth of a second."""

RISES_M = (0.0, 0.1, 0.2, 0.3)
"""How far above the height where the cycle ends it is tried to pass over what is in the way."""

SLOWED = 0.97
"""Share of its speed at which a line is passed where it is left: the motions before and after can
then be planned apart, and both have room to keep the limits."""

HALVINGS = 40
"""Of the time in which a line is passed."""


@dataclass(frozen=True, slots=True, eq=False)
class Detour:
    """A cycle whose sideways motions go around what is in the way; see `planner.pick_place`.

    Attributes:
        manipulator: the arm and its hand.
        lines: where the cycle leads the tip.
        direct: the same cycle without obstacles; what is clear of it is kept.
        timeout_s: when to give up the search for one way around.
    """

    manipulator: Manipulator
    lines: Lines
    direct: Cycle
    timeout_s: float = TIMEOUT_S

    def entry(self, around: Surroundings) -> tuple[Trajectory, Trajectory]:
        """To the line above the pick, and down it.

        Raises:
            StageError: when there is no way.
        """
        direct = self.direct
        if around.is_clear(direct.to_pick):
            return direct.to_pick, direct.down_to_pick
        start = _Rest(direct.to_pick.q_start, self.manipulator.limits)
        goal = partial(self._line, direct.q_pick, self.lines.T_base_pick)
        with at_stage("pick: approach"):
            across, _, down = self._across("pick: approach", lambda _: start, goal, around)
        return across, down

    def transfer(self, around: Surroundings) -> tuple[Trajectory, Trajectory, Trajectory]:
        """Up from the pick, across, and down to the place.

        Raises:
            StageError: when there is no way.
        """
        direct, lines = self.direct, self.lines
        if around.is_clear(direct.to_place):
            return direct.up_from_pick, direct.to_place, direct.down_to_place
        start = partial(self._line, direct.q_pick, lines.T_base_pick)
        goal = partial(self._line, direct.q_place, lines.T_base_place)
        with at_stage("place: approach"):
            across, down_to_pick, down = self._across("place: approach", start, goal, around)
        return down_to_pick.reversed(), across, down

    @property
    def up_from_place(self) -> Trajectory:
        """From the place to where the cycle ends."""
        return self.direct.up_from_place

    def _across(
        self, stage: str, start_at: _EndAt, goal_at: _EndAt, around: Surroundings
    ) -> tuple[Trajectory, Trajectory, Trajectory]:
        """The way between two ends, and down from it to either; over what is there, or found."""
        for rise_m in RISES_M:
            height_m = self.lines.hover_m + rise_m
            try:
                start, goal = start_at(height_m), goal_at(height_m)
                over = plan_joint_move(start.q_top, goal.q_top, self.manipulator.limits)
            except MotionError:
                break  # out of reach, and more so higher up
            if all(around.is_clear(piece) for piece in (over, start.upper, goal.upper)):
                return _joined(start, over, goal, around)
        start, goal = (self._highest(end_at, around) for end_at in (start_at, goal_at))
        return _joined(start, self._found(stage, start, goal, around), goal, around)

    def _highest(self, end_at: _EndAt, around: Surroundings) -> _End:
        """From where the cycle may end, or just from the clear height if that is all."""
        try:
            end = end_at(self.lines.hover_m)
            if around.is_clear(end.upper):
                return end
        except MotionError:
            pass
        return end_at(self.lines.clear_m)

    def _line(self, q_target: Vector, T_base_target: pin.SE3, height_m: float) -> _Line:
        """The line to a pose from a height above it.

        Raises:
            MotionError: when the arm cannot follow it.
        """
        limits = self.manipulator.limits
        T_top = raised(T_base_target, height_m)
        path = plan_straight_path(self.manipulator.arm, q_target, T_top, limits).reversed()
        passed = max(0.0, 1.0 - self.lines.clear_m / height_m)
        return _Line(path, passed, plan_path_move(path, limits))

    def _found(self, stage: str, start: _End, goal: _End, around: Surroundings) -> Trajectory:
        found = plan_free_move(
            start.q_top,
            goal.q_top,
            self.manipulator.limits,
            around.space,
            around.is_clear,
            timeout_s=self.timeout_s,
            margin_m=around.margin_m + MARGIN_M,
        )
        if found.trajectory is None:
            raise StageError(stage, str(found.failure))
        return found.trajectory


class _End(Protocol):
    """Where a way around begins or ends: at rest at the top, or lower down in motion."""

    @property
    def q_top(self) -> Vector:
        """The configuration at the top, shape (7,), rad."""

    @property
    def upper(self) -> Trajectory:
        """From rest at the top to where the arm may no longer move sideways, nearly."""

    def split(self) -> tuple[Trajectory, Trajectory]:
        """The same exactly, and the rest of the way down."""


_EndAt: TypeAlias = Callable[[float], _End]
"""An end whose top is so many metres above its pose."""


@dataclass(frozen=True, slots=True, eq=False)
class _Rest:
    """Where the arm stands; it begins there at any height."""

    q_top: Vector
    limits: JointLimits

    @property
    def upper(self) -> Trajectory:
        return Trajectory.stay(self.q_top, self.limits)

    def split(self) -> tuple[Trajectory, Trajectory]:
        return self.upper, self.upper


@dataclass(frozen=True, slots=True, eq=False)
class _Line:
    """The way down a line to a pose, from rest to rest.

    Attributes:
        path: the configurations along it.
        passed: the fraction of it from where the arm may no longer move sideways; 0 where that is
            the top.
        motion: along all of it.
    """

    path: StraightPath
    passed: float
    motion: Trajectory

    @property
    def q_top(self) -> Vector:
        return self.motion.q_start

    @property
    def upper(self) -> Trajectory:
        return section(self.motion, 0.0, self._passed_s())

    def split(self) -> tuple[Trajectory, Trajectory]:
        if self.passed == 0.0:
            return self.upper, self.motion
        passing, limits = self._passing_state(), self.motion.limits
        upper = plan_path_move(self.path, limits, end=passing)
        return upper, plan_path_move(self.path, limits, start=passing)

    def _passing_state(self) -> PathState:
        """The motion where it passes, a little slowed down, so that it can be continued exactly."""
        _, tangent, bend, _ = self.path.at(self.passed)
        along = tangent / (tangent @ tangent)
        _, v, a = self.motion.sample(self._passed_s())
        speed = float(v @ along)
        acceleration = float((a - bend * speed**2) @ along)
        return PathState(self.passed, SLOWED * speed, SLOWED**2 * acceleration)

    def _passed_s(self) -> float:
        """When the motion passes that fraction."""
        if self.passed == 0.0:
            return 0.0
        q_passed, tangent, *_ = self.path.at(self.passed)
        early_s, late_s = 0.0, self.motion.duration
        for _ in range(HALVINGS):
            middle_s = (early_s + late_s) / 2
            is_before = (self.motion.sample(middle_s).q - q_passed) @ tangent < 0.0
            early_s, late_s = (middle_s, late_s) if is_before else (early_s, middle_s)
        return late_s


def _joined(
    start: _End, across: Trajectory, goal: _End, around: Surroundings
) -> tuple[Trajectory, Trajectory, Trajectory]:
    """The way from where one line may be left to where the other begins, and both descents.

    It stops in between only if all else would collide.
    """
    (start_upper, start_lower), (goal_upper, goal_lower) = start.split(), goal.split()
    pieces = start_upper.reversed(), across, goal_upper
    ends = pieces[0].q_start, pieces[-1].q_goal
    guarded = around.space.with_margin(around.margin_m + MARGIN_M, *ends)
    motion = blended(pieces, guarded.is_free, np.random.default_rng(0))
    return motion if around.is_clear(motion) else joined(pieces), start_lower, goal_lower
