"""A planned cycle, as a plan file and as the checker reads it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter
from planner import Body as SceneBody
from planner import Manipulator, PickAndPlace, Plan, Scene, plan_pick_and_place, save_plan
from planner.certificate.body import Body
from planner.certificate.clusters import Clusters
from planner.certificate.intervals import Array
from planner.certificate.robot import Robot
from planner.certificate.rows import Joints
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


def frames(own: Joints, q: Array) -> list[tuple[Array, Array]]:
    """Poses of all joints seen from the chain's first frame, which comes first; q is (k, n)."""
    R, p = np.tile(np.eye(3), (len(q), 1, 1)), np.zeros((len(q), 3))
    found = [(R, p)]
    for i, span in enumerate(own.spans):
        turn = np.tile(np.eye(3), (len(q), 1, 1))
        c, s = np.cos(q[:, i]), np.sin(q[:, i])
        turn[:, 0, 0], turn[:, 1, 1], turn[:, 0, 1], turn[:, 1, 0] = c, c, -s, s
        p = p + R @ span.p.centred()[0]
        R = R @ span.R.centred()[0] @ turn
        found.append((R, p))
    return found


def lowest(clusters: Clusters, node: int, n: Array, T: tuple[Array, Array]) -> Array:
    """Least n . x of a node at some instants, n seen from base, one each."""
    R, p = T
    along = np.einsum("tij,ti->tj", R, n)
    x = clusters.points(node)
    ball, disc, axis = clusters.widths(node)
    least = (along @ x.T).min(axis=1) - ball * np.linalg.norm(n, axis=1)
    if disc:
        across = along - np.outer(along @ axis, axis)
        least = least - disc * np.linalg.norm(across, axis=1)
    found: Array = least + np.einsum("ti,ti->t", n, p)
    return found
