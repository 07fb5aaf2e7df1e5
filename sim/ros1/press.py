"""Presses a button of the simulated Baxter: `python -m sim.ros1.press left ok`.

It publishes once on `/robot/sim/press`, our own topic, which a real Baxter does not have. `ok`,
`cancel` and `show` of the navigator, and `cuff`, `circle` and `dash` of the cuff are pressed for
half a second, the emergency stop `estop` until `release`; the robot stays stopped until `reset`,
which is no button but what `enable_robot.py -r` of the RSDK does. `wheel` turns that of the
navigator by one notch.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Sequence
from typing import NoReturn

from baxter_kin.command_line import OneSentenceParser, examples
from baxter_kin.command_line import run_process as run
from baxter_kin.kinematics.arm import LIMBS
from sim.ros1.node import Node
from sim.ros1.robot.parts.panel import PRESSABLE
from sim.ros1.robot.topics.inlet import PRESS_TOPIC
from sim.ros1.terminal import EXIT_FAILED, EXIT_STATUS, SIMULATED, Terminal

TERMINAL = Terminal("baxter-press")
CONNECTED_S = 2.0
"""How long the robot may take to connect."""

SENT_S = 0.2
"""How long a message may take to be read before the node is gone."""

POLL_S = 0.01


def main(argv: Sequence[str] | None = None) -> int:
    """Press it; returns the exit status."""
    options = _parser().parse_args(argv)
    return TERMINAL.ended(lambda _: _pressed(f"{options.side} {options.button}"))


def _pressed(text: str) -> int:
    with Node(f"/press_{os.getpid()}") as node:
        if _press(node, text):
            return 0
    return TERMINAL.complain(
        f"no simulated Baxter listens to {PRESS_TOPIC}; start one: {SIMULATED}"
    )


def _press(node: Node, text: str) -> bool:
    """Whether a simulated Baxter was told."""
    publisher = node.advertise(PRESS_TOPIC, "std_msgs/String")
    end_s = time.monotonic() + CONNECTED_S
    while not publisher.readers:
        if time.monotonic() > end_s:
            return False
        time.sleep(POLL_S)
    publisher.publish(publisher.type.make(data=text))
    time.sleep(SENT_S)
    return True


def _parser() -> argparse.ArgumentParser:
    parser = OneSentenceParser(
        prog=TERMINAL.name,
        description="Presses a button of the simulated Baxter on the master of ROS_MASTER_URI.",
        epilog=examples(
            "python -m sim.ros1.press left ok",
            "python -m sim.ros1.press left estop",
            "python -m sim.ros1.press left release",
            "python -m sim.ros1.press left reset",
            end=EXIT_STATUS.format(done="0 pressed; 1 no robot heard it"),
        ),
    )
    parser.add_argument("side", choices=LIMBS, help="of which arm; the emergency stop has no side")
    parser.add_argument(
        "button", choices=(*PRESSABLE, "estop", "release", "reset"), help="which button"
    )
    return parser


def run_process() -> NoReturn:
    """Press as a program of its own."""
    run(main, TERMINAL.name, failed=EXIT_FAILED)


if __name__ == "__main__":
    run_process()
