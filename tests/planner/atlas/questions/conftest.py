"""A task at a table, and what looks for configurations by itself."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter
from planner import Manipulator, load_object, make_block
from planner.atlas import TableTask, TableTransfer
from planner.atlas.checking.pose_finder import PoseFinder


def on_the_table(x_m: float, y_m: float) -> pin.SE3:
    """The centre of a block of 5 cm on the table, seen from there."""
    return pin.SE3(np.eye(3), np.array([x_m, y_m, 0.80]))


@pytest.fixture(scope="session")
def task(robot: Baxter) -> TableTask:
    """A block goes 30 cm to the robot's right."""
    block = make_block("red", on_the_table(-0.3, 0.15))
    hand = Manipulator.of(robot, "left").hand
    transfer = TableTransfer.from_above(hand, block, on_the_table(-0.3, -0.15))
    return TableTask((transfer,), bodies=(load_object("table", pin.SE3.Identity()), block))


@pytest.fixture(scope="session")
def finders(robot: Baxter) -> dict[str, PoseFinder]:
    """Least squares on Pinocchio's model of the whole robot, for each arm."""
    return {side: PoseFinder(robot, side) for side in robot.arms}
