"""The stages of a pick and place, drafted for one choice of IK solutions.

```
pick    open - approach - descend - close - retract
place   approach - descend - open - retract
```
"""

from __future__ import annotations

from planner.cycle import Route
from planner.draft import Draft
from planner.lines import Lines
from planner.plan import GripperAction

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
PICK_LINES = ("pick: descend", "pick: retract")
PLACE_LINES = ("place: descend", "place: retract")


def reach_waypoints(draft: Draft, lines: Lines) -> None:
    """Whether every waypoint can be reached at all; nothing moves.

    Raises:
        NoSolutionError: when one cannot.
    """
    draft.reach("pick: approach", lines.T_base_above_pick)
    draft.reach("pick: descend", lines.T_base_pick)
    draft.reach("place: approach", lines.T_base_above_place)
    draft.reach("place: descend", lines.T_base_place)
    draft.reach("place: retract", lines.T_base_end)


def draft_cycle(draft: Draft, body: str, lines: Lines, route: Route) -> None:
    """Every step, each move proven clear.

    Raises:
        NoSolutionError: when a stage has no solution.
        StageError: when the route has no motion for one.
    """
    target = draft.body(body)
    draft.refuse_wide("pick: open", lines.T_base_pick, target)
    draft.grip("pick: open", GripperAction.OPEN)
    to_pick, down_to_pick = route.entry(draft.surroundings())
    draft.pass_by("pick: approach", to_pick, lines.T_base_above_pick)
    draft.descend("pick: descend", down_to_pick, lines.T_base_pick)
    draft.grasp("pick: close", target, lines.T_base_pick, lines.T_base_place)
    up_from_pick, to_place, down_to_place = route.transfer(draft.surroundings(free=True))
    draft.rise("pick: retract", up_from_pick, lines.T_base_above_pick)
    draft.pass_by("place: approach", to_place, lines.T_base_above_place)
    draft.descend("place: descend", down_to_place, lines.T_base_place)
    draft.release("place: open", lines.T_base_place)
    draft.rise("place: retract", route.up_from_place, lines.T_base_end)
