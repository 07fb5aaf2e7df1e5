"""Meshes from files, read by Coal and cleaned."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.errors import SceneError
from planner.scene.mesh_file import load_mesh
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


@pytest.mark.parametrize("scale", [(0.0, 1.0, 1.0), (1.0, 1.0), (np.nan, 1.0, 1.0)])
def test_a_scale_is_three_numbers_other_than_zero(path: Path, scale: tuple[float, ...]) -> None:
    with pytest.raises(SceneError, match="scale"):
        load_mesh(path, scale)


def test_a_file_that_is_no_mesh_is_named(tmp_path: Path) -> None:
    path = tmp_path / "words.obj"
    path.write_text("only words", encoding="utf-8")
    with pytest.raises(SceneError, match="cannot read the mesh"):
        load_mesh(path)
    with pytest.raises(SceneError, match="cannot read the mesh"):
        load_mesh(tmp_path / "none.stl")
