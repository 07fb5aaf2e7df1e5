"""A plan, to be shown without being simulated first."""

from __future__ import annotations

import pytest

from planner import Body, Manipulator, PickAndPlace, Plan, Scene, plan_pick_and_place
from tests.conftest import overhead


@pytest.fixture(scope="session")
def plan(manipulator: Manipulator, table: Body, block: Body) -> Plan:
    """The left arm carries the block elsewhere."""
    task = PickAndPlace("block", overhead(0.70, 0.15, -0.129), overhead(0.75, 0.0, -0.129))
    made = plan_pick_and_place(task, manipulator, Scene.of([table, block]), manipulator.arm.start)
    assert made.is_valid
    return made
