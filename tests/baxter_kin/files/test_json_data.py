"""Values as JSON: they come back bit by bit, and nothing but what the hints say is made."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum, IntEnum
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from baxter_kin.errors import PoseError
from baxter_kin.files.json_data import from_json, plain_data, to_json
from baxter_kin.files.json_text import as_text, from_text
from baxter_kin.validation import FloatArray
from tests.baxter_kin.files.test_json_text import FINITE, JSON, FileProblemError


class Mood(str, Enum):
    """Also text, whose value is not its name."""

    CALM = "quite calm"


class Level(IntEnum):
    """Also a number."""

    LOW = 1


@dataclass(frozen=True)
class Ball:
    radius_m: float

    def __post_init__(self) -> None:
        if self.radius_m <= 0.0:
            raise PoseError(f"a ball of radius {self.radius_m:g} m")


@dataclass(frozen=True)
class Cube:
    edge_m: float = 1.0


@dataclass(frozen=True, eq=False)
class Thing:
    """One field of each type that has a place."""

    name: str
    count: int = 0
    is_red: bool = False
    shape: Ball | Cube | None = None
    parts: tuple[Thing, ...] = ()
    corner: tuple[float, float] = (0.0, 0.0)
    moods: tuple[Mood, ...] = ()
    numbers: Mapping[Level, float] = field(default_factory=dict)
    rows: FloatArray | None = None
    T: pin.SE3 | None = None
    made: int = field(default=3, init=False)


@dataclass(frozen=True)
class Faulty:
    """Whose check has a fault."""

    name: str

    def __post_init__(self) -> None:
        _ = self.name + 1  # type: ignore[operator]


FULL = Thing(
    "a",
    2,
    True,
    Ball(2),
    (Thing("b", parts=(Thing("c", shape=Cube()),)),),
    (1, np.float64(1 / 3)),
    (Mood.CALM,),
    {Level.LOW: 0.1},
    np.arange(6.0).reshape(2, 3),
    pin.SE3(pin.exp3(np.array([0.1, 0.2, 0.3])), np.array([1.0, 2.0, 1 / 3])),
)


def kept(value: Any, hint: Any) -> Any:
    """A value as it comes back from text."""
    text = as_text(to_json(value, hint, "it", FileProblemError), FileProblemError)
    return from_json(from_text(text, FileProblemError), hint, "it", FileProblemError)


def refusal(data: Any, hint: Any = Thing) -> str:
    with pytest.raises(FileProblemError) as caught:
        from_json(data, hint, "it", FileProblemError)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_every_type_that_has_a_place_comes_back_bit_by_bit() -> None:
    again = kept(FULL, Thing)
    assert to_json(again, Thing, "it", FileProblemError) == plain_data(FULL, Thing)
    assert again.shape == Ball(2.0)
    assert again.parts[0].parts[0].shape == Cube()
    assert again.moods == (Mood.CALM,)
    assert again.rows.tobytes() == FULL.rows.tobytes()  # type: ignore[union-attr]
    assert again.T == FULL.T


def test_the_format_is_this() -> None:
    written = to_json(FULL, Thing, "it", FileProblemError)
    assert isinstance(written, dict)
    assert list(written)[:2] == ["name", "count"]
    assert "made" not in written
    assert as_text(written["shape"], FileProblemError) == '{"type":"Ball","radius_m":2.0}'
    assert written["corner"] == [1.0, 1 / 3]
    assert written["moods"] == ["CALM"]
    assert written["numbers"] == {"LOW": 0.1}
    assert isinstance(written["T"], dict)
    assert list(written["T"]) == ["rotation", "translation"]


@given(hnp.arrays(np.float64, hnp.array_shapes(min_side=0, max_dims=3), elements=FINITE))
def test_arrays_of_any_shape_come_back_bit_by_bit(array: FloatArray) -> None:
    again = kept(array, FloatArray)
    assert again.shape == array.shape
    assert again.tobytes() == array.tobytes()


def test_arrays_are_known_by_the_annotation_of_this_numpy() -> None:
    """NumPy 2.5 made its alias generic itself, where it used to stand for the class."""
    array = np.arange(6.0).reshape(2, 3)
    for annotation in (FloatArray, NDArray[np.float64], np.ndarray[Any, np.dtype[np.float64]]):
        assert kept(array, annotation).tolist() == array.tolist()


NAMES = st.sampled_from(["count", "is_red", "shape", "parts", "corner", "numbers", "rows", "T"])


@given(st.dictionaries(NAMES | st.text(), JSON, max_size=3))
def test_any_data_is_a_value_or_refused_in_one_line(data: dict[str, Any]) -> None:
    said = ""
    try:
        from_json({"name": "a", **data}, Thing, "it", FileProblemError)
    except FileProblemError as error:
        said = str(error)
    assert "\n" not in said


def test_a_field_that_is_lacking_takes_its_default() -> None:
    assert from_json({"name": "a"}, Thing, "it", FileProblemError).parts == ()


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        ({}, "it.name is missing"),
        ([], "it must be an object, got []"),
        ({"name": "a", "wheels": 4}, "it has an entry 'wheels'; a Thing has: name, count"),
        ({"name": "a", "made": 4}, "it has an entry 'made'; a Thing has: name, count"),
        ({"name": 3}, "it.name must be of type str, got 3"),
        ({"name": "a", "count": True}, "it.count must be of type int, got True"),
        ({"name": "a", "count": 1.0}, "it.count must be of type int, got 1.0"),
        ({"name": "a", "is_red": 1}, "it.is_red must be of type bool, got 1"),
        ({"name": "a", "parts": {}}, "it.parts must be a list, got {}"),
        ({"name": "a", "parts": [{"name": "b"}, 3]}, "it.parts[1] must be an object, got 3"),
        ({"name": "a", "corner": [1, 2, 3]}, "it.corner must have 2 items, got 3"),
        ({"name": "a", "corner": [1, "2"]}, "it.corner[1] must be of type float, got '2'"),
        ({"name": "a", "corner": "12"}, "it.corner must be a list, got '12'"),
        ({"name": "a", "shape": {"edge_m": 1}}, "it.shape has type None; use one of: Ball, Cube"),
        ({"name": "a", "shape": {"type": "os.system"}}, "it.shape has type 'os.system'"),
        ({"name": "a", "shape": {"type": ["Ball"]}}, "it.shape has type ['Ball']"),
        ({"name": "a", "shape": {"type": "Ball", "radius_m": 0}}, "it.shape: a ball of radius 0"),
        ({"name": "a", "shape": 3}, "it.shape must be an object, got 3"),
        ({"name": "a", "moods": ["quite calm"]}, "it.moods[0] is 'quite calm'; use one of: CALM"),
        ({"name": "a", "moods": [["CALM"]]}, "it.moods[0] is ['CALM']; use one of: CALM"),
        ({"name": "a", "numbers": []}, "it.numbers must be an object, got []"),
        ({"name": "a", "numbers": {"LOW": None}}, "it.numbers['LOW'] must be of type float"),
        ({"name": "a", "numbers": {"HIGH": 1}}, "it.numbers['HIGH'] is 'HIGH'; use one of: LOW"),
        ({"name": "a", "rows": [[0.0], [0.0, 0.0]]}, "it.rows must be lists of numbers, in rows"),
        ({"name": "a", "rows": [[[[0.0]]]]}, "it.rows must be lists of numbers"),
        ({"name": "a", "rows": ["0.0"]}, "it.rows must be of type float, got '0.0'"),
        ({"name": "a", "rows": [True]}, "it.rows must be of type float, got True"),
        ({"name": "a", "rows": [math.inf]}, "it.rows must be a finite number up to 1e+30"),
        ({"name": "a", "rows": [2e30]}, "it.rows must be a finite number up to 1e+30"),
        ({"name": "a", "rows": {"shape": [0, 9999]}}, "it.rows must be lists of numbers"),
        ({"name": "a", "rows": {"shape": [2, 3]}}, "it.rows must be lists of numbers"),
        ({"name": "a", "rows": {"shape": [-1, 0]}}, "it.rows must be lists of numbers"),
        ({"name": "a", "rows": {"shape": [0, 0, 0, 0]}}, "it.rows must be lists of numbers"),
        ({"name": "a", "rows": {"shape": [False]}}, "it.rows[0] must be of type int, got False"),
        ({"name": "a", "T": {"rotation": [0.0]}}, "it.T must be a pose, arrays of the shapes"),
        ({"name": "a", "T": {"rotation": "x"}}, "it.T['rotation'] must be of type float"),
    ],
)
def test_a_refusal_says_what_is_wrong_and_where(data: Any, reason: str) -> None:
    assert refusal(data).startswith(reason)


def test_nesting_without_end_is_refused() -> None:
    data: dict[str, Any] = {"name": "a"}
    for _ in range(5_000):
        data = {"name": "a", "parts": [data]}
    assert refusal(data).endswith("is nested too deeply")


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        (Thing("a", shape=Ball(math.inf)), "it.shape.radius_m must be a finite number"),
        (Thing("a", rows=np.array([math.nan])), "it.rows must be a finite number"),
        (Thing("a", rows=np.array([True])), "it.rows must be of type float, got True"),
        (Thing("a", rows=np.array(["1"])), "it.rows must be of type float, got '1'"),
        (Thing(3), "it.name must be of type str, got 3"),  # type: ignore[arg-type]
        (Thing(Mood.CALM), "it.name must be of type str, got 'CALM'"),
        (Thing("a", Level.LOW), "it.count must be of type int, got 'LOW'"),
        (Thing("a", corner=(1.0, 2.0, 3.0)), "it.corner must have 2 items"),  # type: ignore[arg-type]
        (Thing("a", corner=(10**400, 1.0)), "it.corner[0] must be a finite number"),
        (Thing("a", shape=Thing("b")), "it.shape must be an object"),  # type: ignore[arg-type]
        (Ball(1.0), "it must be Thing, got Ball: 'Ball' object has no attribute 'name'"),
    ],
)
def test_what_cannot_be_read_again_is_not_kept(value: Any, reason: str) -> None:
    with pytest.raises(FileProblemError) as caught:
        to_json(value, Thing, "it", FileProblemError)
    assert str(caught.value).startswith(f"cannot be saved: {reason}")


def test_a_type_without_a_place_in_files_is_named() -> None:
    with pytest.raises(FileProblemError, match="thing has a type that cannot be stored"):
        to_json({1}, set[int], "thing", FileProblemError)
    with pytest.raises(FileProblemError, match="thing has a type that cannot be stored"):
        from_json([1], Any, "thing", FileProblemError)


def test_a_fault_in_the_check_of_a_class_is_no_refusal() -> None:
    with pytest.raises(TypeError, match="concatenate"):
        from_json({"name": "a"}, Faulty, "it", FileProblemError)
