"""COLLADA files to be read: one geometry of seven points, in one node."""

from __future__ import annotations

from pathlib import Path

import pytest

from baxter_kin.errors import DescriptionError
from planner.verification.body.collada import read_collada

POINTS = "0 0 0  2 0 0  2 1 0  0 1 0  9 9 9  0 0 3  2 0 3"


def write(
    folder: Path,
    primitive: str,
    node: str = '<instance_geometry url="#shape"/>',
    unit: str = "0.01",
    points: str = POINTS,
) -> Path:
    """A file with seven points, each with a normal, one primitive and one node."""
    path = folder / "shape.dae"
    path.write_text(
        f"""<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
  <asset><unit name="centimetre" meter="{unit}"/><up_axis>Y_UP</up_axis></asset>
  <library_geometries><geometry id="shape"><mesh>
    <source id="p"><float_array id="pa" count="21">{points}</float_array><technique_common>
      <accessor source="#pa" count="7" stride="3"/></technique_common></source>
    <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
    {primitive}
  </mesh></geometry></library_geometries>
  <library_visual_scenes><visual_scene id="s"><node id="n">{node}</node></visual_scene>
  </library_visual_scenes>
  <scene><instance_visual_scene url="#s"/></scene>
</COLLADA>"""
    )
    return path


def primitive(kind: str, numbers: str) -> str:
    """A primitive whose corners are a normal and a vertex."""
    inputs = '<input semantic="NORMAL" offset="0" source="#n"/>'
    inputs += '<input semantic="VERTEX" offset="1" source="#v"/>'
    return f"<{kind}>{inputs}{numbers}</{kind}>"


TRIANGLE = primitive("triangles", "<p>7 0 7 1 7 2</p>")


def refuses(path: Path, reason: str) -> None:
    """One sentence that names the file and what is wrong with it."""
    with pytest.raises(DescriptionError) as caught:
        read_collada(path)
    message = str(caught.value)
    assert message.startswith(f"cannot read {path}: ")
    assert reason in message
    assert "\n" not in message
    assert len(message) < len(str(path)) + 250
