"""Identification: an arm's lag, found by moving it a little."""

from __future__ import annotations

import numpy as np
import pytest

from baxter_kin import Baxter
from planner import Plan
from sim.errors import RosError, SimulationError
from sim.ros1.execution import identification
from sim.ros1.execution.identification import STEP_RAD, Identification, lines_of
from tests.sim.ros1.execution.conftest import Network, networked

LAG_S = 0.25
OFF_S = 0.05
"""The robot ticks at 100 Hz, and so do its states."""


def wait_for_arm(network: Network) -> None:
    names = [f"left_{joint}" for joint in ("s0", "w2")]
    assert network.link.wait_until(lambda: not network.link.joints.missing(names), 2.0)


def test_the_lag_of_every_joint_is_found(
    robot: Baxter, demo_plan: Plan, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", "sim.ros1.execution.identification")
    with networked(robot, demo_plan, lag_s=LAG_S) as network:
        wait_for_arm(network)
        before = dict(network.robot.q)
        found = Identification(network.link, "left")
        assert f"{STEP_RAD:g} rad" in found.warning
        assert "(s0, s1, e0, e1, w0, w1, w2)" in found.warning
        assert network.robot.commands == []
        response = found.run()
        assert (response.lag_s[:, 0] <= LAG_S + OFF_S).all()
        assert (response.lag_s[:, 1] >= LAG_S - OFF_S).all()
        assert np.ptp(response.lag_s, axis=1).max() < 0.2
        moved = {name for _, asked in network.robot.commands for name in asked}
        assert moved == {f"left_{j}" for j in ("s0", "s1", "e0", "e1", "w0", "w1", "w2")}
        assert all(abs(network.robot.q[name] - q) < 0.01 for name, q in before.items())
        assert any("lag" in line for line in lines_of(response))
        progress = [record.getMessage() for record in caplog.records]
        assert progress[0] == "moving s0, joint 1 of 7"
        assert progress[6] == "moving w2, joint 7 of 7"
        assert len(progress) == 8


def test_a_robot_that_does_not_describe_itself_is_not_moved(network: Network) -> None:
    network.bus.parameters["/robot_description"] = None
    with pytest.raises(RosError, match="/robot_description"):
        Identification(network.link, "left")


def test_an_arm_between_its_limits_cannot_be_identified(
    network: Network, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(identification, "STEP_RAD", 5.0)
    wait_for_arm(network)
    with pytest.raises(SimulationError, match="s0 cannot move by 5 rad either way"):
        Identification(network.link, "left")
