"""Models come and go as Gazebo's do; bodies out of SDF and URDF against numbers known otherwise."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Baxter
from planner import Box, Cylinder, Sphere
from planner.errors import SceneError
from planner.scene.coal_shapes import shape_of
from planner.scene.mesh import Mesh
from planner.scene.objects import URDF_FOLDER, load_object
from sim import World
from sim.ros1.definitions import service_type
from sim.ros1.robot.baxter import SimulatedBaxter
from sim.ros1.robot.gazebo import DELETE, SPAWN, Models, body_of_text
from tests.conftest import at

ROUNDING = 1e-12
HERE = at(0.0, 0.0, 0.0)
ANGLES = st.floats(-3.0, 3.0)

TABLE_SDF = """<?xml version="1.0"?>
<sdf version="1.4"><model name="any"><static>true</static>
 <link name="link">
  <collision name="surface"><pose>0 0 0.755 0 0 0</pose>
   <geometry><box><size>0.913 0.913 0.04</size></box></geometry></collision>
  <collision name="column"><pose>0 0 0.37 0 0 0</pose>
   <geometry><box><size>0.042 0.042 0.74</size></box></geometry></collision>
  <visual name="v"><geometry><mesh><uri>model://cafe_table/cafe.dae</uri></mesh></geometry>
   <material><script><name>Gazebo/Blue</name></script></material></visual>
 </link></model></sdf>"""
"""As the demo's table is written: shapes to collide with, and a mesh that nobody here has."""

TETRAHEDRON = """v 0 0 0
v 1 0 0
v 0 1 0
v 0 0 1
v 0 0 1
f 1 3 2
f 1 2 4
f 1 4 3
f 2 3 5
f 1 2 2
"""
"""With a vertex written twice and a triangle without area."""


def sdf(link: str, model: str = "") -> str:
    return f"<sdf version='1.6'><model name='m'>{model}<link name='l'>{link}</link></model></sdf>"


def solid(geometry: str, pose: str = "0 0 0 0 0 0") -> str:
    return f"<collision name='c'><pose>{pose}</pose><geometry>{geometry}</geometry></collision>"


class TestSdf:
    """What Gazebo's own format says."""

    def test_a_table_is_fixed_and_has_its_shapes_for_collision(self) -> None:
        body = body_of_text(TABLE_SDF, "cafe_table", at(1.0, 0.0, -0.93))
        assert (body.name, body.is_movable) == ("cafe_table", False)
        assert [part.shape for part in body.parts] == [
            Box((0.913, 0.913, 0.04)),
            Box((0.042, 0.042, 0.74)),
        ]
        assert body.extent_m((0, 0, 1))[1] == pytest.approx(0.775 - 0.93)
        assert body.parts[0].rgba[2] > body.parts[0].rgba[0]  # blue

    def test_all_kinds_of_shapes(self) -> None:
        text = sdf(
            solid("<cylinder><radius>0.1</radius><length>0.3</length></cylinder>")
            + solid("<sphere><radius> 0.2 </radius></sphere>")
        )
        parts = body_of_text(text, "b", HERE).parts
        assert [part.shape for part in parts] == [Cylinder(0.1, 0.3), Sphere(0.2)]

    @given(st.lists(ANGLES, min_size=18, max_size=18))
    def test_poses_of_model_link_and_shape_follow_each_other(self, values: list[float]) -> None:
        poses = [values[i : i + 6] for i in (0, 6, 12)]
        model, link, shape = (" ".join(map(repr, pose)) for pose in poses)
        box = "<box><size>1 1 1</size></box>"
        text = sdf(f"<pose>{link}</pose>" + solid(box, shape), f"<pose>{model}</pose>")
        (part,) = body_of_text(text, "b", HERE).placed_parts
        expected = pin.SE3.Identity()
        for x, y, z, roll, pitch, yaw in poses:
            expected = expected * pin.SE3(
                pin.rpy.rpyToMatrix(roll, pitch, yaw), np.array([x, y, z])
            )
        assert part.T_body_part.isApprox(expected, 1e-9)

    @pytest.mark.parametrize(
        ("text", "said"),
        [
            ("<sdf><world/></sdf>", "no model"),
            ("nonsense", "not XML"),
            ("<html/>", "'html'"),
            ("<!DOCTYPE sdf><sdf/>", "document type"),
            (sdf(""), "1 .. 1000 shapes, got 0"),
            (sdf(solid("<plane><normal>0 0 1</normal></plane>")), "not plane"),
            (sdf(solid("<box><size>1 1</size></box>")), "size of a box is 3 finite numbers"),
            (sdf(solid("<box><size>1 1 nan</size></box>")), "3 finite numbers"),
            (sdf(solid("<box><size>1 1 -1</size></box>")), "above zero"),
            (sdf(solid("<mesh><uri>model://no/such.dae</uri></mesh>")), "no mesh"),
            (sdf(solid("")), "one geometry, got 0"),
            (sdf("<pose relative_to='x'>0 0 0 0 0 0</pose>"), "relative to 'x'"),
            (sdf("", "<include/>"), "<include>"),
            (sdf("", "<joint name='hinge' type='revolute'/>"), "'hinge' is 'revolute'"),
        ],
    )
    def test_what_is_not_simulated_is_named(self, text: str, said: str) -> None:
        with pytest.raises(SceneError, match=said):
            body_of_text(text, "b", HERE)


