"""Models come and go as Gazebo's do."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter
from planner.scene.objects import URDF_FOLDER
from sim import World
from sim.ros1.definitions import service_type
from sim.ros1.robot.baxter import SimulatedBaxter
from sim.ros1.robot.services.models import DELETE, SPAWN, Models
from tests.sim.ros1.robot.services.test_model_text import TABLE_SDF

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

    monkeypatch.setattr("sim.ros1.robot.services.models.ANSWER_S", 0.01)
    shop = Shop(robot)
    shop.models = Models(shop.baxter, never, shop.said.append)
    response = shop.spawn("t", TABLE_SDF)
    assert not response.success
    assert "shutting down" in response.status_message
    assert waiting[0].cancelled()
