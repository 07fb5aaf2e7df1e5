"""Which triangles a simplified surface may have: outside the mesh, and close to it.

A triangle is allowed when no triangle of the mesh comes closer to it than a gap, and when none of
its sample points is farther from the reference triangles than their tolerance. Both ask a uniform
grid whose cells list the triangles that come near.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

F = NDArray[np.float64]


class Envelope(NamedTuple):
    """Reference triangles in a grid; the first `solid_count` of them are the mesh.

    `triangles` (n, 3, 3) in mm; `tolerance` (n,) in mm: how far a surface may stand out from each;
    `origin`, `cell`, `shape`: of the grid; cell c lists `items[starts[c]:starts[c + 1]]`.
    """

    triangles: F
    normals: F
    tolerance: F
    solid_count: int
    gap: float
    spacing: float
    origin: F
    cell: float
    shape: NDArray[np.int64]
    starts: NDArray[np.int64]
    items: NDArray[np.int64]
    seen: NDArray[np.int64]


def envelope(solid: F, others: F, tolerance: F, *, gap: float, spacing: float) -> Envelope:
    """The envelope of the mesh's triangles `solid`, with other triangles one may stay near to."""
    triangles = np.ascontiguousarray(np.concatenate([solid, others]))
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    low, high = triangles.min(axis=(0, 1)) - 4.0, triangles.max(axis=(0, 1)) + 4.0
    cell = max(1.5, float(np.prod(high - low) / 6e6) ** (1 / 3))
    shape = np.ceil((high - low) / cell).astype(np.int64)
    pad = float(tolerance.max()) + 0.01
    counts = np.zeros(int(np.prod(shape)) + 1, dtype=np.int64)
    _rasterise(triangles, normals, low, cell, shape, pad, counts, np.zeros(0, dtype=np.int64))
    starts = np.concatenate([[0], np.cumsum(counts[:-1])]).astype(np.int64)
    items = np.empty(starts[-1], dtype=np.int64)
    _rasterise(triangles, normals, low, cell, shape, pad, starts[:-1].copy(), items)
    seen = np.zeros(len(triangles) + 1, dtype=np.int64)
    return Envelope(
        triangles, normals, tolerance, len(solid), gap, spacing, low, cell, shape, starts, items,
        seen,
    )  # fmt: skip


@njit(cache=True)
def _rasterise(triangles, normals, low, cell, shape, pad, cursor, items):  # type: ignore[no-untyped-def]
    """Count, or with `items` note, the triangles within `pad` of each cell (conservatively)."""
    reach = pad + cell * np.sqrt(3.0) / 2.0
    for t in range(len(triangles)):
        first = np.empty(3, np.int64)
        last = np.empty(3, np.int64)
        for k in range(3):
            a, b, c = triangles[t, 0, k], triangles[t, 1, k], triangles[t, 2, k]
            first[k] = max(0, int((min(a, b, c) - pad - low[k]) / cell))
            last[k] = min(shape[k] - 1, int((max(a, b, c) + pad - low[k]) / cell))
        for i in range(first[0], last[0] + 1):
            for j in range(first[1], last[1] + 1):
                for k in range(first[2], last[2] + 1):
                    x = low[0] + (i + 0.5) * cell - triangles[t, 0, 0]
                    y = low[1] + (j + 0.5) * cell - triangles[t, 0, 1]
                    z = low[2] + (k + 0.5) * cell - triangles[t, 0, 2]
                    d = normals[t, 0] * x + normals[t, 1] * y + normals[t, 2] * z
                    if abs(d) <= reach:
                        c = (i * shape[1] + j) * shape[2] + k
                        if len(items):
                            items[cursor[c]] = t
                        cursor[c] += 1


