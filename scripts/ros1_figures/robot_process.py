"""The simulated Baxter as a process of its own, with table and block, on its own master."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

START_S = 30.0
URI = re.compile(r"ROS_MASTER_URI=(http://\S+)")


@contextmanager
def robot_process(*options: str) -> Iterator[tuple[str, int]]:
    """Where its master is, and the number of the process, as soon as it is ready."""
    command = [sys.executable, "-m", "sim.ros1.robot", "--own-master", "--port", "0"]
    process = subprocess.Popen(
        [*command, "--table", "--block", *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    try:
        assert process.stdout is not None
        found = URI.search(process.stdout.readline())
        if found is None:
            raise SystemExit("the simulated Baxter did not start")
        yield found[1], process.pid
    finally:
        process.terminate()
        process.wait(START_S)
