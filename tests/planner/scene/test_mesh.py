"""Meshes: which arrays and files are one, and which are convex."""

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
from planner.scene.mesh import LARGEST_SHAPE_M
from tests.bodies import CORNERS, SIDES
from tests.planner.conftest import hull, mesh_of

TRIANGLE = np.eye(3)

FLOATS_OF_32_BITS = 1e-6
"""Relative accuracy of coordinates read by assimp."""

SCALES = st.sampled_from([-2.0, -0.5, 0.1, 1.0, 3.0])


def test_a_cube_is_convex() -> None:
    assert mesh_of(CORNERS, SIDES).is_convex


@given(st.integers(0, 2**32 - 1), st.integers(5, 40))
def test_a_convex_hull_is_convex(seed: int, count: int) -> None:
    assert hull(np.random.default_rng(seed).normal(size=(count, 3))).is_convex


@pytest.mark.parametrize(
    ("vertices", "triangles"),
    [
        (CORNERS, SIDES[1:]),  # open
        (CORNERS, np.array(SIDES)[:, ::-1]),  # inside out
        (CORNERS, [SIDES[0][::-1], *SIDES[1:]]),  # one triangle turned over
        (TRIANGLE, [[0, 1, 2]]),
        (TRIANGLE, [[0, 1, 2], [0, 2, 1]]),  # closed, but flat
        (np.concatenate([CORNERS, CORNERS + 3]), [*SIDES, *(np.array(SIDES) + 8).tolist()]),
        (np.concatenate([CORNERS, CORNERS / 2]), [*SIDES, *(np.array(SIDES) + 8).tolist()]),
        (CORNERS * np.where(np.arange(8) == 7, 0.1, 1.0)[:, None], SIDES),  # one corner dented
    ],
)
def test_a_mesh_that_does_not_close_around_a_convex_volume_is_a_surface(
    vertices: Any, triangles: Any
) -> None:
    assert not mesh_of(vertices, triangles).is_convex


@given(st.integers(0, 2**32 - 1))
def test_support_is_the_farthest_corner(seed: int) -> None:
    rng = np.random.default_rng(seed)
    vertices = rng.normal(size=(3, 3))
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    farthest = max(float(np.dot(vertex, direction)) for vertex in vertices)
    assert mesh_of(vertices, [[0, 1, 2]]).support_m(direction) == pytest.approx(farthest)


@pytest.mark.parametrize(
    ("vertices", "triangles", "says"),
    [
        (np.zeros((0, 3)), np.zeros((0, 3)), "1 .. "),
        (TRIANGLE, np.zeros((0, 3)), "1 .. "),
        (TRIANGLE[:, :2], [[0, 1, 2]], "shape"),
        (TRIANGLE, [0, 1, 2], "shape"),
        (TRIANGLE, [[0, 1, 2, 0]], "shape"),
        (3.0, [[0, 1, 2]], "shape"),
        (TRIANGLE, 3, "shape"),
        (TRIANGLE * np.nan, [[0, 1, 2]], "finite"),
        (TRIANGLE + np.inf, [[0, 1, 2]], "finite"),
        (TRIANGLE, [[0, 1, np.nan]], "finite"),
        (TRIANGLE, [[0, 1, 3]], "vertex 3"),
        (TRIANGLE, [[0, 1, -1]], "vertex -1"),
        (TRIANGLE, [[0, 1, 1.5]], "vertex 1.5"),
        (TRIANGLE, [[0, 1, 1e300]], "vertex 1e\\+300"),
        ("corners", [[0, 1, 2]], "real numbers"),
        (TRIANGLE, "abc", "real numbers"),
        (None, None, "mesh vertices"),
        (TRIANGLE, [[0, 1, 1]], "vertex 2 of a mesh is in no triangle"),
        (TRIANGLE, [[0, 1, 2], [0, 1, 1]], "triangle 1 of a mesh has no area"),
        (np.outer([0.0, 1.0, 2.0], [1.0, 1.0, 1.0]), [[0, 1, 2]], "no area"),
        (TRIANGLE * 1e-9, [[0, 1, 2]], "no area"),
        (TRIANGLE * 1e-300, [[0, 1, 2]], "no area"),
        (TRIANGLE * 2 * LARGEST_SHAPE_M, [[0, 1, 2]], "in metres"),
        (TRIANGLE * 1e300, [[0, 1, 2]], "in metres"),
        (TRIANGLE, np.tile([0, 1, 2], (200_001, 1)), "200000"),
    ],
)
def test_refuses_arrays_that_are_not_a_mesh(vertices: Any, triangles: Any, says: str) -> None:
    with pytest.raises(SceneError, match=says):
        mesh_of(vertices, triangles)


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
def test_a_cube_stays_convex_when_scaled_or_mirrored(
    path: Path, scale: tuple[float, float, float]
) -> None:
    mesh = load_mesh(path, scale)
    assert (len(mesh.vertices), len(mesh.triangles)) == (8, 12)
    assert mesh.is_convex
    expected = np.abs(scale)
    np.testing.assert_allclose(mesh.vertices.max(axis=0), expected, rtol=FLOATS_OF_32_BITS)


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
def test_the_unit_of_a_collada_file_is_applied(
    tmp_path: Path, meter: str | None, edge_m: float
) -> None:
    path = tmp_path / "box.dae"
    trimesh.creation.box((1.0, 1.0, 1.0)).export(path)
    unit = "" if meter is None else f'<unit name="u" meter="{meter}"/>'
    path.write_text(path.read_text().replace("<up_axis>", f"{unit}<up_axis>"))
    np.testing.assert_allclose(np.ptp(load_mesh(path).vertices, axis=0), edge_m, rtol=1e-6)


