"""RotationGrid: directions of the tool's z axis, each with the same rolls about it.

Poses that differ by a roll about the last joint's axis share their self-motion, so a solution for
one of them serves all. A list of rotations without this structure has a single roll.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin.display import count
from baxter_kin.fields import array, frozen
from baxter_kin.frames import nearest_rotation
from baxter_kin.validation import FloatArray, finite_array, whole_scalar
from planner.errors import AtlasError

FINEST_HOPF = 4
"""Finest level of a Hopf grid: 294,912 rotations, 3 degrees apart."""

MOST_ROTATIONS = 300_000
"""Maximum number of rotations of a map: a worker holds those of one position in memory."""

_ORTHONORMAL = 1e-6


@frozen(error=AtlasError)
class RotationGrid:
    """d directions times k rolls, in this order: rotation i is direction i // k with roll i % k.

    Attributes:
        R_base_tips: the tip at roll zero for each direction, shape (d, 3, 3).
        rolls: angles about the tip's z axis, shape (k,), rad.

    Raises:
        AtlasError: when there is no rotation, more than `MOST_ROTATIONS`, or an invalid matrix.
    """

    R_base_tips: FloatArray = array(None, 3, 3)
    rolls: FloatArray = array(None)

    def __attrs_post_init__(self) -> None:
        Rs, rolls = self.R_base_tips, self.rolls
        if not len(Rs) or not len(rolls):
            raise AtlasError("a grid needs one rotation and one roll at least")
        if len(Rs) * len(rolls) > MOST_ROTATIONS:
            raise AtlasError(
                f"a map has at most {MOST_ROTATIONS:,} rotations, got {len(Rs) * len(rolls):,}"
            )
        error = np.abs(Rs @ Rs.swapaxes(1, 2) - np.eye(3)).max(axis=(1, 2))
        is_bad = (error > _ORTHONORMAL) | (np.linalg.det(Rs) < 0.0)
        if is_bad.any():
            bad = int(is_bad.argmax())
            raise AtlasError(f"rotation {bad} is no rotation matrix: {Rs[bad].tolist()}")

    @classmethod
    def hopf(cls, level: int = 1) -> RotationGrid:
        """A grid that covers all rotations evenly: 72, 576 or 4608 for levels 0, 1 and 2.

        Directions are the pixel centres of HEALPix (Gorski et al. 2005, section 5); rolls are
        60, 30 or 15 degrees apart (Yershova, Jain, LaValle and Mitchell 2010, section 4). The grid
        is turned so that one direction points straight down, and at its roll zero the tip's x axis
        is along that of base.

        Raises:
            AtlasError: when the level is not a whole number from 0 to `FINEST_HOPF`.
        """
        whole_scalar(level, "level", AtlasError, least=0, most=FINEST_HOPF)
        z, azimuth = _healpix_centres(2**level)
        Rs = _rotation(azimuth, np.arccos(z))
        down = np.diag([1.0, -1.0, -1.0])
        rolls = np.arange(6 * 2**level, dtype=np.float64) * (2.0 * math.pi / (6 * 2**level))
        return cls(nearest_rotation(down @ Rs[0].T @ Rs), rolls)

    @classmethod
    def of(cls, rotations: Sequence[ArrayLike]) -> RotationGrid:
        """Given rotations of the tip, in their order.

        Args:
            rotations: matrices, shape (n, 3, 3), as seen from base.
        """
        try:
            Rs: FloatArray = np.array(rotations, dtype=np.float64)
        except (TypeError, ValueError):
            raise AtlasError("rotations must be matrices, shape (n, 3, 3)") from None
        return cls(Rs, np.zeros(1, np.float64))

    @classmethod
    def about_tool_axis(cls, R_base_tip: ArrayLike, rolls: int) -> RotationGrid:
        """One direction with evenly spaced rolls, such as straight down for grasps from above."""
        whole_scalar(rolls, "rolls", AtlasError, least=1, most=100_000)
        R = finite_array(R_base_tip, (3, 3), "R_base_tip", AtlasError)
        return cls(R[None], np.arange(rolls, dtype=np.float64) * (2.0 * math.pi / rolls))

    def __len__(self) -> int:
        return len(self.R_base_tips) * len(self.rolls)

    @property
    def matrices(self) -> FloatArray:
        """All rotations of the tip seen from base, shape (n, 3, 3)."""
        turned = self.R_base_tips[:, None] @ about_z(self.rolls)
        return turned.reshape(-1, 3, 3)

    @property
    def quats_xyzw(self) -> FloatArray:
        """The same as quaternions, shape (n, 4)."""
        return np.array([pin.Quaternion(R).coeffs() for R in self.matrices])

    def nearest(self, R_base_tip: ArrayLike) -> int:
        """Index of the nearest rotation."""
        R = finite_array(R_base_tip, (3, 3), "R_base_tip", AtlasError)
        return int(self._traces(R).argmax())

    def angles_rad(self, R_base_tip: FloatArray) -> FloatArray:
        """Angles of all rotations from one, shape (n,), within 2e-8 rad."""
        cosines = 0.5 * (self._traces(R_base_tip) - 1.0)
        angles: FloatArray = np.arccos(cosines.clip(-1.0, 1.0))
        return angles

    def _traces(self, R: FloatArray) -> FloatArray:
        traces: FloatArray = np.einsum("nij,ij->n", self.matrices, R)
        return traces

    def expanded(self) -> RotationGrid:
        """The same rotations in the same order, each as a direction with a single roll."""
        return RotationGrid(self.matrices, np.zeros(1))

    def _facts(self) -> tuple[str, ...]:
        directions = count(len(self.R_base_tips), "direction")
        return (f"{directions} with {count(len(self.rolls), 'roll')} each",)


def about_z(angles: FloatArray) -> FloatArray:
    """Rotations about z, shape (n, 3, 3)."""
    cosine, sine, zero = np.cos(angles), np.sin(angles), np.zeros_like(angles)
    rows = [cosine, -sine, zero, sine, cosine, zero, zero, zero, zero + 1.0]
    return np.stack(rows, axis=-1).reshape(-1, 3, 3)


def _rotation(azimuth: FloatArray, polar: FloatArray) -> FloatArray:
    """Rotations about z, then about y: z points to these angles; shape (n, 3, 3)."""
    cosine, sine, zero = np.cos(polar), np.sin(polar), np.zeros_like(polar)
    rows = [cosine, zero, sine, zero, zero + 1.0, zero, -sine, zero, cosine]
    tilts: FloatArray = about_z(azimuth) @ np.stack(rows, axis=-1).reshape(-1, 3, 3)
    return tilts


def _healpix_centres(sides: int) -> tuple[FloatArray, FloatArray]:
    """Heights and azimuths of the 12 `sides`^2 pixel centres, ring by ring from the pole."""
    z, azimuth = [], []
    for ring in range(1, 4 * sides):
        cap = min(ring, 4 * sides - ring)
        if cap < sides:
            height = 1.0 - cap * cap / (3.0 * sides * sides)
            pixels, first = 4 * cap, 0.5
        else:
            height = abs(4.0 / 3.0 - 2.0 * ring / (3.0 * sides))
            pixels, first = 4 * sides, 1.0 - 0.5 * ((ring - sides + 1) % 2)
        z += [math.copysign(height, 2 * sides - ring)] * pixels
        azimuth += [(j + first) * 2.0 * math.pi / pixels for j in range(pixels)]
    return np.array(z), np.array(azimuth)
