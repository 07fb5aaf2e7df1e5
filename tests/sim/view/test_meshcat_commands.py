"""Meshcat's commands: as its viewer reads them, and small."""

from __future__ import annotations

import sys
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
import umsgpack
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from sim.view.meshcat_commands import (
    TUBE_STEP_M,
    compact,
    delete,
    glowing,
    material,
    packed,
    painted,
    set_object,
    set_property,
    set_transform,
    short_numbers,
    triangles,
    tube,
)

MSGPACK_LITE = {0x11: "<i1", 0x13: "<i2", 0x14: "<u2", 0x16: "<u4", 0x17: "<f4"}
"""Its extension types of Int8Array, Int16Array, Uint16Array, Uint32Array and Float32Array."""

RADIUS_M = 0.01

lines = st.integers(2, 8).flatmap(
    lambda n: arrays(np.float64, (n, 3), elements=st.floats(-2.0, 2.0, width=32))
)


def apart(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Those that are 5 cm and more from the one before."""
    kept = [points[0]]
    for point in points[1:]:
        if np.linalg.norm(point - kept[-1]) > 0.05:
            kept.append(point)
    return np.array(kept)


def unpacked(data: bytes) -> object:
    """As msgpack-lite decodes it."""
    handlers = {
        code: lambda ext: np.frombuffer(ext.data, MSGPACK_LITE[ext.type]) for code in MSGPACK_LITE
    }
    return umsgpack.unpackb(data, ext_handlers=handlers)


@pytest.mark.parametrize("name", ["int8", "int16", "uint16", "uint32", "float32"])
@pytest.mark.parametrize("order", ["<", ">"])
def test_arrays_come_back_whatever_their_type_and_byte_order(name: str, order: str) -> None:
    values = np.array([0, 1, 100], dtype=np.dtype(name).newbyteorder(order))  # type: ignore[arg-type]
    found = unpacked(packed({"array": values}))
    assert isinstance(found, dict)
    assert found["array"].dtype == np.dtype(name)
    assert found["array"].tolist() == [0, 1, 100]
    assert sys.byteorder == "little"  # or the line above compares with a swapped type


def test_a_transform_is_sent_column_by_column() -> None:
    T = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, np.pi / 2), np.array([1.0, 2.0, 3.0]))
    matrix = set_transform("/a", T)["matrix"]
    assert matrix == pytest.approx([0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 1, 2, 3, 1], abs=1e-15)


def test_an_object_names_the_geometry_and_material_that_it_is_drawn_with() -> None:
    command = set_object("/a/b", {"type": "BufferGeometry"}, glowing((1.0, 0.0, 0.0)))
    drawn = command["object"]["object"]
    assert command["path"] == "/a/b"
    assert drawn["geometry"] == command["object"]["geometries"][0]["uuid"]
    assert drawn["material"] == command["object"]["materials"][0]["uuid"]
    assert "matrix" not in drawn
    named = triangles(np.zeros((3, 3), np.int16), np.zeros((1, 3), np.uint16), uuid="cup")
    assert set_object("/a", named, glowing((0, 0, 0)))["object"]["object"]["geometry"] == "cup"


@pytest.mark.parametrize(
    ("rgb", "number"),
    [
        ((1.0, 0.0, 0.0), 0xFF0000),
        ((0.0, 1.0, 0.0), 0x00FF00),
        ((0.0, 0.0, 1.0), 0x0000FF),
        ((9.0, -1.0, 0.5), 0xFF0080),
    ],
)
def test_colours_are_numbers_and_stay_within_what_a_screen_shows(
    rgb: tuple[float, float, float], number: int
) -> None:
    assert material(rgb)["color"] == number
    assert glowing(rgb)["color"] == number


def test_transparent_materials_are_marked() -> None:
    assert not material((1.0, 1.0, 1.0))["transparent"]
    assert material((1.0, 1.0, 1.0), opacity=0.5)["transparent"]
    assert painted(gloss=0.1)["transparent"]


def test_properties_and_deletions_name_their_node() -> None:
    assert set_property("/a", "visible", value=False) == {
        "type": "set_property",
        "path": "/a",
        "property": "visible",
        "value": False,
    }
    assert delete("/a") == {"type": "delete", "path": "/a"}


def test_triangles_name_their_arrays_as_javascript_does() -> None:
    vertices, faces = np.zeros((3, 3), np.float32), np.array([[0, 1, 2]], np.uint32)
    data = triangles(
        vertices, faces, np.zeros((3, 3), np.int8), colours=np.ones((3, 4), np.float32)
    )
    attributes = data["data"]["attributes"]
    assert {name: (a["type"], a["itemSize"]) for name, a in attributes.items()} == {
        "position": ("Float32Array", 3),
        "normal": ("Int8Array", 3),
        "color": ("Float32Array", 4),
    }
    assert data["data"]["index"]["type"] == "Uint32Array"
    assert data["data"]["index"]["array"].tolist() == [0, 1, 2]


@given(lines)
def test_the_corners_of_a_tube_are_its_radius_from_its_line_and_around_it(
    points: NDArray[np.float64],
) -> None:
    points = apart(points)
    vertices, faces = tube(points, RADIUS_M)
    assert vertices.shape == faces.shape == (8 * (len(points) - 1), 3)
    assert faces.max(initial=0) < max(1, len(vertices))
    rounded_m = np.sqrt(3.0) * TUBE_STEP_M / 2 + 1e-6  # and what single precision leaves
    for k, (begin, end) in enumerate(pairwise(points)):
        way = (end - begin) / np.linalg.norm(end - begin)
        corners = vertices[8 * k : 8 * k + 8].astype(float) - begin
        off_m = np.linalg.norm(corners - np.outer(corners @ way, way), axis=1)
        assert off_m == pytest.approx(np.full(8, RADIUS_M), abs=rounded_m)
        ends = corners[:4].mean(axis=0), corners[4:].mean(axis=0)
        assert np.array(ends) == pytest.approx(np.array([0 * way, end - begin]), abs=rounded_m)


def test_a_segment_of_no_length_has_a_tube_of_finite_numbers() -> None:
    vertices, _ = tube(np.zeros((3, 3)), RADIUS_M)
    assert np.isfinite(vertices).all()


@pytest.mark.parametrize(("largest", "name"), [(0, "uint16"), (65535, "uint16"), (65536, "uint32")])
def test_faces_take_16_bits_as_long_as_these_are_enough(largest: int, name: str) -> None:
    found = compact(np.array([[0, 1, largest]]))
    assert found.dtype == np.dtype(name)
    assert found.tolist() == [[0, 1, largest]]


@given(arrays(np.float64, 5, elements=st.floats(-8.0, 8.0)))
def test_short_numbers_are_multiples_of_the_step_next_to_the_values(
    values: NDArray[np.float64],
) -> None:
    found = short_numbers(values, TUBE_STEP_M).astype(float)
    assert np.abs(found - values).max() <= TUBE_STEP_M / 2
    assert (found / TUBE_STEP_M == np.round(found / TUBE_STEP_M)).all()
