"""A plan as the demo's, and the arm that it is for."""

from __future__ import annotations

import pytest

from planner import Manipulator, PickAndPlace, Plan, Scene, plan_pick_and_place
from tests.conftest import overhead


@pytest.fixture(scope="session")
def tracked_plan(manipulator: Manipulator, scene: Scene) -> Plan:
    task = PickAndPlace("block", overhead(0.70, 0.15, -0.129), overhead(0.75, 0.0, -0.129))
    plan = plan_pick_and_place(task, manipulator, scene, manipulator.arm.start)
    assert plan.failure is None
    return plan
