"""Arrays as differences are the same again, by other code and in the page, and smaller."""

from __future__ import annotations

import base64
import copy
import zlib
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from numpy.typing import NDArray

from sim.view.encoding import MIN_CODED, delta_coded, packed, shared_geometries
from tests.sim.conftest import Watched
from tests.sim.view.replay_decoding import added_up

TYPES = ("int8", "uint8", "int16", "uint16", "int32", "uint32", "float32")
ANY = st.sampled_from(TYPES).flatmap(
    lambda kind: arrays(kind, array_shapes(max_dims=1, min_side=0, max_side=200))
)
SAMPLES = np.arange(7000) / 7000.0


@given(ANY)
def test_every_array_is_the_same_again(values: NDArray[Any]) -> None:
    again = added_up(delta_coded({"a": [values]}))["a"][0]
    assert again.dtype == values.dtype
    assert again.tobytes() == values.tobytes()


@pytest.mark.parametrize("kind", ["int32", "float32"])
@pytest.mark.parametrize("most", [2**30 - 64, 1_500_000_000])
def test_differences_of_large_numbers_do_not_overflow(kind: str, most: int) -> None:
    values = np.resize(np.array([most, -most], kind), 41)  # in one column, as 41 is prime
    again = added_up(delta_coded(values)) if most < 2**30 else delta_coded(values)
    assert again.tobytes() == values.tobytes()


def test_trees_without_long_arrays_of_multiples_stay() -> None:
    tree = {"a": [1, "b", None, (2.5, {})], "c": True}
    assert delta_coded(tree) == {"a": [1, "b", None, [2.5, {}]], "c": True}
    odd = (np.nan, np.inf, 1e-30, 3e9, 2.0**-25, -0.0)
    short = np.arange(MIN_CODED - 1, dtype=np.uint16)
    for values in (short, *(np.full(100, worst, dtype=np.float32) for worst in odd)):
        assert delta_coded(values) is values
    long = np.arange(MIN_CODED, dtype=np.uint16)
    assert delta_coded(long) is not long


@pytest.mark.parametrize("width", [1, 2, 3, 4, 6, 7])
def test_columns_are_found(width: int) -> None:
    columns = [np.round(1000 * np.sin((j + 1) * SAMPLES)) + 5000 * j for j in range(width)]
    values = np.stack(columns, axis=1).reshape(-1).astype(np.int16)
    assert delta_coded(values)["width"] == width


def test_a_motion_is_half_as_large() -> None:
    q = np.round(2.0**13 * np.sin(np.outer(SAMPLES, np.arange(1, 8)))) / 2.0**13
    values = q.reshape(-1).astype(np.float32)
    sizes = [len(zlib.compress(packed(each), level=9)) for each in (values, delta_coded(values))]
    assert sizes[1] < 0.5 * sizes[0]


def test_the_page_adds_them_up_to_the_same(story: Watched) -> None:
    rng = np.random.default_rng(5)
    wanted: dict[str, NDArray[Any]] = {
        "int8": rng.integers(-127, 128, 300).astype(np.int8),
        "int16": rng.integers(-(2**15), 2**15, 300).astype(np.int16),
        "uint16": rng.integers(0, 2**16, 303).astype(np.uint16),
        "uint8": rng.integers(0, 256, 300).astype(np.uint8),
        "int32": rng.integers(-(2**30) + 1, 2**30, 101).astype(np.int32),
        "uint32": rng.integers(0, 2**30, 100).astype(np.uint32),
        "float32": (rng.integers(-(2**23), 2**23, 700) / 2.0**13).astype(np.float32),
    }
    coded = delta_coded(wanted)
    assert all("differences" in each for each in coded.values())
    text = base64.b64encode(zlib.compress(packed(coded))).decode()
    found = story.run(
        """async (text) => Object.fromEntries(Object.entries(await decode(text)).map(
          ([name, values]) => [name, [values.constructor.name, Array.from(values)]]))""",
        text,
    )
    for name, values in wanted.items():
        assert found[name] == [f"{name.capitalize()}Array", values.tolist()]


def test_sharing_geometries_leaves_the_commands_alone() -> None:
    geometry = {"uuid": "a", "type": "BoxGeometry"}
    command = {"type": "set_object", "path": "/b", "object": {"geometries": [geometry]}}
    given_before = copy.deepcopy(command)
    geometries, commands = shared_geometries([command, {"type": "delete"}])
    assert command == given_before
    assert geometries == {"a": geometry}
    assert commands[0]["object"]["geometries"] == [{"uuid": "a"}]
    assert commands[1] == {"type": "delete"}


@pytest.mark.parametrize("kind", ["float64", "int64"])
def test_arrays_that_pages_lack_are_refused_by_name(kind: str) -> None:
    with pytest.raises(TypeError, match=kind):
        packed(np.zeros(3, dtype=kind))
