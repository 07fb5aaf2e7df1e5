from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin.display import (
    MAX_LINE,
    OneLine,
)
from baxter_kin.errors import CopyError
from baxter_kin.fields import Frozen, FrozenMapping, NotCopied
from baxter_kin.validation import FloatArray

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
    assert len(text) <= MAX_LINE
    assert text.isprintable()
