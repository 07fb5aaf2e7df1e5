"""A planned cycle, as a plan file and as the checker reads it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
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


def checked_alone(file: Path, urdf: str) -> str:
    """What the command prints of a file that it certifies, importing nothing else of ours."""
    robot = file.with_name("robot.urdf")
    robot.write_text(urdf, "utf-8")
    code = (
        "import sys; from planner.certificate.__main__ import main; status = main(sys.argv[1:]);"
        "own = {n for n in sys.modules if n.startswith(('planner.', 'baxter_kin.'))};"
        "few = ('planner.certificate', 'baxter_kin.lazy');"
        "assert all(n.startswith(few) for n in own), own;"
        "sys.exit(status)"
    )
    run = subprocess.run(
        [sys.executable, "-c", code, str(file), "--urdf", str(robot)],
        cwd=Path(__file__).parents[3],
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    return run.stdout
