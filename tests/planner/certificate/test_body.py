"""The file of clusters contains Rethink's meshes, read by another reader."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from baxter_kin.description import StockFiles
from planner.certificate.body import MESH_BALL_M, STOCK_FILE, Body
from planner.certificate.clusters import LEAF, Shape
from planner.certificate.errors import NotCertifiedError
from planner.certificate.intervals import Array
from tests.meshes.collada import read_collada

OUTSIDE_M = MESH_BALL_M
"""So far outside of its leaf's points a corner may be, as the leaf is widened by it."""

THICK_M = 5e-4
SAMPLES = 150


def files() -> dict[str, Path]:
    root = StockFiles.installed().urdf.parent.parent / "meshes"
    return {file.stem: file for file in root.rglob("*.DAE")}


def leaves(shape: Shape) -> list[Array]:
    return [shape.points_of(i) for i in range(shape.size) if shape.children[i, 0] == LEAF]


@pytest.mark.parametrize("mesh", ["W2", "E1", "paddle_tip", "extended_narrow", "H0"])
def test_triangles_of_the_meshes_are_in_leaves(body: Body, mesh: str) -> None:
    """Of some triangles, a leaf is found that no direction shows to miss a corner."""
    vertices, triangles = read_collada(files()[mesh])
    rng = np.random.default_rng(6)
    chosen = vertices[triangles[rng.choice(len(triangles), min(SAMPLES, len(triangles)), False)]]
    found = leaves(body.mesh(mesh))
    low = np.array([x.min(axis=0) for x in found]) - OUTSIDE_M
    high = np.array([x.max(axis=0) for x in found]) + OUTSIDE_M
    directions = rng.normal(size=(60, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for corners in chosen:
        inside = (corners[None] >= low[:, None]).all((1, 2)) & (corners[None] <= high[:, None]).all(
            (1, 2)
        )
        assert any(
            (directions @ corners.T <= (directions @ found[i].T).max(1)[:, None] + OUTSIDE_M).all()
            for i in np.flatnonzero(inside)
        )


def test_leaves_are_thin(body: Body) -> None:
    for points in leaves(body.mesh("W2"))[::20]:
        around = points - points.mean(axis=0)
        normal = np.linalg.svd(around, full_matrices=False)[2][-1]
        assert np.ptp(around @ normal) <= THICK_M + 1e-9 or len(points) <= 3


def test_links_without_a_shape_are_named(body: Body) -> None:
    assert "left_gripper" in body.bare
    assert "left_lower_forearm" not in body.bare
    assert {"left_wrist", "right_wrist", "torso", "pedestal"} <= {s.link for s in body.shapes}


def test_a_damaged_file_is_refused(text: str, tmp_path: Path) -> None:
    content = STOCK_FILE.read_bytes()
    for number, damaged in enumerate((content[:1000], content[:-1000], b"nothing")):
        file = tmp_path / f"{number}.npz"
        file.write_bytes(damaged)
        with pytest.raises(NotCertifiedError, match="damaged"):
            Body(text, file)


def test_a_shape_with_a_huge_angle_is_refused(text: str) -> None:
    first = text.index("<origin", text.index("<visual>"))
    end = text.index("/>", first) + 2
    turned = text[:first] + '<origin xyz="0 0 0" rpy="0 1e308 0"/>' + text[end:]
    with pytest.raises(NotCertifiedError, match=r"unknown shape of .*: an angle is beyond"):
        Body(turned)
