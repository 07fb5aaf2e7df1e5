"""The motions of a pick and place, for one choice of IK solutions; not checked for collision."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

import pinocchio as pin

from baxter_kin.arrays import Vector
from planner.approach import Approach, plan_entry, plan_transfer
from planner.choice import Choice
from planner.errors import MotionError, TrajectoryError
from planner.lines import Lines
from planner.manipulator import Manipulator
from planner.straight import plan_straight_move
from planner.surroundings import Surroundings
from planner.trajectory import Trajectory


class StageError(MotionError):
    """A motion that there is none for, with the stage that it belongs to.

    Attributes:
        stage: label of the move.
    """

    def __init__(self, stage: str, reason: str) -> None:
        """At a stage."""
        self.stage = stage
        super().__init__(reason)


class Route(Protocol):
    """Where the motions of a pick and place come from, stage by stage."""

    @property
    def up_from_place(self) -> Trajectory:
        """From the place to where the cycle ends."""

    def entry(self, around: Surroundings) -> tuple[Trajectory, Trajectory]:
        """To the line above the pick, and down it; `around` is the situation before the grasp.

        Raises:
            StageError: when there is none.
        """

    def transfer(self, around: Surroundings) -> tuple[Trajectory, Trajectory, Trajectory]:
        """Up, across, and down to the place; `around` is the situation with the body in the hand.

        Raises:
            StageError: when there is none.
        """


@dataclass(frozen=True, slots=True, eq=False)
class Cycle:
    """The direct route: the motions in order, from rest to rest where the gripper acts.

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

    def entry(self, around: Surroundings) -> tuple[Trajectory, Trajectory]:  # noqa: ARG002
        """To the line above the pick, and down it, whatever stands around."""
        return self.to_pick, self.down_to_pick

    def transfer(
        self,
        around: Surroundings,  # noqa: ARG002
    ) -> tuple[Trajectory, Trajectory, Trajectory]:
        """Up, across, and down to the place, whatever stands around."""
        return self.up_from_pick, self.to_place, self.down_to_place

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


class Cycles:
    """Plans the cycles of a task; what several of them share is planned once."""

    def __init__(self, manipulator: Manipulator, q_start: Vector, lines: Lines) -> None:
        """For an arm that stands somewhere."""
        self._manipulator = manipulator
        self._q_start = q_start
        self._lines = lines
        self._approaches: dict[tuple[str, bytes], Approach] = {}
        self._ends: dict[bytes, Trajectory] = {}

    def of(self, choice: Choice) -> Cycle:
        """The motions for a choice of solutions.

        Raises:
            StageError: when the arm cannot follow a line from one of them, or no motion joins the
                lines under the limits.
        """
        lines, limits = self._lines, self._manipulator.limits
        pick = self._approach("pick: descend", choice.q_pick, lines.T_base_above_pick)
        place = self._approach("place: descend", choice.q_place, lines.T_base_above_place)
        with at_stage("pick: approach"):
            entry = plan_entry(self._q_start, pick, limits)
        with at_stage("place: approach"):
            transfer = plan_transfer(pick, place, limits)
        return Cycle(*entry, *transfer, self._end(place.q_target))

    def _approach(self, stage: str, q: Vector, T_base_above: pin.SE3) -> Approach:
        key = stage, q.tobytes()
        if key not in self._approaches:
            with at_stage(stage):
                self._approaches[key] = Approach.of(self._manipulator, q, T_base_above)
        return self._approaches[key]

    def _end(self, q_place: Vector) -> Trajectory:
        arm, limits, key = self._manipulator.arm, self._manipulator.limits, q_place.tobytes()
        if key not in self._ends:
            with at_stage("place: retract"):
                T_base_end = self._lines.T_base_end
                self._ends[key] = plan_straight_move(arm, q_place, T_base_end, limits)
        return self._ends[key]


@contextmanager
def at_stage(stage: str) -> Iterator[None]:
    """Says which stage an impossible motion belongs to."""
    try:
        yield
    except StageError:
        raise
    except (MotionError, TrajectoryError) as cause:
        raise StageError(stage, str(cause)) from cause
