"""Edge collapses that stay inside an envelope: fewer triangles, still around the mesh.

Quadric error metrics (Garland and Heckbert, SIGGRAPH 1997) choose edge and position; a collapse is
done only if every changed triangle is allowed by the envelope.
"""

from __future__ import annotations

import heapq

import numpy as np
from numba import njit
from numpy.typing import NDArray
from body.envelope import Envelope, is_clear, is_close, is_empty, nearest

F = NDArray[np.float64]


def simplified(
    vertices: F, faces: NDArray[np.int64], E: Envelope
) -> tuple[F, NDArray[np.int64]]:
    """The closed mesh (mm) with as few triangles as the envelope allows."""
    vertices, faces = vertices.copy(), np.ascontiguousarray(faces, dtype=np.int64).copy()
    for _ in range(3):
        before = len(faces)
        alive = _collapse(vertices, faces, E)
        faces = faces[alive]
        used, inverse = np.unique(faces, return_inverse=True)
        vertices, faces = vertices[used].copy(), inverse.reshape(-1, 3).copy()
        if len(faces) > 0.95 * before:
            break
    return vertices, faces


def tightened(
    vertices: F, faces: NDArray[np.int64], E: Envelope, offset: float, rounds: int = 4
) -> F:
    """The mesh with vertices that stand farther out than `offset` moved towards the reference."""
    vertices = vertices.copy()
    for _ in range(rounds):
        _tighten(vertices, np.ascontiguousarray(faces, dtype=np.int64), E, offset)
    return vertices


@njit(cache=True)
def _incidence(n, faces):  # type: ignore[no-untyped-def]
    head = np.full(n, -1, np.int64)
    tail = np.full(n, -1, np.int64)
    link = np.full(3 * len(faces), -1, np.int64)
    for f in range(len(faces)):
        for k in range(3):
            v = faces[f, k]
            if head[v] < 0:
                head[v] = 3 * f + k
            else:
                link[tail[v]] = 3 * f + k
            tail[v] = 3 * f + k
    return head, tail, link


@njit(cache=True)
def _normal(A):  # type: ignore[no-untyped-def]
    n = np.cross(A[1] - A[0], A[2] - A[0])
    size = np.sqrt(n[0] ** 2 + n[1] ** 2 + n[2] ** 2)
    return n / max(size, 1e-300), size


@njit(cache=True)
def _is_folded(old, new):  # type: ignore[no-untyped-def]
    """Whether the changed triangle turned over or became a needle."""
    n_old, _ = _normal(old)
    n, size = _normal(new)
    longest = 0.0
    for k in range(3):
        m = (k + 1) % 3
        e = (new[m, 0] - new[k, 0]) ** 2 + (new[m, 1] - new[k, 1]) ** 2
        longest = max(longest, np.sqrt(e + (new[m, 2] - new[k, 2]) ** 2))
    if size < 0.03 * longest or size < 1e-3 * longest * longest:
        return True
    return n[0] * n_old[0] + n[1] * n_old[1] + n[2] * n_old[2] < 0.3


@njit(cache=True)
def _tighten(vertices, faces, E, offset):  # type: ignore[no-untyped-def]
    head, _, link = _incidence(len(vertices), faces)
    out = np.empty(3)
    for v in range(len(vertices)):
        p = vertices[v].copy()
        if nearest(E, p, offset + 0.05, out) < offset + 0.05:
            continue
        d = nearest(E, p, 4.0, out)
        if d >= 4.0:
            continue
        goal = out + (p - out) * (offset / d)
        for step in (1.0, 0.5, 0.25):
            x = p + (goal - p) * step
            good = True
            c = head[v]
            while c >= 0 and good:
                f = c // 3
                old = np.empty((3, 3))
                new = np.empty((3, 3))
                for k in range(3):
                    old[k] = vertices[faces[f, k]]
                    new[k] = x if faces[f, k] == v else vertices[faces[f, k]]
                n_old, _s = _normal(old)
                n, size = _normal(new)
                if size < 1e-3 or n[0] * n_old[0] + n[1] * n_old[1] + n[2] * n_old[2] < 0.3:
                    good = False
                elif not is_clear(E, new, n, 0.5 * offset):
                    good = False
                elif not is_empty(E, old[0], old[1], old[2], x):
                    good = False
                c = link[c]
            if good:
                vertices[v] = x
                break


