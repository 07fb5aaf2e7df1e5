"""Sends random and spoilt bytes to every socket of a ROS 1 node and its master.

`python scripts/fuzz_ros1.py [--count N] [--seed N]`

A fault is: the node or the master answers no more, an error that nobody foresaw, a thread or
connection that stays, memory that grows, or a socket that listens beyond 127.0.0.1. Memory is taken
after every tenth of the messages. Exit status 1 when there is a fault. The same seed sends the
same.
"""

from __future__ import annotations

import argparse
import gc
import logging
import os
import sys
import threading
import time
import tracemalloc
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # what the tests send

from tests.sim.ros1.hostile import Target, attack, target
from tests.sim.ros1.wire import listening_addresses, own_sockets

ROUNDS = 10
WARM = 3
"""Rounds after which memory is compared: first calls load and cache what stays."""

GROWTH_KB = 200.0
"""What may stay of all later rounds together, of Python's own memory: interned words, caches."""

QUIET_S = 10.0
LOOPBACK = "0100007F"


def main(argv: Sequence[str] | None = None) -> int:
    """Attack, print what was sent and what it cost."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--count", type=int, default=10_000, help="default: %(default)s")
    parser.add_argument("--seed", type=int, default=0, help="default: %(default)s")
    options = parser.parse_args(argv)
    os.environ["ROS_IP"] = "127.0.0.1"
    logging.disable(logging.WARNING)
    started_s = time.perf_counter()
    before = own_sockets()
    tracemalloc.start()
    with target() as aim:
        sent, memory = _rounds(aim, options.count, options.seed)
        faults = [*_faults(aim, memory), *_listening(own_sockets() - before)]
    faults += _left()
    for name, number in sorted(sent.items()):
        print(f"{name:<30}{number:>8}")
    for kb, rss_mb in memory:
        print(f"memory of Python's objects {kb:8.0f} kB, of the process {rss_mb:6.1f} MB")
    print(f"{aim.node.counts!r} {aim.master.counts!r}")
    print(f"{options.count} messages in {time.perf_counter() - started_s:.0f} s")
    for fault in faults:
        print(f"FAULT: {fault}")
    return int(bool(faults))


def _rounds(aim: Target, count: int, seed: int) -> tuple[Counter[str], list[tuple[float, float]]]:
    sent: Counter[str] = Counter()
    memory = []
    for number in range(ROUNDS):
        sent += attack(aim, count // ROUNDS, seed * ROUNDS + number)
        _wait_until_quiet(aim)
        gc.collect()
        memory.append((tracemalloc.get_traced_memory()[0] / 1024, _resident_mb()))
    return sent, memory


def _wait_until_quiet(aim: Target) -> None:
    end_s = time.monotonic() + QUIET_S
    while aim.node._server.peers and time.monotonic() < end_s:
        time.sleep(0.01)


def _faults(aim: Target, memory: list[tuple[float, float]]) -> list[str]:
    found = []
    if not aim.is_well():
        found.append("the node or the master does not work any more")
    all_counts = (aim.node.counts, aim.master.counts)
    found += [f"unforeseen errors: {counts!r}" for counts in all_counts if counts.faults]
    if aim.node._server.peers:
        found.append("connections stay open")
    growth_kb = memory[-1][0] - memory[WARM - 1][0]
    if growth_kb > GROWTH_KB:
        found.append(f"memory grows by {growth_kb:.0f} kB")
    return found


def _listening(inodes: set[str]) -> list[str]:
    beyond = listening_addresses(inodes) - {LOOPBACK}
    return [f"something listens at {', '.join(beyond)}"] if beyond else []


def _left() -> list[str]:
    end_s = time.monotonic() + QUIET_S
    while len(threading.enumerate()) > 1 and time.monotonic() < end_s:
        time.sleep(0.01)
    return [f"a thread stays: {each.name}" for each in threading.enumerate()[1:]]


def _resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text("utf-8").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


if __name__ == "__main__":
    sys.exit(main())
