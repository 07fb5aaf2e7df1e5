"""Checks of distances: what is clear, what touches on purpose, and how."""

from __future__ import annotations

from collections.abc import Iterator

from planner.plan import Move
from planner.verification.certificate import Check, Worst, greatest
from planner.verification.clearance import Found, least_of
from planner.verification.motion.motion_checks import NO_MOVES
from planner.verification.tolerances import Tolerances

NO_TRAVEL = "no gripper action"


def clearance_checks(
    found: list[Found], rest: tuple[Worst, Worst], allowed: Tolerances
) -> Iterator[Check]:
    """Moves, travels of the fingers, what the arm does not move, and contacts on purpose."""
    bound, steps = allowed.clearance_m, [step for stage in found for step in stage.steps]
    standing, standing_inside = rest
    yield standing.above(bound, "clearance of the rest", "m")
    moves = [step for step in steps if isinstance(step.step, Move)]
    travels = [step for step in steps if not isinstance(step.step, Move)]
    for kind, some, none in (("", moves, NO_MOVES), (" of fingers", travels, NO_TRAVEL)):
        nearest, proven = least_of(some, none)
        yield nearest.above(bound, f"clearance{kind}", "m")
        yield proven.above(bound, f"clearance{kind} between samples", "m")
    inside = greatest([standing_inside, *(f.enclosed for f in found)], NO_MOVES)
    yield inside.at_most(0.0, "bodies inside a link")
    press = greatest((f.press for f in found), NO_MOVES)
    yield press.at_most(allowed.press_m, "press of contacts", "m")
    slide = greatest((f.slide for f in found), NO_MOVES)
    yield slide.at_most(allowed.slide_m, "slide in contact", "m")
    astray = greatest((f.astray for f in found), NO_MOVES)
    yield astray.at_most(0.0, "contacts out of turn")