@njit(cache=True)
def _quadrics(vertices, faces):  # type: ignore[no-untyped-def]
    Q = np.zeros((len(vertices), 4, 4))
    for f in range(len(faces)):
        A = np.empty((3, 3))
        for k in range(3):
            A[k] = vertices[faces[f, k]]
        n, size = _normal(A)
        plane = np.empty(4)
        plane[:3] = n
        plane[3] = -(n[0] * A[0, 0] + n[1] * A[0, 1] + n[2] * A[0, 2])
        for k in range(3):
            v = faces[f, k]
            for i in range(4):
                for j in range(4):
                    Q[v, i, j] += size * plane[i] * plane[j]
            w = 1e-4 * size
            x = vertices[v]
            for i in range(3):
                Q[v, i, i] += w
                Q[v, i, 3] -= w * x[i]
                Q[v, 3, i] -= w * x[i]
                Q[v, 3, 3] += w * x[i] * x[i]
    return Q


@njit(cache=True)
def _cost(Q, x):  # type: ignore[no-untyped-def]
    y = np.empty(4)
    y[:3] = x
    y[3] = 1.0
    return max(0.0, np.dot(y, np.dot(Q, y)))


@njit(cache=True)
def _best(Q, a, b):  # type: ignore[no-untyped-def]
    """The position of least quadric error near the edge ab, and that error."""
    M = Q[:3, :3].copy()
    middle = 0.5 * (a + b)
    rhs = -Q[:3, 3].copy()
    x = middle
    if abs(np.linalg.det(M)) > 1e-12 * max(1e-30, (M[0, 0] + M[1, 1] + M[2, 2]) ** 3):
        y = np.linalg.solve(M, rhs)
        if np.linalg.norm(y - middle) <= 2.0 * np.linalg.norm(b - a):
            x = y
    return x, _cost(Q, x)


