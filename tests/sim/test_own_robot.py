"""A robot by its own description: plan, file, verdict, simulation, recording and replay."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter
from baxter_kin.errors import UnknownNameError
from baxter_kin.fields import evolve
from planner import (
    Manipulator,
    PickAndPlace,
    Plan,
    Scene,
    load_plan,
    plan_pick_and_place,
    save_plan,
    verify,
)
from planner.collision.robot.robot_body import RobotBody
from planner.collision.robot.robot_shapes import RobotShapes
from planner.errors import SceneError, TaskError
from planner.verification.command_line import main
from sim import Recorder, Recording, Simulation, World, read_recording, save_recording
from sim.errors import RecordingError, SimulationError
from sim.view.appearance import Appearance
from sim.view.replay import replay_html
from sim.view.scenegraph import RobotTree
from tests.conftest import overhead
from tests.served_urdf import VARIANTS, served_urdf, variant


class Own(NamedTuple):
    text: str
    robot: Baxter
    plan: Plan


def planned(text: str, scene: Scene) -> Own:
    robot = Baxter.load(text)
    arm = Manipulator.of(robot, "left")
    task = PickAndPlace("block", overhead(0.70, 0.15, -0.129), overhead(0.75, 0.0, -0.129))
    return Own(text, robot, plan_pick_and_place(task, arm, scene, arm.arm.start))


@pytest.fixture(scope="module", params=["calibrated", "as drawn, other limits", "one gripper"])
def own(request: pytest.FixtureRequest, scene: Scene) -> Own:
    rng = np.random.default_rng(1)
    return planned(
        {
            "calibrated": served_urdf(rng, limit_change=0.005),
            "as drawn, other limits": served_urdf(
                rng, apart_m=0.0, turned_rad=0.0, limit_change=0.005
            ),
            "one gripper": served_urdf(without_grippers=["right"]),
        }[request.param],
        scene,
    )


def executed(own: Own, scene: Scene, *, plan: Plan | None = None) -> Recording:
    world, recorder = World(own.robot), Recorder(own.robot)
    for body in scene:
        world.spawn(body)
    world.move_arm("left", own.plan.q_start)
    simulation = Simulation(world, [recorder])
    outcome = simulation.execute(own.plan if plan is None else plan)
    assert outcome.is_success, outcome.failure
    simulation.finish()
    return recorder.recording()


@pytest.mark.slow
def test_is_planned_and_verified_for_itself_and_refused_for_the_stock_robot(
    own: Own, robot: Baxter
) -> None:
    assert own.plan.is_valid, own.plan.failure
    anybody = evolve(own.plan, robot=None)  # judged by its joints
    certificate = verify(anybody, description=own.robot.description)
    assert certificate.is_valid, certificate.verdict
    with pytest.raises(TaskError, match="another robot than the stock robot"):
        verify(own.plan)
    world = World(robot)
    world.move_arm("left", own.plan.q_start)
    with pytest.raises(SimulationError, match="another robot"):
        Simulation(world).execute(own.plan)


@pytest.mark.slow
def test_survives_its_file_and_is_judged_on_the_stock_robot_where_that_has_its_joints(
    own: Own, robot: Baxter, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, urdf = tmp_path / "own.plan", tmp_path / "own.urdf"
    save_plan(own.plan, path)
    urdf.write_text(own.text, encoding="utf-8")
    assert load_plan(path).robot == own.plan.robot
    assert main([str(path), "-q", "--urdf", str(urdf)]) == 0
    if own.robot.joint_names != robot.joint_names:
        status = 2
    else:
        status = int(not verify(own.plan, on_another_robot=True).is_valid)
    assert main([str(path), "-q"]) == status
    assert "for another robot" in capsys.readouterr().err


@pytest.mark.slow
def test_is_executed_recorded_and_replayed(
    own: Own, robot: Baxter, scene: Scene, tmp_path: Path
) -> None:
    save_recording(executed(own, scene), tmp_path / "own.mcap")
    again = read_recording(tmp_path / "own.mcap").recording
    assert again.robot == own.robot.description.identity
    if own.robot.joint_names != robot.joint_names:
        assert replay_html(again, own.robot, body=RobotBody.load())
    with pytest.raises(RecordingError):
        replay_html(again, robot)


def test_another_body_is_refused_by_the_simulation(robot: Baxter, stock_plan: Plan) -> None:
    world = World(robot, RobotBody.load().padded(0.001))
    world.move_arm("left", stock_plan.q_start)
    with pytest.raises(SimulationError, match="other shapes"):
        Simulation(world).execute(stock_plan)


def test_a_hand_without_fingers_is_refused_in_a_sentence() -> None:
    bare = Baxter.load(served_urdf(without_grippers=["left", "right"]))
    with pytest.raises(SceneError, match="the left hand of this robot has no fingers"):
        Manipulator.of(bare, "left")
    world = World(bare)
    with pytest.raises(SimulationError, match="has no fingers"):
        world.set_fingers("left", 0.0)
    with pytest.raises(UnknownNameError):
        world.hand("middle")
    world.move_arm("left", bare.arm("left").start)
    recorder = Recorder(bare)
    Simulation(world, [recorder]).wait(0.1)
    assert not recorder.recording().gripper_percent.any()


def test_fingers_that_slide_another_way_are_refused_in_a_sentence() -> None:
    rng, joint = np.random.default_rng(0), "l_gripper_l_finger_joint"
    robot = Baxter.load(served_urdf(rng, joints=[joint]))
    with pytest.raises(SceneError, match=f"{joint} slides .* mrad off y of left_gripper"):
        Manipulator.of(robot, "left")


@pytest.mark.parametrize("side", ["left", "right"])
def test_meshes_are_drawn_on_the_links_of_the_robot(side: str) -> None:
    """Where a part is drawn, against the link's own place in the untouched text."""
    text = served_urdf(np.random.default_rng(4))
    untouched = pin.buildModelFromXML(text)
    robot = Baxter.load(text)
    appearance = Appearance.of(robot)
    tree = RobotTree(robot.model, appearance)
    placed = {
        command["path"]: np.array(command["matrix"]).reshape(4, 4).T
        for command in tree.commands()
        if command["type"] == "set_transform"
    }
    node, T = "/robot", np.eye(4)
    for joint in ["s0", "s1", "e0", "e1", "w0", "w1", "w2"]:
        node = f"{node}/{side}_{joint}"
        T = T @ placed[node]
        node += "/moves"
    data = untouched.createData()
    pin.framesForwardKinematics(untouched, data, pin.neutral(untouched))
    wanted = data.oMf[untouched.getFrameId(f"{side}_wrist")].homogeneous
    assert np.abs(T - wanted).max() < 1e-6


