"""Simple shapes around all others: boxes, balls and capsules, whose distances cost little."""

from __future__ import annotations

from typing import NamedTuple

import coal
import numpy as np

from baxter_kin.validation import FloatArray, Indices


class Covers(NamedTuple):
    """Simple shapes around n shapes, each in the frame of its shape.

    A box `lowest` .. `highest`, (n, 3); a ball around `centres`, (n, 3), of `ball_radii`, (n,);
    a capsule between `ends`, (n, 2, 3), of `radii`, (n,).
    """

    lowest: FloatArray
    highest: FloatArray
    centres: FloatArray
    ball_radii: FloatArray
    ends: FloatArray
    radii: FloatArray

    def gaps_m(
        self, poses: FloatArray, number: Indices, first: Indices, second: Indices
    ) -> FloatArray:
        """Lower bounds on the distances of pairs, shape (k,), metres; negative says nothing.

        The first of each pair is taken as a ball around it, the second as a box around it.

        Args:
            poses: of all shapes in base, shape (m, n, 4, 4).
            number: which of the m, for each pair, shape (k,).
            first: a shape, for each pair, shape (k,).
            second: another.
        """
        T_first, T = poses[number, first], poses[number, second]
        centres = (T_first[:, :3, :3] @ self.centres[first, :, None])[..., 0] + T_first[:, :3, 3]
        apart = centres - T[:, :3, 3]
        inside = np.einsum("kji,kj->ki", T[:, :3, :3], apart)  # in the frame of the second
        outside = np.maximum(self.lowest[second] - inside, inside - self.highest[second])
        distances = np.linalg.norm(np.maximum(outside, 0.0), axis=1)
        gaps: FloatArray = distances - self.ball_radii[first]
        return gaps

    def with_those_of(self, geometries: list[coal.CollisionGeometry]) -> Covers:
        """These, and those around further shapes."""
        added = Covers.of(geometries)
        return Covers(*(np.concatenate(both) for both in zip(self, added, strict=True)))

    @classmethod
    def of(cls, geometries: list[coal.CollisionGeometry]) -> Covers:
        """Those around some shapes."""
        lowest, highest = (np.empty((len(geometries), 3)) for _ in range(2))
        axes, radii = np.zeros((len(geometries), 3)), np.empty(len(geometries))
        for number, geometry in enumerate(geometries):
            if geometry.aabb_radius < 0.0:  # not known yet, and slow for thousands of triangles
                geometry.computeLocalAABB()
            box = geometry.aabb_local
            lowest[number], highest[number] = box.min_, box.max_
            half = (highest[number] - lowest[number]) / 2
            axes[number], radii[number] = _capsule(geometry, half)
        centres = (lowest + highest) / 2
        ends = np.stack([centres - axes, centres + axes], axis=1)
        lengths = np.linalg.norm(axes, axis=1)
        round_ends = np.array([isinstance(g, coal.Cylinder | coal.Sphere) for g in geometries])
        balls = np.where(round_ends, np.hypot(lengths, radii), 0.0)
        balls = np.where(round_ends, balls, np.linalg.norm(highest - lowest, axis=1) / 2)
        return cls(lowest, highest, centres, balls, ends, radii)


def _capsule(geometry: coal.CollisionGeometry, half: FloatArray) -> tuple[FloatArray, float]:
    """From the middle to an end, shape (3,), and the radius, of a capsule around a shape."""
    axis = np.zeros(3)
    if isinstance(geometry, coal.Sphere):
        return axis, float(geometry.radius)
    if isinstance(geometry, coal.Cylinder):
        axis[2] = geometry.halfLength
        return axis, float(geometry.radius)
    longest = int(half.argmax())
    axis[longest] = half[longest]
    return axis, float(np.linalg.norm(half - axis))


def placed_points(poses: FloatArray, points: FloatArray) -> FloatArray:
    """Points (n, k, 3) of the frames in `poses`, (m, n, 4, 4), as (m, n, k, 3) of base."""
    return points @ poses[..., :3, :3].swapaxes(-1, -2) + poses[..., None, :3, 3]
