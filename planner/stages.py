"""The stages of a pick and place, built from its motions.

```
pick    open - approach - descend - close - retract
place   approach - descend - open - retract
```
"""

from __future__ import annotations

import pinocchio as pin

from planner.cycle import Cycle
from planner.lines import Lines
from planner.phases import Phases
from planner.plan import GripperAction
from planner.plan_builder import PlanBuilder
from planner.trajectory import Trajectory

STAGES = (
    "pick: open",
    "pick: approach",
    "pick: descend",
    "pick: close",
    "pick: retract",
    "place: approach",
    "place: descend",
    "place: open",
    "place: retract",
)
SIDEWAYS = ("pick: approach", "place: approach")
"""Those in which the tip is free; the other moves are along lines."""

PICK_LINES = ("pick: descend", "pick: close", "pick: retract")
PLACE_LINES = ("place: descend", "place: open", "place: retract")


def build_cycle(builder: PlanBuilder, lines: Lines, phases: Phases, cycle: Cycle) -> None:
    """Every step, each proven clear.

    Raises:
        NoSolutionError: when one is not.
    """
    around, body = phases.around, phases.body.name

    def move(label: str, trajectory: Trajectory, T_base_tip: pin.SE3) -> None:
        is_straight = label not in SIDEWAYS
        builder.add_move(label, trajectory, around[label], T_base_tip, is_straight=is_straight)

    builder.add_open("pick: open", phases.opening_m)
    move("pick: approach", cycle.to_pick, lines.T_base_above_pick)
    move("pick: descend", cycle.down_to_pick, lines.T_base_pick)
    builder.add_grip("pick: close", GripperAction.CLOSE, phases.closing, body)
    move("pick: retract", cycle.up_from_pick, lines.T_base_above_pick)
    move("place: approach", cycle.to_place, lines.T_base_above_place)
    move("place: descend", cycle.down_to_place, lines.T_base_place)
    builder.add_grip("place: open", GripperAction.OPEN, phases.releasing, body)
    move("place: retract", cycle.up_from_place, lines.T_base_end)
