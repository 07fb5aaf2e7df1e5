"""Readiness: a plan is judged as the robot stands, and nothing is sent where it does not fit."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest

from baxter_kin import Baxter, ElectricGripper
from baxter_kin.fields import evolve
from planner import Certificate, Grip, Move, Plan, verify
from sim.ros1.execution.readiness import plans
from sim.ros1.execution.readiness.ready import ExecutionOptions, NotReadyError, Readiness, ReadyPlan
from sim.ros1.execution.set_points import Pace
from tests.sim.ros1.execution.conftest import FAST, Network


@pytest.fixture(scope="module")
def certificate(demo_plan: Plan) -> Certificate:
    return verify(demo_plan)


@pytest.fixture(autouse=True)
def _certified_once(monkeypatch: pytest.MonkeyPatch, certificate: Certificate) -> None:
    """A certificate takes seconds; these tests are of other conditions, but for one."""
    monkeypatch.setattr(plans, "verify", lambda *_, **__: certificate)


def looked(network: Network, plan: Plan, options: ExecutionOptions = FAST) -> Readiness[ReadyPlan]:
    return network.executor(options=options).prepare(plan)


def move_robot(network: Network, **off: float) -> None:
    for name, value in off.items():
        network.robot.q[name] += value
        network.robot.goal[name] += value
    network.link.wait_until(
        lambda: all(
            abs(network.link.joints.positions().get(name, 9.0) - network.robot.q[name]) < 1e-9
            for name in off
        ),
        1.0,
    )


def told(found: Readiness[ReadyPlan], name: str) -> str:
    return next(finding.text for finding in found.findings if finding.name == name)


def motions(steps: Iterable[Move | Grip]) -> list[object]:
    """Labels and motions of steps, whose states count where the other joints are measured."""
    return [(s.label, s.trajectory if isinstance(s, Move) else s.opening_m) for s in steps]


@pytest.mark.slow
def test_an_arm_at_the_start_begins_there(network: Network, demo_plan: Plan) -> None:
    move_robot(network, left_w2=0.015)
    found = looked(network, demo_plan)
    assert found.ready is not None
    assert motions(found.ready.plan.steps) == motions(demo_plan.steps)
    assert "0.0150 rad" in told(found, "start")


def test_an_arm_elsewhere_goes_to_the_start_first_by_a_proven_move(
    network: Network, demo_plan: Plan
) -> None:
    move_robot(network, left_w2=0.3, left_s1=-0.2)
    found = looked(network, demo_plan)
    assert found.ready is not None
    first, *rest = found.ready.plan.steps
    assert first.label == "move to start"
    assert motions(rest) == motions(demo_plan.steps)
    assert all(step.state is not None for step in found.ready.plan)
    move = found.ready.plan.moves[0]
    assert move.proof is not None
    assert np.abs(move.trajectory.q_goal - demo_plan.q_start).max() < 1e-9
    assert "0.300 rad away; a move to it takes" in told(found, "start")


@pytest.mark.parametrize(("beyond", "text"), [(0.034, "untuck it"), (0.3, "no real arm does")])
def test_an_arm_outside_its_limits_is_named_and_refused(
    network: Network, demo_plan: Plan, robot: Baxter, beyond: float, text: str
) -> None:
    lowest = float(robot.arm("left").limits.q_min[1])
    move_robot(network, left_s1=lowest - beyond - network.robot.q["left_s1"])
    found = looked(network, demo_plan)
    assert found.ready is None
    assert f"left_s1 stands {beyond:.3f} rad outside its limits" in told(found, "start")
    assert text in told(found, "start")


def test_the_other_arm_counts_where_it_is_measured(network: Network, demo_plan: Plan) -> None:
    move_robot(network, right_s0=0.2)
    found = looked(network, demo_plan)
    assert found.ready is not None
    assert found.ready.plan.start.joints["right_s0"] == pytest.approx(network.robot.q["right_s0"])


def test_an_arm_that_is_not_measured_is_refused_by_its_joints(
    network: Network, demo_plan: Plan
) -> None:
    readings = network.link.joints._readings
    kept = {name: each for name, each in readings.items() if name != "right_w1"}
    network.link.joints._readings = kept
    check = plans._PlanCheck(network.link, demo_plan, FAST, [])
    with pytest.raises(plans._RefusedError, match=r"of right_w1 on .* cannot be excluded"):
        check.ready()


def test_a_head_that_is_not_measured_is_stated_to_be_assumed(
    network: Network, demo_plan: Plan
) -> None:
    start = evolve(demo_plan.start, joints={**demo_plan.start.joints, "head_pan": 0.25})
    found = looked(network, evolve(demo_plan, start=start))
    assert found.ready is not None
    assert "assumed to be 0.250 rad" in told(found, "head")
    assert found.ready.plan.start.joints["head_pan"] == 0.25


def test_a_robot_of_other_hands_is_refused(network: Network, demo_plan: Plan) -> None:
    other = Baxter.load(hands={"left": ElectricGripper("wide")})
    network.node.set_parameter("/robot_description", other.description.text)
    found = looked(network, demo_plan)
    assert found.ready is None
    assert "for another robot" in told(found, "plan")


@pytest.mark.parametrize("text", [None, "<robot name='toaster'/>"])
def test_a_robot_that_does_not_describe_itself_is_refused(
    network: Network, demo_plan: Plan, text: str | None
) -> None:
    network.bus.parameters["/robot_description"] = text
    found = looked(network, demo_plan)
    assert found.ready is None
    assert "/robot_description" in told(found, "URDF")


def test_what_no_baxter_can_follow_is_refused(network: Network, demo_plan: Plan) -> None:
    found = looked(network, demo_plan, evolve(FAST, pace=Pace(1.0, 1.0)))
    assert found.ready is None
    assert "rad/s" in told(found, "speed")


def test_a_plan_that_fails_its_certificate_is_refused_and_nothing_is_sent(
    network: Network, demo_plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plans, "verify", verify)
    known = demo_plan.start
    without = evolve(demo_plan, start=evolve(known, scene=known.scene.without("table")))
    executor = network.executor()
    with pytest.raises(NotReadyError, match="not valid") as refusal:
        executor.execute(without)
    assert [finding.name for finding in refusal.value.readiness.failures] == ["plan"]
    assert network.robot.commands == []
    assert network.robot.enables == 0


def test_a_move_without_room_for_the_guard_is_refused(
    network: Network, demo_plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    ready = looked(network, demo_plan).ready
    assert ready is not None
    first = ready.clearances[0]
    monkeypatch.setattr(plans, "KEPT_M", min(first.clear_m) + 1e-3)
    found = looked(network, demo_plan)
    assert found.ready is None
    assert told(found, "clearance").startswith(f"{first.label}: ")
    assert "move it away by hand" in told(found, "clearance")
