"""Readiness of a robot: each condition of the robot, and what is said where it does not hold."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from sim.ros1.definitions import message_type
from sim.ros1.execution.readiness import robot
from sim.ros1.execution.readiness.ready import Finding
from sim.ros1.execution.readiness.robot import check_robot
from tests.sim.ros1.execution.bus import BusNode
from tests.sim.ros1.execution.conftest import Network


@pytest.fixture(autouse=True)
def _short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(robot, "FIRST_S", 0.5)


def found(network: Network) -> dict[str, list[Finding]]:
    findings: dict[str, list[Finding]] = {}
    for finding in check_robot(network.link, ["left"], grips=["left"]):
        findings.setdefault(finding.name, []).append(finding)
    return findings


def test_a_sound_robot_passes_all(network: Network) -> None:
    findings = found(network)
    assert list(findings) == [
        *("version", "state publisher", "state", "joint states", "left arm", "left gripper"),
    ]
    assert all(each.is_ok for group in findings.values() for each in group)


def advertise(topic: str, kind: str, **values: Any) -> Callable[[Network], None]:
    def make(network: Network) -> None:
        publisher = BusNode("/stranger", network.bus).advertise(topic, kind)
        for _ in range(30 if values else 0):
            publisher.publish(message_type(kind).make(**values))

    return make


def parameter(name: str, value: object) -> Callable[[Network], None]:
    return lambda network: network.node.set_parameter(name, value)


def remove_parameter(name: str) -> Callable[[Network], object]:
    return lambda network: network.bus.parameters.pop(name)


def uncalibrate(network: Network) -> None:
    network.robot.gripper_fields["calibrated"] = 0


def silence(network: Network) -> None:
    network.robot.close()


COMMAND = ("/robot/limb/left/joint_command", "baxter_core_msgs/JointCommand")
CASES: list[tuple[str, Callable[[Network], object], str]] = [
    (
        "version",
        parameter("/rethink/software_version", "1.1.1"),
        "1.1.1; only RSDK 1.2.x is supported",
    ),
    ("version", remove_parameter("/rethink/software_version"), "software_version is missing"),
    ("state publisher", advertise("/robot/state", "baxter_core_msgs/AssemblyState"), "/stranger"),
    ("state", lambda network: network.robot.tell(stopped=True), "it was stopped"),
    ("state", lambda network: network.robot.tell(stopped=True, estop_button=1), "emergency stop"),
    ("state", lambda network: network.robot.tell(error=True), "error"),
    (
        "joint states",
        advertise("/robot/joint_states", "sensor_msgs/JointState", name=["left_s1"], position=[0]),
        "left_s1 is published by /baxter and /stranger",
    ),
    ("joint states", lambda network: setattr(network.robot, "every", 5), "Hz are needed"),
    ("joint states", silence, "nothing was received of left_s0"),
    ("left arm", advertise(*COMMAND), "/stranger may command it"),
    ("left gripper", uncalibrate, "not calibrated"),
]


@pytest.mark.parametrize(("name", "make", "text"), CASES, ids=[case[2] for case in CASES])
def test_each_condition_that_does_not_hold_is_told(
    network: Network, name: str, make: Callable[[Network], object], text: str
) -> None:
    if make is silence:  # before anything was heard
        network.robot.close()
        network.link.joints._readings.clear()
    else:
        make(network)
    failed = [each for each in found(network)[name] if not each.is_ok]
    assert failed, "it passed"
    assert text in failed[0].text


def test_nothing_is_advertised_by_checking(network: Network) -> None:
    found(network)
    own = [topic for topic, ends in network.bus.publishers.items() if ends]
    assert not [topic for topic in own if "/baxter_kin" in network.node.publishers_of(topic)]
    assert network.robot.commands == []
