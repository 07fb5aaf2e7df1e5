"""Other hands in the simulation, in recordings and on the page."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter, ElectricGripper
from baxter_kin.description import StockFiles
from baxter_kin.description.hands import FINGER_MESHES, TIP_MESHES
from baxter_kin.validation import FloatArray
from planner import (
    Manipulator,
    PickAndPlace,
    Scene,
    load_object,
    make_block,
    overhead_grasp,
    plan_pick_and_place,
    tool_of,
    verify,
)
from sim import Recorder, Simulation, SimulationError, World
from sim.errors import RecordingError
from sim.view.appearance import Appearance
from sim.view.replay import replay_html
from tests.baxter_kin.description.test_hands import MOUNTS
from tests.conftest import at
from tests.meshes.collada import read_collada

FINGERS = StockFiles.installed().urdf.parents[1] / "meshes" / "electric_gripper" / "fingers"
THINNED_M = 3e-3
"""What is drawn is thinned out; see `test_appearance`."""


def bounds(points: FloatArray) -> FloatArray:
    return np.array([points.min(axis=0), points.max(axis=0)])


@pytest.mark.slow
@pytest.mark.parametrize("mount", MOUNTS, ids=str)
def test_fingers_are_drawn_where_they_are_mounted(mount: ElectricGripper) -> None:
    """The closed right hand, seen from its flange, against the files and Rethink's numbers."""
    robot = Baxter.load(hands={"right": mount})
    appearance = Appearance.of(robot)
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, pin.neutral(robot.model))
    T_base_hand = data.oMf[robot.model.getFrameId("right_hand_link", pin.FrameType.BODY)]
    width = {"narrow": 0.01725, "wide": 0.05503}[mount.fingers]
    slot = (mount.slot - 1) * 0.0095 - 0.011
    for finger, sign in (("l", 1.0), ("r", -1.0)):
        joint = f"r_gripper_{finger}_finger_joint"
        drawn = {p.mesh.name.split(".")[0]: p for p in appearance.parts if p.joint == joint}
        wanted = {
            FINGER_MESHES[mount.fingers]: np.array([0.0, sign * slot, 0.045]),
            TIP_MESHES[mount.tips]: np.array([0.0, sign * (slot + width), 0.045 + 0.1127]),
        }
        assert drawn.keys() == wanted.keys()
        for name, offset in wanted.items():
            vertices, _ = read_collada(FINGERS / f"{name}.DAE")
            T = T_base_hand.actInv(data.oMi[robot.model.getJointId(joint)])
            T = T * drawn[name].T_joint_mesh
            shown = drawn[name].mesh.points_m @ T.rotation.T + T.translation
            turned = vertices * np.array([-sign, -sign, 1.0]) + offset
            assert np.abs(bounds(shown) - bounds(turned)).max() < THINNED_M


def test_only_what_is_mounted_is_drawn(robot: Baxter) -> None:
    drawn = {part.mesh.name for part in Appearance.of(robot).parts}
    assert drawn.isdisjoint({"half_round_tip.0", "extended_wide.0"})


def test_a_tool_is_drawn_where_it_is() -> None:
    size, centre = np.array([0.02, 0.03, 0.1]), np.array([0.01, 0.0, 0.05])
    tool = tool_of(make_block("rod", at(*centre), edge_m=size.tolist()), at(0.0, 0.0, 0.1))
    robot = Baxter.load(hands={"left": tool})
    appearance = Appearance.of(robot)
    (part,) = (p for p in appearance.parts if "tool" in p.mesh.name)
    assert part.joint == "left_w2"
    hand = robot.model.frames[robot.model.getFrameId("left_hand_link")].placement
    T_hand_mesh = hand.actInv(part.T_joint_mesh)
    points = part.mesh.points_m @ T_hand_mesh.rotation.T + T_hand_mesh.translation
    np.testing.assert_allclose(bounds(points), [centre - size / 2, centre + size / 2], atol=1e-5)
    corners = part.mesh.points_m[part.mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = part.mesh.normals[part.mesh.faces[:, 0]]
    assert (np.einsum("ij,ij->i", across, normals.astype(float)) > 0.0).all()


@pytest.mark.slow
def test_wide_fingers_carry_what_narrow_ones_cannot_take(robot: Baxter) -> None:
    """A block of 12 cm: planned, verified, executed, recorded and shown; refused for others."""
    edge_m, table_z_m = 0.12, -0.155
    wide = Baxter.load(hands={"right": ElectricGripper("wide")})
    table = load_object("table", at(1.0, 0.0, -0.93))
    block = make_block("block", at(0.70, -0.2, table_z_m + edge_m / 2), edge_m=edge_m)
    scene = Scene.of([table, block])

    q_start = wide.arm("right").start
    right = Manipulator.of(wide, "right")
    pick = overhead_grasp(right.hand, block)
    task = PickAndPlace("block", pick, at(0.05, 0.15, 0.0) * pick)
    plan = plan_pick_and_place(task, right, scene, q_start)
    assert plan.is_valid, plan.failure
    certificate = verify(plan, description=wide.description)
    assert certificate.is_valid, certificate.verdict
    refused = plan_pick_and_place(task, Manipulator.of(robot, "right"), scene, q_start)
    assert "the right hand opens only 57.0 mm" in str(refused.failure)

    world, recorder = World(wide), Recorder(wide)
    for body in scene:
        world.spawn(body)
    world.move_arm("right", q_start)
    simulation = Simulation(world, [recorder])
    outcome = simulation.execute(plan)
    assert outcome.is_success, outcome.failure
    simulation.finish()
    moved = world.body("block").T_base_body.translation - block.T_base_body.translation
    np.testing.assert_allclose(moved, [0.05, 0.15, 0.0], atol=1e-3)
    with pytest.raises(RecordingError, match="another robot"):
        replay_html(recorder.recording(), robot)
    other = World(robot)
    other.move_arm("right", q_start)
    with pytest.raises(SimulationError, match="the plan is for another robot"):
        Simulation(other).execute(plan)
