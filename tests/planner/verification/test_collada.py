"""The reader of COLLADA files: trimesh's triangles, Pinocchio's vertices, and what it refuses."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from functools import cache
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest
import trimesh
from numpy.typing import NDArray

from baxter_kin.description import RobotDescription, StockFiles
from baxter_kin.errors import DescriptionError
from planner.scene.contact import shape_of
from planner.verification.body import collada
from planner.verification.body.collada import read_collada
from planner.verification.body.robot_body import NO_PARTS, robot_body
from planner.verification.body.urdf_shapes import link_shapes
from planner.verification.urdf_robot import read_model

FILES = StockFiles.installed()

SINGLE = 1e-7
"""What rounding to single precision, as trimesh and Pinocchio do, moves in Baxter's meshes, m."""

SAME_PLACE = 1e-12
"""Rounding, of sines and of m."""

MESHES = sorted(
    {
        FILES.package_dir / mesh.get("filename", "").removeprefix("package://")
        for mesh in ET.parse(FILES.urdf).getroot().iterfind("link/visual/geometry/mesh")
    }
)

POINTS = "0 0 0  2 0 0  2 1 0  0 1 0  9 9 9  0 0 3  2 0 3"


@cache
def read(path: Path) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    return read_collada(path)


def twice_areas(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    a, b, c = corners.swapaxes(0, 1)
    lengths: NDArray[np.float64] = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return lengths


def of_trimesh(path: Path) -> NDArray[np.float64]:
    """The corners of every triangle but those with two in one point, shape (m, 3, 3)."""
    mesh = trimesh.load(path, force="mesh", process=False)
    assert isinstance(mesh, trimesh.Trimesh)
    corners = np.asarray(mesh.vertices)[np.asarray(mesh.faces)]
    is_flat = (corners == corners[:, [1, 2, 0]]).all(axis=2).any(axis=1)
    kept: NDArray[np.float64] = corners[~is_flat]
    return kept


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
POLYLIST = primitive("polylist", "<vcount>4 3</vcount><p>7 0 7 1 7 2 7 3 8 0 8 6 8 5</p>")
POLYGONS = primitive("polygons", "<p>7 0 7 1 7 2 7 3</p><p>8 0 8 6 8 5</p>")
FANS_M = [
    [[0, 0, 0], [0.02, 0, 0], [0.02, 0.01, 0]],
    [[0, 0, 0], [0.02, 0.01, 0], [0, 0.01, 0]],
    [[0, 0, 0], [0.02, 0, 0.03], [0, 0, 0.03]],
]


@pytest.mark.parametrize("path", MESHES, ids=lambda path: path.stem)
def test_every_triangle_of_the_robot_is_trimeshs(path: Path) -> None:
    vertices, triangles = read(path)
    theirs = of_trimesh(path)
    assert len(triangles) == len(theirs)
    assert np.abs(vertices[triangles] - theirs).max() < SINGLE


@pytest.mark.parametrize("path", MESHES, ids=lambda path: path.stem)
def test_the_robots_surface_has_trimeshs_area(path: Path) -> None:
    vertices, triangles = read(path)
    theirs = of_trimesh(path)
    areas, their_areas = twice_areas(vertices[triangles]), twice_areas(theirs)
    # what single precision may move an area by: every edge by two roundings
    edges = np.linalg.norm(theirs[:, [1, 2, 0]] - theirs, axis=2).sum(axis=1)
    assert (np.abs(areas - their_areas) < 4.0 * SINGLE * (edges + SINGLE)).all()
    assert areas.sum() == pytest.approx(their_areas.sum(), rel=SINGLE)


@pytest.mark.parametrize("path", MESHES, ids=lambda path: path.stem)
def test_the_robots_vertices_are_those_that_pinocchio_reads(path: Path) -> None:
    ours = read(path)[0]
    theirs = np.array(coal.MeshLoader(coal.BV_OBBRSS).load(str(path)).vertices())
    assert farthest_m(ours, theirs) < SINGLE
    assert farthest_m(theirs, ours) < SINGLE


def farthest_m(points: NDArray[np.float64], others: NDArray[np.float64]) -> float:
    """How far any point is from the nearest of others."""
    spatial = pytest.importorskip("scipy.spatial")
    return float(spatial.cKDTree(others).query(points)[0].max())


def test_every_shape_is_where_pinocchio_places_it() -> None:
    model = read_model(RobotDescription.installed())
    shapes = pin.buildGeomFromUrdf(
        model, str(FILES.urdf), pin.GeometryType.VISUAL, package_dirs=[str(FILES.package_dir)]
    )
    ours = {solid.name: solid for solid in robot_body(RobotDescription.installed()).solids}
    for theirs in shapes.geometryObjects:
        name = str(model.frames[theirs.parentFrame].name)
        if not any(word in name for word in NO_PARTS):
            solid = ours.pop(name)
            assert solid.joint == theirs.parentJoint
            off = solid.T_joint_shape.homogeneous - theirs.placement.homogeneous
            assert np.abs(off).max() < SAME_PLACE
            assert solid.is_surface or shape_of(solid.shape) == shape_of(theirs.geometry)
    assert sorted(ours) == ["left_hand_link", "right_hand_link"]


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


def test_both_arms_share_a_mesh() -> None:
    solids = {solid.name: solid for solid in robot_body(RobotDescription.installed()).solids}
    left, right = solids["left_wrist"], solids["right_wrist"]
    assert left.shape is right.shape
    assert left.cover is right.cover
    assert left.joint != right.joint


@pytest.mark.parametrize("shown", [POLYLIST, POLYGONS], ids=["polylist", "polygons"])
def test_polygons_are_fans_of_triangles_in_metres(tmp_path: Path, shown: str) -> None:
    vertices, triangles = read_collada(write(tmp_path, shown))
    assert vertices[triangles] == pytest.approx(np.array(FANS_M), abs=1e-15)
    assert len(vertices) == 6  # the point that no polygon names is left out


def test_a_node_is_placed_by_its_transforms_in_their_order(tmp_path: Path) -> None:
    matrix = "<matrix>0 -1 0 5  1 0 0 0  0 0 1 0  0 0 0 1</matrix>"
    steps = "<translate>5 0 0</translate><rotate>0 0 2 90</rotate><scale>1 1 2</scale>"
    shows = '<instance_geometry url="#shape"/>'
    expected = np.array([[0.05, 0, 0], [0.05, 0.02, 0], [0.04, 0.02, 0]])
    for node in (matrix + shows, steps + shows, f"{steps}<node>{shows}</node>"):
        vertices, triangles = read_collada(write(tmp_path, TRIANGLE, node))
        assert vertices[triangles[0]] == pytest.approx(expected, abs=1e-15)


def test_a_nested_node_is_seen_from_its_parent(tmp_path: Path) -> None:
    inner = '<node><translate>1 0 0</translate><instance_geometry url="#shape"/></node>'
    vertices, _ = read_collada(write(tmp_path, TRIANGLE, f"<rotate>0 0 1 90</rotate>{inner}"))
    assert vertices[0] == pytest.approx([0.0, 0.01, 0.0], abs=1e-15)


def test_an_instance_more_is_a_surface_more(tmp_path: Path) -> None:
    shows = '<instance_geometry url="#shape"/>'
    other = f"<node><translate>0 0 1</translate>{shows}</node>"
    vertices, triangles = read_collada(write(tmp_path, TRIANGLE, shows + other))
    assert triangles.tolist() == [[0, 1, 2], [3, 4, 5]]
    assert vertices[3:] - vertices[:3] == pytest.approx(np.tile([0, 0, 0.01], (3, 1)), abs=1e-15)


def test_a_triangle_with_two_corners_in_one_point_is_left_out(tmp_path: Path) -> None:
    twice = primitive("triangles", "<p>7 0 7 1 7 2 7 3 7 3 7 1</p>")
    assert read_collada(write(tmp_path, twice))[1].tolist() == [[0, 1, 2]]


@pytest.mark.parametrize(
    ("shown", "reason"),
    [
        ("", "shows no triangles"),
        (primitive("triangles", "<p>7 0 7 1 7 9</p>"), "name vertices 0 .. 9"),
        (primitive("triangles", "<p>7 0 7 1 7 -2</p>"), "name vertices -2 .. 1"),
        (primitive("triangles", "<p>7 0 7 1</p>"), "2 corners"),
        (primitive("triangles", "<p>7 0 7 1 7</p>"), "5 numbers"),
        (primitive("triangles", "<p>7 0 7 x 7 1</p>"), "invalid literal"),
        (primitive("triangles", f"<p>7 0 7 1 7 {10**30}</p>"), "too large"),
        (primitive("polylist", "<vcount>4</vcount><p>7 0 7 1 7 2</p>"), "4 corners, but name 3"),
        (primitive("polylist", "<vcount>6 -3</vcount><p>7 0 7 1 7 2</p>"), "corners, but name 3"),
        (primitive("tristrips", "<p>7 0 7 1 7 2</p>"), "tristrips"),
        (primitive("polygons", "<ph><p>7 0 7 1 7 2</p></ph>"), "holes"),
        ("<triangles><p>0 1 2</p></triangles>", "names no vertices"),
    ],
)
def test_refuses_primitives_that_do_not_fit(tmp_path: Path, shown: str, reason: str) -> None:
    refuses(write(tmp_path, shown), reason)


@pytest.mark.parametrize(
    ("node", "reason"),
    [
        ('<instance_geometry url="#nothing"/>', "'#nothing'"),
        ("<instance_geometry/>", "lacks what ''"),
        ('<instance_geometry url="#s"/>', "not a mesh"),
        ('<instance_node url="#n"/>', "instance_node"),
        ("<matrix>1 0 0</matrix>", "3 numbers, not 16"),
        ("<matrix>1 0 0 0 0 1 0 0 0 0 1 0 0 0 1 1</matrix>", "last row"),
        ("<rotate>0 0 0 90</rotate>", "no length"),
        ("<translate>nan 0 0</translate>", "not finite"),
    ],
)
def test_refuses_nodes_that_mean_nothing(tmp_path: Path, node: str, reason: str) -> None:
    refuses(write(tmp_path, TRIANGLE, node), reason)


@pytest.mark.parametrize(("unit", "reason"), [("0", "0 m"), ("nan", "nan m"), ("cm", "'cm'")])
def test_refuses_a_unit_of_no_length(tmp_path: Path, unit: str, reason: str) -> None:
    refuses(write(tmp_path, TRIANGLE, unit=unit), reason)


@pytest.mark.parametrize(("points", "reason"), [("0 0", "has 2 numbers"), ("a" * 9999, "aaa")])
def test_refuses_points_that_are_none(tmp_path: Path, points: str, reason: str) -> None:
    refuses(write(tmp_path, TRIANGLE, points=points), reason)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (b"", "no element found"),
        (b"solid of STL", "syntax error"),
        (b"<COLLADA", "unclosed token"),
        (b"<robot/>", "<robot>"),
        (b"<COLLADA/>", "no visual scene"),
        (b'<?xml version="1.0" encoding="none"?><COLLADA/>', "none"),
        (b'<!DOCTYPE C [<!ENTITY e "e">]><COLLADA>&e;</COLLADA>', "document type"),
    ],
)
def test_refuses_what_is_no_collada(tmp_path: Path, text: bytes, reason: str) -> None:
    path = tmp_path / "shape.dae"
    path.write_bytes(text)
    refuses(path, reason)


def test_refuses_a_file_that_is_not_there(tmp_path: Path) -> None:
    refuses(tmp_path / "shape.dae", "No such file")
    refuses(tmp_path, "directory")


def test_refuses_a_file_that_is_too_large(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path, TRIANGLE)
    monkeypatch.setattr(collada, "MOST_TRIANGLES", 0)
    refuses(path, "more than 0 triangles")
    monkeypatch.setattr(collada, "LARGEST_FILE", 100)
    refuses(path, "more than 100 bytes")


def refuses(path: Path, reason: str) -> None:
    """One sentence that names the file and what is wrong with it."""
    with pytest.raises(DescriptionError) as caught:
        read_collada(path)
    message = str(caught.value)
    assert message.startswith(f"cannot read {path}: ")
    assert reason in message
    assert "\n" not in message
    assert len(message) < len(str(path)) + 250
