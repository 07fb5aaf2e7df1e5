from __future__ import annotations

import copy
import pickle
from collections.abc import Callable, Mapping
from typing import Any

import attrs
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin.display import MAX_LINE, millimetres
from baxter_kin.errors import BaxterError, CopyError
from baxter_kin.fields import (
    FrozenMapping,
    NotCopied,
    array,
    evolve,
    field,
    frozen,
    integer,
    mapping,
    number_or_nan,
    scalar,
    sequence,
    shown,
)
from baxter_kin.validation import FloatArray

COPIES: dict[str, Callable[[Any], Any]] = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "pickle": lambda each: pickle.loads(pickle.dumps(each)),
}


class SampleError(BaxterError, ValueError):
    """Raised by the samples below."""


@frozen(error=SampleError)
class Sample:
    """One field of every kind."""

    q: FloatArray = array(3)
    rows: FloatArray = array(None, 2, factory=lambda: np.zeros((0, 2)))
    name: str = "plain"
    length_m: float = scalar(above=0.0, default=0.1, repr=millimetres)
    ratio: float = scalar(least=0.0, most=1.0, default=1.0)
    count: int = integer(least=1, most=9, default=1)
    named: Mapping[str, FloatArray] = mapping(factory=dict)
    parts: tuple[Sample, ...] = sequence(default=())
    pair: tuple[int, str] | None = None
    offset_m: float = number_or_nan(default=0.0)
    ratios: Mapping[str, float] = field(factory=dict)
    is_open: bool = False


@frozen(error=SampleError, eq=True)
class Interval:
    """Two numbers in order."""

    start: float = scalar()
    end: float = scalar()

    def __attrs_post_init__(self) -> None:
        if self.end < self.start:
            raise SampleError(f"an interval ends at {self.end:g}, before it starts")


@frozen(error=SampleError)
class Larger(Sample):
    """A value class that extends another one."""

    extra: FloatArray = array(2, factory=lambda: np.zeros(2))


Q = np.array((1.0, 2.0, 3.0))


@pytest.mark.parametrize(
    "fields",
    [
        *({"q": q} for q in ((1.0, 2.0), (1.0, 2.0, np.nan), "text", np.zeros((1, 3)))),
        {"rows": np.zeros((2, 3))},
        *({"name": name} for name in (3, b"a", "\ud800")),
        *({"length_m": length} for length in (0.0, True, np.inf, "1")),
        *({"ratio": ratio} for ratio in (-0.5, 1.5)),
        *({"count": count} for count in (0, 10, 2.0, True)),
        *({"named": named} for named in ([1], {"a": 1})),
        *({"parts": parts} for parts in (3, [None])),
        *({"pair": pair} for pair in ((1, 2), (1,), [1, "a"])),
        *({"offset_m": offset} for offset in (None, "1", True)),
        *({"ratios": ratios} for ratios in ({"a": "b"}, {"a": 2**2000}, {1: 1.0}, [1.0])),
        {"ratios": {"a": np.nan}},
        {"is_open": 1},
    ],
    ids=str,
)
def test_a_wrong_argument_is_refused_by_name(fields: dict[str, Any]) -> None:
    (name,) = fields
    with pytest.raises(SampleError, match=name):
        Sample(**{"q": Q, **fields})


@pytest.mark.parametrize(
    "fields",
    [
        *({"ratio": ratio} for ratio in (0, 1, np.float32(0.5))),
        *({"count": count} for count in (1, 9, np.int8(2))),
        {"is_open": np.bool_(True)},
        {"ratios": {"a": 1, "b": np.inf}},
        {"rows": [[1, 2]], "parts": [Sample(Q)], "pair": (1, "a"), "offset_m": np.nan},
    ],
    ids=str,
)
def test_values_of_the_stated_classes_are_taken(fields: dict[str, Any]) -> None:
    assert Sample(Q, **fields)


def test_a_refusal_says_what_is_needed_and_what_came() -> None:
    with pytest.raises(SampleError, match=r"^length_m must be above zero, got 0$"):
        Sample(Q, length_m=0.0)


def test_arguments_are_copied_and_read_only() -> None:
    q, named = Q.copy(), {"a": np.ones(2)}
    sample = Sample(q, named=named)
    q[0] = 9.0
    named["b"] = np.ones(2)
    np.testing.assert_array_equal(sample.q, Q)
    assert list(sample.named) == ["a"]
    with pytest.raises(ValueError, match="read-only"):
        sample.q[0] = 9.0


def test_fields_cannot_be_set() -> None:
    with pytest.raises(attrs.exceptions.FrozenInstanceError):
        Sample(Q).name = "other"  # type: ignore[misc]


def test_a_changed_copy_is_checked_again() -> None:
    assert evolve(Interval(0.0, 1.0), end=2.0) == Interval(0.0, 2.0)
    with pytest.raises(SampleError, match="an interval ends at -1, before it starts"):
        evolve(Interval(0.0, 1.0), end=-1.0)


def test_only_values_that_ask_for_it_are_compared_by_value() -> None:
    assert Sample(Q) != Sample(Q)
    assert Interval(0.0, 1.0) == Interval(0.0, 1.0)
    assert hash(Interval(0.0, 1.0)) == hash(Interval(0.0, 1.0))


@pytest.mark.parametrize("way", COPIES)
def test_arrays_are_read_only_in_a_copy(way: str) -> None:
    sample = Larger(Q, named={"a": np.ones(2)}, parts=(Sample(Q),))
    again = COPIES[way](sample)
    assert repr(again) == repr(sample)
    assert type(again.named) is FrozenMapping
    assert not again.q.flags.writeable
    assert not again.extra.flags.writeable
    assert not again.parts[0].q.flags.writeable


def test_fields_that_differ_from_their_defaults_are_shown() -> None:
    assert repr(Sample(Q)) == "Sample(q=(1, 2, 3), rows=0 x 2 array)"
    sample = Sample(Q, np.zeros((4, 2)), length_m=0.02, is_open=True)
    assert repr(sample) == "Sample(q=(1, 2, 3), rows=4 x 2 array, length_m=20.0 mm, is_open=True)"
    long = repr(Sample(Q, name="x\ny" * 1000))
    assert len(long) <= MAX_LINE
    assert long.isprintable()


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1.0 / 3.0, "0.3333"),
        ((0.1, -0.0), "(0.1, 0)"),
        ((), "()"),
        (np.zeros(9), "9 array"),
        (np.array([True]), "1 array"),
        ("a\nb", "'a\\nb'"),
    ],
)
def test_values_are_shown_rounded_and_large_arrays_by_their_shape(value: Any, text: str) -> None:
    assert shown(value) == text


@pytest.mark.parametrize("way", COPIES)
def test_what_holds_a_file_says_that_it_cannot_be_copied(way: str) -> None:
    class Held(NotCopied):
        pass

    with pytest.raises(CopyError, match="a Held holds an open file"):
        COPIES[way](Held())


@given(st.dictionaries(st.text(), st.integers()))
def test_a_frozen_mapping_is_the_mapping_it_was_made_of(items: dict[str, int]) -> None:
    read_only = FrozenMapping(items)
    again = pickle.loads(pickle.dumps(read_only))
    assert read_only == again == items
    assert list(read_only) == list(again) == list(items)
    assert repr(read_only) == repr(items)


def test_a_frozen_mapping_does_not_follow_what_it_was_made_of() -> None:
    items = {"a": 1}
    read_only = FrozenMapping(items)
    items["a"] = 2
    assert read_only["a"] == 1
    with pytest.raises(TypeError):
        read_only["a"] = 2  # type: ignore[index]