@njit(cache=True)
def point_triangle(px, py, pz, T):  # type: ignore[no-untyped-def]
    """Squared distance from p to triangle T, and the nearest point (Ericson 2005, 5.1.5)."""
    ax, ay, az = T[0, 0], T[0, 1], T[0, 2]
    ux, uy, uz = T[1, 0] - ax, T[1, 1] - ay, T[1, 2] - az
    vx, vy, vz = T[2, 0] - ax, T[2, 1] - ay, T[2, 2] - az
    wx, wy, wz = px - ax, py - ay, pz - az
    d1, d2 = ux * wx + uy * wy + uz * wz, vx * wx + vy * wy + vz * wz
    bx, by, bz = wx - ux, wy - uy, wz - uz
    d3, d4 = ux * bx + uy * by + uz * bz, vx * bx + vy * by + vz * bz
    cx, cy, cz = wx - vx, wy - vy, wz - vz
    d5, d6 = ux * cx + uy * cy + uz * cz, vx * cx + vy * cy + vz * cz
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    s, t = 0.0, 0.0
    if d1 <= 0 and d2 <= 0:
        pass
    elif d3 >= 0 and d4 <= d3:
        s = 1.0
    elif vc <= 0 and d1 >= 0 and d3 <= 0:
        s = d1 / max(d1 - d3, 1e-300)
    elif d6 >= 0 and d5 <= d6:
        t = 1.0
    elif vb <= 0 and d2 >= 0 and d6 <= 0:
        t = d2 / max(d2 - d6, 1e-300)
    elif va <= 0 and d4 - d3 >= 0 and d5 - d6 >= 0:
        t = (d4 - d3) / max((d4 - d3) + (d5 - d6), 1e-300)
        s = 1.0 - t
    else:
        whole = max(va + vb + vc, 1e-300)
        s, t = vb / whole, vc / whole
    s, t = min(1.0, max(0.0, s)), min(1.0, max(0.0, t))
    qx, qy, qz = ax + s * ux + t * vx, ay + s * uy + t * vy, az + s * uz + t * vz
    return (px - qx) ** 2 + (py - qy) ** 2 + (pz - qz) ** 2, qx, qy, qz


@njit(cache=True)
def _segments(A, k, B, m):  # type: ignore[no-untyped-def]
    """Squared distance of edge k of A and edge m of B (Ericson 2005, 5.1.9)."""
    k2, m2 = (k + 1) % 3, (m + 1) % 3
    ux, uy, uz = A[k2, 0] - A[k, 0], A[k2, 1] - A[k, 1], A[k2, 2] - A[k, 2]
    vx, vy, vz = B[m2, 0] - B[m, 0], B[m2, 1] - B[m, 1], B[m2, 2] - B[m, 2]
    rx, ry, rz = A[k, 0] - B[m, 0], A[k, 1] - B[m, 1], A[k, 2] - B[m, 2]
    a, e = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz
    f, c = vx * rx + vy * ry + vz * rz, ux * rx + uy * ry + uz * rz
    b = ux * vx + uy * vy + uz * vz
    denominator = a * e - b * b
    s = 0.0
    if denominator > 1e-14 * a * e:
        s = min(1.0, max(0.0, (b * f - c * e) / denominator))
    t = (b * s + f) / e if e > 0 else 0.0
    if t < 0:
        t = 0.0
        s = min(1.0, max(0.0, -c / a)) if a > 0 else 0.0
    elif t > 1:
        t = 1.0
        s = min(1.0, max(0.0, (b - c) / a)) if a > 0 else 0.0
    return (
        (rx + s * ux - t * vx) ** 2 + (ry + s * uy - t * vy) ** 2 + (rz + s * uz - t * vz) ** 2
    )


@njit(cache=True)
def _height(n, A, x, y, z):  # type: ignore[no-untyped-def]
    return n[0] * (x - A[0, 0]) + n[1] * (y - A[0, 1]) + n[2] * (z - A[0, 2])


@njit(cache=True)
def _pierces(A, k, B, n):  # type: ignore[no-untyped-def]
    """Whether edge k of A passes through triangle B with normal n."""
    m = (k + 1) % 3
    dp = _height(n, B, A[k, 0], A[k, 1], A[k, 2])
    dq = _height(n, B, A[m, 0], A[m, 1], A[m, 2])
    if dp * dq > 0 or dp == dq:
        return False
    s = dp / (dp - dq)
    x = A[k, 0] + s * (A[m, 0] - A[k, 0])
    y = A[k, 1] + s * (A[m, 1] - A[k, 1])
    z = A[k, 2] + s * (A[m, 2] - A[k, 2])
    for i in range(3):
        j = (i + 1) % 3
        ex, ey, ez = B[j, 0] - B[i, 0], B[j, 1] - B[i, 1], B[j, 2] - B[i, 2]
        fx, fy, fz = x - B[i, 0], y - B[i, 1], z - B[i, 2]
        side = (
            (ey * fz - ez * fy) * n[0] + (ez * fx - ex * fz) * n[1] + (ex * fy - ey * fx) * n[2]
        )
        if side < 0:
            return False
    return True


