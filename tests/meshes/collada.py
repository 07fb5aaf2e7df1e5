"""COLLADA files (.dae) as triangles, read with pycollada.

Pinocchio's reader joins wrong vertices where a mesh has several materials. As its reader and ROS
do, the axes of the file are taken for those of the link, whatever its `up_axis` says.
"""

from __future__ import annotations

import warnings
from functools import cache
from pathlib import Path

import collada
import numpy as np
from collada.triangleset import BoundTriangleSet

from baxter_kin.validation import FloatArray, Indices

SINGLE_M = 1e-7
"""Largest error of coordinates in single precision, in which pycollada and Pinocchio read them."""


@cache
def read_collada(path: Path) -> tuple[FloatArray, Indices]:
    """Vertices, shape (n, 3), m, and triangles, shape (m, 3), of the scene of a file.

    Each triangle has corners of its own. Lines are left out, and triangles with two corners in one
    point.
    """
    corners = [np.zeros((0, 3, 3))]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PendingDeprecationWarning)  # pycollada uses numpy.matrix
        document = collada.Collada(str(path))
        for geometry in document.scene.objects("geometry"):
            for primitive in geometry.primitives():
                part = primitive.triangleset() if hasattr(primitive, "triangleset") else primitive
                if isinstance(part, BoundTriangleSet) and len(part):
                    corners.append(np.asarray(part.vertex, np.float64)[part.vertex_index])
    found = np.concatenate(corners) * (document.assetInfo.unitmeter or 1.0)
    is_flat = (found == found[:, [1, 2, 0]]).all(axis=2).any(axis=1)
    vertices = found[~is_flat].reshape(-1, 3)
    return vertices, np.arange(len(vertices), dtype=np.intp).reshape(-1, 3)
