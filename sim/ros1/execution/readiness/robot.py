"""Checks of the robot alone, as `python -m sim.ros1.check` makes them; nothing is sent."""

from __future__ import annotations

import logging
import re
import time
from collections.abc import Iterator, Sequence

from baxter_kin import Baxter
from baxter_kin.description.hands import finger_joints
from baxter_kin.errors import BaxterError
from baxter_kin.kinematics.arm import LIMBS, arm_joints
from planner.grasping.hand import reported_finger_m
from sim.errors import RosError
from sim.ros1.execution.link import ELECTRIC, JOINT_STATES, STATE, BaxterLink, command_topic
from sim.ros1.execution.readiness.ready import Finding

VERSIONS = re.compile(r"1\.2\.\d+")
"""Versions of the RSDK that have this interface."""

MIN_RATE_HZ = 50.0

LISTEN_S = 1.2
"""How long joint states are received before their rate is judged."""

FIRST_S = 3.0
"""Time limit for the robot's first message."""

_LOG = logging.getLogger(__name__)
"""Announces operations that take seconds."""


def check_robot(
    link: BaxterLink, limbs: Sequence[str] = LIMBS, *, grips: Sequence[str] = LIMBS
) -> tuple[Finding, ...]:
    """Listen to a robot for a moment and check all conditions; nothing is sent.

    Args:
        link: to the robot.
        limbs: the arms that are to be driven.
        grips: those whose grippers are to act.
    """
    _LOG.info("listening to the robot of %s", link.node.master_uri)
    link.wait_until(lambda: link.robot is not None, FIRST_S)
    names = [name for limb in limbs for name in arm_joints(limb)]
    if link.wait_until(lambda: not link.joints.missing(names), FIRST_S):
        time.sleep(LISTEN_S)
    return (
        _version(link),
        *_state(link),
        *_joints(link, names),
        *(_commanders(link, limb) for limb in limbs),
        *(_gripper(link, limb) for limb in grips),
    )


def _version(link: BaxterLink) -> Finding:
    version = link.version
    if version is None:
        return Finding("version", False, "the parameter /rethink/software_version is missing")
    is_ok = VERSIONS.match(version) is not None
    return Finding(
        "version", is_ok, version if is_ok else f"{version}; only RSDK 1.2.x is supported"
    )


def _state(link: BaxterLink) -> Iterator[Finding]:
    publishers = link.node.publishers_of(STATE)
    text = ", ".join(publishers) or "nobody"
    is_one = len(publishers) == 1
    advice = "" if is_one else f"; exactly one must publish {STATE}: end the others"
    yield Finding("state publisher", is_one, f"{text}{advice}")
    report = link.robot
    if report is None:
        yield Finding("state", False, f"nothing was received on {STATE} within {FIRST_S:g} s")
    elif report.is_stopped:
        button = "its emergency stop is pressed" if report.is_estop_pressed else "it was stopped"
        yield Finding("state", False, f"{button}; release and reset it by hand")
    elif report.has_error:
        yield Finding("state", False, "the robot reports an error; look at its display and log")
    else:
        yield Finding("state", True, "enabled" if report.is_enabled else "ready, not enabled yet")


def _joints(link: BaxterLink, names: Sequence[str]) -> Iterator[Finding]:
    missing, now_s = link.joints.missing(names), time.monotonic()
    if missing:
        text = f"nothing was received of {', '.join(missing)} on {JOINT_STATES}"
        yield Finding("joint states", False, text)
        return
    senders = {name: link.joints.senders(name, now_s) for name in names}
    doubled = next((name for name in names if len(senders[name]) != 1), None)
    if doubled is not None:
        who = " and ".join(sorted(senders[doubled])) or "nobody any more"
        yield Finding("joint states", False, f"{doubled} is published by {who}; end all but one")
    rates = {name: link.joints.rate_hz(name, now_s) for name in names}
    slowest = min(rates, key=lambda name: rates[name])
    is_fast = rates[slowest] >= MIN_RATE_HZ
    text = f"{rates[slowest]:.0f} Hz at least"
    if not is_fast:
        text = f"{slowest} comes at {rates[slowest]:.0f} Hz; {MIN_RATE_HZ:g} Hz are needed"
    if doubled is None:
        text += f", by {', '.join(sorted({publishers[0] for publishers in senders.values()}))}"
    if doubled is None or not is_fast:
        yield Finding("joint states", is_fast, text)


def _commanders(link: BaxterLink, limb: str) -> Finding:
    topic, name = command_topic(limb), f"{limb} arm"
    others = link.others_of(topic)
    if others:
        text = f"{', '.join(others)} may command it by {topic}; end that first"
        return Finding(name, False, text)
    if not [reader for reader in link.node.subscribers_of(topic) if reader != link.node.name]:
        return Finding(name, False, f"nobody listens to {topic}")
    return Finding(name, True, "nobody else commands it")


def _gripper(link: BaxterLink, limb: str) -> Finding:
    name = f"{limb} gripper"
    link.wait_until(lambda: link.gripper(limb) is not None, 1.0)
    report, kind = link.gripper(limb), link.gripper_kind(limb)
    if report is None:
        return Finding(name, False, "reports nothing; is there one?")
    if kind is not None and kind != ELECTRIC:
        return Finding(name, False, f"has type {kind}; only the electric gripper is supported")
    if report.has_error:
        return Finding(name, False, "reports an error")
    if not report.is_calibrated:
        return Finding(name, False, "is not calibrated; calibrate it first")
    return Finding(name, True, f"calibrated, {report.percent:.0f} % open")


def described_robot(text: str | None) -> Baxter:
    """The robot that a description on the network describes.

    Raises:
        RosError: when there is none, or it cannot be read.
    """
    if text is None:
        raise RosError("the parameter /robot_description is missing")
    try:
        return Baxter.load(text)
    except BaxterError as cause:
        raise RosError(f"/robot_description cannot be read: {cause}") from cause


def measured_joints(link: BaxterLink, robot: Baxter) -> dict[str, float]:
    """The joints of a robot that are known, by name: as measured, fingers as grippers report."""
    measured = link.joints.positions()
    joints = {name: measured[name] for name in robot.joint_names if name in measured}
    for side in LIMBS:
        report, (first, second) = link.gripper(side), finger_joints(side)
        if report is not None and first in robot.joint_names:
            stroke_m = float(robot.model.upperPositionLimit[robot.indices((first,))[0]])
            finger_m = reported_finger_m(report.percent, stroke_m)
            joints |= {first: finger_m, second: -finger_m}
    return joints
