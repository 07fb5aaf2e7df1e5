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
from tests.meshes.collada import read_collada

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
