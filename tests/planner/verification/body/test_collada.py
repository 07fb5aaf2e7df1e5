"""The reader of COLLADA files: trimesh's triangles, Pinocchio's vertices, and placed nodes."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from functools import cache
from pathlib import Path

import coal
import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from baxter_kin.description import StockFiles
from planner.verification.body import collada
from planner.verification.body.collada import read_collada
from tests.planner.verification.body.collada_files import TRIANGLE, primitive, refuses, write

FILES = StockFiles.installed()

SINGLE = 1e-7
"""What rounding to single precision, as trimesh and Pinocchio do, moves in Baxter's meshes, m."""

MESHES = sorted(
    {
        FILES.package_dir / mesh.get("filename", "").removeprefix("package://")
        for mesh in ET.parse(FILES.urdf).getroot().iterfind("link/visual/geometry/mesh")
    }
)


@cache
def read(path: Path) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    return read_collada(path)


def twice_areas(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    a, b, c = corners.swapaxes(0, 1)
    lengths: NDArray[np.float64] = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return lengths


def of_trimesh(path: Path) -> NDArray[np.float64]:
    """The corners of every triangle but those with two in one point, shape (m, 3, 3)."""
    mesh = trimesh.load(path, force="mesh", process=False)
    assert isinstance(mesh, trimesh.Trimesh)
    corners = np.asarray(mesh.vertices)[np.asarray(mesh.faces)]
    is_flat = (corners == corners[:, [1, 2, 0]]).all(axis=2).any(axis=1)
    kept: NDArray[np.float64] = corners[~is_flat]
    return kept


@pytest.mark.parametrize("path", MESHES, ids=lambda path: path.stem)
def test_every_triangle_of_the_robot_is_trimeshs(path: Path) -> None:
    vertices, triangles = read(path)
    theirs = of_trimesh(path)
    assert len(triangles) == len(theirs)
    assert np.abs(vertices[triangles] - theirs).max() < SINGLE


@pytest.mark.parametrize("path", MESHES, ids=lambda path: path.stem)
def test_the_robots_surface_has_trimeshs_area(path: Path) -> None:
    vertices, triangles = read(path)
    theirs = of_trimesh(path)
    areas, their_areas = twice_areas(vertices[triangles]), twice_areas(theirs)
    # what single precision may move an area by: every edge by two roundings
    edges = np.linalg.norm(theirs[:, [1, 2, 0]] - theirs, axis=2).sum(axis=1)
    assert (np.abs(areas - their_areas) < 4.0 * SINGLE * (edges + SINGLE)).all()
    assert areas.sum() == pytest.approx(their_areas.sum(), rel=SINGLE)


@pytest.mark.parametrize("path", MESHES, ids=lambda path: path.stem)
def test_the_robots_vertices_are_those_that_pinocchio_reads(path: Path) -> None:
    ours = read(path)[0]
    theirs = np.array(coal.MeshLoader(coal.BV_OBBRSS).load(str(path)).vertices())
    assert farthest_m(ours, theirs) < SINGLE
    assert farthest_m(theirs, ours) < SINGLE


def farthest_m(points: NDArray[np.float64], others: NDArray[np.float64]) -> float:
    """How far any point is from the nearest of others."""
    spatial = pytest.importorskip("scipy.spatial")
    return float(spatial.cKDTree(others).query(points)[0].max())


def test_a_node_is_placed_by_its_transforms_in_their_order(tmp_path: Path) -> None:
    matrix = "<matrix>0 -1 0 5  1 0 0 0  0 0 1 0  0 0 0 1</matrix>"
    steps = "<translate>5 0 0</translate><rotate>0 0 2 90</rotate><scale>1 1 2</scale>"
    shows = '<instance_geometry url="#shape"/>'
    expected = np.array([[0.05, 0, 0], [0.05, 0.02, 0], [0.04, 0.02, 0]])
    for node in (matrix + shows, steps + shows, f"{steps}<node>{shows}</node>"):
        vertices, triangles = read_collada(write(tmp_path, TRIANGLE, node))
        assert vertices[triangles[0]] == pytest.approx(expected, abs=1e-15)


def test_a_nested_node_is_seen_from_its_parent(tmp_path: Path) -> None:
    inner = '<node><translate>1 0 0</translate><instance_geometry url="#shape"/></node>'
    vertices, _ = read_collada(write(tmp_path, TRIANGLE, f"<rotate>0 0 1 90</rotate>{inner}"))
    assert vertices[0] == pytest.approx([0.0, 0.01, 0.0], abs=1e-15)


def test_an_instance_more_is_a_surface_more(tmp_path: Path) -> None:
    shows = '<instance_geometry url="#shape"/>'
    other = f"<node><translate>0 0 1</translate>{shows}</node>"
    vertices, triangles = read_collada(write(tmp_path, TRIANGLE, shows + other))
    assert triangles.tolist() == [[0, 1, 2], [3, 4, 5]]
    assert vertices[3:] - vertices[:3] == pytest.approx(np.tile([0, 0, 0.01], (3, 1)), abs=1e-15)


def test_a_triangle_with_two_corners_in_one_point_is_left_out(tmp_path: Path) -> None:
    twice = primitive("triangles", "<p>7 0 7 1 7 2 7 3 7 3 7 1</p>")
    assert read_collada(write(tmp_path, twice))[1].tolist() == [[0, 1, 2]]


@pytest.mark.parametrize(
    ("node", "reason"),
    [
        ('<instance_geometry url="#nothing"/>', "'#nothing'"),
        ("<instance_geometry/>", "lacks what ''"),
        ('<instance_geometry url="#s"/>', "not a mesh"),
        ('<instance_node url="#n"/>', "instance_node"),
        ("<matrix>1 0 0</matrix>", "3 numbers, not 16"),
        ("<matrix>1 0 0 0 0 1 0 0 0 0 1 0 0 0 1 1</matrix>", "last row"),
        ("<rotate>0 0 0 90</rotate>", "no length"),
        ("<translate>nan 0 0</translate>", "not finite"),
    ],
)
def test_refuses_nodes_that_mean_nothing(tmp_path: Path, node: str, reason: str) -> None:
    refuses(write(tmp_path, TRIANGLE, node), reason)


@pytest.mark.parametrize(("unit", "reason"), [("0", "0 m"), ("nan", "nan m"), ("cm", "'cm'")])
def test_refuses_a_unit_of_no_length(tmp_path: Path, unit: str, reason: str) -> None:
    refuses(write(tmp_path, TRIANGLE, unit=unit), reason)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (b"", "no element found"),
        (b"solid of STL", "syntax error"),
        (b"<COLLADA", "unclosed token"),
        (b"<robot/>", "<robot>"),
        (b"<COLLADA/>", "no visual scene"),
        (b'<?xml version="1.0" encoding="none"?><COLLADA/>', "none"),
        (b'<!DOCTYPE C [<!ENTITY e "e">]><COLLADA>&e;</COLLADA>', "document type"),
    ],
)
def test_refuses_what_is_no_collada(tmp_path: Path, text: bytes, reason: str) -> None:
    path = tmp_path / "shape.dae"
    path.write_bytes(text)
    refuses(path, reason)


def test_refuses_a_file_that_is_not_there(tmp_path: Path) -> None:
    refuses(tmp_path / "shape.dae", "No such file")
    refuses(tmp_path, "directory")


def test_refuses_a_file_that_is_too_large(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path, TRIANGLE)
    monkeypatch.setattr(collada, "MOST_TRIANGLES", 0)
    refuses(path, "more than 0 triangles")
    monkeypatch.setattr(collada, "LARGEST_FILE", 100)
    refuses(path, "more than 100 bytes")
