"""Preflight: every condition that must hold before anything is sent, each as a finding.

What is asked of the robot alone is here, and so is `python -m sim.ros1.check`; what is asked of a
plan is on `sim.ros1.execution.readiness`.
"""

from __future__ import annotations

import logging
import re
import time
from collections.abc import Iterator, Sequence

from baxter_kin.display import phrase
from baxter_kin.fields import frozen
from baxter_kin.kinematics.arm import JOINTS, LIMBS
from sim.errors import SimulationError
from sim.ros1.execution.link.baxter_link import (
    ELECTRIC,
    JOINT_STATES,
    STATE,
    BaxterLink,
    command_topic,
)

VERSIONS = re.compile(r"1\.2\.\d+")
"""The RSDK that the interface is of."""

LEAST_RATE_HZ = 50.0

LISTEN_S = 1.2
"""For so long joint states are listened to before their rate is judged."""

FIRST_S = 3.0
"""A robot that is there says something within that time."""


_LOG = logging.getLogger(__name__)


@frozen(error=SimulationError, eq=True)
class Finding:
    """One condition, and whether it holds.

    Attributes:
        name: what was looked at, such as "joint states".
        is_ok: whether it is as it must be.
        text: what was found; where it is not as it must be, what to do.
    """

    name: str
    is_ok: bool
    text: str

    def __str__(self) -> str:
        return f"{self.name}: {self.text}"

    def _facts(self) -> tuple[str, ...]:
        return "ok" if self.is_ok else "not ok", phrase(self.name), self.text


def look_at_robot(
    link: BaxterLink, limbs: Sequence[str] = LIMBS, *, grips: Sequence[str] = LIMBS
) -> tuple[Finding, ...]:
    """Listen to a robot for a moment, and tell what is as it must be; nothing is sent.

    Args:
        link: to the robot.
        limbs: the arms that shall be driven.
        grips: those whose grippers shall act.
    """
    _LOG.info("listening to the robot of %s", link.node.master_uri)
    link.wait_until(lambda: link.robot is not None, FIRST_S)
    names = [f"{limb}_{joint}" for limb in limbs for joint in JOINTS]
    if link.wait_until(lambda: not link.joints.missing(names), FIRST_S):
        time.sleep(LISTEN_S)
    return tuple(_findings(link, limbs, grips, names))


def _findings(
    link: BaxterLink, limbs: Sequence[str], grips: Sequence[str], names: Sequence[str]
) -> Iterator[Finding]:
    yield _version(link)
    yield from _state(link)
    yield from _joints(link, names)
    for limb in limbs:
        yield _commanders(link, limb)
    for limb in grips:
        yield _gripper(link, limb)


def _version(link: BaxterLink) -> Finding:
    version = link.version
    if version is None:
        return Finding("version", False, "the parameter /rethink/software_version is missing")
    is_ok = VERSIONS.match(version) is not None
    return Finding("version", is_ok, version if is_ok else f"{version}; 1.2.x is spoken here")


def _state(link: BaxterLink) -> Iterator[Finding]:
    publishers = link.node.publishers_of(STATE)
    text = ", ".join(publishers) or "nobody"
    is_one = len(publishers) == 1
    yield Finding(
        "state publisher",
        is_one,
        text if is_one else f"{text}; exactly one must publish {STATE}: end the others",
    )
    report = link.robot
    if report is None:
        yield Finding("state", False, f"nothing was heard on {STATE} within {FIRST_S:g} s")
        return
    if report.is_stopped:
        button = "its emergency stop is pressed" if report.is_estop_pressed else "it was stopped"
        yield Finding("state", False, f"{button}; release and reset it by hand")
    elif report.has_error:
        yield Finding("state", False, "the robot reports an error; look at its display and log")
    else:
        yield Finding("state", True, "enabled" if report.is_enabled else "ready, not enabled yet")


def _joints(link: BaxterLink, names: Sequence[str]) -> Iterator[Finding]:
    missing = link.joints.missing(names)
    if missing:
        text = f"nothing was heard of {', '.join(missing)} on {JOINT_STATES}"
        yield Finding("joint states", False, text)
        return
    now_s = time.monotonic()
    shared = {name: link.joints.senders(name, now_s) for name in names}
    doubled = {name: senders for name, senders in shared.items() if len(senders) != 1}
    for name, senders in list(doubled.items())[:1]:
        who = " and ".join(sorted(senders)) or "nobody any more"
        yield Finding("joint states", False, f"{name} is published by {who}; end all but one")
    rates = {name: link.joints.rate_hz(name, now_s) for name in names}
    slowest = min(rates, key=lambda name: rates[name])
    is_fast = rates[slowest] >= LEAST_RATE_HZ
    text = f"{rates[slowest]:.0f} Hz at least"
    if not is_fast:
        text = f"{slowest} comes at {rates[slowest]:.0f} Hz; {LEAST_RATE_HZ:g} Hz are needed"
    if not doubled or not is_fast:
        who = "" if doubled else f", by {', '.join(sorted({s[0] for s in shared.values()}))}"
        yield Finding("joint states", is_fast, f"{text}{who}")


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
    name, report = f"{limb} gripper", link.gripper(limb)
    link.wait_until(lambda: link.gripper(limb) is not None, 1.0)
    report, kind = link.gripper(limb), link.gripper_kind(limb)
    if report is None:
        return Finding(name, False, "says nothing; is there one?")
    if kind is not None and kind != ELECTRIC:
        return Finding(name, False, f"is of type {kind}, no electric one ({ELECTRIC})")
    if report.has_error:
        return Finding(name, False, "reports an error")
    if not report.is_calibrated:
        return Finding(name, False, "is not calibrated; calibrate it first")
    return Finding(name, True, f"calibrated, {report.percent:.0f} % open")