def test_meshes_go_along_with_a_link_that_is_mounted_elsewhere(robot: Baxter) -> None:
    text = served_urdf().replace('xyz="0 0 0.11355"', 'xyz="0 0 0.11855"')
    own, stock = Appearance.of(Baxter.load(text)), Appearance.of(robot)
    moved = {
        part.mesh.name.split(".")[0]
        for part, drawn in zip(own.parts, stock.parts, strict=True)
        if not part.T_joint_mesh.isApprox(drawn.T_joint_mesh, 1e-9)
    }
    assert moved == {"electric_gripper_base", "hand_camera", "hand_range"}


@pytest.mark.slow
@pytest.mark.parametrize("name", VARIANTS)
def test_robots_of_any_file_have_all_shapes_and_all_that_is_seen(name: str) -> None:
    """Each part is on the same joint, where it is drawn; only grippers may be missing."""
    rounding = 1e-9
    own = Baxter.load(variant(name))
    parts = (
        {f"{part.joint} {part.mesh.name}": part.T_joint_mesh for part in each.parts}
        for each in (Appearance.of(own), Appearance.of(Baxter.load(served_urdf())))
    )
    seen, drawn = parts
    lost = drawn.keys() - seen.keys()
    assert all("gripper" in key for key in lost), lost
    assert ("l_gripper_l_finger_joint" in own.joint_names) == (not lost)
    for key, T in seen.items():
        assert np.abs(T.homogeneous - drawn[key].homogeneous).max() < rounding
    links = {each.name for each in RobotBody.load().links.values() if ":" not in each.name}
    shapes = RobotShapes(own)
    assert {link for link in links - set(shapes.links) if "gripper" not in link} == set()
    tree = RobotTree(own.model, Appearance.of(own))
    assert len(list(tree.body_commands(RobotBody.load()))) >= len(set(shapes.links))


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["camera_named_as_a_moving_joint", "grippers_on_bases", "older_head"]
)
def test_robots_of_other_files_are_planned_for_verified_executed_and_shown(
    name: str, scene: Scene
) -> None:
    own = planned(variant(name), scene)
    assert own.plan.is_valid, own.plan.failure
    certificate = verify(own.plan, description=own.robot.description)
    assert certificate.is_valid, certificate.verdict
    assert executed(own, scene).duration_s > 1.0


@pytest.fixture(scope="module")
def stock_plan(robot: Baxter, scene: Scene) -> Plan:
    """That of the demo's first cycle."""
    return planned(robot.description.text, scene).plan


@pytest.mark.parametrize(
    ("measured", "off_mm", "reason"),
    [("one", 13.0, "block is stated"), ("another", 9.0, "is inside block")],
)
def test_a_plan_for_the_drawing_is_judged_on_a_real_robot_and_by_how_much_it_is_off_is_said(
    stock_plan: Plan,
    measured: str,
    off_mm: float,
    reason: str,
    *,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    file, urdf = tmp_path / "plan.json", tmp_path / "own.urdf"
    save_plan(stock_plan, file)
    urdf.write_text(served_urdf(measured=measured), encoding="utf-8")
    assert main([str(file), "--urdf", str(urdf)]) == 1
    said = capsys.readouterr()
    assert "joint left_torso_arm_mount lies" in said.err
    assert f"where the tip is up to {off_mm:.1f} mm and" in said.err
    assert reason in said.err
    assert "FAILS  tip position" in said.out


@pytest.mark.slow
def test_a_certificate_of_another_robot_is_of_no_plan(stock_plan: Plan, robot: Baxter) -> None:
    wider = Baxter.load(robot.description.text.replace('velocity="1.5"', 'velocity="1.6"'))
    with pytest.raises(TaskError, match="on_another_robot=True"):
        verify(stock_plan, description=wider.description)
    judged = verify(stock_plan, description=wider.description, on_another_robot=True)
    assert not judged.is_of(stock_plan)
    assert verify(stock_plan).is_of(stock_plan)


@pytest.mark.slow
@pytest.mark.parametrize("measured", ["one", "another"])
def test_plans_for_real_robots_are_as_clear_and_as_fast_as_for_the_drawing(
    stock_plan: Plan, scene: Scene, measured: str
) -> None:
    own = planned(served_urdf(measured=measured), scene)
    certificate = verify(own.plan, description=own.robot.description)
    assert certificate.is_valid, certificate.verdict
    clearance_mm = 1e3 * certificate["clearance"].value
    assert clearance_mm == pytest.approx(21.9, abs=0.15)
    motion_s, stock_s = (
        sum(m.trajectory.duration for m in p.moves) for p in (own.plan, stock_plan)
    )
    assert motion_s == pytest.approx(stock_s, rel=0.01)
