from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import BaxterError
from baxter_kin.errors import (
    LONGEST_NAME,
    LONGEST_QUOTE,
    FileError,
    UnknownNameError,
    degrees_hint,
    millimetres_hint,
    nearest_name,
    quoted,
    shortened,
)
from baxter_kin.validation import finite_array, finite_scalar

anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.binary(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
)


@given(anything)
def test_a_quote_is_short_printable_and_on_one_line(value: object) -> None:
    text = quoted(value)
    assert len(text) <= LONGEST_QUOTE
    assert text.encode()
    assert "\n" not in text


@pytest.mark.parametrize(
    "value",
    ["x" * 10_000_000, list(range(1_000_000)), np.zeros(1_000_000), 10**100_000, [10**5_000] * 9],
    ids=["text", "list", "array", "integer", "integers"],
)
def test_a_quote_of_something_huge_is_short(value: object) -> None:
    assert len(quoted(value)) <= LONGEST_QUOTE


def test_short_values_are_quoted_whole() -> None:
    assert quoted([1.0, "a", None]) == "[1.0, 'a', None]"
    assert quoted(np.eye(2)) == "array([[1., 0.], [0., 1.]])"


@given(st.text(max_size=400))
def test_a_text_keeps_its_ends(text: str) -> None:
    short = shortened(text, 50)
    assert len(short) <= 50
    if len(text) <= 50:
        assert short == text
    elif " " not in text:
        assert (short[:23], short[-23:]) == (text[:23], text[-23:])
    else:
        assert (short[:16], short[-16:]) == (text[:16], text[-16:])


@given(st.lists(st.text("abcdefgh", min_size=1, max_size=6), min_size=20, max_size=60))
def test_a_text_is_cut_between_words(words: list[str]) -> None:
    text = " ".join(words)
    short = shortened(text, 50)
    if len(text) > 50:
        head, tail = short.split(" ... ")
        assert text.startswith(f"{head} ")
        assert text.endswith(f" {tail}")
        assert len(short) > 50 - 2 * 8


def test_half_a_surrogate_pair_is_written_as_an_escape() -> None:
    assert shortened("a\ud800") == "a\\ud800"
    assert str(FileError("read", "\ud800", "no")) == "cannot read \\ud800: no"


def test_messages_do_not_repeat_long_input() -> None:
    long = "x" * 100_000
    assert len(str(UnknownNameError("limb", long, ("left",)))) < LONGEST_NAME + 60
    assert len(str(FileError("read", long, "no"))) < LONGEST_QUOTE + 60
    for call in (
        lambda: finite_scalar(long, "a number", BaxterError),
        lambda: finite_array([long] * 100, (3,), "an array", BaxterError),
        lambda: finite_array([np.nan] * 100_000, (100_000,), "an array", BaxterError),
    ):
        with pytest.raises(BaxterError) as caught:
            call()
        assert len(str(caught.value)) < LONGEST_QUOTE + 60


@pytest.mark.parametrize("name", [5, None, ["left"], np.zeros(3)], ids=str)
def test_unknown_names_of_any_class_are_told(name: Any) -> None:
    assert "unknown limb" in str(UnknownNameError("limb", name, ("left",)))


@pytest.mark.parametrize(
    ("name", "meant"),
    [("Left", "left"), ("rigth", "right"), ("left_gripr", "left_gripper"), ("RIGHT", "right")],
)
def test_a_name_that_is_nearly_one_that_exists_is_asked_about(name: str, meant: str) -> None:
    error = UnknownNameError("frame", name, ["left", "right", "left_gripper", "left_hand"])
    assert str(error).endswith(f"left_hand; did you mean {meant}?")
    assert error.allowed == ("left", "right", "left_gripper", "left_hand")


@pytest.mark.parametrize("name", ["top", "", "left_s9", 7, None, b"left", "left" * 10_000_000])
def test_no_other_name_is(name: Any) -> None:
    assert "did you mean" not in str(UnknownNameError("joint", name, ["left_s0", "left_s1"]))
    assert nearest_name(name, []) == ""


def test_lengths_of_a_workcell_in_millimetres_are_asked_about() -> None:
    assert millimetres_hint(700.0, 150.0, -129.0) == (
        "; are these millimetres? Lengths are in metres: 700 mm is 0.7 m"
    )
    assert millimetres_hint(0.0, -50.0).endswith("-50 mm is -0.05 m")


@given(st.floats(-9.99, 9.99) | st.floats(min_value=1.01e4) | st.floats(max_value=-1.01e4))
def test_no_other_length_is(length: float) -> None:
    assert millimetres_hint(length) == millimetres_hint(0.0, length) == ""


def test_angles_in_degrees_are_asked_about() -> None:
    assert degrees_hint(0.0, -90.0) == (
        "; are these degrees? Angles are in radians: -90 deg is -1.571 rad"
    )
    assert degrees_hint(5.0, least=math.pi / 2).endswith("5 deg is 0.08727 rad")


@given(st.floats(-math.tau, math.tau) | st.floats(min_value=360.1) | st.floats(max_value=-360.1))
def test_no_other_angle_is(angle: float) -> None:
    assert degrees_hint(angle) == degrees_hint(0.0, angle) == ""