@njit(cache=True)
def _near(A, nA, B, nB, gap):  # type: ignore[no-untyped-def]
    """Whether triangles A and B come nearer than `gap`."""
    for k in range(3):
        if max(A[0, k], A[1, k], A[2, k]) < min(B[0, k], B[1, k], B[2, k]) - gap:
            return False
        if min(A[0, k], A[1, k], A[2, k]) > max(B[0, k], B[1, k], B[2, k]) + gap:
            return False
    a = _height(nA, A, B[0, 0], B[0, 1], B[0, 2])
    b = _height(nA, A, B[1, 0], B[1, 1], B[1, 2])
    c = _height(nA, A, B[2, 0], B[2, 1], B[2, 2])
    if min(a, b, c) > gap or max(a, b, c) < -gap:
        return False
    a = _height(nB, B, A[0, 0], A[0, 1], A[0, 2])
    b = _height(nB, B, A[1, 0], A[1, 1], A[1, 2])
    c = _height(nB, B, A[2, 0], A[2, 1], A[2, 2])
    if min(a, b, c) > gap or max(a, b, c) < -gap:
        return False
    for k in range(3):
        if _pierces(A, k, B, nB) or _pierces(B, k, A, nA):
            return True
    for k in range(3):
        if point_triangle(A[k, 0], A[k, 1], A[k, 2], B)[0] < gap * gap:
            return True
        if point_triangle(B[k, 0], B[k, 1], B[k, 2], A)[0] < gap * gap:
            return True
        for m in range(3):
            if _segments(A, k, B, m) < gap * gap:
                return True
    return False


@njit(cache=True)
def is_clear(E, A, nA, gap):  # type: ignore[no-untyped-def]
    """Whether triangle A, of unit normal nA, keeps `gap` from every triangle of the mesh."""
    E.seen[-1] += 1
    query = E.seen[-1]
    first, last = np.empty(3, np.int64), np.empty(3, np.int64)
    for k in range(3):
        low, high = min(A[0, k], A[1, k], A[2, k]), max(A[0, k], A[1, k], A[2, k])
        first[k] = max(0, int((low - E.origin[k]) / E.cell))
        last[k] = min(E.shape[k] - 1, int((high - E.origin[k]) / E.cell))
    reach = E.cell * 0.8661
    for i in range(first[0], last[0] + 1):
        x = E.origin[0] + (i + 0.5) * E.cell - A[0, 0]
        for j in range(first[1], last[1] + 1):
            y = E.origin[1] + (j + 0.5) * E.cell - A[0, 1]
            for k in range(first[2], last[2] + 1):
                z = E.origin[2] + (k + 0.5) * E.cell - A[0, 2]
                if abs(nA[0] * x + nA[1] * y + nA[2] * z) > reach:
                    continue
                c = (i * E.shape[1] + j) * E.shape[2] + k
                for m in range(E.starts[c], E.starts[c + 1]):
                    t = E.items[m]
                    if t < E.solid_count and E.seen[t] != query:
                        E.seen[t] = query
                        if _near(A, nA, E.triangles[t], E.normals[t], gap):
                            return False
    return True


@njit(cache=True)
def _volume(A, B, C, D):  # type: ignore[no-untyped-def]
    """Six times the signed volume of a tetrahedron."""
    ux, uy, uz = B[0] - A[0], B[1] - A[1], B[2] - A[2]
    vx, vy, vz = C[0] - A[0], C[1] - A[1], C[2] - A[2]
    wx, wy, wz = D[0] - A[0], D[1] - A[1], D[2] - A[2]
    return (uy * vz - uz * vy) * wx + (uz * vx - ux * vz) * wy + (ux * vy - uy * vx) * wz


