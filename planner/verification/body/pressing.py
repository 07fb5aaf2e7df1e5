"""How deep one shape presses into another.

Between convex shapes coal says so. A surface of triangles has no depth; there it is how far the
first shape must be moved along one of the three axes of the hand, either way, until it is free: no
less than the least way out.
"""

from __future__ import annotations

import coal
import numpy as np
import pinocchio as pin

from baxter_kin.validation import FloatArray
from planner.verification.body.solid import Solid, distance_request

DEEPEST_M = 0.064
"""What is deeper counts as this deep."""

_HALVINGS = 12

_AXES = np.concatenate([np.eye(3)[[1, 0, 2]], -np.eye(3)[[1, 0, 2]]])
"""The closing axis first."""


def depth_m(
    first: Solid,
    T_first: pin.SE3,
    second: Solid,
    T_second: pin.SE3,
    R_base_hand: FloatArray,
    *,
    known_m: float = 0.0,
) -> float:
    """How deep two placed shapes press into each other; zero when they do not.

    Args:
        first: one shape.
        T_first: where it is, seen from base.
        second: the other.
        T_second: where it is.
        R_base_hand: the axes along which a way out is sought.
        known_m: what is no deeper than this need not be measured; it counts as this deep.
    """
    if not (first.is_surface or second.is_surface):
        return max(0.0, -_distance(first, T_first, second, T_second))
    if not _meets(first, T_first, second, T_second):
        return 0.0
    ways = [R_base_hand @ axis for axis in _AXES]
    if known_m and any(_is_free(first, T_first, known_m * way, second, T_second) for way in ways):
        return known_m
    step = DEEPEST_M / 256
    while step < DEEPEST_M:
        free = [way for way in ways if _is_free(first, T_first, step * way, second, T_second)]
        if free:
            return min(_way_out(first, T_first, second, T_second, step * way) for way in free)
        step *= 2
    return DEEPEST_M


def _way_out(
    first: Solid, T_first: pin.SE3, second: Solid, T_second: pin.SE3, way: FloatArray
) -> float:
    """How much of a way, free at its end, frees it; rounded up."""
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        is_free = _is_free(first, T_first, middle * way, second, T_second)
        low, high = (low, middle) if is_free else (middle, high)
    return high * float(np.linalg.norm(way))


def _is_free(
    first: Solid, T_first: pin.SE3, way: FloatArray, second: Solid, T_second: pin.SE3
) -> bool:
    """Whether the first shape, moved so far, leaves the second."""
    return not _meets(first, pin.SE3(T_first.rotation, T_first.translation + way), second, T_second)


def _meets(first: Solid, T_first: pin.SE3, second: Solid, T_second: pin.SE3) -> bool:
    request, result = coal.CollisionRequest(), coal.CollisionResult()
    placed = (coal.Transform3s(T.rotation, T.translation) for T in (T_first, T_second))
    first_at, second_at = placed
    return bool(coal.collide(first.shape, first_at, second.shape, second_at, request, result))


def _distance(first: Solid, T_first: pin.SE3, second: Solid, T_second: pin.SE3) -> float:
    request, result = distance_request(), coal.DistanceResult()
    placed = (coal.Transform3s(T.rotation, T.translation) for T in (T_first, T_second))
    first_at, second_at = placed
    return float(coal.distance(first.shape, first_at, second.shape, second_at, request, result))
