"""What is stored of a freedom."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin.fields import field_names
from planner.atlas.redundancy import Freedom
from planner.atlas.redundancy.measures import MEASURES, from_steps, in_steps

ROUNDING = 1e-9


def numbers_of(freedom: Freedom) -> list[float]:
    return [getattr(freedom, name) for name in field_names(freedom)]


@given(st.integers(1, 40), st.lists(st.floats(0.0, 1.0), min_size=5, max_size=5))
def test_what_is_read_is_what_was_stored_to_half_a_step_or_less_than_one_below(
    pieces: int, numbers: list[float]
) -> None:
    freedom = Freedom(pieces, 90.0 * numbers[0], 30.0 * numbers[1], *numbers[2:])
    read = from_steps(in_steps(freedom))
    off = np.subtract(numbers_of(read), numbers_of(freedom)) / np.array(list(MEASURES.values()))
    assert (np.abs(off) <= np.array([0, 0.5, 0.5, 1, 1, 0.5]) + ROUNDING).all()
    assert read.margin_rad <= freedom.margin_rad + ROUNDING
    assert read.manipulability <= freedom.manipulability + ROUNDING


def test_measures_are_those_of_a_freedom() -> None:
    assert tuple(MEASURES) == field_names(Freedom(0, 0.0, 0.0, math.nan, math.nan, math.nan))
