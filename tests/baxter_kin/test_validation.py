from __future__ import annotations

import dataclasses
from typing import Any

import attrs
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import BaxterError
from baxter_kin.validation import finite_array, float_array, whole_scalar
from tests.front_doors import FRONT_DOORS


def rows_of_three(values: Any) -> object:
    return finite_array(values, (None, 3), "rows", BaxterError)


def any_array(values: Any) -> object:
    return float_array(values, "q", BaxterError)


def pair(values: Any) -> object:
    return finite_array(values, (2,), "q", BaxterError)


def one_to_five(value: Any) -> int:
    return whole_scalar(value, "n", BaxterError, least=1, most=5)


@pytest.mark.parametrize(
    ("check", "value"),
    [
        *((any_array, given) for given in ([True], ["1"], [1j], [10**400], {1.0}, None)),
        *((any_array, np.array(given, dtype=object)) for given in (["1", 2], [None, 1.0])),
        (any_array, np.array(["2020-01-01"], dtype="datetime64[D]")),
        (any_array, [[1.0], [1.0, 2.0]]),
        (any_array, np.ma.array([1.0, 2.0], mask=[True, False])),
        (any_array, range(10**12)),
        *((pair, given) for given in ([1.0], [1.0, np.nan], [[1.0, 2.0]], 1.0)),
        *((rows_of_three, np.zeros(shape)) for shape in (3, (2, 4), (1, 2, 3))),
        (rows_of_three, [[np.nan] * 3]),
        *((one_to_five, given) for given in (True, 1.0, "1", None, np.ones(1), 10**400)),
    ],
)
def test_other_values_are_refused_by_name(check: Any, value: Any) -> None:
    with pytest.raises(BaxterError, match=r"^(q|rows|n) "):
        check(value)


def test_numbers_without_a_numpy_type_and_unmasked_arrays_are_taken() -> None:
    assert float_array([10**30, 1], "q", BaxterError).tolist() == [1e30, 1.0]
    taken = float_array(np.ma.array([1.0, 2.0]), "q", BaxterError)
    assert type(taken) is np.ndarray


@given(st.lists(st.lists(st.floats(-9, 9), min_size=3, max_size=3), min_size=1))
def test_rows_are_copied_and_frozen(rows: list[list[float]]) -> None:
    given_rows = np.array(rows)
    array = finite_array(given_rows, (None, 3), "rows", BaxterError)
    given_rows[:] = 10.0
    assert array.tolist() == rows
    assert not array.flags.writeable


@given(st.integers(-10, 10))
def test_whole_numbers_within_bounds_are_taken(value: int) -> None:
    if 1 <= value <= 5:
        assert whole_scalar(np.int64(value), "n", BaxterError, least=1, most=5) == value
    else:
        with pytest.raises(BaxterError, match=f"n must be a whole number from 1 to 5, got {value}"):
            whole_scalar(value, "n", BaxterError, least=1, most=5)


def arguments(thing: Any) -> tuple[str, ...]:
    """What a value class takes; empty for anything else."""
    if dataclasses.is_dataclass(thing):
        return tuple(each.name for each in dataclasses.fields(thing) if each.init)
    is_value = isinstance(thing, type) and attrs.has(thing)
    return tuple(each.alias for each in attrs.fields(thing) if each.init) if is_value else ()


PUBLIC = {
    f"{package.__name__}.{name}": getattr(package, name)
    for package in FRONT_DOORS
    for name in package.__all__
}
RESULTS = {"IKResult"}
"""Value classes that only the toolkit makes, without checks."""

CHECKED = [
    name
    for name, thing in PUBLIC.items()
    if arguments(thing) and name.rpartition(".")[2] not in RESULTS
]


class Stranger:
    """Of a class that nothing asks for."""


@pytest.mark.parametrize("name", CHECKED)
def test_no_public_value_class_accepts_a_foreign_object(name: str) -> None:
    kind = PUBLIC[name]
    for chosen in arguments(kind):
        others = dict.fromkeys(arguments(kind))
        with pytest.raises(BaxterError):
            kind(**{**others, chosen: Stranger()})
