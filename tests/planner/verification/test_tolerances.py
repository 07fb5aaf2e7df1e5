"""Tolerances are numbers, the toolkit's or those that a plan states."""

from __future__ import annotations

import math
from typing import Any

import pytest

from planner import TaskError, Tolerances


@pytest.mark.parametrize("value", [-1.0, math.nan, "1"])
def test_a_tolerance_is_a_number_not_below_zero(value: Any) -> None:
    with pytest.raises(TaskError, match="tip_m"):
        Tolerances(tip_m=value)
