"""A planned cycle, as a plan file and as the checker reads it."""

from __future__ import annotations

import json
from typing import Any

import pytest

from baxter_kin import Baxter
from planner import Body as SceneBody
from planner import Manipulator, PickAndPlace, Plan, Scene, plan_pick_and_place, save_plan
from planner.certificate.body import Body
from planner.certificate.robot import Robot
from tests.planner.verification.conftest import BLOCK, PICK, PLACE


@pytest.fixture(scope="session")
def planned(manipulator: Manipulator, table: SceneBody, block: SceneBody) -> Plan:
    scene = Scene.of([table, block.at(BLOCK)])
    made = plan_pick_and_place(
        PickAndPlace("block", PICK, PLACE), manipulator, scene, manipulator.arm.neutral
    )
    assert made.is_valid, str(made.failure)
    return made


@pytest.fixture(scope="session")
def saved(planned: Plan, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("certificate") / "plan.json"
    save_plan(planned, path)
    return path.read_bytes()


@pytest.fixture
def document(saved: bytes) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(saved)
    return found


@pytest.fixture(scope="session")
def text(robot: Baxter) -> str:
    return robot.description.text


@pytest.fixture(scope="session")
def own(text: str) -> Robot:
    return Robot(text, "left")


@pytest.fixture(scope="session")
def body(text: str) -> Body:
    return Body(text)
