"""The robot at one moment: arms and fingers are where they were put."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Baxter, BaxterError
from baxter_kin.errors import ConfigurationError, UnknownNameError
from sim import SimulationError, World

seeds = st.integers(0, 2**32 - 1)


class TestRobot:
    """Arms and fingers."""

    def test_a_new_world_has_neutral_arms_and_open_hands(self, robot: Baxter) -> None:
        world = World(robot)
        for side, arm in robot.arms.items():
            assert world.arm_q(side).tolist() == arm.neutral.tolist()
            assert world.finger_m(side) == world.hands[side].stroke_m

    @given(seeds)
    def test_an_arm_is_where_it_was_put_and_so_is_its_tip(self, shared: World, seed: int) -> None:
        rng = np.random.default_rng(seed)
        for side, arm in shared.robot.arms.items():
            q = arm.random_configuration(rng)
            shared.move_arm(side, q)
            assert shared.arm_q(side).tolist() == q.tolist()
            assert shared.T_base_tip(side) == arm.T_base_tip(q)

    def test_the_head_and_an_arm_move_alone(self, robot: Baxter) -> None:
        world = World(robot)
        before = world.q
        world.turn_head(-0.7)
        (turned,) = np.flatnonzero(world.q != before)
        assert (robot.joint_names[turned], world.q[turned]) == ("head_pan", -0.7)
        before = world.q
        world.move_arm("left", robot.arm("left").start)
        moved = np.flatnonzero(world.q != before)
        assert {robot.joint_names[i] for i in moved} == set(robot.arm("left").joint_names)
        with pytest.raises(SimulationError, match="pan_rad"):
            world.turn_head(float("nan"))

    @pytest.mark.parametrize("side", ["left", "right"])
    def test_the_fingers_of_a_hand_move_in_mirror_image(self, robot: Baxter, side: str) -> None:
        world = World(robot)
        world.set_fingers(side, 0.01)
        joints = dict(zip(robot.joint_names, world.q.tolist(), strict=True))
        assert joints[f"{side[0]}_gripper_l_finger_joint"] == 0.01
        assert joints[f"{side[0]}_gripper_r_finger_joint"] == -0.01
        assert world.finger_m(side) == 0.01

    def test_invalid_positions_are_refused_and_nothing_moves(self, world: World) -> None:
        before = world.q.tolist()
        wrong: Any
        for wrong in (-1e-6, 0.0209, np.nan, np.inf, None, "open", True, [0.0]):
            with pytest.raises(SimulationError, match="finger position"):
                world.set_fingers("left", wrong)
        for wrong in (None, "q", [], [0.0] * 6, [np.nan] * 7, [9.0] * 7):
            with pytest.raises(ConfigurationError, match="q"):
                world.move_arm("left", wrong)
        assert world.q.tolist() == before

    def test_an_unknown_side_or_no_robot_is_refused(self, world: World) -> None:
        wrong: Any
        for wrong in ("middle", "", None, 5, ["left"], np.zeros(2)):
            for use in (
                world.arm_q,
                world.T_base_tip,
                world.finger_m,
                world.holding,
                world.detach,
                lambda side: world.move_arm(side, np.zeros(7)),
                lambda side: world.set_fingers(side, 0.0),
            ):
                with pytest.raises(UnknownNameError, match="left, right"):
                    use(wrong)
        for wrong in (None, "baxter", 5):
            with pytest.raises(SimulationError, match="robot"):
                World(wrong)
        assert issubclass(SimulationError, BaxterError)
