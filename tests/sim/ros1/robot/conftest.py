"""A simulated Baxter at our own master, and a client of it."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from baxter_kin import Baxter
from sim import World
from sim.ros1.node import Node
from sim.ros1.robot.ros_robot import RosRobot
from tests.sim.ros1.robot.client import Client
from tests.sim.runs import Witness


@pytest.fixture
def witness() -> Witness:
    return Witness()


@pytest.fixture
def served(robot: Baxter, own_master: str, witness: Witness) -> Iterator[RosRobot]:
    """At the demo's start, disabled, nothing around it."""
    q_start = {side: arm.start for side, arm in robot.arms.items()}
    with RosRobot(
        World(robot), observers=[witness], q_start=q_start, master_uri=own_master
    ) as served:
        yield served
        assert served.failure is None


@pytest.fixture
def client(served: RosRobot) -> Iterator[Client]:
    with Node("/client", master_uri=served.node.master_uri) as node:
        yield Client(node)
