"""Primitives of COLLADA as triangles, and what is refused of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from planner.verification.body.collada import read_collada
from tests.planner.verification.body.collada_files import TRIANGLE, primitive, refuses, write

POLYLIST = primitive("polylist", "<vcount>4 3</vcount><p>7 0 7 1 7 2 7 3 8 0 8 6 8 5</p>")
POLYGONS = primitive("polygons", "<p>7 0 7 1 7 2 7 3</p><p>8 0 8 6 8 5</p>")

FANS_M = [
    [[0, 0, 0], [0.02, 0, 0], [0.02, 0.01, 0]],
    [[0, 0, 0], [0.02, 0.01, 0], [0, 0.01, 0]],
    [[0, 0, 0], [0.02, 0, 0.03], [0, 0, 0.03]],
]


@pytest.mark.parametrize("shown", [POLYLIST, POLYGONS], ids=["polylist", "polygons"])
def test_polygons_are_fans_of_triangles_in_metres(tmp_path: Path, shown: str) -> None:
    vertices, triangles = read_collada(write(tmp_path, shown))
    assert vertices[triangles] == pytest.approx(np.array(FANS_M), abs=1e-15)
    assert len(vertices) == 6  # the point that no polygon names is left out


@pytest.mark.parametrize(
    ("shown", "reason"),
    [
        ("", "shows no triangles"),
        (primitive("triangles", "<p>7 0 7 1 7 9</p>"), "name vertices 0 .. 9"),
        (primitive("triangles", "<p>7 0 7 1 7 -2</p>"), "name vertices -2 .. 1"),
        (primitive("triangles", "<p>7 0 7 1</p>"), "2 corners"),
        (primitive("triangles", "<p>7 0 7 1 7</p>"), "5 numbers"),
        (primitive("triangles", "<p>7 0 7 x 7 1</p>"), "invalid literal"),
        (primitive("triangles", f"<p>7 0 7 1 7 {10**30}</p>"), f"name vertices 0 .. {2**63 - 1}"),
        (primitive("polylist", "<vcount>4</vcount><p>7 0 7 1 7 2</p>"), "4 corners, but name 3"),
        (primitive("polylist", "<vcount>6 -3</vcount><p>7 0 7 1 7 2</p>"), "corners, but name 3"),
        (primitive("tristrips", "<p>7 0 7 1 7 2</p>"), "tristrips"),
        (primitive("polygons", "<ph><p>7 0 7 1 7 2</p></ph>"), "holes"),
        ("<triangles><p>0 1 2</p></triangles>", "names no vertices"),
    ],
)
def test_refuses_primitives_that_do_not_fit(tmp_path: Path, shown: str, reason: str) -> None:
    refuses(write(tmp_path, shown), reason)


@pytest.mark.parametrize(("points", "reason"), [("0 0", "has 2 numbers"), ("a" * 9999, "aaa")])
def test_refuses_points_that_are_none(tmp_path: Path, points: str, reason: str) -> None:
    refuses(write(tmp_path, TRIANGLE, points=points), reason)
