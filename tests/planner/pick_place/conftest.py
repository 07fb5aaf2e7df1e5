"""The demo's pick and place, which the tests of this folder plan, and bodies in its way."""

from __future__ import annotations

import pytest

from planner import Body, Box, Manipulator, Part, PickAndPlace, Plan, Scene, plan_pick_and_place
from tests.conftest import at, overhead

PICK, PLACE = overhead(0.70, 0.15, -0.129), overhead(0.75, 0.00, -0.129)
TASK = PickAndPlace("block", PICK, PLACE)
ORIGIN = at(0.0, 0.0, 0.0)

STAGES = [
    "pick: open",
    "pick: approach",
    "pick: descend",
    "pick: close",
    "pick: retract",
    "place: approach",
    "place: descend",
    "place: open",
    "place: retract",
]


@pytest.fixture(scope="session")
def plan(tracked_plan: Plan) -> Plan:
    """The demo's cycle."""
    return tracked_plan


def planned(task: PickAndPlace, manipulator: Manipulator, scene: Scene) -> Plan:
    """From where the arm starts in the demo."""
    return plan_pick_and_place(task, manipulator, scene, manipulator.arm.start)


def box(name: str, size: tuple[float, float, float], x: float, y: float, z: float) -> Body:
    """An unrotated box at a position in base."""
    return Body(name, (Part(Box(size), ORIGIN),), at(x, y, z))


def labels(plan: Plan) -> list[str]:
    """Of its steps, in order."""
    return [step.label for step in plan]
