"""Shapes of links as the URDF shows them, and what is refused."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from baxter_kin.description import StockFiles
from baxter_kin.errors import DescriptionError
from planner.verification.body.urdf_shapes import link_shapes
from tests.planner.verification.body.collada_files import TRIANGLE, write


@pytest.mark.parametrize(
    ("geometry", "reason"),
    [
        ("<geometry/>", "no geometry"),
        ("<geometry><cone/></geometry>", "<cone>"),
        ('<geometry><box size="1 2"/></geometry>', "'1 2'; finite numbers needed: 3"),
        ('<geometry><sphere radius="inf"/></geometry>', "'inf'; finite numbers needed: 1"),
        ('<geometry><mesh filename="shape.dae"/></geometry>', "package://"),
        ('<geometry><mesh filename="package://no.dae"/></geometry>', "no.dae: No such file"),
    ],
)
def test_refuses_shapes_of_a_link_that_are_none(tmp_path: Path, geometry: str, reason: str) -> None:
    urdf = tmp_path / "robot.urdf"
    urdf.write_text(f'<robot><link name="a"><visual>{geometry}</visual></link></robot>')
    with pytest.raises(DescriptionError, match=re.escape(reason)):
        link_shapes(StockFiles(urdf, urdf, tmp_path), ())


def test_a_mesh_is_scaled_as_the_urdf_says(tmp_path: Path) -> None:
    write(tmp_path, TRIANGLE)
    urdf = tmp_path / "robot.urdf"
    mesh = '<geometry><mesh filename="package://shape.dae" scale="1 2 3"/></geometry>'
    urdf.write_text(f'<robot><link name="a"><visual>{mesh}</visual></link></robot>')
    (shape,) = link_shapes(StockFiles(urdf, urdf, tmp_path), ())
    assert np.array(shape.shape.vertices()) == pytest.approx(
        np.array([[0, 0, 0], [0.02, 0, 0], [0.02, 0.02, 0]]), abs=1e-15
    )
    assert shape.T_link_shape.isIdentity()
