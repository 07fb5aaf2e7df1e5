"""TrackingProof as a value."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from planner import Response, TrackingProof
from planner.clearance import Clearance
from planner.errors import TaskError
from planner.pick_place.tracking.result import MoveTracking

RESPONSE = Response((0.3, 0.5), 0.001, 0.3)
MOVE = MoveTracking("lift", 0.02, Clearance(0.03, "hand", "table", 1.0), 0.1, 0.01, 0.005, 0.002)


def made(**given: Any) -> TrackingProof:
    values: dict[str, Any] = {
        "response": RESPONSE,
        "moves": (MOVE,),
        "margin_m": 0.0,
        "most_off_m": 0.04,
        "start_rad": 0.02,
        "rate_rad_s": np.full(7, np.inf),
        "greatest_speed": 0.3,
    }
    return TrackingProof(**{**values, **given})


def test_it_is_valid_without_a_failure() -> None:
    assert made().is_valid
    assert not made(failure="lift: it hits", greatest_speed=None).is_valid


def test_its_clearance_is_the_least_of_its_moves() -> None:
    other = MoveTracking("sink", 0.01, None, 0.1, 0.01, 0.0)
    assert made(moves=(MOVE, other)).clearance_m == 0.01
    assert made(moves=()).clearance_m == np.inf


def test_rates_are_of_seven_joints_and_read_only() -> None:
    proof = made(rate_rad_s=[1.0] * 7)
    with pytest.raises(ValueError, match="read-only"):
        proof.rate_rad_s[0] = 2.0
    with pytest.raises(TaskError, match="shape"):
        made(rate_rad_s=[1.0] * 6)


def test_values_of_other_classes_are_refused() -> None:
    with pytest.raises(TaskError, match="response"):
        made(response=0.4)
    with pytest.raises(TaskError, match="clearance_m"):
        MoveTracking("lift", None, None, 0.1, 0.01, 0.0)  # type: ignore[arg-type]


def test_text_tells_every_move() -> None:
    text = str(made())
    assert text.splitlines()[1] == (
        "  lift: 20.0 mm clear, joints within 0.100 rad, tip within 10.0 mm of its path, 5.0 mm "
        "where it touches on purpose, 2.0 mm from its goal when settled"
    )
    assert str(made(failure="lift: it hits")).startswith("lift: it hits\n")
    assert repr(MOVE) == "MoveTracking(lift, 20.0 mm clear, tip up to 10.0 mm off, 5.0 mm allowed)"