@pytest.mark.parametrize("meter", ["0", "-1", "inch", "nan"])
def test_an_invalid_unit_is_refused(tmp_path: Path, meter: str) -> None:
    path = tmp_path / "box.dae"
    trimesh.creation.box((1.0, 1.0, 1.0)).export(path)
    path.write_text(path.read_text().replace("<up_axis>", f'<unit meter="{meter}"/><up_axis>'))
    with pytest.raises(SceneError, match=r"cannot read the mesh .*box\.dae"):
        load_mesh(path)


def test_values_of_a_mesh_are_its_own_and_triangles_without_area_are_left_out(
    tmp_path: Path,
) -> None:
    vertices, triangles = np.eye(3), np.array([[0, 1, 2]])
    mesh = mesh_of(vertices, triangles)
    vertices[0], triangles[0] = 9.0, 0
    assert np.array_equal(mesh.corners[0], np.eye(3))
    for name in ("vertices", "triangles"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(mesh, name)[0, 0] = 1
    path = cube(tmp_path / "cube.obj")
    with path.open("a", encoding="utf-8") as stream:
        stream.write("\nf 1 2 2\n")
    assert len(load_mesh(path).triangles) == 12


def test_a_mesh_that_is_not_solid_is_logged_as_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    box = trimesh.creation.box((0.2, 0.2, 0.1))
    without_a_triangle = trimesh.Trimesh(box.vertices, box.faces[1:])
    ring = trimesh.creation.annulus(0.05, 0.1, 0.1)
    logged = {}
    for name, made in (("box", box), ("bin", without_a_triangle), ("ring", ring)):
        made.export(tmp_path / f"{name}.stl")
        caplog.clear()
        assert load_mesh(tmp_path / f"{name}.stl").is_convex == (name == "box")
        logged[name] = caplog.text
    assert logged["box"] == ""
    assert "bin.stl is not solid: 3 of its edges do not join two triangles;" in logged["bin"]
    assert "ring.stl is not solid: the volume that it encloses is not convex;" in logged["ring"]


def test_a_message_names_the_file_that_is_not_a_mesh(tmp_path: Path) -> None:
    path = tmp_path / "words.obj"
    path.write_text("only words", encoding="utf-8")
    with pytest.raises(SceneError, match="cannot read the mesh"):
        load_mesh(path)
    with pytest.raises(SceneError, match="cannot read the mesh"):
        load_mesh(tmp_path / "none.stl")


@pytest.mark.parametrize(
    "arguments",
    [
        *((nothing,) for nothing in (None, 5, b"box.stl")),
        *(("cube", bad) for bad in ((0.0, 1.0, 1.0), (1.0, 1.0), (np.nan, 1.0, 1.0), 0.0, "half")),
    ],
    ids=str,
)
def test_refuses_paths_and_scales_of_another_class(path: Path, arguments: tuple[Any, ...]) -> None:
    file, *scale = arguments
    with pytest.raises(SceneError, match="scale" if scale else "a mesh is read from a path"):
        load_mesh(path if file == "cube" else file, *scale)
