"""The reader of COLLADA files, compared with Pinocchio's vertices."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import coal
import numpy as np
import pytest
from scipy.spatial import cKDTree

from baxter_kin.description import StockFiles
from tests.meshes.collada import SINGLE_M, read_collada

FILES = StockFiles.installed()
MESHES = sorted(
    {
        FILES.package_dir / mesh.get("filename", "").removeprefix("package://")
        for mesh in ET.parse(FILES.urdf).getroot().iterfind("link/visual/geometry/mesh")
    }
)


@pytest.mark.slow
@pytest.mark.parametrize("path", MESHES, ids=lambda path: path.stem)
def test_the_robots_vertices_are_those_that_pinocchio_reads(path: Path) -> None:
    ours = np.unique(read_collada(path)[0], axis=0)
    theirs = np.array(coal.MeshLoader(coal.BV_OBBRSS).load(str(path)).vertices())
    assert cKDTree(theirs).query(ours)[0].max() < SINGLE_M
    assert cKDTree(ours).query(theirs)[0].max() < SINGLE_M