@njit(cache=True)
def _common(a, b, head, link, faces, alive, mark, stamp):  # type: ignore[no-untyped-def]
    """How many vertices are neighbours of both a and b."""
    c = head[a]
    while c >= 0:
        if alive[c // 3]:
            for k in range(3):
                mark[faces[c // 3, k]] = stamp
        c = link[c]
    mark[a] = 0
    mark[b] = 0
    count = 0
    c = head[b]
    while c >= 0:
        if alive[c // 3]:
            for k in range(3):
                v = faces[c // 3, k]
                if mark[v] == stamp:
                    count += 1
                    mark[v] = 0
        c = link[c]
    return count


@njit(cache=True)
def _verdict(a, b, x, head, link, faces, alive, vertices, E):  # type: ignore[no-untyped-def]
    """0 if moving a and b to x leaves only allowed triangles; 1: too near, 2: far, 3: folded."""
    old, new = np.empty((3, 3)), np.empty((3, 3))
    for question in range(4):
        for v in (a, b):
            c = head[v]
            while c >= 0:
                f = c // 3
                c = link[c]
                if not alive[f]:
                    continue
                hits = 0
                for k in range(3):
                    u = faces[f, k]
                    if u == a or u == b:
                        hits += 1
                    for m in range(3):
                        old[k, m] = vertices[u, m]
                        new[k, m] = x[m] if u == v else vertices[u, m]
                if question == 3:
                    if not is_empty(E, old[0], old[1], old[2], x):
                        return 1
                    continue
                if hits == 2:
                    continue
                if question == 0:
                    if _is_folded(old, new):
                        return 3
                elif question == 1:
                    if not is_close(E, new):
                        return 2
                else:
                    n, _ = _normal(new)
                    if not is_clear(E, new, n, E.gap):
                        return 1
    return 0


@njit(cache=True)
def _push_edges(v, heap, head, link, faces, alive, vertices, Q, stamps):  # type: ignore[no-untyped-def]
    c = head[v]
    while c >= 0:
        f = c // 3
        if alive[f]:
            for k in range(3):
                u = faces[f, k]
                if u != v:
                    _, cost = _best(Q[u] + Q[v], vertices[u], vertices[v])
                    e = vertices[u] - vertices[v]
                    cost += 1e-6 * (e[0] ** 2 + e[1] ** 2 + e[2] ** 2)
                    heapq.heappush(heap, (cost, u, v, stamps[u] + stamps[v]))
        c = link[c]


@njit(cache=True)
def _collapse(vertices, faces, E):  # type: ignore[no-untyped-def]
    n = len(vertices)
    head, tail, link = _incidence(n, faces)
    Q = _quadrics(vertices, faces)
    alive = np.ones(len(faces), np.bool_)
    gone = np.zeros(n, np.bool_)
    stamps = np.zeros(n, np.int64)
    mark = np.zeros(n, np.int64)
    stamp = 0
    heap = [(0.0, 0, 0, np.int64(-1))]
    for f in range(len(faces)):
        for k in range(3):
            u, v = faces[f, k], faces[f, (k + 1) % 3]
            if u < v:
                _, cost = _best(Q[u] + Q[v], vertices[u], vertices[v])
                e = vertices[u] - vertices[v]
                cost += 1e-6 * (e[0] ** 2 + e[1] ** 2 + e[2] ** 2)
                heapq.heappush(heap, (cost, u, v, stamps[u] + stamps[v]))
    while len(heap):
        _, a, b, when = heapq.heappop(heap)
        if a == b or gone[a] or gone[b] or when != stamps[a] + stamps[b]:
            continue
        stamp += 1
        if _common(a, b, head, link, faces, alive, mark, stamp) != 2:
            continue
        x, _c = _best(Q[a] + Q[b], vertices[a], vertices[b])
        code = _verdict(a, b, x, head, link, faces, alive, vertices, E)
        if code == 1 or code == 2:
            normal = np.zeros(3)
            for v in (a, b):
                c = head[v]
                while c >= 0:
                    if alive[c // 3]:
                        A = np.empty((3, 3))
                        for k in range(3):
                            A[k] = vertices[faces[c // 3, k]]
                        m, size = _normal(A)
                        normal += m * size
                    c = link[c]
            normal /= max(1e-300, np.linalg.norm(normal))
            sign = 1.0 if code == 1 else -1.0
            for step in (0.08, 0.2):
                y = x + sign * step * normal
                code = _verdict(a, b, y, head, link, faces, alive, vertices, E)
                if code == 0:
                    x = y
                    break
        if code:
            for choice in range(1 if code == 3 else 3):
                if choice == 0:
                    y = 0.5 * (vertices[a] + vertices[b])
                elif choice == 1:
                    y = vertices[a].copy()
                else:
                    y = vertices[b].copy()
                code = _verdict(a, b, y, head, link, faces, alive, vertices, E)
                if code == 0:
                    x = y
                    break
        if code:
            continue
        vertices[a] = x
        Q[a] += Q[b]
        gone[b] = True
        c = head[b]
        while c >= 0:
            f = c // 3
            if alive[f]:
                hits = 0
                for k in range(3):
                    if faces[f, k] == a:
                        hits += 1
                if hits:
                    alive[f] = False
                else:
                    for k in range(3):
                        if faces[f, k] == b:
                            faces[f, k] = a
            c = link[c]
        link[tail[a]] = head[b]
        tail[a] = tail[b]
        stamps[a] += 1
        c = head[a]
        _push_edges(a, heap, head, link, faces, alive, vertices, Q, stamps)
    return alive
