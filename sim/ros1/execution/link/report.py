"""What a robot says of itself beyond the conditions, a line each: for `sim.ros1.check`."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence

from baxter_kin.kinematics.arm import JOINTS
from sim.ros1.execution.link.baxter_link import (
    JOINT_STATES,
    STATE,
    BaxterLink,
    command_topic,
    gripper_topic,
)


def lines_of(link: BaxterLink, limbs: Sequence[str]) -> Iterator[str]:
    """Who publishes what at which rate, the clocks, the joints and the grippers."""
    for topic in (JOINT_STATES, STATE, *(gripper_topic(limb, "state") for limb in limbs)):
        yield f"{topic}: {', '.join(link.node.publishers_of(topic)) or 'nobody'}"
    for limb in limbs:
        others = ", ".join(link.others_of(command_topic(limb))) or "nobody"
        yield f"{command_topic(limb)}: {others}"
    offset_s = link.clock_offset_s
    if offset_s is not None:
        yield f"clock: the robot's is {1e3 * offset_s:+.0f} ms from this machine's"
    yield f"simulated by this toolkit: {'yes' if link.is_simulated else 'no'}"
    for limb in limbs:
        yield from _of_arm(link, limb)


def _of_arm(link: BaxterLink, limb: str) -> Iterator[str]:
    names = [f"{limb}_{joint}" for joint in JOINTS]
    reading = link.joints.arm(names)
    if reading is None:
        return
    told = ", ".join(f"{j} {q:+.3f}" for j, q in zip(JOINTS, reading.q.tolist(), strict=True))
    rate = link.joints.rate_hz(names[0], time.monotonic())
    yield f"{limb} arm, {rate:.0f} Hz: {told} rad"
    report = link.gripper(limb)
    if report is not None:
        state = "calibrated" if report.is_calibrated else "not calibrated"
        yield f"{limb} gripper: {report.percent:.0f} % open, {state}"
