"""Trees of convex clusters, which represent links and bodies.

A node of a tree stands for the convex hull of its points, widened by a ball, or by a disc
perpendicular to the z axis of its shape; so spheres and cylinders are exact. It contains its two
children. A support, the smallest n . x over a node, is computed in doubles; `Clusters.rounding_m`
bounds its error.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planner.certificate.errors import NotCertifiedError, require
from planner.certificate.intervals import UNIT, Array, Interval, Pose, norm_bound

Nodes = np.ndarray[Any, np.dtype[np.intp]]

LEAF = -1
"""Stands for a missing child."""

MAX_EXACT = 8
"""A node with more triangles of a scene's mesh is replaced by the box around them."""

MAX_TRIANGLES = 200_000
"""Maximum size of a mesh in a scene."""

BOX_CORNERS = (np.arange(8)[:, None] >> np.arange(3) & 1).astype(np.bool_)
"""Which corner of a box is at the upper end of which axis, shape (8, 3)."""

BOX_MARGIN_M = 1e-9
"""By how much a box around several trees is widened."""


@dataclass(frozen=True, eq=False)
class Shape:
    """A tree of clusters in a frame of its own; node 0 is the root.

    Attributes:
        points: points of all nodes, one node after the other, shape (k, 3), m, in single or double
            precision.
        counts: number of points of each of n nodes.
        children: numbers of the children of each node, or `LEAF`, shape (n, 2).
        ball_m: radius of the ball that widens every node.
        disc_m: radius of the disc perpendicular to z that widens every node.
    """

    points: NDArray[np.floating[Any]]
    counts: Nodes
    children: Nodes
    ball_m: float = 0.0
    disc_m: float = 0.0

    @classmethod
    def of_points(cls, points: Array, ball_m: float = 0.0, disc_m: float = 0.0) -> Shape:
        """A tree of a single node."""
        return cls(points, np.array([len(points)]), np.array([[LEAF, LEAF]]), ball_m, disc_m)

    @classmethod
    def of_file(cls, data: Mapping[str, Any], where: str) -> Shape:
        """A shape as a plan file states it.

        Raises:
            NotCertifiedError: when it is malformed or of an unknown kind.
        """
        try:
            shape = cls._of_kind(data, where)
        except (KeyError, TypeError, ValueError) as cause:
            raise NotCertifiedError(f"{where}: the shape is malformed: {cause!r}") from cause
        sizes = np.array([shape.ball_m, shape.disc_m])
        is_finite = len(shape.points) > 0 and np.isfinite(shape.points).all()
        require(is_finite, f"{where}: no finite shape")
        require((sizes >= 0.0) & np.isfinite(sizes), f"{where}: a radius is negative or not finite")
        return shape

    @classmethod
    def _of_kind(cls, data: Mapping[str, Any], where: str) -> Shape:
        kind = data["type"]
        if kind == "Box":
            half = np.array(data["size_m"], np.float64).reshape(3) / 2.0
            return cls.of_points(_corners(-half, half))
        if kind == "Sphere":
            return cls.of_points(np.zeros((1, 3)), ball_m=float(data["radius_m"]))
        if kind == "Cylinder":
            ends = np.zeros((2, 3))
            ends[:, 2] = float(data["length_m"]) * np.array([-0.5, 0.5])
            return cls.of_points(ends, disc_m=float(data["radius_m"]))
        require(kind == "Mesh", f"{where}: a shape of unknown kind {kind!r}")
        vertices = np.array(data["vertices"], np.float64).reshape(-1, 3)
        triangles = np.array(data["triangles"]).reshape(-1, 3)
        require(len(triangles) > 0, f"{where}: no finite shape")
        require(len(triangles) <= MAX_TRIANGLES, f"{where}: too many triangles")
        require(triangles.dtype.kind == "i", f"{where}: triangles are not whole numbers")
        require((triangles >= 0) & (triangles < len(vertices)), f"{where}: no such vertex")
        return tree_of(vertices[triangles])

    @property
    def size(self) -> int:
        """Number of nodes."""
        return len(self.counts)

    @cached_property
    def reach_m(self) -> float:
        """Upper bound on the distance of any point from the shape's own origin.

        The root contains all other nodes, apart from their widening.
        """
        return float(norm_bound(self.points_of(0)).max()) + 2.0 * self.ball_m + self.disc_m

    @cached_property
    def middle(self) -> Array:
        """Middle of the box around the root, shape (3,), m."""
        root = self.points_of(0)
        middle: Array = 0.5 * (root.min(axis=0) + root.max(axis=0))
        return middle

    def points_of(self, node: int) -> Array:
        """Points of a node, shape (k, 3), m."""
        start = self._starts[node]
        return self.points[start : start + self.counts[node]].astype(np.float64)

    @cached_property
    def _starts(self) -> Nodes:
        starts: Nodes = np.cumsum(self.counts) - self.counts
        return starts


