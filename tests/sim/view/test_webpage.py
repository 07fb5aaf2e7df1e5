"""Pages are put together whole, and arrays in them are the same again."""

from __future__ import annotations

import base64
import copy
import json
import zlib
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from numpy.typing import NDArray

from sim.errors import ViewerError
from sim.view import webpage
from sim.view.meshcat_commands import packed, shared_geometries
from sim.view.webpage import MIN_CODED, delta_coded, inside_script, live_page, page, viewer_bundle
from tests.sim.conftest import Watched
from tests.sim.view.replay_decoding import added_up


def replay_page(title: object = "", notice: str = "", data: str = "") -> str:
    return page("replay.html", title=title, notice=notice, data=data)


def test_no_slot_is_left_open() -> None:
    assert "{{" not in live_page("Baxter")
    for template in ("replay.html", "atlas/atlas.html"):
        filled = page(template, title="Baxter", notice="", data="")
        assert "{{" not in filled.replace(inside_script(viewer_bundle()), "")
    assert "<h1>Baxter &amp; &lt;friends&gt;</h1>" in live_page("Baxter & <friends>")


@pytest.mark.parametrize("text", [r"\1 \g<0> \n", "{{card.html}}", "{{title}}", "", "ä €"])
def test_a_text_is_inserted_as_it_is(text: str) -> None:
    before, after = replay_page(data="@@@").split("@@@")
    assert replay_page(data=text) == before + text + after


@given(st.text() | st.sampled_from(["</script>", "a</SCRIPT b", "<!-- </scripty", "<\\/script>"]))
def test_a_text_in_a_script_keeps_its_value_and_does_not_end_the_script(text: str) -> None:
    code = inside_script(json.dumps(text))
    assert "</script" not in code.lower()
    assert json.loads(code) == text


def test_the_viewer_is_there_and_has_no_end_of_script_left_in_it() -> None:
    bundle = viewer_bundle()
    assert "BufferGeometry" in bundle
    assert "</script" not in inside_script(bundle).lower()


def test_without_meshcat_the_error_names_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(webpage, "find_spec", lambda _name: None)
    with pytest.raises(ViewerError, match=r"run: .* -m pip install meshcat$"):
        viewer_bundle()


TYPES = ("int8", "uint8", "int16", "uint16", "int32", "uint32", "float32")
ANY = st.sampled_from(TYPES).flatmap(
    lambda kind: arrays(kind, array_shapes(max_dims=1, min_side=0, max_side=200))
)
SAMPLES = np.arange(7000) / 7000.0


@given(ANY)
def test_every_coded_array_is_restored(values: NDArray[Any]) -> None:
    again = added_up(delta_coded({"a": [values]}))["a"][0]
    assert again.dtype == values.dtype
    assert again.tobytes() == values.tobytes()


@pytest.mark.parametrize("kind", ["int32", "float32"])
@pytest.mark.parametrize("most", [2**30 - 64, 1_500_000_000])
def test_differences_of_large_numbers_do_not_overflow(kind: str, most: int) -> None:
    values = np.resize(np.array([most, -most], kind), 41)  # in one column, as 41 is prime
    again = added_up(delta_coded(values)) if most < 2**30 else delta_coded(values)
    assert again.tobytes() == values.tobytes()


def test_trees_without_long_arrays_of_multiples_are_unchanged() -> None:
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


def test_the_page_restores_coded_arrays(story: Watched) -> None:
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
def test_arrays_of_other_types_are_refused(kind: str) -> None:
    with pytest.raises(TypeError, match=kind):
        packed(np.zeros(3, dtype=kind))
