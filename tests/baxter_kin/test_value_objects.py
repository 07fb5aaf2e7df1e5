from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin.errors import CopyError
from baxter_kin.validation import FloatArray
from baxter_kin.value_objects import (
    LONGEST,
    Frozen,
    FrozenMapping,
    NotCopied,
    OneLine,
    count,
    listing,
    millimetres,
    position,
    seconds,
    shown,
    side_of,
)

COPIES: dict[str, Callable[[Any], Any]] = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "pickle": lambda value: pickle.loads(pickle.dumps(value)),
}


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Sample(Frozen, OneLine):
    """Arrays by themselves, in a tuple and in a mapping."""

    row: FloatArray
    rows: tuple[FloatArray, ...] = ()
    named: FrozenMapping[str, FloatArray] | None = None
    label: str = "plain"


def arrays(sample: Sample) -> list[FloatArray]:
    named = () if sample.named is None else sample.named.values()
    return [sample.row, *sample.rows, *named]


@pytest.fixture
def sample() -> Sample:
    made = Sample(np.arange(3.0), (np.ones(2), np.zeros(1)), FrozenMapping({"a": np.ones(4)}))
    for array in arrays(made):
        array.setflags(write=False)
    return made


@pytest.mark.parametrize("way", COPIES)
def test_arrays_are_read_only_in_a_copy_as_well(sample: Sample, way: str) -> None:
    again = COPIES[way](sample)
    for array, kept in zip(arrays(again), arrays(sample), strict=True):
        np.testing.assert_array_equal(array, kept)
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 7.0


@pytest.mark.parametrize("way", COPIES)
def test_what_holds_a_file_says_that_it_cannot_be_copied(way: str) -> None:
    class Held(NotCopied):
        pass

    with pytest.raises(CopyError, match="a Held holds an open file"):
        COPIES[way](Held())


@given(st.dictionaries(st.text(), st.integers()))
def test_a_frozen_mapping_is_the_mapping_it_was_made_of(items: dict[str, int]) -> None:
    frozen = FrozenMapping(items)
    again = pickle.loads(pickle.dumps(frozen))
    assert frozen == again == items
    assert list(frozen) == list(again) == list(items)
    assert repr(frozen) == repr(items)


def test_a_frozen_mapping_does_not_follow_what_it_was_made_of() -> None:
    items = {"a": 1}
    frozen = FrozenMapping(items)
    items["a"] = 2
    assert frozen["a"] == 1
    with pytest.raises(TypeError):
        frozen["a"] = 2  # type: ignore[index]


def test_a_line_leaves_out_what_is_as_by_default(sample: Sample) -> None:
    assert repr(Sample(np.arange(3.0))) == "Sample(row=(0, 1, 2))"
    assert "label=" not in repr(sample)
    assert repr(Sample(np.ones((2, 5)), label="odd")) == "Sample(row=2 x 5 array, label='odd')"


def test_a_long_value_does_not_make_a_long_line() -> None:
    text = repr(Sample(np.arange(3.0), label="x\ny" * 1000))
    assert len(text) <= LONGEST
    assert text.isprintable()


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


def test_numbers_of_things_agree_with_their_nouns() -> None:
    assert [count(n, "body") for n in (0, 1, 2)] == ["0 bodies", "1 body", "2 bodies"]
    assert listing(["table", "block"], "body") == "2 bodies: table, block"
    assert listing([], "move") == "0 moves"


def test_no_number_is_shown_as_minus_zero() -> None:
    T = pin.SE3(np.eye(3), np.array([-0.0, -1e-9, 0.7]))
    assert position(T) == "(0, 0, 0.7) m"
    assert millimetres(-1e-9) == "0.0 mm"
    assert seconds(-1e-9) == "0.00 s"


def test_joints_of_one_side_are_told_by_it_and_others_counted() -> None:
    assert side_of(["left_s0", "left_s1"]) == "left"
    assert side_of(["left_s0", "right_s0"]) == "2 joints"
    assert side_of([]) == "0 joints"
