"""Make `planner/certificate/body.npz`: the robot's meshes as trees of thin convex clusters.

    python scripts/build_body_clusters.py [--out FILE]

Reads the COLLADA meshes of example-robot-data (Rethink Robotics, BSD-3-Clause) by pycollada, in
single precision, for which the checker widens every cluster by 2e-8 m. A node of a tree stands for
the convex hull of its points and contains every triangle below it: all corners of a triangle are in
one leaf. Triangles are halved at the median of the longest extent until they are at most `LEAF`,
and between two planes `THICK_M` apart: what a hull fills in is then at most so deep. Points inside
the hull of others are left out only where they are a convex combination of points that stay, with a
residual of at most `RESIDUAL_M`, which the checker's rounding covers. Needs the `body` extra. Ten
minutes.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from body.meshes import F, placed_shapes, triangles
from scipy.spatial import ConvexHull, Delaunay, QhullError
from tqdm import tqdm

from baxter_kin.description import StockFiles
from planner.certificate.clusters import LEAF as NO_CHILD
from planner.certificate.clusters import Shape

TARGET = Path(__file__).resolve().parent.parent / "planner" / "certificate" / "body.npz"

LEAF = 32
"""Triangles of a leaf at most."""

THICK_M = 5e-4
"""Extent of a leaf at most, in the direction in which it varies least."""

RESIDUAL_M = 1e-12
"""By how much a point that is left out may be outside, in the sum of its coordinates."""

FEW = 12
"""So many points are all kept."""


def main() -> None:
    """Build the file."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--out", type=Path, default=TARGET, help="default: %(default)s")
    options = parser.parse_args()
    placed = [each for each in placed_shapes() if ":" not in each.link]
    meshes = sorted({each.mesh for each in placed_shapes() if each.mesh})
    trees = [tree_of(1e-3 * triangles(mesh)) for mesh in tqdm(meshes, unit="mesh")]
    kinds = [each.primitive[0] or "mesh" for each in placed]
    sizes = np.zeros((len(placed), 3))
    for row, each in zip(sizes, placed, strict=True):
        row[: len(each.primitive[1])] = each.primitive[1]
    points = np.concatenate([tree.points for tree in trees])
    single = points.astype(np.float32)
    if not (single == points).all():
        sys.exit("points of the meshes are not in single precision, as the reader gives them")
    notice = (StockFiles.installed().urdf.parent.parent / "LICENSE").read_text("utf-8")
    np.savez_compressed(
        options.out,
        allow_pickle=False,
        notice=np.array(notice),
        meshes=np.array(meshes),
        nodes=np.array([tree.size for tree in trees]),
        points=single,
        counts=np.concatenate([tree.counts for tree in trees]).astype(np.int32),
        children=np.concatenate([tree.children for tree in trees]).astype(np.int32),
        links=np.array([each.link for each in placed]),
        link_meshes=np.array([each.mesh for each in placed]),
        link_kinds=np.array(kinds),
        link_sizes=sizes,
        link_rotations=np.array([each.R_link_shape for each in placed]),
        link_translations=np.array([each.p_link_shape for each in placed]),
    )
    nodes = sum(tree.size for tree in trees)
    print(f"{options.out}: {options.out.stat().st_size / 1e6:.1f} MB, {nodes} nodes")


def tree_of(corners: F) -> Shape:
    """A tree of triangles, shape (m, 3, 3), halved at the median of the longest extent."""
    points: list[F] = []
    children: list[list[int]] = []
    middles, open_ = corners.mean(axis=1), [(np.arange(len(corners)), NO_CHILD, 0)]
    while open_:
        own, parent, side = open_.pop()
        number = len(points)
        points.append(kept(corners[own].reshape(-1, 3)))
        children.append([NO_CHILD, NO_CHILD])
        if parent >= 0:
            children[parent][side] = number
        if len(own) > 1 and not is_leaf(len(own), points[-1]):
            axis = int(np.ptp(middles[own], axis=0).argmax())
            order = own[np.argsort(middles[own, axis], kind="stable")]
            open_ += [(half, number, i) for i, half in enumerate(np.array_split(order, 2))]
    counts = np.array([len(each) for each in points])
    return Shape(np.concatenate(points), counts, np.array(children))


def is_leaf(count: int, points: F) -> bool:
    """Whether a node is small and thin enough."""
    return count <= LEAF and thickness_m(points) <= THICK_M


def kept(points: F) -> F:
    """Points whose hull contains all of them, up to `RESIDUAL_M`."""
    points = np.unique(points, axis=0)
    if len(points) <= FEW:
        return points
    try:
        hull = points[ConvexHull(points).vertices]
        cells = Delaunay(hull)
    except QhullError:  # all in a plane
        return points
    where = cells.find_simplex(points, tol=1e-9)
    turned, origin = cells.transform[where, :3], cells.transform[where, 3]
    shares = np.einsum("nij,nj->ni", turned, points - origin)
    shares = np.maximum(np.column_stack([shares, 1.0 - shares.sum(axis=1)]), 0.0)
    total = shares.sum(axis=1)
    combined = np.einsum("nk,nkj->nj", shares, hull[cells.simplices[where]]) / total[:, None]
    off = np.abs(combined - points).sum(axis=1)
    is_inside = (where >= 0) & (np.abs(total - 1.0) < 1e-6) & (off <= RESIDUAL_M)
    return np.unique(np.concatenate([hull, points[~is_inside]]), axis=0)


def thickness_m(points: F) -> float:
    """Distance of two planes around points, across the direction in which they vary least."""
    around = points - points.mean(axis=0)
    return float(np.ptp(around @ np.linalg.svd(around, full_matrices=False)[2][-1]))


if __name__ == "__main__":
    main()
