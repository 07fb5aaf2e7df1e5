"""The stages of a pick and place, its motions, and those of one that stops wherever it turns.

```
pick    open - approach - descend - close - retract
place   approach - descend - open - retract
```
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import pinocchio as pin

from baxter_kin.validation import FloatArray
from planner.collision.context import CollisionContext
from planner.errors import MotionError
from planner.motion.straight_move import plan_straight_move
from planner.pick_place.plan_builder import NoSolutionError, free_motion, proven
from planner.pick_place.task import PickAndPlace, PlanRequest
from planner.trajectory import Trajectory

PICK_LINES = ("pick: descend", "pick: close", "pick: retract")
PLACE_LINES = ("place: descend", "place: open", "place: retract")
SIDEWAYS = ("pick: approach", "place: approach")
"""Stages in which the tip is free; the other moves are along lines."""

STAGES = ("pick: open", SIDEWAYS[0], *PICK_LINES, SIDEWAYS[1], *PLACE_LINES)
"""All of them, in order."""

MOVES = tuple(each for each in STAGES if each not in ("pick: open", "pick: close", "place: open"))
"""Those in which the arm moves."""

TIMEOUT_S = 2.0
"""When to give up the search for one way around; a wall on the table takes a tenth of a second."""


class Cycle(NamedTuple):
    """The motions in the order of `MOVES`, from rest to rest where the gripper acts.

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
        return dict(zip(MOVES, self, strict=True))

    @property
    def q_pick(self) -> FloatArray:
        """The configuration at the pick, shape (7,), rad."""
        return self.down_to_pick.q_goal

    @property
    def q_place(self) -> FloatArray:
        """The configuration at the place, shape (7,), rad."""
        return self.down_to_place.q_goal

    @property
    def duration_s(self) -> float:
        """Of all of them."""
        return sum(motion.duration for motion in self)


class StoppingCycles:
    """Cycles that stop above pick and place; their lines are planned once for each solution."""

    def __init__(
        self, request: PlanRequest, task: PickAndPlace, contexts: Mapping[str, CollisionContext]
    ) -> None:
        """For a task, in the situations of the stages, by their labels."""
        self._request, self._task, self._contexts = request, task, contexts
        self._planned: dict[tuple[str, bytes], Trajectory | NoSolutionError] = {}

    def of(self, q_pick: FloatArray, q_place: FloatArray) -> Cycle:
        """The motions for a pair of solutions, those between the lines around what is there.

        Raises:
            NoSolutionError: when the arm cannot follow a line from one of them, a line collides, or
                there is no way between.
        """
        task, contexts, q_start = self._task, self._contexts, self._request.q_start
        up_pick = self._line("pick: retract", q_pick, task.T_base_above_pick)
        up_place = self._line("place: descend", q_place, task.T_base_above_place)
        up_end = self._line("place: retract", q_place, task.T_base_end)
        down_pick, down_place = up_pick.reversed(), up_place.reversed()
        for stage, motion in (
            ("pick: descend", down_pick),
            ("place: descend", down_place),
            ("place: retract", up_end),
        ):
            proven(stage, motion, contexts[stage])
        to_pick, to_place = (
            free_motion(stage, ends, self._request.manipulator, contexts[stage], TIMEOUT_S)
            for stage, ends in (
                ("pick: approach", (q_start, down_pick.q_start)),
                ("place: approach", (up_pick.q_goal, down_place.q_start)),
            )
        )
        return Cycle(to_pick, down_pick, up_pick, to_place, down_place, up_end)

    def _line(self, stage: str, q: FloatArray, T_base_top: pin.SE3) -> Trajectory:
        key = stage, q.tobytes()
        if key not in self._planned:
            arm, limits = self._request.manipulator.arm, self._request.manipulator.limits
            tolerance = self._request.line_tolerance
            try:
                self._planned[key] = plan_straight_move(
                    arm, q, T_base_top, limits, line_tolerance=tolerance
                )
            except MotionError as cause:
                self._planned[key] = NoSolutionError.at(stage, str(cause))
        found = self._planned[key]
        if isinstance(found, NoSolutionError):
            raise found
        return found
