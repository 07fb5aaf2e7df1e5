"""A simulated Baxter on the network, row by row of its interface: our master, our node."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.frames import quaternion_xyzw
from sim import EventKind, World
from sim.errors import RosError
from sim.ros1.master import Master
from sim.ros1.node import Node
from sim.ros1.robot.gazebo import start_rad
from sim.ros1.robot.panel import INPUTS, NAVIGATORS, OUTPUTS
from sim.ros1.robot.ros_robot import NAME, RosRobot
from tests.conftest import overhead
from tests.sim.ros1.processes import until
from tests.sim.ros1.robot.client import CORE, IK, Client
from tests.sim.ros1.robot.test_gazebo import BLOCK_URDF, TABLE_SDF
from tests.sim.runs import Witness

JOINT_STATES = "/robot/joint_states", "sensor_msgs/JointState"
ROSOUT = "/rosout", "rosgraph_msgs/Log"
LEFT = "/robot/limb/left"
HAND = "/robot/end_effector/left_gripper"


class TestRobot:
    """What is there before anything is asked."""

    def test_parameters_are_set_while_it_lives(self, served: RosRobot, client: Client) -> None:
        node = client.node
        assert node.parameter("/rethink/software_version") == "1.2.0"
        assert node.parameter("/baxter_kin/simulated") is True
        text = node.parameter("/robot_description")
        assert Baxter.load(text).digest == served.baxter.world.robot.digest
        served.close()
        assert not any(
            node.has_parameter(name) for name in ("/rethink/software_version", "/robot_description")
        )

    def test_it_says_once_that_it_has_started_to_whoever_comes(self, client: Client) -> None:
        for _ in range(2):
            with Node("/late", master_uri=client.node.master_uri) as late:
                heard = Client(late).listen("/robot/sim/started", "std_msgs/Empty")
                until(heard.copy)

    def test_everything_it_tells_can_be_read(self, served: RosRobot, client: Client) -> None:
        topics = served._publishers.publishers
        for publisher in topics:
            client.listen(publisher.topic, publisher.type.name)
        until(lambda: all(len(client.heard[p.topic]) >= 3 for p in topics))
        names = {publisher.topic for publisher in topics}
        assert names >= {f"/robot/digital_io/{name}/state" for name in (*INPUTS, *OUTPUTS)}
        assert names >= {f"/robot/navigators/{name}_navigator/state" for name in NAVIGATORS}
        assert len(names) == len(topics) == 37

    def test_joint_states_endpoints_and_hands_are_those_of_the_robot(
        self, served: RosRobot, client: Client
    ) -> None:
        message = client.now(*JOINT_STATES)
        robot = served.baxter.world.robot
        assert tuple(message.name) == robot.joint_names
        arrays = (message.position, message.velocity, message.effort)
        assert {len(array) for array in arrays} == {len(message.name)}
        assert message.position.tolist() == served.baxter.world.q.tolist()
        client.until(*JOINT_STATES, lambda m: m.header.seq > message.header.seq)
        stamps = [
            (m.header.stamp.sec, m.header.stamp.nanosec) for m in client.heard[JOINT_STATES[0]]
        ]
        assert stamps == sorted(set(stamps))

        for side, arm in robot.arms.items():
            message = client.now(f"/robot/limb/{side}/endpoint_state", f"{CORE}/EndpointState")
            T_base_tip = arm.T_base_tip(arm.start)
            p, o = message.pose.position, message.pose.orientation
            assert [p.x, p.y, p.z] == pytest.approx(T_base_tip.translation.tolist(), abs=1e-12)
            quat = np.array([o.x, o.y, o.z, o.w])
            assert abs(quat @ quaternion_xyzw(T_base_tip)) == pytest.approx(1.0)
            assert message.header.frame_id == "base"
        detection = f"{LEFT}/collision_detection_state", f"{CORE}/CollisionDetectionState"
        assert not client.now(*detection).collision_state
        found = client.now(f"{HAND}/properties", f"{CORE}/EndEffectorProperties")
        assert (found.id, found.ui_type) == (65538, 2)
        assert found.firmware_date == "2014/7/24 18:30:00"
        assert found.firmware_rev.split()[0] == "3.0.0"
        topic = f"{LEFT}/inverse_dynamics_command"  # feed-forward is taken without a word
        client.say(topic, "trajectory_msgs/JointTrajectoryPoint", effort=[1.0] * 7)
        client.now(*JOINT_STATES)
        assert not served.diagnostics.counts
        assert client.node.subscribers_of("/robot/joint_state_publish_rate") == ()
        assert client.node.publishers_of(f"{LEFT}/follow_joint_trajectory/status") == ()

    def test_a_passive_hand_is_told_as_such(self, own_master: str) -> None:
        world = World(Baxter.load(hands={"left": None}))
        with (
            RosRobot(world, master_uri=own_master) as served,
            Node("/client", master_uri=own_master) as node,
        ):
            client = Client(node)
            found = client.now(f"{HAND}/properties", f"{CORE}/EndEffectorProperties")
            assert (found.id, found.ui_type) == (131073, 3)
            assert client.gripper().calibrated == 2
            assert served.failure is None


class TestEnabling:
    """The robot as a whole."""

    def test_enable_stop_reset_disable(self, served: RosRobot, client: Client) -> None:
        assert not client.state.enabled
        client.enable()
        assert client.state.ready
        topic = "/robot/state", f"{CORE}/AssemblyState"
        client.say("/robot/set_super_stop", "std_msgs/Empty")
        stopped = client.until(*topic, lambda m: m.stopped)
        assert (stopped.enabled, stopped.estop_button, stopped.estop_source) == (False, 0, 2)
        client.say("/robot/set_super_enable", "std_msgs/Bool", data=True)
        until(lambda: served.diagnostics.counts["/robot/set_super_enable"])
        assert not client.state.enabled
        client.say("/robot/set_super_reset", "std_msgs/Empty")
        client.until(*topic, lambda m: not m.stopped)
        client.enable()
        client.say("/robot/set_super_enable", "std_msgs/Bool", data=False)
        client.until(*topic, lambda m: not m.enabled)

    def test_the_emergency_stop_is_pressed_on_our_own_topic(
        self, served: RosRobot, client: Client
    ) -> None:
        topic = "/robot/state", f"{CORE}/AssemblyState"
        client.enable()
        client.say("/robot/sim/press", "std_msgs/String", data="left estop")
        pressed = client.until(*topic, lambda m: m.stopped)
        assert (pressed.estop_button, pressed.estop_source) == (1, 1)
        client.say("/robot/set_super_reset", "std_msgs/Empty")
        until(lambda: served.diagnostics.counts["/robot/set_super_reset"])
        assert client.state.stopped
        client.say("/robot/sim/press", "std_msgs/String", data="left release")
        client.until(*topic, lambda m: m.estop_button == 3)
        client.say("/robot/sim/press", "std_msgs/String", data="left reset")
        reset = client.until(*topic, lambda m: not m.stopped)
        assert (reset.estop_button, reset.estop_source) == (0, 0)

    def test_tucked_arms_need_suppression(self, robot: Baxter, own_master: str) -> None:
        tucked = start_rad(is_tucked=True)
        with (
            RosRobot(World(robot), q_start=tucked, master_uri=own_master) as served,
            Node("/client", master_uri=own_master) as node,
        ):
            client = Client(node)
            client.say("/robot/set_super_enable", "std_msgs/Bool", data=True)
            until(lambda: served.diagnostics.counts["/robot/set_super_enable"])
            assert client.joints()["left_s1"] == -2.175
            assert not client.state.enabled

            def suppressed() -> bool:
                client.say(f"{LEFT}/suppress_collision_avoidance", "std_msgs/Empty")
                client.say("/robot/set_super_enable", "std_msgs/Bool", data=True)
                return bool(client.state.enabled)

            until(suppressed)
            avoidance = f"{LEFT}/collision_avoidance_state", f"{CORE}/CollisionAvoidanceState"
            assert client.now(*avoidance).collision_object == []


class TestArm:
    """Joint commands."""

    def test_it_goes_and_stays_and_tells_its_set_points(
        self, served: RosRobot, client: Client
    ) -> None:
        client.enable()
        goal = {"left_w2": 0.3, "left_s0": 0.1}
        client.move(goal, 1e-9)
        targets = client.now("/robot/ref_joint_states", "sensor_msgs/JointState")
        told = dict(zip(targets.name, targets.position.tolist(), strict=True))
        assert {name: told[name] for name in goal} == goal
        assert len(told) == 14
        for _ in range(20):
            joints = client.joints()
        assert joints["left_s0"] == pytest.approx(0.1, abs=1e-9)
        assert served.baxter.world.arm_q("left")[0] == pytest.approx(0.1, abs=1e-9)

    def test_velocity_and_twist_are_those_of_the_motion_and_the_speed_ratio_counts(
        self, served: RosRobot, client: Client
    ) -> None:
        client.enable()
        endpoint = f"{LEFT}/endpoint_state", f"{CORE}/EndpointState"
        client.listen(*endpoint)
        client.move({"left_s0": 0.3}, 1e-9)
        moves = [m for m in client.heard[endpoint[0]] if m.twist.angular.z]
        assert moves
        assert max(m.twist.angular.z for m in moves) == pytest.approx(0.6)
        mid = moves[len(moves) // 2]
        about_shoulder = mid.pose.position.y - 0.259  # by the URDF's mount, to a millimetre
        assert mid.twist.linear.x == pytest.approx(-0.6 * about_shoulder, abs=0.002)
        speeds = {float(np.abs(m.velocity).max()) for m in client.heard[JOINT_STATES[0]]}
        assert max(speeds) == pytest.approx(0.6)
        client.say(f"{LEFT}/set_speed_ratio", "std_msgs/Float64", data=1.0)
        until(lambda: served.baxter.arms["left"].speed_ratio == 1.0)
        client.move({"left_s0": 0.0}, 1e-9)
        speeds = {float(np.abs(m.velocity).max()) for m in client.heard[JOINT_STATES[0]]}
        assert max(speeds) == pytest.approx(2.0)

    def test_a_head_that_turned_unread_rests(self, served: RosRobot, client: Client) -> None:
        client.enable()
        pan = {"target": 0.5, "speed_ratio": 1.0}
        client.say("/robot/head/command_head_pan", f"{CORE}/HeadPanCommand", **pan)
        until(lambda: served.baxter.head.pan_rad > 0.499 and not served.baxter.head.is_turning)
        client.now("/robot/head/head_state", f"{CORE}/HeadState")  # a tick at rest
        assert np.abs(client.now(*JOINT_STATES).velocity).max() < 0.1  # it settles without end

    def test_velocities_end_after_the_time_out(self, served: RosRobot, client: Client) -> None:
        client.enable()
        client.say(f"{LEFT}/joint_command_timeout", "std_msgs/Float64", data=0.1)
        until(lambda: served.baxter.arms["left"].timeout_s == 0.1)
        before = client.joints()["left_s0"]
        client.send({"left_s0": 0.5}, mode=2)
        moved = until(lambda: (now := client.joints()["left_s0"]) != before and now)
        assert moved > before
        until(lambda: served.baxter.arms["left"].v[0] == 0.0)
        assert client.joints()["left_s0"] - before == pytest.approx(0.05, abs=0.006)

    def test_what_makes_no_sense_is_ignored_whole_said_and_counted(
        self, served: RosRobot, client: Client
    ) -> None:
        client.enable()
        before = client.joints()
        client.listen(*ROSOUT)
        for _ in range(5):
            client.send({"left_s0": 0.5, "left_s1": math.nan})
        until(lambda: served.diagnostics.counts[f"{LEFT}/joint_command"] == 5)
        assert client.joints() == before
        logs = until(lambda: [m for m in client.heard["/rosout"] if "nan" in m.msg])
        assert (
            logs[0].msg == f"{LEFT}/joint_command from /client: left_s1 = nan is no finite number"
        )
        assert len(logs) == 1

        def is_clipped() -> bool:
            client.send({"left_w2": -9.0})  # it is said once a second
            return any("left_w2 = -9 rad is outside" in m.msg for m in client.heard["/rosout"])

        until(is_clipped)
        assert served.baxter.arms["left"].target[6] == -3.059


class TestGripper:
    """Commands to a hand."""

    def test_it_answers_moves_and_misses(self, client: Client, witness: Witness) -> None:
        client.enable()
        first = client.gripper()
        assert (first.id, first.calibrated, first.ready, first.position) == (131073, 1, 1, 100.0)
        client.command_gripper("configure", '{"holding_force": 50}', 1)
        heard = until(lambda: (now := client.gripper()).command == "configure" and now)
        assert (heard.command_sender, heard.command_sequence) == ("/client", 1)
        assert json.loads(heard.state)["holding_force"] == 50.0
        client.command_gripper("go", '{"position": 0.0}', 2)
        done = until(lambda: (now := client.gripper()).missed == 1 and now)
        assert (done.moving, done.ready, done.gripping, done.position) == (0, 1, 0, 0.0)
        states = client.heard[f"{HAND}/state"]
        assert any(m.moving == 1 and m.ready == 0 for m in states)
        assert EventKind.MISSED in witness.kinds

    def test_calibrating_takes_its_time(self, client: Client) -> None:
        client.enable()
        client.command_gripper("clear_calibration", sequence=1)
        cleared = until(lambda: (now := client.gripper()).calibrated == 0 and now)
        assert cleared.ready == 1
        client.command_gripper("calibrate", sequence=2)
        done = until(lambda: (now := client.gripper()).calibrated == 1 and now)
        assert done.ready == 1
        assert any(m.ready == 0 for m in client.heard[f"{HAND}/state"])

    def test_custom_end_effectors_are_refused(self, served: RosRobot, client: Client) -> None:
        for what, kind in (("properties", "EndEffectorProperties"), ("state", "EndEffectorState")):
            client.say(f"{HAND}/rsdk/set_{what}", f"{CORE}/{kind}", id=7)
            until(lambda what=what: served.diagnostics.counts[f"{HAND}/rsdk/set_{what}"])  # type: ignore[misc]
        assert client.gripper().id == 131073


class TestServices:
    """Inverse kinematics and models."""

    def test_a_block_is_picked_up_and_put_down_elsewhere(
        self, served: RosRobot, client: Client
    ) -> None:
        spawn = "gazebo_msgs/SpawnModel"
        for kind, name, xml, place in (
            ("sdf", "cafe_table", TABLE_SDF, (1.0, 0.0, 0.0)),
            ("urdf", "block", BLOCK_URDF, (0.6725, 0.1265, 0.7825)),
        ):
            x, y, z = place
            response = client.call(
                f"/gazebo/spawn_{kind}_model",
                spawn,
                model_name=name,
                model_xml=xml,
                reference_frame="world",
                initial_pose={"position": {"x": x, "y": y, "z": z}},
            )
            assert response.success, response.status_message
        client.enable()
        client.say(f"{LEFT}/set_speed_ratio", "std_msgs/Float64", data=1.0)
        for x, y, position in ((0.70, 0.15, 0), (0.75, 0.0, 100)):
            above, there = (client.solve(overhead(x, y, z)) for z in (0.0, -0.129))
            for goal in (above, there):
                client.move(goal)
            client.command_gripper("go", json.dumps({"position": position}), 10 + position)
            self._wait_for_grip(client, is_gripping=position == 0)
            client.move(above)
        centre = served.baxter.world.body("block").centre_base
        assert centre == pytest.approx([0.75, 0.0, -0.130], abs=0.003)
        assert served.baxter.world.supports["block"] == ("cafe_table",)
        client.listen(*ROSOUT)
        for name in ("cafe_table", "block"):
            assert client.call(
                "/gazebo/delete_model", "gazebo_msgs/DeleteModel", model_name=name
            ).success
        until(lambda: any("before cafe_table" in m.msg for m in client.heard["/rosout"]))

    def _wait_for_grip(self, client: Client, *, is_gripping: bool) -> None:
        until(lambda: client.gripper().gripping == int(is_gripping))

    def test_the_reason_why_there_is_no_solution_is_on_rosout(self, client: Client) -> None:
        client.listen(*ROSOUT)
        until(lambda: client.node.publishers_of("/rosout"))
        service = "/ExternalTools/right/PositionKinematicsNode/IKService"
        pose = {"pose": {"position": {"x": 3.0}, "orientation": {"w": 1.0}}}
        until(lambda: self._is_said(client, service, pose))

    def _is_said(self, client: Client, service: str, pose: dict[str, Any]) -> bool:
        answer = client.call(service, IK, pose_stamp=[pose])
        assert answer.result_type.tolist() == [0]
        return any("right IK, pose 0: " in m.msg for m in client.heard["/rosout"])

    def test_a_real_baxter_has_no_gazebo(self, robot: Baxter, own_master: str) -> None:
        with (
            RosRobot(World(robot), has_side_effects=False, master_uri=own_master),
            Node("/client", master_uri=own_master) as node,
        ):
            assert not node.wait_for_service("/gazebo/delete_model", 0.05)
            assert node.publishers_of("/robot/sim/started") == ()
            assert node.wait_for_service(
                "/ExternalTools/left/PositionKinematicsNode/IKService", 5.0
            )


class TestPanelAndHead:
    """Lights, buttons, head."""

    def test_lights_echo_and_navigators_show_them(self, client: Client) -> None:
        digital = "/robot/digital_io/left_outer_light/state", f"{CORE}/DigitalIOState"
        assert not client.now(*digital).isInputOnly
        client.say(
            "/robot/digital_io/command",
            f"{CORE}/DigitalOutputCommand",
            name="left_outer_light",
            value=True,
        )
        client.until(*digital, lambda m: m.state == 1)
        shown = client.now("/robot/navigators/left_navigator/state", f"{CORE}/NavigatorState")
        assert dict(zip(shown.light_names, shown.lights.tolist(), strict=True)) == {
            "inner": False,
            "outer": True,
        }
        assert list(shown.button_names) == ["ok", "cancel", "show"]

    def test_buttons_are_pressed_and_come_up_again(self, client: Client) -> None:
        cuff = "/robot/digital_io/right_lower_cuff/state", f"{CORE}/DigitalIOState"
        navigator = "/robot/navigators/right_navigator/state", f"{CORE}/NavigatorState"
        assert client.now(*cuff).isInputOnly
        client.listen(*navigator)
        for button in ("cuff", "show", "wheel"):
            client.say("/robot/sim/press", "std_msgs/String", data=f"right {button}")
        client.until(*cuff, lambda m: m.state == 1)
        client.until(*cuff, lambda m: m.state == 0)
        assert any(m.buttons.tolist() == [False, False, True] for m in client.heard[navigator[0]])
        assert client.now(*navigator).wheel == 1

    def test_analog_outputs_echo(self, served: RosRobot, client: Client) -> None:
        command = "/robot/analog_io/command", f"{CORE}/AnalogOutputCommand"
        client.say(*command, name="torso_fan", value=40)
        fan = "/robot/analog_io/torso_fan/state", f"{CORE}/AnalogIOState"
        client.until(*fan, lambda m: m.value == 40.0)
        client.say(*command, name="left_hand_range", value=1)
        until(lambda: served.diagnostics.counts[command[0]])

    def test_the_head_pans_and_nods(self, client: Client) -> None:
        client.enable()
        head = "/robot/head/head_state", f"{CORE}/HeadState"
        pan = {"target": 0.5, "speed_ratio": 1.0, "enable_pan_request": 1}
        client.say("/robot/head/command_head_pan", f"{CORE}/HeadPanCommand", **pan)
        client.until(*head, lambda m: m.isTurning)
        there = client.until(*head, lambda m: abs(m.pan - 0.5) < 1e-3 and not m.isTurning)
        assert there.isPanEnabled
        names = list(client.now(*JOINT_STATES).name)
        assert client.now(*JOINT_STATES).position[names.index("head_pan")] == pytest.approx(
            0.5, abs=1e-3
        )
        client.say("/robot/head/command_head_nod", "std_msgs/Bool", data=False)
        client.say("/robot/head/command_head_nod", "std_msgs/Bool", data=True)
        client.until(*head, lambda m: m.isNodding)
        client.until(*head, lambda m: not m.isNodding)


class TestEnds:
    """However it ends, nothing of it is left."""

    def test_nothing_is_registered_after_it_is_closed(
        self, served: RosRobot, client: Client
    ) -> None:
        assert not client.state.enabled
        served.close()
        served.close()
        assert client.node.nodes() == ("/client",)
        assert client.node.publishers_of("/robot/state") == ()
        assert not client.node.wait_for_service("/gazebo/delete_model", 0.05)

    def test_a_robot_of_the_same_name_ends_it(self, served: RosRobot) -> None:
        assert served.wait_ended(0.0) is None
        with Node(NAME, master_uri=served.node.master_uri):
            reason = until(lambda: served.wait_ended(0.1))
        assert "registered" in reason

    def test_a_tick_that_breaks_is_told(
        self, served: RosRobot, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(served.baxter, "tick", lambda *_: 1 / 0)
        assert "ZeroDivisionError" in until(lambda: served.wait_ended(0.05))
        assert isinstance(served.failure, ZeroDivisionError)
        served._failure = None

    def test_a_master_that_is_not_there_is_told_and_nothing_is_left(self, robot: Baxter) -> None:
        with pytest.raises(RosError, match="cannot reach the master"):
            RosRobot(World(robot), master_uri="http://127.0.0.1:1")

    def test_others_reach_it_only_when_a_host_is_given(
        self, robot: Baxter, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setenv("ROS_IP", "192.0.2.77")
        with Master(port=0) as master, pytest.raises(RosError, match=r"--host 192\.0\.2\.77"):
            RosRobot(World(robot), master_uri=master.uri)
