"""Random messages of every type have the bytes, and the sums, of ROS's own classes."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim.ros1.definitions import SERVICES, TYPES, message_type, service_type
from tests.sim.ros1.processes import Peer

STANDARD = (
    "actionlib_msgs/GoalStatusArray",
    "geometry_msgs/PoseStamped",
    "rosgraph_msgs/Log",
    "sensor_msgs/CameraInfo",
    "sensor_msgs/Image",
    "sensor_msgs/JointState",
    "std_msgs/Bool",
    "std_msgs/Duration",
    "std_msgs/Empty",
    "std_msgs/Float64",
    "std_msgs/String",
    "std_msgs/UInt16",
    "trajectory_msgs/JointTrajectory",
)
"""Those of the interface, and some with kinds of field that it does not have."""

SAMPLES = 5
LETTERS = list("aZ0 _/\n{}=ü€𝄞")
SEPARATOR = re.compile(r"^=+\nMSG: (.+)$", re.MULTILINE)
FIELD = re.compile(r"([\w/]+)(\[\d*\])? (\w+)")


@pytest.fixture(scope="module")
def peer(classes: Path) -> Iterator[Peer]:
    """One that needs no master: it only reads and writes."""
    peer = Peer("", uri="http://127.0.0.1:1/", classes=classes, log=classes / "genpy", start=False)
    yield peer
    peer.kill()


class Values:
    """Random values of a type's fields, read from its definition."""

    def __init__(self, name: str, definition: str, rng: np.random.Generator) -> None:
        parts = SEPARATOR.split(definition)
        names = [name, *parts[1::2]]
        self._texts = dict(zip(names, parts[0::2], strict=True))
        self._rng = rng

    def of(self, name: str) -> dict[str, Any]:
        lines = [line for line in self._texts[name].splitlines() if line and "=" not in line]
        fields = [FIELD.fullmatch(line) for line in lines]
        return {f[3]: self._field(f[1], f[2]) for f in fields if f is not None}

    def _field(self, kind: str, brackets: str | None) -> Any:
        if brackets is None:
            return self._one(kind)
        length = int(brackets[1:-1]) if brackets != "[]" else int(self._rng.integers(0, 5))
        return [self._one(kind) for _ in range(length)]

    def _one(self, kind: str) -> Any:
        if "/" in kind:
            return self.of(kind)
        if kind == "string":
            return "".join(self._rng.choice(LETTERS, self._rng.integers(0, 12)))
        if kind == "bool":
            return bool(self._rng.integers(2))
        if kind.startswith("float"):
            return float(self._rng.choice([self._rng.normal() * 1e3, 0.0, np.inf, -1e-30]))
        if kind in ("time", "duration"):
            least = 0 if kind == "time" else -(2**31)
            sec = int(self._rng.integers(least, 2**31))
            return {"sec": sec, "nanosec": int(self._rng.integers(10**9))}
        limits = np.iinfo({"byte": "int8", "char": "uint8"}.get(kind, kind))
        return int(self._rng.integers(limits.min, limits.max, dtype=limits.dtype, endpoint=True))


@pytest.mark.parametrize("name", [*TYPES.names(), *STANDARD])
def test_bytes_and_sums_are_those_of_ros(name: str, peer: Peer) -> None:
    kind = message_type(name)
    values = Values(name, kind.definition, np.random.default_rng(len(name)))
    data = [kind.serialise(kind.make(**values.of(name))) for _ in range(SAMPLES)]
    md5, *echoed = peer.ask("echo", name, [each.hex() for each in data])
    assert [bytes.fromhex(each) for each in echoed] == data
    assert md5 == kind.md5


def test_sums_of_services_are_those_of_ros(peer: Peer) -> None:
    for name in SERVICES:
        assert peer.ask("service_sum", name) == service_type(name).md5
