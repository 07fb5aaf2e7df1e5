"""Bounds in boxes of joint angles, against distances at random places in them."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from baxter_kin.description import RobotDescription
from baxter_kin.validation import FloatArray
from planner import Manipulator, Scene, State
from planner.verification.body.distances import SolidDistances, SolidPair
from planner.verification.body.robot_body import robot_body
from planner.verification.body.solid import solids_of
from planner.verification.body.stretch import PUSH, Stretch
from planner.verification.body.stretches import Stretches
from planner.verification.story import Run
from planner.verification.tracking.box_distances import BoxDistances
from planner.verification.urdf_robot import UrdfRobot
from tests.planner.collision.continuous.test_hull_gaps import plate_behind_the_hand

FAR_M = 0.2
PLACES = 25
OPEN_M = 0.02


@pytest.fixture(scope="module")
def urdf_robot() -> UrdfRobot:
    return UrdfRobot(RobotDescription.installed(), "left")


@pytest.fixture(scope="module")
def standing(urdf_robot: UrdfRobot, manipulator: Manipulator, scene: Scene) -> FloatArray:
    return urdf_robot.standing(State.of(manipulator, scene).joints)


@pytest.fixture(scope="module")
def pairs(
    urdf_robot: UrdfRobot, standing: FloatArray, manipulator: Manipulator, scene: Scene
) -> list[SolidPair]:
    solids = robot_body(RobotDescription.installed()).solids
    stretches = Stretches(urdf_robot, solids, standing, (), ())
    run = Run(manipulator.arm.start, (), scene, OPEN_M)
    return stretches.pairs_of_run(run, stretches.of_rest(scene))


@pytest.mark.parametrize("wide_rad", [0.005, 0.03, 0.1])
def test_no_place_in_a_box_is_nearer_than_its_bound(
    urdf_robot: UrdfRobot,
    standing: FloatArray,
    pairs: list[SolidPair],
    manipulator: Manipulator,
    wide_rad: float,
) -> None:
    rng, boxes = np.random.default_rng(2), BoxDistances(urdf_robot, pairs, standing, OPEN_M)
    everything, is_near = np.arange(len(pairs)), False
    for _ in range(4):
        middle = manipulator.arm.start + rng.uniform(-0.25, 0.25, 7)
        w = rng.uniform(0.0, wide_rad, 7)
        (bounds,) = boxes.least((middle - w)[None], (middle + w)[None], [everything], FAR_M)
        corners = rng.choice([-1.0, 1.0], (PLACES, 7)) * rng.choice([1.0, 1.0, 0.5], (PLACES, 1))
        full = urdf_robot.configurations(standing, middle + w * corners, OPEN_M)
        still = np.zeros(PLACES)
        stretch = Stretch(full, np.zeros((PLACES, PUSH + 1)), still, still, ())
        distances = SolidDistances(urdf_robot, stretch, pairs)
        near = np.flatnonzero(bounds < FAR_M)
        is_near |= len(near) > 0
        for pair in near.tolist():
            for place in range(PLACES):
                assert distances.shapes_apart(pair, place) >= bounds[pair], str(pairs[pair])
    assert is_near


@pytest.mark.parametrize("joints", [(0,), (1,), (0, 1), (0, 3), (1, 3), (0, 1, 3, 5)])
def test_turns_curve_towards_what_is_nearer_to_their_axes(
    urdf_robot: UrdfRobot,
    standing: FloatArray,
    manipulator: Manipulator,
    joints: tuple[int, ...],
) -> None:
    """A plate across the way to the shoulder: to first order a turn leads along it."""
    plate = plate_behind_the_hand(manipulator)
    solids = robot_body(RobotDescription.installed()).solids
    hand = next(solid for solid in solids if solid.name == "left_hand_link")
    (still,) = solids_of(plate, 0, plate.T_base_body)
    boxes = BoxDistances(urdf_robot, [SolidPair(hand, still)], standing, OPEN_M)
    q, w = manipulator.arm.neutral, np.zeros(7)
    w[list(joints)] = 0.15
    (bounds,) = boxes.least((q - w)[None], (q + w)[None], [np.arange(1)], 1.0)
    turns = np.array(list(product((-1.0, 0.0, 1.0), repeat=7)))
    turns = np.unique(turns * w, axis=0)
    places = boxes.least(q + turns, q + turns, [np.arange(1)] * len(turns), 1.0)
    least = min(float(each[0]) for each in places)
    assert bounds[0] <= least + 1e-5
    assert bounds[0] >= least - 0.1


def test_a_box_of_no_width_has_the_distances_themselves(
    urdf_robot: UrdfRobot, standing: FloatArray, pairs: list[SolidPair], manipulator: Manipulator
) -> None:
    boxes, q = BoxDistances(urdf_robot, pairs, standing, OPEN_M), manipulator.arm.start
    (bounds,) = boxes.least(q[None], q[None], [np.arange(len(pairs))], FAR_M)
    full = urdf_robot.configurations(standing, q[None], OPEN_M)
    one = np.zeros(1)
    distances = SolidDistances(
        urdf_robot, Stretch(full, np.zeros((1, PUSH + 1)), one, one, ()), pairs
    )
    true = [distances.shapes_apart(pair, 0) for pair in range(len(pairs))]
    assert bounds.min() == pytest.approx(min(true), abs=1e-3)
    for pair in np.flatnonzero(bounds < FAR_M).tolist():
        (alone,) = boxes.least(q[None], q[None], [np.array([pair])], FAR_M)
        assert alone[0] == pytest.approx(true[pair], abs=1e-3) or min(alone[0], true[pair]) >= FAR_M


def test_tips_are_where_they_may_be(
    urdf_robot: UrdfRobot, standing: FloatArray, manipulator: Manipulator
) -> None:
    rng, boxes = np.random.default_rng(4), BoxDistances(urdf_robot, [], standing, OPEN_M)
    for _ in range(20):
        middle, w = manipulator.arm.start + rng.uniform(-0.3, 0.3, 7), rng.uniform(0.0, 0.03, 7)
        goal = manipulator.arm.T_base_tip(middle + rng.uniform(-0.02, 0.02, 7)).translation[None]
        (bound,) = boxes.tips_off((middle - w)[None], (middle + w)[None], goal)
        corners = middle + w * rng.choice([-1.0, 1.0], (200, 7))
        tips = np.array([manipulator.arm.T_base_tip(q).translation for q in corners])
        found = np.linalg.norm(tips - goal, axis=1)
        assert found.max() <= bound
        assert bound <= 1.5 * found.max() + 0.002
