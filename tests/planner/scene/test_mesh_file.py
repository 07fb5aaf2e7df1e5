"""Meshes from files, read by Coal and cleaned."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from planner import load_mesh
from planner.errors import SceneError
from tests.bodies import CORNERS, SIDES

FLOATS_OF_32_BITS = 1e-6
"""Relative: what assimp reads coordinates with."""

SCALES = st.sampled_from([-2.0, -0.5, 0.1, 1.0, 3.0])


def cube(path: Path) -> Path:
    """A cube of edge 2 m in Wavefront's format, with every corner written for each triangle."""
    lines = [f"v {x} {y} {z}" for side in SIDES for x, y, z in CORNERS[list(side)]]
    lines += [f"f {3 * i + 1} {3 * i + 2} {3 * i + 3}" for i in range(len(SIDES))]
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return cube(tmp_path_factory.mktemp("meshes") / "cube.obj")


@given(st.tuples(SCALES, SCALES, SCALES))
def test_a_cube_is_one_however_it_is_scaled_or_mirrored(
    path: Path, scale: tuple[float, float, float]
) -> None:
    mesh = load_mesh(path, scale)
    assert (len(mesh.vertices), len(mesh.triangles)) == (8, 12)
    assert mesh.is_convex
    expected = np.abs(scale)
    np.testing.assert_allclose(mesh.vertices.max(axis=0), expected, rtol=FLOATS_OF_32_BITS)


def test_triangles_without_area_are_left_out(tmp_path: Path) -> None:
    path = cube(tmp_path / "cube.obj")
    with path.open("a", encoding="utf-8") as stream:
        stream.write("\nf 1 2 2\n")
    assert len(load_mesh(path).triangles) == 12


@pytest.mark.parametrize("ending", ["stl", "obj", "dae"])
def test_every_format_gives_the_same_mesh(tmp_path: Path, ending: str) -> None:
    made = trimesh.creation.box((0.1, 0.2, 0.3))
    made.apply_translation((0.4, 0.0, 0.05))
    made.export(tmp_path / f"box.{ending}")
    mesh = load_mesh(str(tmp_path / f"box.{ending}"), 0.5)
    assert mesh.is_convex
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    np.testing.assert_allclose(low, 0.5 * made.bounds[0], atol=FLOATS_OF_32_BITS)
    np.testing.assert_allclose(high, 0.5 * made.bounds[1], atol=FLOATS_OF_32_BITS)


@pytest.mark.parametrize(("meter", "edge_m"), [("0.0254", 0.0254), ("1.0", 1.0), (None, 1.0)])
def test_the_unit_of_a_collada_file_is_heeded(
    tmp_path: Path, meter: str | None, edge_m: float
) -> None:
    path = tmp_path / "box.dae"
    trimesh.creation.box((1.0, 1.0, 1.0)).export(path)
    unit = "" if meter is None else f'<unit name="u" meter="{meter}"/>'
    path.write_text(path.read_text().replace("<up_axis>", f"{unit}<up_axis>"))
    np.testing.assert_allclose(np.ptp(load_mesh(path).vertices, axis=0), edge_m, rtol=1e-6)


@pytest.mark.parametrize("meter", ["0", "-1", "inch", "nan"])
def test_a_unit_that_makes_no_sense_is_refused(tmp_path: Path, meter: str) -> None:
    path = tmp_path / "box.dae"
    trimesh.creation.box((1.0, 1.0, 1.0)).export(path)
    path.write_text(path.read_text().replace("<up_axis>", f'<unit meter="{meter}"/><up_axis>'))
    with pytest.raises(SceneError, match=r"cannot read the mesh .*box\.dae"):
        load_mesh(path)


def test_a_mesh_that_is_not_solid_is_warned_of(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    box = trimesh.creation.box((0.2, 0.2, 0.1))
    without_a_triangle = trimesh.Trimesh(box.vertices, box.faces[1:])
    ring = trimesh.creation.annulus(0.05, 0.1, 0.1)
    said = {}
    for name, made in (("box", box), ("bin", without_a_triangle), ("ring", ring)):
        made.export(tmp_path / f"{name}.stl")
        caplog.clear()
        assert load_mesh(tmp_path / f"{name}.stl").is_convex == (name == "box")
        said[name] = caplog.text
    assert said["box"] == ""
    assert "bin.stl is not solid: 3 of its edges do not join two triangles;" in said["bin"]
    assert "ring.stl is not solid: the volume that it encloses is not convex;" in said["ring"]


@pytest.mark.parametrize("nothing", [None, 5, b"box.stl"])
def test_a_mesh_is_read_from_a_path(nothing: Any) -> None:
    with pytest.raises(SceneError, match="a mesh is read from a path"):
        load_mesh(nothing)


@pytest.mark.parametrize("scale", [(0.0, 1.0, 1.0), (1.0, 1.0), (np.nan, 1.0, 1.0), 0.0, "half"])
def test_a_scale_is_numbers_other_than_zero(path: Path, scale: Any) -> None:
    with pytest.raises(SceneError, match="scale"):
        load_mesh(path, scale)


def test_a_file_that_is_no_mesh_is_named(tmp_path: Path) -> None:
    path = tmp_path / "words.obj"
    path.write_text("only words", encoding="utf-8")
    with pytest.raises(SceneError, match="cannot read the mesh"):
        load_mesh(path)
    with pytest.raises(SceneError, match="cannot read the mesh"):
        load_mesh(tmp_path / "none.stl")
