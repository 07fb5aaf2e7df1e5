from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin.errors import BaxterError
from baxter_kin.files.json_text import as_lines, as_text, from_text

FINITE = st.floats(-1e30, 1e30)
JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**14), 10**14) | FINITE | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=9,
)


class FileProblemError(BaxterError):
    """What the caller of these tests wants to be raised."""


def test_numbers_that_are_not_finite_are_no_text() -> None:
    with pytest.raises(FileProblemError, match="cannot be saved"):
        as_text([1.0, float("nan")], FileProblemError)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "not complete JSON"),
        ('{"a": 1', "not complete JSON"),
        (b"\xff", "not complete JSON"),
        ("NaN", "has NaN where a finite number must be"),
        ("-Infinity", "has -Infinity"),
        ("1e999", "has 1e999 where a finite number must be"),
        ("1" * 5000, "not complete JSON"),
        ('{"a": 1, "a": 2}', "has the entry 'a' twice"),
        ("[" * 100_000, "nested too deeply|not complete JSON"),
    ],
)
def test_text_that_is_no_data_is_refused(text: str | bytes, words: str) -> None:
    with pytest.raises(FileProblemError, match=words):
        from_text(text, FileProblemError)


def test_lines_show_a_row_of_numbers_each() -> None:
    data: Any = {"a": [[1, 2], [3, 4]], "b": {}, "c": []}
    assert as_lines(data) == '{\n "a": [\n  [1, 2],\n  [3, 4]\n ],\n "b": {},\n "c": []\n}'
    assert json.loads(as_lines(data)) == data


@given(JSON)
def test_data_comes_back_from_text(data: Any) -> None:
    assert from_text(as_text(data, FileProblemError), FileProblemError) == data
    assert from_text(as_lines(data).encode(), FileProblemError) == data


@given(JSON)
def test_text_is_one_line_of_ascii(data: Any) -> None:
    text = as_text(data, FileProblemError)
    assert text.isascii()
    assert not {"\n", "\r"} & set(text)
