"""The motions of a pick and place, for one choice of IK solutions; not checked for collision."""

from __future__ import annotations

from dataclasses import dataclass

import pinocchio as pin

from baxter_kin.arrays import Vector
from planner.approach import Approach, plan_entry, plan_transfer
from planner.choice import Choice
from planner.errors import MotionError
from planner.lines import Lines
from planner.manipulator import Manipulator
from planner.straight import plan_straight_move
from planner.trajectory import Trajectory


class UnreachableLineError(MotionError):
    """A line that the arm cannot follow in this family of configurations.

    Attributes:
        stage: whose line.
    """

    def __init__(self, stage: str, cause: MotionError) -> None:
        """At a stage."""
        self.stage = stage
        super().__init__(str(cause))


@dataclass(frozen=True, slots=True, eq=False)
class Cycle:
    """The motions in order, from rest to rest where the gripper acts; see `planner.pick_place`.

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
    def duration_s(self) -> float:
        """Of all of them."""
        return sum(motion.duration for motion in self.motions)

    @property
    def motions(self) -> tuple[Trajectory, ...]:
        """All of them, in order."""
        before = self.to_pick, self.down_to_pick, self.up_from_pick
        return *before, self.to_place, self.down_to_place, self.up_from_place


class Cycles:
    """Plans the cycles of a task; what several of them share is planned once."""

    def __init__(self, manipulator: Manipulator, q_start: Vector, lines: Lines) -> None:
        """For an arm that stands somewhere."""
        self._manipulator = manipulator
        self._q_start = q_start
        self._lines = lines
        self._approaches: dict[tuple[str, bytes], Approach] = {}

    def of(self, choice: Choice) -> Cycle:
        """The motions for a choice of solutions.

        Raises:
            UnreachableLineError: when the arm cannot follow a line from one of them.
            MotionError: when no motion joins the lines under the limits.
        """
        lines, limits = self._lines, self._manipulator.limits
        pick = self._approach("pick: descend", choice.q_pick, lines.T_base_above_pick)
        place = self._approach("place: descend", choice.q_place, lines.T_base_above_place)
        entry = plan_entry(self._q_start, pick, limits)
        transfer = plan_transfer(pick, place, limits)
        return Cycle(*entry, *transfer, self._end(place.q_target))

    def _approach(self, stage: str, q: Vector, T_base_above: pin.SE3) -> Approach:
        key = stage, q.tobytes()
        if key not in self._approaches:
            try:
                self._approaches[key] = Approach.of(self._manipulator, q, T_base_above)
            except MotionError as cause:
                raise UnreachableLineError(stage, cause) from cause
        return self._approaches[key]

    def _end(self, q_place: Vector) -> Trajectory:
        arm, limits = self._manipulator.arm, self._manipulator.limits
        try:
            return plan_straight_move(arm, q_place, self._lines.T_base_end, limits)
        except MotionError as cause:
            raise UnreachableLineError("place: retract", cause) from cause