def tree_of(corners: Array) -> Shape:
    """A tree of triangles, halved at the median along the longest extent of their centres.

    A node of at most `MAX_EXACT` triangles has all their corners, a larger one the corners of the
    box around them. Leaves are single triangles, so they are exact. Nodes are numbered level by
    level.

    Args:
        corners: corners of m triangles, shape (m, 3, 3), m.
    """
    middles, lows, highs = corners.mean(axis=1), corners.min(axis=1), corners.max(axis=1)
    order, sizes = np.arange(len(corners)), np.array([len(corners)])
    points, counts, children, number = [], [], [], 0
    while len(sizes):
        node, starts = np.repeat(np.arange(len(sizes)), sizes), np.cumsum(sizes) - sizes
        is_box = sizes > MAX_EXACT
        counts.append(np.where(is_box, 8, 3 * sizes))
        own = np.empty((counts[-1].sum(), 3))
        first = np.cumsum(counts[-1]) - counts[-1]
        boxes = np.minimum.reduceat(lows[order], starts), np.maximum.reduceat(highs[order], starts)
        place = first[is_box, None] + np.arange(8)
        own[place] = np.where(BOX_CORNERS, boxes[1][is_box, None], boxes[0][is_box, None])
        few = np.flatnonzero(~is_box[node])
        place = (first[node] + 3 * (np.arange(len(node)) - starts[node]))[few, None] + np.arange(3)
        own[place] = corners[order[few]]
        points.append(own)

        cut = np.flatnonzero(sizes > 1)
        kids = np.full((len(sizes), 2), LEAF)
        kids[cut] = number + len(sizes) + np.arange(2 * len(cut)).reshape(-1, 2)
        children.append(kids)
        number += len(sizes)
        if not len(cut):
            break
        order, node = order[sizes[node] > 1], np.repeat(np.arange(len(cut)), sizes[cut])
        starts = np.cumsum(sizes[cut]) - sizes[cut]
        extents = np.maximum.reduceat(middles[order], starts)
        extents -= np.minimum.reduceat(middles[order], starts)
        along = middles[order, extents.argmax(axis=1)[node]]
        order = order[np.lexsort((along, node))]
        sizes = np.column_stack([(sizes[cut] + 1) // 2, sizes[cut] // 2]).ravel()
    return Shape(np.concatenate(points), np.concatenate(counts), np.concatenate(children))


class Placed(NamedTuple):
    """A tree in the frame that carries it.

    Attributes:
        shape: the tree.
        R, p: its pose there, shapes (3, 3) and (3,).
        root: number of its root among the nodes of all trees.
        apex: a further point of every node, seen from the shape, or None.
        joined: the indices of the two trees that this one is a box around, or None.
    """

    shape: Shape
    R: Array
    p: Array
    root: int
    apex: Array | None
    joined: tuple[int, int] | None


class Clusters:
    """All trees of one problem, each at a constant pose in the frame that carries it.

    The nodes of all trees are numbered together.
    """

    def __init__(self) -> None:
        self.placed: list[Placed] = []
        self._bases: list[int] = []
        self._count = 0
        self._error_R = self._error_p = 0.0
        self.reach_m = 0.0

    def add(self, shape: Shape, T: Pose, *, is_filled: bool = False) -> int:
        """Add a tree at a pose; returns the number of its root.

        A filled tree also contains the volume that its surface encloses, as every node reaches to
        the middle of the whole: every enclosed point is on a line from the middle to the surface,
        and so in one of the nodes.
        """
        return self._add(shape, T, shape.middle if is_filled and shape.size > 1 else None)

    def _add(
        self, shape: Shape, T: Pose, apex: Array | None, joined: tuple[int, int] | None = None
    ) -> int:
        (R, error_R), (p, error_p) = T.R.centred(), T.p.centred()
        self._error_R, self._error_p = max(self._error_R, error_R), max(self._error_p, error_p)
        root = self._count
        self.placed.append(Placed(shape, R, p, root, apex, joined))
        self._bases.append(root)
        own_m = shape.reach_m if apex is None else max(shape.reach_m, float(norm_bound(apex)))
        self.reach_m = max(self.reach_m, (own_m + float(norm_bound(p))) * (1.0 + 1e-9))
        self._count += shape.size
        return root

    def joined(self, roots: Sequence[int]) -> int:
        """Join several trees that one frame carries by boxes around them; returns the root."""
        require(len(roots) > 0, "nothing to join")
        if len(roots) == 1:
            return roots[0]
        boxes = np.array([self._box(root) for root in roots])
        low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
        axis = int(np.ptp(boxes.sum(axis=1), axis=0).argmax())
        order = np.argsort(boxes.sum(axis=1)[:, axis], kind="stable")
        halves = [[roots[i] for i in half] for half in np.array_split(order, 2)]
        first, second = (self.joined(half) for half in halves)
        numbers = self._block(first)[0], self._block(second)[0]
        return self._add(Shape.of_points(_corners(low, high)), Pose.identity(), None, numbers)

    @property
    def rounding_m(self) -> float:
        """Maximum error of a support along a direction with |n|_1 = 1, m.

        A pose is within `error_R` and `error_p` of its doubles, entry by entry, which changes n . x
        by at most sqrt(3) error_R |x| + error_p. The rounding of the products R^T n, n . x and
        n . p is below 30 units of |x| (Higham's gamma_n, any order, fused or not).
        """
        return self.reach_m * (9.0 * self._error_R + 128.0 * UNIT) + 3.0 * self._error_p

    def children(self, nodes: Nodes) -> Nodes:
        """Children of each node, shape (k, 2); `LEAF` where there are none."""
        found = np.empty((len(nodes), 2), np.intp)
        for i, node in enumerate(nodes.tolist()):
            block, own = self._block(node)
            placed = self.placed[block]
            if placed.joined is not None:
                found[i] = [self._bases[number] for number in placed.joined]
                continue
            kids = placed.shape.children[own]
            found[i] = np.where(kids >= 0, kids + placed.root, LEAF)
        return found

    def reaches_m(self, nodes: Nodes) -> Array:
        """Upper bounds on the distance of any point of a node from the frame that carries it, m."""
        return self._each(nodes, self._reach_m)

    def middles(self, nodes: Nodes) -> Array:
        """Middles of boxes around the nodes, shape (k, 3), seen from the frames that carry them.

        The boxes are along the axes of their shapes. Guides a search; concludes nothing.
        """
        return self._each(nodes, self._middle).reshape(-1, 3)

    def lowest(self, nodes: Nodes, n: Array) -> Array:
        """Smallest n . x over each node, shape (k,); n in the carrying frame, shape (k, 3)."""
        value = np.empty(len(nodes))
        for node, rows in _alike(nodes):
            shape, R, p = self.placed[self._block(node)[0]][:3]
            along = n[rows] @ R
            least = (self._own(node) @ along.T).min(axis=0)
            if shape.ball_m:
                least = least - shape.ball_m * norm_bound(n[rows])
            if shape.disc_m:
                least = least - shape.disc_m * norm_bound(along[:, :2])
            value[rows] = least + n[rows] @ p
        return value

    def lowest_points(self, nodes: Nodes, n: Array) -> Array:
        """Points of the nodes with the smallest n . x, shape (k, 3); concludes nothing."""
        found = np.empty((len(nodes), 3))
        for node, rows in _alike(nodes):
            x, along = self.points(node), n[rows]
            ball, disc, axis = self.widths(node)
            points = x[(x @ along.T).argmin(axis=0)]
            if ball:
                points = points - ball * _unit(along)
            if disc:
                points = points - disc * _unit(along - np.outer(along @ axis, axis))
            found[rows] = points
        return found

    def rotations(self, nodes: Nodes) -> Array:
        """Rotations of the shapes in the carrying frames, shape (k, 3, 3); concludes nothing."""
        return np.array([self.placed[self._block(node)[0]].R for node in nodes.tolist()])

    def extents_m(self, nodes: Nodes) -> Array:
        """Diagonals of boxes around the nodes, shape (k,), m; concludes nothing."""
        return self._each(nodes, lambda node: float(np.linalg.norm(np.ptp(self._own(node), 0))))

    def points(self, root: int) -> Array:
        """Points of a node in the frame that carries it, without ball or disc, shape (k, 3), m."""
        placed = self.placed[self._block(root)[0]]
        return self._own(root) @ placed.R.T + placed.p

    def widths(self, node: int) -> tuple[float, float, Array]:
        """Radii of the ball and the disc that widen a node, and the axis of the disc."""
        placed = self.placed[self._block(node)[0]]
        return placed.shape.ball_m, placed.shape.disc_m, placed.R[:, 2]

    def _box(self, root: int) -> tuple[Array, Array]:
        x, shape = self.points(root), self.placed[self._block(root)[0]].shape
        wider = shape.ball_m + shape.disc_m + BOX_MARGIN_M
        return x.min(axis=0) - wider, x.max(axis=0) + wider

    def _reach_m(self, node: int) -> float:
        shape, _, p = self.placed[self._block(node)[0]][:3]
        own_m = float(norm_bound(self._own(node)).max()) + shape.ball_m + shape.disc_m
        return (own_m + float(norm_bound(p))) * (1.0 + 1e-9)

    def _middle(self, node: int) -> Array:
        x = self._own(node)
        _, R, p = self.placed[self._block(node)[0]][:3]
        middle: Array = R @ (0.5 * (x.min(axis=0) + x.max(axis=0))) + p
        return middle

    def _own(self, node: int) -> Array:
        """The points of a node in the frame of its shape."""
        block, own = self._block(node)
        placed = self.placed[block]
        points = placed.shape.points_of(own)
        return points if placed.apex is None else np.vstack([points, placed.apex])

    def _each(self, nodes: Nodes, of: Any) -> Array:
        kinds, back = np.unique(nodes, return_inverse=True)
        return np.array([of(node) for node in kinds.tolist()], np.float64)[back]

    def _block(self, node: int) -> tuple[int, int]:
        block = bisect_right(self._bases, node) - 1
        return block, node - self._bases[block]


def _corners(low: Array, high: Array) -> Array:
    """The corners of a box, shape (8, 3)."""
    corners: Array = np.where(BOX_CORNERS, high, low)
    return corners


def _alike(nodes: Nodes) -> Iterator[tuple[int, Nodes]]:
    """Each node that occurs, and its rows."""
    order = np.argsort(nodes, kind="stable")
    cuts = np.flatnonzero(np.diff(nodes[order])) + 1
    for rows in np.split(order, cuts) if len(order) else []:
        yield int(nodes[rows[0]]), rows


def _unit(vectors: Array) -> Array:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    units: Array = vectors / np.maximum(lengths, 1e-12)
    return units


def stated_pose(data: Mapping[str, Any], where: str) -> Pose:
    """A pose as a plan file states it: "rotation", a matrix, and "translation".

    Raises:
        NotCertifiedError: when it is malformed, or its matrix is not a rotation within 1e-9.
    """
    try:
        R = np.array(data["rotation"], np.float64).reshape(3, 3)
        p = np.array(data["translation"], np.float64).reshape(3)
    except (KeyError, TypeError, ValueError) as cause:
        raise NotCertifiedError(f"{where}: the pose is malformed: {cause!r}") from cause
    require(np.isfinite(p).all() & np.isfinite(R).all(), f"{where}: a pose is not finite")
    require(np.abs(R @ R.T - np.eye(3)) <= 1e-9, f"{where}: the pose has no rotation")
    require(np.linalg.det(R) > 0.0, f"{where}: the pose is a reflection")
    return Pose(Interval(R), Interval(p))
