"""The motions of a pick and place, and those of one that stops wherever it turns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import pinocchio as pin

from baxter_kin.arrays import Vector
from planner.context import CollisionContext
from planner.errors import MotionError
from planner.lines import Lines
from planner.manipulator import Manipulator
from planner.motion.straight_move import plan_straight_move
from planner.plan import PlanFailure
from planner.plan_builder import NoSolutionError, free_motion
from planner.straight_line import LineTolerance
from planner.swept_result import SweptContact
from planner.trajectory import Trajectory

TIMEOUT_S = 2.0
"""When to give up the search for one way around; a wall on the table takes a tenth of a second."""


@dataclass(frozen=True, slots=True, eq=False)
class Cycle:
    """The motions in order, from rest to rest where the gripper acts.

    Attributes:
        to_pick: to the line above the pick.
        down_to_pick: down it, to rest.
        up_from_pick: up again.
        to_place: to the line above the place.
        down_to_place: down it, to rest.
        up_from_place: up to where the cycle ends.
    """

    to_pick: Trajectory
    down_to_pick: Trajectory
    up_from_pick: Trajectory
    to_place: Trajectory
    down_to_place: Trajectory
    up_from_place: Trajectory

    @property
    def by_stage(self) -> dict[str, Trajectory]:
        """The motions by the labels of their moves."""
        return {
            "pick: approach": self.to_pick,
            "pick: descend": self.down_to_pick,
            "pick: retract": self.up_from_pick,
            "place: approach": self.to_place,
            "place: descend": self.down_to_place,
            "place: retract": self.up_from_place,
        }

    @property
    def q_pick(self) -> Vector:
        """The configuration at the pick, shape (7,), rad."""
        return self.down_to_pick.q_goal

    @property
    def q_place(self) -> Vector:
        """The configuration at the place, shape (7,), rad."""
        return self.down_to_place.q_goal

    @property
    def duration_s(self) -> float:
        """Of all of them."""
        return sum(motion.duration for motion in self.by_stage.values())


def refuse_colliding(stage: str, motion: Trajectory, around: CollisionContext) -> None:
    """Stop when a motion collides at samples; quick, and no proof that it does not.

    Raises:
        NoSolutionError: then; says with what.
    """
    if not around.looks_clear(motion):
        result = around.prove(motion)
        if isinstance(result, SweptContact):
            raise NoSolutionError(PlanFailure(stage, str(result), contact=result))


class StoppingCycles:
    """Cycles that stop above pick and place; their lines are planned once for each solution."""

    def __init__(
        self,
        manipulator: Manipulator,
        q_start: Vector,
        lines: Lines,
        around: Mapping[str, CollisionContext],
        line_tolerance: LineTolerance | None = None,
    ) -> None:
        self._line_tolerance = line_tolerance
        self._manipulator, self._q_start = manipulator, q_start
        self._lines, self._around = lines, around
        self._planned: dict[tuple[str, bytes], Trajectory | NoSolutionError] = {}

    def of(self, q_pick: Vector, q_place: Vector) -> Cycle:
        """The motions for a pair of solutions, those between the lines around what is there.

        Raises:
            NoSolutionError: when the arm cannot follow a line from one of them, a line collides, or
                there is no way between.
        """
        lines = self._lines
        up_pick = self._line("pick: retract", q_pick, lines.T_base_above_pick)
        up_place = self._line("place: descend", q_place, lines.T_base_above_place)
        up_end = self._line("place: retract", q_place, lines.T_base_end)
        down_pick, down_place = up_pick.reversed(), up_place.reversed()
        for stage, motion in (
            ("pick: descend", down_pick),
            ("place: descend", down_place),
            ("place: retract", up_end),
        ):
            refuse_colliding(stage, motion, self._around[stage])
        to_pick, to_place = (
            free_motion(stage, ends, self._manipulator, self._around[stage], TIMEOUT_S)
            for stage, ends in (
                ("pick: approach", (self._q_start, down_pick.q_start)),
                ("place: approach", (up_pick.q_goal, down_place.q_start)),
            )
        )
        return Cycle(to_pick, down_pick, up_pick, to_place, down_place, up_end)

    def _line(self, stage: str, q: Vector, T_base_top: pin.SE3) -> Trajectory:
        key = stage, q.tobytes()
        if key not in self._planned:
            arm, limits = self._manipulator.arm, self._manipulator.limits
            try:
                self._planned[key] = plan_straight_move(
                    arm, q, T_base_top, limits, line_tolerance=self._line_tolerance
                )
            except MotionError as cause:
                self._planned[key] = NoSolutionError.at(stage, str(cause))
        found = self._planned[key]
        if isinstance(found, NoSolutionError):
            raise found
        return found
