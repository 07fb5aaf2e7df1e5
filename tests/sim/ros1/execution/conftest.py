"""The demo's plan, ready to be carried out by a robot in memory; made once a session."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, cast

import pytest

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from baxter_kin.kinematics.arm import LIMBS
from planner import Manipulator, Plan, TwoArmPlan, plan_together
from sim.ros1.execution.execution import RosExecutor
from sim.ros1.execution.link import BaxterLink
from sim.ros1.execution.readiness.ready import ExecutionOptions, ReadyPlan, ReadyTwoArmPlan
from sim.ros1.execution.set_points import Pace
from sim.ros1.node import Node
from sim.simulation import Dwell
from tests.planner.two_arms.pairs import pair
from tests.sim.ros1.execution.bus import Bus, BusNode
from tests.sim.ros1.execution.clock import virtual_time
from tests.sim.ros1.execution.fake_robot import FakeRobot

FAST = ExecutionOptions(Pace(0.6), Dwell(0.0, 0.0))

PREPARED = ExecutionOptions(Pace(1.0), Dwell(0.0, 0.0))


@dataclass
class Network:
    """A robot in memory, and an executor's node that listens to it."""

    bus: Bus
    robot: FakeRobot
    node: BusNode
    link: BaxterLink

    def when(self, is_so: Callable[[], object], act: Callable[[], object]) -> None:
        """Do something once, at the first tick at which something is so."""

        def tick() -> None:
            if is_so():
                self.bus.clock.on_tick.remove(tick)
                act()

        self.bus.clock.on_tick.append(tick)

    def executor(self, *observers: Any, options: ExecutionOptions = FAST) -> RosExecutor:
        return RosExecutor(self.link, observers, options=options)


@pytest.fixture(scope="session")
def demo_plan(plan: Plan) -> Plan:
    """The demo's pick and place."""
    return plan


@pytest.fixture
def network(robot: Baxter, demo_plan: Plan) -> Iterator[Network]:
    with networked(robot, demo_plan) as network:
        yield network


@contextmanager
def networked(robot: Baxter, plan: Plan, **options: Any) -> Iterator[Network]:
    left, right = robot.arm("left"), robot.arm("right")
    q = left.joints(plan.q_start) | right.joints(right.neutral)
    with started(robot, q, **options) as network:
        yield network


@contextmanager
def started(robot: Baxter, q: Mapping[str, float], **options: Any) -> Iterator[Network]:
    """A robot in memory whose joints stand somewhere."""
    urdf = robot.description.text
    with virtual_time() as clock:
        bus = Bus(clock)
        with (
            FakeRobot(BusNode("/baxter", bus), q, urdf=urdf, **options) as fake,
            BusNode("/baxter_kin", bus) as node,
            BaxterLink(cast(Node, node)) as link,
        ):
            clock.sleep(0.1)
            yield Network(bus, fake, node, link)


@pytest.fixture(scope="session")
def two_arm_plan(robot: Baxter) -> TwoArmPlan:
    """Each arm carries a block on its own side, both at once."""
    manipulators = {side: Manipulator.of(robot, side) for side in LIMBS}
    left, right = ((0.65, 0.2, 0.0), (0.75, 0.4, 0.5)), ((0.75, -0.2, 0.3), (0.65, -0.4, 0.0))
    return plan_together(*pair(manipulators, left, right).arguments)


@contextmanager
def networked_at(robot: Baxter, plan: TwoArmPlan, **options: Any) -> Iterator[Network]:
    """A robot in memory at the start of a plan of both arms."""
    q: dict[str, float] = {}
    for side in LIMBS:
        q |= robot.arm(side).joints(plan.plans[side].q_start)
    with started(robot, q, **options) as network:
        yield network


@pytest.fixture(scope="session")
def both_ready(robot: Baxter, two_arm_plan: TwoArmPlan) -> ReadyTwoArmPlan:
    """What was prepared once of the plan of both arms: its certificate takes ten seconds."""
    with networked_at(robot, two_arm_plan) as network:
        found = network.executor().prepare(two_arm_plan)
    assert found.ready is not None, found.failures
    return found.ready


@pytest.fixture(scope="session")
def ready(robot: Baxter, demo_plan: Plan) -> ReadyPlan:
    """What was prepared of the demo's plan at full speed, and is executed as `FAST`."""
    with networked(robot, demo_plan) as network:
        found = network.executor(options=PREPARED).prepare(demo_plan)
    assert found.ready is not None, found.failures
    return evolve(found.ready, options=FAST)