class TestUrdf:
    """What URDF says, as Pinocchio reads it."""

    @pytest.mark.parametrize("kind", ["block", "table"])
    def test_the_toolkits_own_objects(self, kind: str) -> None:
        text = (URDF_FOLDER / f"{kind}.urdf").read_text(encoding="utf-8")
        ours, theirs = body_of_text(text, kind, HERE), load_object(kind, HERE)
        assert [part.shape for part in ours.parts] == [part.shape for part in theirs.parts]
        for one, other in zip(ours.placed_parts, theirs.placed_parts, strict=True):
            assert one.T_body_part.isApprox(other.T_body_part, ROUNDING)
            np.testing.assert_allclose(one.rgba, other.rgba, atol=1e-6)

    @given(st.lists(ANGLES, min_size=18, max_size=18))
    def test_fixed_joints_place_links_as_pinocchio_does(self, values: list[float]) -> None:
        origins = [
            f'<origin xyz="{" ".join(map(repr, values[i : i + 3]))}" '
            f'rpy="{" ".join(map(repr, values[i + 3 : i + 6]))}"/>'
            for i in (0, 6, 12)
        ]
        text = f"""<robot name="r"><link name="c"><collision>{origins[0]}<geometry>
            <sphere radius="0.1"/></geometry></collision></link><link name="a"/><link name="b"/>
            <joint name="1" type="fixed"><parent link="a"/><child link="b"/>{origins[1]}</joint>
            <joint name="2" type="fixed"><parent link="b"/><child link="c"/>{origins[2]}</joint>
            </robot>"""
        (part,) = body_of_text(text, "b", HERE).placed_parts
        model = pin.buildModelFromXML(text)
        shapes = pin.buildGeomFromUrdfString(model, text, pin.GeometryType.COLLISION)
        (shape,) = shapes.geometryObjects
        assert part.T_body_part.isApprox(shape.placement, 1e-9)
        assert part.shape == shape_of(shape.geometry)

    def test_gazebos_words_on_colour_and_on_standing_still(self) -> None:
        text = """<robot name="r"><link name="a"><collision><geometry><sphere radius="0.1"/>
            </geometry></collision></link><gazebo reference="a"><material>Gazebo/Red</material>
            </gazebo><gazebo><static>1</static></gazebo></robot>"""
        body = body_of_text(text, "b", HERE)
        assert not body.is_movable
        assert body.parts[0].rgba == (0.85, 0.08, 0.06, 1.0)

    @pytest.mark.parametrize(
        ("joints", "said"),
        [
            ('<joint name="j" type="revolute"/>', "'j' is 'revolute'"),
            ('<joint name="j" type="fixed"><child link="a"/></joint>', "'j' names no parent"),
            (
                '<joint name="j" type="fixed"><child link="a"/><parent link="a"/></joint>',
                "go in a circle",
            ),
        ],
    )
    def test_joints_that_make_no_rigid_model_are_refused(self, joints: str, said: str) -> None:
        with pytest.raises(SceneError, match=said):
            body_of_text(f'<robot name="r"><link name="a"/>{joints}</robot>', "b", HERE)


