from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import attrs
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from baxter_kin import BaxterError
from baxter_kin.fields import field, frozen
from baxter_kin.validation import finite_array, finite_rows, float_array, whole_scalar
from tests.front_doors import FRONT_DOORS


@pytest.mark.parametrize(
    "values",
    [
        [True, False],
        np.ones(2, dtype=np.bool_),
        ["1", "2"],
        np.array(["1", 2], dtype=object),
        np.array([None, 1.0], dtype=object),
        np.array(["2020-01-01"], dtype="datetime64[D]"),
        np.array([1], dtype="timedelta64[s]"),
        [1j],
        [10**400],
        {1.0},
        [[1.0], [1.0, 2.0]],
        (x for x in [1.0]),
        None,
    ],
    ids=lambda value: type(value).__name__,
)
def test_what_is_no_real_number_is_refused(values: Any) -> None:
    with pytest.raises(BaxterError, match="q must be real numbers"):
        float_array(values, "q", BaxterError)


def test_masked_entries_are_refused_and_unmasked_ones_taken() -> None:
    masked = np.ma.array([1.0, 2.0], mask=[True, False])
    with pytest.raises(BaxterError, match="q has masked entries"):
        float_array(masked, "q", BaxterError)
    taken = float_array(np.ma.array([1.0, 2.0]), "q", BaxterError)
    assert type(taken) is np.ndarray
    assert taken.tolist() == [1.0, 2.0]


def test_a_range_that_fills_the_memory_is_refused() -> None:
    with pytest.raises(BaxterError, match="q has 1000000000000 numbers; up to 100000000 are taken"):
        float_array(range(10**12), "q", BaxterError)


def test_large_integers_are_numbers() -> None:
    assert float_array([10**30, 1], "q", BaxterError).tolist() == [1e30, 1.0]


@given(st.lists(st.lists(st.floats(-9, 9), min_size=3, max_size=3), min_size=1))
def test_rows_are_copied_and_frozen(rows: list[list[float]]) -> None:
    given_rows = np.array(rows)
    array = finite_rows(given_rows, 3, "rows", BaxterError)
    given_rows[:] = 10.0
    assert array.tolist() == rows
    assert not array.flags.writeable


@pytest.mark.parametrize("rows", [np.zeros(3), np.zeros((2, 4)), np.zeros((1, 2, 3)), 5.0])
def test_rows_of_another_width_are_refused(rows: Any) -> None:
    with pytest.raises(BaxterError, match=r"it must have shape \(n, 3\)"):
        finite_rows(rows, 3, "rows", BaxterError)


def test_numbers_that_are_not_finite_are_refused() -> None:
    for make in (lambda v: finite_array(v, (1, 1), "q", BaxterError), _rows_of_one):
        with pytest.raises(BaxterError, match=r"q must be finite numbers, got \[\[nan\]\]"):
            make([[np.nan]])


def _rows_of_one(values: Any) -> object:
    return finite_rows(values, 1, "q", BaxterError)


@given(st.integers(-10, 10))
def test_whole_numbers_within_bounds_are_taken(value: int) -> None:
    if 1 <= value <= 5:
        assert whole_scalar(np.int64(value), "n", BaxterError, least=1, most=5) == value
    else:
        with pytest.raises(BaxterError, match=f"n must be a whole number from 1 to 5, got {value}"):
            whole_scalar(value, "n", BaxterError, least=1, most=5)


@pytest.mark.parametrize("value", [True, 1.0, "1", None, np.ones(1), 10**400], ids=str)
def test_what_is_no_whole_number_is_refused(value: Any) -> None:
    with pytest.raises(BaxterError, match="n must be a whole number from 1 to 5"):
        whole_scalar(value, "n", BaxterError, least=1, most=5)


@frozen(error=BaxterError)
class Thing:
    number: float = 1.0
    count: int = 1
    is_so: bool = True
    name: str = "thing"
    other: Thing | None = None
    names: tuple[str, ...] = ()
    pair: tuple[str, int] = ("a", 1)
    shares: Mapping[str, float] = field(factory=dict)
    array: NDArray[np.float64] | None = None


@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"number": 2},
        {"number": np.float32(2)},
        {"number": float("inf")},
        {"count": np.int8(2)},
        {"is_so": np.bool_(False)},
        {"other": Thing()},
        {"names": ("a", "b")},
        {"shares": {"a": 1}},
        {"array": np.zeros(3)},
    ],
    ids=str,
)
def test_values_of_the_stated_classes_are_taken(fields: dict[str, Any]) -> None:
    assert Thing(**fields)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"number": "1"}, "Thing.number must be float, got '1'"),
        ({"number": 10**400}, "Thing.number must be float, got an integer of 1329 bits"),
        ({"number": True}, "Thing.number must be float, got True"),
        ({"count": 1.0}, "Thing.count must be int, got 1.0"),
        ({"count": False}, "Thing.count must be int, got False"),
        ({"is_so": 1}, "Thing.is_so must be bool, got 1"),
        ({"name": b"a"}, "Thing.name must be str, got b'a'"),
        ({"name": "\ud800"}, r"Thing.name must be str, got '\\ud800'"),
        ({"other": 5}, "Thing.other must be Thing or None, got 5"),
        ({"names": ["a"]}, r"Thing.names must be tuple\[str, ...\], got \['a'\]"),
        ({"names": ("a", 1)}, r"Thing.names must be tuple\[str, ...\], got \('a', 1\)"),
        ({"pair": ("a",)}, r"Thing.pair must be tuple\[str, int\], got \('a',\)"),
        ({"shares": {"a": "b"}}, r"Thing.shares must be Mapping\[str, float\]"),
        ({"shares": {1: 1.0}}, r"Thing.shares must be Mapping\[str, float\]"),
        ({"shares": [1.0]}, r"Thing.shares must be Mapping\[str, float\]"),
        ({"array": [1.0]}, "Thing.array must be ndarray.* or None"),
    ],
    ids=str,
)
def test_values_of_other_classes_are_refused_by_name(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(BaxterError, match=message):
        Thing(**fields)


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
