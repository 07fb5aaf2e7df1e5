"""A simulated Baxter and a program in rospy, at our master and at Debian's."""

from __future__ import annotations

import json
import selectors
from pathlib import Path

import pytest

from baxter_kin import Baxter
from planner.scene.objects import URDF_FOLDER
from sim import EventKind, World
from sim.ros1.robot.arm_motion import Follow, Following
from sim.ros1.robot.ros_robot import RosRobot
from tests.sim.ros1.debian import PYTHON
from tests.sim.ros1.processes import Process, until
from tests.sim.ros1.robot.test_gazebo import TABLE_SDF
from tests.sim.runs import Witness

SCRIPT = Path(__file__).with_name("demo_client.py")
DONE_S = 120.0


@pytest.mark.slow
def test_a_program_for_baxter_carries_a_block(
    robot: Baxter,
    master_uri: str,
    classes: Path,
    tmp_path: Path,
    request: pytest.FixtureRequest,
) -> None:
    """Exact set-points at our master, a lag at Debian's."""
    follow = Follow.EXACT if "our master" in request.node.name else Follow.LAG
    table, witness = tmp_path / "table.sdf", Witness()
    table.write_text(TABLE_SDF, encoding="utf-8")
    q_start = {side: arm.start for side, arm in robot.arms.items()}
    command = (PYTHON, str(SCRIPT), str(table), str(URDF_FOLDER / "block.urdf"))
    with RosRobot(
        World(robot),
        observers=[witness],
        following=Following(follow, 0.1),
        q_start=q_start,
        master_uri=master_uri,
    ) as served:
        program = Process(*command, uri=master_uri, classes=classes, log=tmp_path / "log")
        try:
            found = answer_of(program)
        finally:
            program.end()
        world = served.baxter.world
        until(lambda: "cafe_table" not in world.scene.bodies)
        assert served.failure is None
        assert not served.diagnostics.counts
    assert found["version"] == "1.2.0"
    assert found["spawned"] == [True, True]
    assert found["gripped"] == [1, 0]
    assert found["gripper"] == 2
    assert found["endpoint_z"] == pytest.approx(0.021, abs=0.01)
    assert found["deleted"]
    events = [event.kind for event in witness.events]
    assert events.count(EventKind.GRASPED) == events.count(EventKind.RELEASED) == 1
    centre = world.body("block").centre_base
    assert centre[:2] == pytest.approx([0.75, 0.0], abs=0.01)  # as near as the program waited


def answer_of(program: Process) -> dict[str, object]:
    stdout = program.process.stdout
    assert stdout is not None
    with selectors.DefaultSelector() as selector:
        selector.register(stdout, selectors.EVENT_READ)
        assert selector.select(DONE_S), f"no answer: {program.said}"
    line = stdout.readline()
    assert line, program.said
    found: dict[str, object] = json.loads(line)
    return found
