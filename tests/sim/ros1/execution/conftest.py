"""The demo's plan, ready to be carried out by a robot in memory; made once a session."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, cast

import pytest

from baxter_kin import Baxter
from planner import Manipulator, PickAndPlace, Plan, Scene, plan_pick_and_place
from sim.outcome import Dwell
from sim.ros1.execution import readiness, stops
from sim.ros1.execution.execution import RosExecutor
from sim.ros1.execution.link import BaxterLink
from sim.ros1.execution.readiness import ExecutionOptions, ReadyPlan
from sim.ros1.execution.set_points import Pace
from sim.ros1.node import Node
from tests.conftest import overhead
from tests.sim.ros1.execution.bus import Bus, BusNode
from tests.sim.ros1.execution.fake_robot import FakeRobot

FAST = ExecutionOptions(Pace(0.6), Dwell(0.0, 0.0))
"""Slower than the robot would allow, so that one that pauses on a busy computer catches up."""

PREPARED = ExecutionOptions(Pace(1.0), Dwell(0.0, 0.0))


@dataclass
class Network:
    """A robot in memory, and an executor's node that listens to it."""

    bus: Bus
    robot: FakeRobot
    node: BusNode
    link: BaxterLink

    def executor(self, *observers: Any, options: ExecutionOptions = FAST) -> RosExecutor:
        return RosExecutor(self.link, observers, options=options)


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tests share a busy computer, on which a robot may be slower or silent for longer."""
    monkeypatch.setattr(stops, "MAX_AGE_S", 2.0)
    monkeypatch.setattr(readiness, "MIN_RATE_HZ", 20.0)


@pytest.fixture(scope="session")
def demo_plan(manipulator: Manipulator, scene: Scene) -> Plan:
    task = PickAndPlace("block", overhead(0.70, 0.15, -0.129), overhead(0.75, 0.0, -0.129))
    return plan_pick_and_place(task, manipulator, scene, manipulator.arm.start)


@pytest.fixture
def network(robot: Baxter, demo_plan: Plan) -> Iterator[Network]:
    yield from networked(robot, demo_plan)


def networked(robot: Baxter, plan: Plan, **options: Any) -> Iterator[Network]:
    bus, left, right = Bus(), robot.arm("left"), robot.arm("right")
    q = left.joints(plan.q_start) | right.joints(right.neutral)
    urdf = robot.description.text
    with (
        FakeRobot(BusNode("/baxter", bus), q, urdf=urdf, **options) as fake,
        BusNode("/baxter_kin", bus) as node,
        BaxterLink(cast(Node, node)) as link,
    ):
        names = [*left.joint_names, *right.joint_names]
        assert link.wait_until(lambda: not link.joints.missing(names), 5.0)
        yield Network(bus, fake, node, link)


@pytest.fixture(scope="session")
def ready(robot: Baxter, demo_plan: Plan) -> ReadyPlan:
    """What was prepared of the demo's plan at full speed."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(readiness, "MIN_RATE_HZ", 20.0)
        return prepared(robot, demo_plan)


def prepared(robot: Baxter, demo_plan: Plan) -> ReadyPlan:
    for network in networked(robot, demo_plan):
        found = network.executor(options=PREPARED).prepare(demo_plan)
        assert found.ready is not None, found.failures
        return found.ready
    raise AssertionError
