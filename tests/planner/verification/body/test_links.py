"""Pairs of links that a certificate leaves out never touch."""

from __future__ import annotations

from itertools import combinations, product

import coal
import numpy as np
import pinocchio as pin
import pytest

from baxter_kin.description import ElectricGripper, RobotDescription
from baxter_kin.validation import FloatArray
from planner.verification.body import links
from planner.verification.body.robot_body import SolidBody, robot_body
from planner.verification.body.solid import Solid, distance_request
from planner.verification.urdf_robot import read_model

FILES = RobotDescription.installed()


@pytest.fixture(scope="module")
def body() -> SolidBody:
    return robot_body(FILES)


def configurations(count: int) -> list[FloatArray]:
    """Random, each joint one time in four at an end of its range."""
    rng, model = np.random.default_rng(5), read_model(FILES)
    low, high = model.lowerPositionLimit, model.upperPositionLimit
    found = []
    for _ in range(count):
        q = rng.uniform(low, high)
        ends = np.where(rng.random(model.nq) < 0.5, low, high)
        found.append(np.where(rng.random(model.nq) < 0.25, ends, q))
    return found


def distance(first: Solid, second: Solid, data: pin.Data) -> float:
    poses = [data.oMi[solid.joint] * solid.T_joint_shape for solid in (first, second)]
    placed = [coal.Transform3s(T.rotation, T.translation) for T in poses]
    request, result = distance_request(), coal.DistanceResult()
    return float(coal.distance(first.shape, placed[0], second.shape, placed[1], request, result))


def joints_between(model: pin.Model, first: int, second: int) -> int:
    """How many joints move one joint's links relative to another's."""
    return len(set(model.supports[first]) ^ set(model.supports[second]))


@pytest.mark.parametrize("tips", ["paddle", "half_round"])
def test_links_two_joints_apart_that_are_left_out_never_touch(tips: str) -> None:
    """On the left side, with what either side is drawn with."""
    description = RobotDescription.of(hands={"left": ElectricGripper(tips=tips)})
    model, body = read_model(description), robot_body(description)
    data = model.createData()
    among = [
        (first, second)
        for first, second in combinations(body.solids, 2)
        if joints_between(model, first.joint, second.joint) == links.MOUNTED
        and "right" not in first.name + second.name
    ]
    least: dict[tuple[str, str], float] = {}
    for q in configurations(30):
        pin.forwardKinematics(model, data, q)
        for first, second in among:
            names = (first.name, second.name)
            least[names] = min(least.get(names, 1.0), distance(first, second, data))
    assert least
    assert min(least.values()) > 5e-4, min(least.items(), key=lambda item: item[1])


@pytest.mark.parametrize(
    ("names", "joints", "least_m"),
    [
        (("left_upper_elbow", "left_upper_forearm"), ("left_e1", "left_w0"), 1.5e-3),
        (("left_upper_shoulder", "left_upper_elbow"), ("left_s1", "left_e0"), 3.5e-3),
    ],
)
def test_the_nearest_links_two_joints_apart_never_touch_at_any_two_angles(
    body: SolidBody, names: tuple[str, str], joints: tuple[str, str], least_m: float
) -> None:
    """Nearest where the first joint ends."""
    model = read_model(FILES)
    first, second = (next(s for s in body.solids if s.name == name) for name in names)
    data, q = model.createData(), pin.neutral(model)
    bends, turns = (model.joints[model.getJointId(name)].idx_q for name in joints)
    low, high = model.lowerPositionLimit, model.upperPositionLimit
    ends = np.linspace(low[bends], high[bends], 9)
    found = []
    grid = product([*ends, high[bends] - 0.01, low[bends] + 0.01], np.linspace(0.0, 1.0, 61))
    for bend, share in grid:
        q[bends], q[turns] = bend, low[turns] + (high[turns] - low[turns]) * share
        pin.forwardKinematics(model, data, q)
        found.append(distance(first, second, data))
    assert least_m < min(found) < 1.2 * least_m
    assert found.index(min(found)) // 61 == 8
