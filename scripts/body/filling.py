"""The hollow inside of a link: what no ball of some radius reaches from outside, less a rim.

Put into the link before wrapping, it keeps the wrap from entering through slits and seams.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, label

from body.measuring import samples

F = NDArray[np.float64]


def filling(soup: F, voxel: float, ball: float, rim: float) -> F:
    """The boundary of the filled voxels as triangles (n, 3, 3), mm."""
    points = samples(soup, 0.6 * voxel)
    low = points.min(axis=0) - ball - 4.0 * voxel
    shape = np.ceil((points.max(axis=0) + ball + 4.0 * voxel - low) / voxel).astype(int)
    full = np.zeros(shape, dtype=bool)
    full[tuple(((points - low) / voxel).astype(int).T)] = True
    centres = distance_transform_edt(~full) * voxel > ball
    regions, _ = label(centres)
    swept = distance_transform_edt(regions != regions[0, 0, 0]) * voxel <= ball
    core = distance_transform_edt(~swept) * voxel > rim
    return np.asarray(np.concatenate(_sides(core)) * voxel + low)


def _sides(core: NDArray[np.bool_]) -> list[F]:
    """Two triangles for every voxel side between core and the rest, in voxels."""
    padded = np.pad(core, 1)
    triangles = []
    for axis in range(3):
        along, across = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
        for side in (0, 1):
            neighbour = np.roll(padded, 1 - 2 * side, axis=axis)[1:-1, 1:-1, 1:-1]
            corner = np.argwhere(core & ~neighbour).astype(np.float64)
            corner[:, axis] += side
            square = [corner, corner + along, corner + along + across, corner + across]
            triangles.append(np.stack([square[0], square[1], square[2]], axis=1))
            triangles.append(np.stack([square[0], square[2], square[3]], axis=1))
    return triangles