@njit(cache=True)
def is_empty(E, A, B, C, D):  # type: ignore[no-untyped-def]
    """Whether no vertex of the mesh lies in the tetrahedron that a moving triangle sweeps."""
    volume = _volume(A, B, C, D)
    if abs(volume) < 1e-9:
        return True
    first, last = np.empty(3, np.int64), np.empty(3, np.int64)
    for k in range(3):
        low, high = min(A[k], B[k], C[k], D[k]), max(A[k], B[k], C[k], D[k])
        first[k] = max(0, int((low - E.origin[k]) / E.cell))
        last[k] = min(E.shape[k] - 1, int((high - E.origin[k]) / E.cell))
    for i in range(first[0], last[0] + 1):
        for j in range(first[1], last[1] + 1):
            for k in range(first[2], last[2] + 1):
                c = (i * E.shape[1] + j) * E.shape[2] + k
                for m in range(E.starts[c], E.starts[c + 1]):
                    t = E.items[m]
                    if t >= E.solid_count:
                        continue
                    for n in range(3):
                        p = E.triangles[t, n]
                        if (
                            _volume(p, B, C, D) * volume >= 0
                            and _volume(A, p, C, D) * volume >= 0
                            and _volume(A, B, p, D) * volume >= 0
                            and _volume(A, B, C, p) * volume >= 0
                        ):
                            return False
    return True


@njit(cache=True)
def _is_close(E, x, y, z):  # type: ignore[no-untyped-def]
    i = int((x - E.origin[0]) / E.cell)
    j = int((y - E.origin[1]) / E.cell)
    k = int((z - E.origin[2]) / E.cell)
    c = (i * E.shape[1] + j) * E.shape[2] + k
    for m in range(E.starts[c], E.starts[c + 1]):
        t = E.items[m]
        tolerance = E.tolerance[t]
        T = E.triangles[t]
        if abs(_height(E.normals[t], T, x, y, z)) > tolerance:
            continue
        if point_triangle(x, y, z, T)[0] <= tolerance * tolerance:
            return True
    return False


@njit(cache=True)
def is_close(E, A):  # type: ignore[no-untyped-def]
    """Whether all sample points of triangle A are near enough to the reference."""
    longest = 0.0
    for k in range(3):
        m = (k + 1) % 3
        e = (A[m, 0] - A[k, 0]) ** 2 + (A[m, 1] - A[k, 1]) ** 2 + (A[m, 2] - A[k, 2]) ** 2
        longest = max(longest, e)
        if not _is_close(E, A[k, 0], A[k, 1], A[k, 2]):
            return False
    n = max(2, min(80, int(np.ceil(np.sqrt(longest) / E.spacing))))
    for i in range(n + 1):
        for j in range(n + 1 - i):
            a, b = i / n, j / n
            c = 1.0 - a - b
            if not _is_close(
                E,
                a * A[0, 0] + b * A[1, 0] + c * A[2, 0],
                a * A[0, 1] + b * A[1, 1] + c * A[2, 1],
                a * A[0, 2] + b * A[1, 2] + c * A[2, 2],
            ):
                return False
    return True


@njit(cache=True)
def nearest(E, p, radius, out):  # type: ignore[no-untyped-def]
    """The distance from p to the reference, if below `radius`, with the nearest point in `out`."""
    best = radius * radius
    first, last = np.empty(3, np.int64), np.empty(3, np.int64)
    for k in range(3):
        first[k] = max(0, int((p[k] - radius - E.origin[k]) / E.cell))
        last[k] = min(E.shape[k] - 1, int((p[k] + radius - E.origin[k]) / E.cell))
    for i in range(first[0], last[0] + 1):
        for j in range(first[1], last[1] + 1):
            for k in range(first[2], last[2] + 1):
                c = (i * E.shape[1] + j) * E.shape[2] + k
                for m in range(E.starts[c], E.starts[c + 1]):
                    t = E.items[m]
                    if _height(E.normals[t], E.triangles[t], p[0], p[1], p[2]) ** 2 >= best:
                        continue
                    d, x, y, z = point_triangle(p[0], p[1], p[2], E.triangles[t])
                    if d < best:
                        best = d
                        out[0], out[1], out[2] = x, y, z
    return np.sqrt(best)
