"""Types of the demo's arguments: each says what came and what is allowed."""

from __future__ import annotations

import argparse
from pathlib import Path

from baxter_kin.command_line import file_to_write, number, number_within
from baxter_kin.errors import millimetres_hint

FARTHEST_M = 10.0
SLOWEST = 0.001
RECORD_SUFFIXES = (".bag", ".jsonl", ".mcap", ".npz")


def coordinate(text: str) -> float:
    """A position in base, m."""
    value = number(text)
    if abs(value) > FARTHEST_M:
        raise argparse.ArgumentTypeError(
            f"{text} is not within {FARTHEST_M:g} m of the robot{millimetres_hint(value)}"
        )
    return value


def height(text: str) -> float:
    """A height above zero, m."""
    value = number(text)
    if not 0.0 < value <= FARTHEST_M:
        allowed = f"above zero and at most {FARTHEST_M:g} m"
        raise argparse.ArgumentTypeError(f"{text} is not {allowed}{millimetres_hint(value)}")
    return value


ratio = number_within(SLOWEST, 1.0, "")
"""A share of the robot's speed."""


def port(text: str) -> int:
    """Where a server may listen."""
    if not text.isascii() or not text.isdigit() or len(text) > 5 or not 1 <= int(text) <= 65535:
        raise argparse.ArgumentTypeError(f"{text!r} is not a port, a whole number from 1 to 65535")
    return int(text)


def record_target(text: str) -> Path:
    """A file whose suffix says the format of what is recorded."""
    path = file_to_write(text)
    if path.suffix not in RECORD_SUFFIXES:
        known = ", ".join(RECORD_SUFFIXES)
        raise argparse.ArgumentTypeError(f"{text} must end in one of {known}, which say the format")
    return path
