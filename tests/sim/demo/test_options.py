"""What was asked for decides whether the demo looks for the block."""

from __future__ import annotations

import pytest

from baxter_kin.limits import PRESETS
from sim import outcome
from sim.demo import options
from sim.demo.arguments import parse_options
from sim.demo.options import DEFAULT_POSES_M


@pytest.mark.parametrize(
    ("line", "looks"),
    [("", False), ("--retries 0", True), ("--retries 3", True), ("--noise-mm 1", True)],
)
def test_the_loop_is_closed_as_soon_as_attempts_are_counted(line: str, *, looks: bool) -> None:
    assert parse_options(line.split()).is_closed_loop is looks


def test_what_is_said_twice_is_the_same() -> None:
    assert options.LIMITS == PRESETS
    dwells = options.ROBOT_DWELL_S, options.LONGEST_DWELL_S
    assert dwells == (outcome.ROBOT_DWELL_S, outcome.LONGEST_DWELL_S)


def test_the_block_poses_are_the_originals() -> None:
    assert parse_options([]).poses_m == DEFAULT_POSES_M