class TestMeshes:
    """Triangles from files."""

    def test_a_mesh_is_read_scaled_and_cleaned(self, tmp_path: Path) -> None:
        path = tmp_path / "t.obj"
        path.write_text(TETRAHEDRON, encoding="utf-8")
        mesh = f"<mesh><uri>file://{path}</uri><scale>0.1 0.2 0.3</scale></mesh>"
        (part,) = body_of_text(sdf(solid(mesh)), "b", HERE).parts
        assert isinstance(part.shape, Mesh)
        assert (len(part.shape.vertices), len(part.shape.triangles)) == (4, 4)
        assert part.shape.vertices.max(axis=0) == pytest.approx([0.1, 0.2, 0.3])
        assert part.shape.is_convex

    def test_a_mirrored_one_is_not_inside_out(self, tmp_path: Path) -> None:
        path = tmp_path / "t.obj"
        path.write_text(TETRAHEDRON, encoding="utf-8")
        mesh = f"<mesh><uri>file://{path}</uri><scale>-0.1 0.1 0.1</scale></mesh>"
        (part,) = body_of_text(sdf(solid(mesh)), "b", HERE).parts
        assert isinstance(part.shape, Mesh)
        assert part.shape.is_convex

    def test_they_are_looked_for_where_gazebo_and_ros_look(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        (tmp_path / "cone").mkdir()
        (tmp_path / "cone" / "t.obj").write_text(TETRAHEDRON, encoding="utf-8")
        monkeypatch.setenv("GAZEBO_MODEL_PATH", f"/nowhere:{tmp_path}")
        text = sdf(solid("<mesh><uri>model://cone/t.obj</uri></mesh>"))
        assert len(body_of_text(text, "b", HERE).parts) == 1

    def test_a_file_that_is_no_mesh_is_named(self, tmp_path: Path) -> None:
        path = tmp_path / "t.stl"
        path.write_bytes(b"no mesh at all")
        with pytest.raises(SceneError, match="cannot read the mesh"):
            body_of_text(sdf(solid(f"<mesh><uri>file://{path}</uri></mesh>")), "b", HERE)
        with pytest.raises(SceneError, match=r"no mesh 'relative\.stl'"):
            body_of_text(sdf(solid("<mesh><uri>relative.stl</uri></mesh>")), "b", HERE)


BLOCK_URDF = (URDF_FOLDER / "block.urdf").read_text(encoding="utf-8")
REST_M = 1e-7


class Shop:
    """A world whose changes are made at once."""

    def __init__(self, robot: Baxter) -> None:
        self.baxter = SimulatedBaxter(World(robot))
        self.said: list[str] = []
        self.models = Models(self.baxter, at_once, self.said.append)

    def spawn(self, name: str, xml: str, *, frame: str = "world", **pose: Any) -> Any:
        request = service_type(SPAWN).request.make(
            model_name=name,
            model_xml=xml,
            robot_namespace="/",
            initial_pose=pose,
            reference_frame=frame,
        )
        return self.models.spawn(request)

    def delete(self, name: str) -> Any:
        return self.models.delete(service_type(DELETE).request.make(model_name=name))


def at_once(act: Callable[[], None]) -> Future[None]:
    done: Future[None] = Future()
    try:
        act()
    except Exception as cause:
        done.set_exception(cause)
    else:
        done.set_result(None)
    return done


@pytest.fixture
def shop(robot: Baxter) -> Shop:
    return Shop(robot)


@pytest.fixture
def furnished(shop: Shop) -> Shop:
    """As the original demo does it: no quaternion is given."""
    assert shop.spawn("cafe_table", TABLE_SDF, position={"x": 1.0}).success
    place = {"x": 0.6725, "y": 0.1265, "z": 0.7825}
    assert shop.spawn("block", BLOCK_URDF, position=place).success
    return shop


def test_the_demos_scene_is_where_the_demo_expects_it(furnished: Shop) -> None:
    world = furnished.baxter.world
    assert world.supports["block"] == ("cafe_table",)
    assert world.body("cafe_table").extent_m((0, 0, 1))[1] == pytest.approx(-0.155)
    np.testing.assert_allclose(
        world.body("block").centre_base, [0.6975, 0.1515, -0.130], atol=REST_M
    )


def test_a_name_that_is_taken_is_no_success_and_changes_nothing(furnished: Shop) -> None:
    before = furnished.baxter.world.body("block")
    response = furnished.spawn("block", BLOCK_URDF, position={"x": 2.0})
    assert not response.success
    assert "already has a body named 'block'" in response.status_message
    assert furnished.baxter.world.body("block").T_base_body == before.T_base_body


@pytest.mark.parametrize(
    ("name", "xml", "said"),
    [("", BLOCK_URDF, "needs a name"), ("x", "<nothing", "not XML"), ("x", "<a/>", "'a'")],
)
def test_what_is_no_model_is_no_success(shop: Shop, name: str, xml: str, said: str) -> None:
    response = shop.spawn(name, xml)
    assert not response.success
    assert said in response.status_message
    assert said in shop.said[-1]


def test_where_the_block_is_is_told_before_each_deletion(furnished: Shop) -> None:
    assert furnished.delete("cafe_table").success
    (told,) = [text for text in furnished.said if text.startswith("before")]
    assert told.startswith("before cafe_table is deleted: block at (0.67")
    assert told.endswith("its centre at (0.6975, 0.1515, -0.13) m, on cafe_table")
    assert furnished.baxter.world.supports["block"] == ("floor",)
    assert furnished.delete("block").success
    response = furnished.delete("block")
    assert not response.success
    assert "no body 'block'" in response.status_message


def test_frames_of_models_and_of_links(furnished: Shop) -> None:
    xml = TABLE_SDF.replace("0 0 0.755", "0 0 0")
    for name, frame in (("a", "block"), ("b", "baxter::left_gripper"), ("c", "base")):
        assert furnished.spawn(name, xml, frame=frame, position={"x": 0.1}).success
    world = furnished.baxter.world
    by_hand = {
        "a": world.body("block").T_base_body,
        "b": world.T_base_tip("left"),
        "c": type(world.T_base_tip("left")).Identity(),
    }
    for name, T_base_frame in by_hand.items():
        expected = T_base_frame.act(np.array([0.1, 0.0, 0.0]))
        np.testing.assert_allclose(world.body(name).T_base_body.translation, expected, atol=1e-12)
    assert "no frame 'moon'" in furnished.spawn("d", xml, frame="moon").status_message


def test_a_turned_model_is_turned(shop: Shop) -> None:
    half = float(np.sqrt(0.5))
    shop.spawn("t", TABLE_SDF, orientation={"z": half, "w": half})
    x, y, _ = shop.baxter.world.body("t").T_base_body.rotation[:, 0]
    assert (x, y) == pytest.approx((0.0, 1.0))


def test_a_world_that_ticks_no_more_is_told_and_changed_no_more(
    robot: Baxter, monkeypatch: pytest.MonkeyPatch
) -> None:
    waiting: list[Future[None]] = []

    def never(_: Callable[[], None]) -> Future[None]:
        waiting.append(Future())
        return waiting[-1]

    monkeypatch.setattr("sim.ros1.robot.gazebo.ANSWER_S", 0.01)
    shop = Shop(robot)
    shop.models = Models(shop.baxter, never, shop.said.append)
    response = shop.spawn("t", TABLE_SDF)
    assert not response.success
    assert "shutting down" in response.status_message
    assert waiting[0].cancelled()
