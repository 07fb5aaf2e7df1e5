"""Upper bounds on distances: the distance of two points, each proven to be in its cluster.

The points are found by the algorithm of Gilbert, Johnson and Keerthi in doubles. It is not trusted:
its result is weights of points, and a convex combination of points of a cluster is in the cluster
whatever the weights are.
"""

from __future__ import annotations

import heapq
from itertools import combinations

import numpy as np

from planner.certificate.clusters import LEAF, Clusters
from planner.certificate.errors import require
from planner.certificate.intervals import Array

ROUNDING_M = 1e-12
"""Rounding error of a convex combination of points within some metres."""

EXCESS_M = 1e-7
"""By how much a bound may exceed the smallest one, as many pairs may be equally near."""

MAX_ITERATIONS = 40
MAX_PAIRS = 2000
"""Maximum number of pairs of nodes that are examined; then the best bound so far is returned."""

MAX_PAIRS_OF_PLAN = 5000
"""Likewise for one plan; a pick and place takes about 50."""


class DistanceBounds:
    """Upper bounds on distances of trees, for up to `MAX_PAIRS_OF_PLAN` pairs of nodes."""

    def __init__(self, clusters: Clusters) -> None:
        """Start counting pairs of nodes."""
        self._clusters = clusters
        self._examined = 0

    def bound_m(self, first: int, second: int, shift: Array, enough_m: float) -> float:
        """An upper bound on the distance of two trees seen from one frame, m.

        Args:
            first: the root of one tree.
            second: the root of the other.
            shift: added to all points of the first, shape (3,), m.
            enough_m: the search ends at a bound of at most this.

        Raises:
            NotCertifiedError: when the plan exceeds `MAX_PAIRS_OF_PLAN`.
        """
        clusters, best = self._clusters, np.inf
        open_: list[tuple[float, int, int, int]] = [(0.0, 0, first, second)]
        for _ in range(MAX_PAIRS):
            if not open_ or best <= enough_m or open_[0][0] >= best - EXCESS_M:
                break
            self._examined += 1
            require(self._examined <= MAX_PAIRS_OF_PLAN, "contacts take too long to find")
            _, number, a, b = heapq.heappop(open_)
            x, y = clusters.points(a) + shift, clusters.points(b)
            wide = clusters.widths(a), clusters.widths(b)
            weights_x, weights_y = _nearest(x, y)
            on_first, on_second = weights_x @ x, weights_y @ y
            away_m = float(np.linalg.norm(on_first - on_second))
            kids = [clusters.children(np.array([node]))[0].tolist() for node in (a, b)]
            are_leaves = [pair[0] == LEAF for pair in kids]
            if all(are_leaves):
                on_first = _towards(on_first, on_second, *wide[0])
                on_second = _towards(on_second, on_first, *wide[1])
                best = min(best, float(np.linalg.norm(on_first - on_second)) + ROUNDING_M)
                continue
            low = max(0.0, away_m - sum(ball + disc for ball, disc, _ in wide) - 1e-9)
            side = 1 if are_leaves[0] or (not are_leaves[1] and np.ptp(y) > np.ptp(x)) else 0
            for kid in kids[side]:
                pair = (kid, b) if side == 0 else (a, kid)
                heapq.heappush(
                    open_, (low, number - 1, *pair)
                )  # of equally near pairs, the smaller nodes
        return best


def _towards(point: Array, goal: Array, ball_m: float, disc_m: float, axis: Array) -> Array:
    """A point of the widened cluster that is nearer to a goal than a point of its hull."""
    way = goal - point
    if disc_m:
        across = way - (axis @ way) * axis
        length = float(np.linalg.norm(across))
        if length > 0.0:
            point = point + across * (min(disc_m * (1.0 - 1e-12), length) / length)
            way = goal - point
    length = float(np.linalg.norm(way))
    if ball_m and length > 0.0:
        point = point + way * (min(ball_m * (1.0 - 1e-12), length) / length)
    return point


def _nearest(x: Array, y: Array) -> tuple[Array, Array]:
    """Weights of the points of two hulls that are nearest, or nearly nearest, to each other."""
    pairs = [(0, 0)]
    weights = np.ones(1)
    for _ in range(MAX_ITERATIONS):
        corners = np.array([x[i] - y[j] for i, j in pairs])
        found = _least_norm(corners)
        pairs = [pair for pair, w in zip(pairs, found, strict=True) if w > 0.0]
        weights = found[found > 0.0]
        v = weights @ np.array([x[i] - y[j] for i, j in pairs])
        new = int((x @ v).argmin()), int((y @ v).argmax())
        gain = v @ v - v @ (x[new[0]] - y[new[1]])
        if gain <= 1e-14 or new in pairs or len(pairs) == 4:
            break
        pairs.append(new)
    pairs = pairs[: len(weights)]  # the last may have been added without a weight
    found_x, found_y = np.zeros(len(x)), np.zeros(len(y))
    for (i, j), w in zip(pairs, weights, strict=True):
        found_x[i] += w
        found_y[j] += w
    return found_x / found_x.sum(), found_y / found_y.sum()


def _least_norm(corners: Array) -> Array:
    """Weights of the point of a simplex that is nearest to the origin, of up to four corners.

    The last corner was found as a support, so its weight is not zero. Weights on the plane through
    some corners are in the ratio of cofactors, which follow from those of fewer corners (Gilbert,
    Johnson and Keerthi 1988).
    """
    gram, last = (corners @ corners.T).tolist(), len(corners) - 1
    best = gram[last][last]
    weights: Array = np.eye(last + 1)[last]
    cofactors: dict[tuple[int, ...], list[float]] = {(i,): [1.0] for i in range(last + 1)}
    for size in range(2, last + 2):
        for of in combinations(range(last + 1), size):
            found = []
            for j in of:
                fewer = tuple(i for i in of if i != j)
                k = fewer[0]
                terms = zip(fewer, cofactors[fewer], strict=True)
                found.append(sum(c * (gram[i][k] - gram[i][j]) for i, c in terms))
            cofactors[of], total = found, sum(found)
            if of[-1] < last or min(found) < 0.0 or not total > 0.0:
                continue
            norm = sum(c * gram[i][last] for i, c in zip(of, found, strict=True)) / total
            if norm < best:
                best, weights = norm, np.zeros(last + 1)
                weights[list(of)] = np.array(found) / total
    return weights
