"""Measures the ROS 1 side against rospy, and prints the table of its figures.

`python scripts/measure_ros1.py [--duration-s T] [--only TEXT]`

It needs Debian's ROS 1, as `make test` installs it. All runs on this computer, at a master of its
own; a computer that does other things meanwhile gives worse figures. Exit status 1 when a figure
misses its limit.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # the tests' generator of classes

from ros1_figures import baxter, executor, transport
from ros1_figures.figure import Figure

PARTS: dict[str, Callable[[float], Iterator[Figure]]] = {
    "transport": transport.figures,
    "baxter": baxter.figures,
    "executor": executor.figures,
}
"""What is measured, by name; each is given for how long."""


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, and print a row as soon as it is there."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--duration-s", type=float, default=10.0, help="default: %(default)s")
    parser.add_argument("--only", choices=PARTS, help="one part alone")
    options = parser.parse_args(argv)
    os.environ["ROS_IP"] = "127.0.0.1"
    print("| figure | required | measured | met |\n| --- | --- | --- | --- |")
    is_met = True
    for name, part in PARTS.items():
        if options.only not in (None, name):
            continue
        for figure in part(options.duration_s):
            verdict = {None: "", True: "yes", False: "NO"}[figure.is_met]
            print(f"| {figure.what} | {figure.required} | {figure.found} | {verdict} |", flush=True)
            is_met &= figure.is_met is not False
    return int(not is_met)


if __name__ == "__main__":
    sys.exit(main())
