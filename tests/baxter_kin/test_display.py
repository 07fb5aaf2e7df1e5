from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin import BaxterError, Tolerance, Tool
from baxter_kin.description.urdf import ShapeKind, UrdfShape
from baxter_kin.display import (
    MAX_QUOTE,
    count,
    degrees_hint,
    listing,
    millimetres,
    millimetres_hint,
    position,
    quoted,
    seconds,
    shortened,
    side_of,
)
from baxter_kin.errors import FileError
from tests.conftest import at

anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.binary(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
)


@settings(max_examples=25)
@given(anything)
def test_a_quote_is_short_printable_and_on_one_line(value: object) -> None:
    text = quoted(value)
    assert len(text) <= MAX_QUOTE
    assert text.encode()
    assert "\n" not in text


@pytest.mark.parametrize(
    "value",
    ["x" * 10_000_000, list(range(1_000_000)), np.zeros(1_000_000), 10**100_000, [10**5_000] * 9],
    ids=["text", "list", "array", "integer", "integers"],
)
def test_a_quote_of_something_huge_is_short(value: object) -> None:
    assert len(quoted(value)) <= MAX_QUOTE


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


BALL = UrdfShape(ShapeKind.SPHERE, (0.02,))


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


@pytest.mark.parametrize(
    ("call", "question"),
    [
        (lambda: Tolerance(rotation_rad=(5.0, 5.0, 5.0)), "degrees? .* 5 deg is 0.08727 rad"),
        (lambda: Tolerance(tilt_rad=5.0), "degrees? .* 5 deg is 0.08727 rad"),
        (lambda: Tool((BALL,), at(0.0, 0.0, 150.0)), "millimetres? .* 150 mm is 0.15 m"),
    ],
)
def test_doors_ask_about_values_in_another_unit(call: Callable[[], object], question: str) -> None:
    with pytest.raises(BaxterError, match=question.replace("?", r"\?")):
        call()
