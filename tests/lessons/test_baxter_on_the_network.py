"""The checks of notebook 6: every right answer passes, typical mistakes get their sentence."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter
from lessons.baxter_on_the_network import (
    NAMES,
    POSITIONS,
    check_lag,
    check_order,
    check_response,
)
from planner import Response
from tests.lessons.told import assert_told

ORDER = Baxter.load().arm("left").joint_names
BY_NAME = dict(zip(NAMES, POSITIONS, strict=True))
SORTED = np.array([BY_NAME[name] for name in ORDER])
TENTH = np.radians(0.1)


@pytest.mark.parametrize("answer", [0.1 * np.pi, 0.314, -0.314])
def test_the_lag_is_right_whatever_its_sign(answer: float) -> None:
    assert check_lag(answer).is_right


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        (18.0, "in degrees"),
        (0.785, "that is the speed"),
        (1.963, "speed times lag"),
        (314.2, "milliseconds"),
        (0.5, "multiply"),
    ],
)
def test_a_wrong_lag_is_explained(answer: float, told: str) -> None:
    assert_told(check_lag(answer), told)


def test_the_response_is_right_in_every_form() -> None:
    assert check_response(Response((0.35, 0.45), TENTH, 0.25)).is_right
    assert check_response(Response(np.tile([0.35, 0.45], (7, 1)), np.full(7, TENTH), 0.25)).is_right


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        (Response((0.35, 0.45), 0.1, 0.25), "in radians"),
        (Response((0.35, 0.45), TENTH), "a quarter is 0.25, not 1"),
        (Response((0.0, 0.45), TENTH, 0.25), "the least and the greatest lag"),
        (Response((0.35, 0.45), 0.0, 0.25), "should be 0.1 degrees"),
        (Response((0.35, 0.45), TENTH, 0.25, 0.4), "leave lead_s out"),
        ((0.35, 0.45), "should be a Response"),
    ],
)
def test_a_wrong_response_is_explained(answer: Any, told: str) -> None:
    assert_told(check_response(answer), told)


def test_the_order_is_right_as_list_and_array() -> None:
    assert check_order(SORTED).is_right
    assert check_order(list(SORTED)).is_right


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        (POSITIONS, "the order of the message"),
        (np.degrees(SORTED), "in degrees"),
        (SORTED[::-1], "left_s0 has another joint's"),
        (SORTED + 0.1, "not the angles of the message"),
        (BY_NAME, "class dict"),
    ],
)
def test_a_wrong_order_is_explained(answer: Any, told: str) -> None:
    assert_told(check_order(answer), told)
