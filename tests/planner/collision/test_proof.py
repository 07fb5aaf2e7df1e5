"""Proofs by rows compared with dense sampling by coal, and contacts that sampling misses."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from baxter_kin import Arm, Baxter
from baxter_kin.errors import ConfigurationError
from baxter_kin.fields import evolve
from planner import Body, Box, Part, RobotBody, RobotShapes, Scene, Trajectory, plan_joint_move
from planner.clearance import ContinuousContact, ContinuousProof, ContinuousResult
from planner.collision import ClearanceChecker, proof
from planner.collision.distances import ACCURACY_M
from planner.collision.proof import prove_clear
from planner.errors import MotionError, SceneError, TrajectoryError
from planner.prover.problem import SHARES
from planner.scene.bodies import Attachment, Shape
from planner.scene.contact import PRESSING_TOLERANCE_M
from tests.bodies import CORNERS, SIDES
from tests.conftest import at
from tests.planner.conftest import mesh_of

FloatArray = NDArray[np.float64]

ORIGIN = at(0.0, 0.0, 0.0)
SLAB = Box((0.06, 0.06, 0.01))

SAME_DISTANCE_M = 2e-6
"""Difference of two runs of GJK on one pair; its tolerance is 1e-6."""

BODY_M = 2e-3
"""Coal's shapes contain Rethink's meshes, and its distances are up to this much less: twice half a
millimetre for each of two links."""

ROUNDING_M = 1e-6

INSIDE_AN_ELBOW = (0.2225, 0.4115, 0.5020)
"""A point in base, 68 mm from all corners of the upper elbow's triangles at neutral."""

SAMPLES = 40
seeds = st.integers(0, 2**32 - 1)


class Stage:
    """One arm of the robot among some bodies."""

    def __init__(self, robot: Baxter, arm: Arm, shapes: RobotShapes, *bodies: Body) -> None:
        self.robot, self.arm = robot, arm
        self.checker = ClearanceChecker(shapes, arm, Scene.of(bodies))

    def full(self, q: FloatArray, finger_m: float = 0.0) -> FloatArray:
        letter = self.arm.side[0]
        fingers = {
            f"{letter}_gripper_l_finger_joint": finger_m,
            f"{letter}_gripper_r_finger_joint": -finger_m,
        }
        return self.robot.configuration(self.arm.joints(q) | fingers)

    def prove(
        self, motion: Trajectory, margin_m: float = 0.0, finger_m: float = 0.0
    ) -> ContinuousResult:
        q = self.full(np.zeros(7), finger_m)
        return prove_clear(self.checker, motion, q, margin_m=margin_m)

    def sampled(self, motion: Trajectory, times: Any, finger_m: float = 0.0) -> list[float]:
        full = (self.full(q, finger_m) for q in motion.sample(times).q)
        return [self.checker.clearance(q).distance_m for q in full]

    def distance(self, motion: Trajectory, time_s: float) -> float:
        return self.sampled(motion, [time_s])[0]


@pytest.fixture(scope="module")
def shapes(robot: Baxter) -> RobotShapes:
    return RobotShapes(robot)


@pytest.fixture(scope="module")
def free(robot: Baxter, left: Arm, shapes: RobotShapes) -> Stage:
    return Stage(robot, left, shapes)


@pytest.fixture
def swing(left: Arm) -> Trajectory:
    """The outstretched arm swings sideways and flicks its wrist, faster than 2 m/s."""
    q_start, q_goal = (
        [s0, -0.3, 0.0, 0.0, 1.57, w1, 1.57] for s0, w1 in [(-0.6, -1.5), (1.6, 1.9)]
    )
    return plan_joint_move(q_start, q_goal, left.limits)


def plate_at(T_base_tip: pin.SE3) -> Body:
    """A plate of 100 x 60 x 2 mm across the path of the finger tips."""
    T_base_plate = T_base_tip * at(0.0, 0.0, 0.02)
    return Body("plate", (Part(Box((0.1, 0.002, 0.06)), ORIGIN),), T_base_plate)


def random_bodies(rng: np.random.Generator, T_base_tip: pin.SE3) -> list[Body]:
    bodies = []
    for number in range(rng.integers(0, 4)):
        quat = rng.normal(size=4)
        R = pin.Quaternion(*(quat / np.linalg.norm(quat))).matrix()
        x, y, z = rng.uniform(0.002, 0.3, size=3).tolist()
        pose = pin.SE3(R, T_base_tip.translation + 0.3 * rng.normal(size=3))
        bodies.append(Body(f"box {number}", (Part(Box((x, y, z)), ORIGIN),), pose))
    return bodies


def random_stage(
    robot: Baxter, arm: Arm, shapes: RobotShapes, seed: int
) -> tuple[Stage, Trajectory, float]:
    """Boxes around a random move, and a margin."""
    rng = np.random.default_rng(seed)
    q_start = rng.uniform(0.7 * arm.limits.q_min, 0.7 * arm.limits.q_max)
    step = rng.normal(size=7) * rng.choice([0.03, 0.1, 0.4])
    q_goal = np.clip(q_start + step, arm.limits.q_min, arm.limits.q_max)
    bodies = random_bodies(rng, arm.T_base_tip(q_start))
    motion = plan_joint_move(q_start, q_goal, arm.limits)
    return Stage(robot, arm, shapes, *bodies), motion, float(rng.choice([0.0, 0.005]))


@settings(max_examples=15)
@given(seed=seeds)
@example(seed=38)  # several shapes deep in one box, whose bounds are all below zero
@example(seed=511)  # nothing at the end is nearer than what was found at the start
def test_no_sample_comes_closer_than_proven_and_reported_contacts_exist(
    robot: Baxter, left: Arm, shapes: RobotShapes, seed: int
) -> None:
    stage, motion, margin_m = random_stage(robot, left, shapes, seed)
    result = stage.prove(motion, margin_m)
    if isinstance(result, ContinuousProof):
        samples = stage.sampled(motion, np.linspace(0.0, motion.duration, SAMPLES))
        assert margin_m < result.proven_m <= min(samples) + BODY_M
        least_m = result.nearest.distance_m
        assert max(SHARES[0] * least_m, margin_m) - ROUNDING_M <= result.proven_m <= least_m
    elif result.is_found:
        distance_m = stage.distance(motion, result.nearest.time_s or 0.0)
        assert distance_m <= margin_m
        assert distance_m == pytest.approx(result.nearest.distance_m, abs=SAME_DISTANCE_M)


def test_the_proof_finds_a_thin_plate_between_samples(
    robot: Baxter, left: Arm, shapes: RobotShapes, swing: Trajectory
) -> None:
    stage = Stage(robot, left, shapes, plate_at(left.T_base_tip(swing.sample(1.33).q)))
    every_10_ms = np.arange(0.0, swing.duration, 0.01)
    assert min(stage.sampled(swing, every_10_ms, finger_m=0.0175)) > 0.001
    result = stage.prove(swing, finger_m=0.0175)
    assert isinstance(result, ContinuousContact)
    assert result.is_found
    assert {result.nearest.first, result.nearest.second} & {"plate"}
    assert result.nearest.time_s == pytest.approx(1.33, abs=0.03)
    assert stage.sampled(swing, [result.nearest.time_s], finger_m=0.0175)[0] <= 0.0


def test_a_margin_is_kept_or_a_contact_is_found(free: Stage, swing: Trajectory) -> None:
    clear = free.prove(swing, finger_m=0.0175)
    assert isinstance(clear, ContinuousProof)
    assert 0 < clear.evaluations <= clear.intervals
    margin_m = 0.999 * clear.nearest.distance_m
    kept = free.prove(swing, margin_m, finger_m=0.0175)
    assert isinstance(kept, ContinuousProof)
    assert kept.proven_m > margin_m
    margin_m = clear.nearest.distance_m + 0.001
    contact = free.prove(swing, margin_m, finger_m=0.0175)
    assert isinstance(contact, ContinuousContact)
    assert contact.needed_m == margin_m
    assert contact.is_found


def test_a_motion_without_duration_is_proven(free: Stage, left: Arm) -> None:
    result = free.prove(Trajectory.stay(left.neutral, left.limits))
    assert isinstance(result, ContinuousProof)
    least_m = free.checker.clearance(free.full(left.neutral)).distance_m
    assert least_m - ACCURACY_M <= result.nearest.distance_m <= least_m + BODY_M
    assert SHARES[0] * result.nearest.distance_m - ROUNDING_M <= result.proven_m


def test_a_tiny_move_is_proven(free: Stage, left: Arm) -> None:
    motion = plan_joint_move(left.neutral, left.neutral + 1e-9, left.limits)
    assert free.prove(motion).is_clear


@pytest.mark.parametrize(("end", "fraction"), [("q_start", 0.0), ("q_goal", 1.0)])
def test_an_end_in_collision_is_found_at_its_time(
    free: Stage, shapes: RobotShapes, swing: Trajectory, end: str, fraction: float
) -> None:
    place = free.arm.T_base_tip(getattr(swing, end))
    wall = Body("wall", (Part(Box((0.02, 0.02, 0.02)), ORIGIN),), place)
    result = Stage(free.robot, free.arm, shapes, wall).prove(swing)
    assert isinstance(result, ContinuousContact)
    assert result.fraction == fraction


def test_a_thicker_body_is_nearer(robot: Baxter, left: Arm, swing: Trajectory) -> None:
    near = []
    for padding_m in (0.0, 0.004):
        stage = Stage(robot, left, RobotShapes(robot, RobotBody.load().padded(padding_m)))
        result = stage.prove(swing)
        assert isinstance(result, ContinuousProof)
        near.append(result.nearest.distance_m)
    assert near[0] - near[1] == pytest.approx(0.008, abs=1e-6)  # two links, each thicker


def test_another_body_is_proven_by_its_own_triangles(
    robot: Baxter, left: Arm, shapes: RobotShapes, swing: Trajectory
) -> None:
    """The stored body under another name: its triangles are within its margin of the meshes."""
    stored = RobotBody.load()
    links = {
        name: evolve(link, surface=link.surface._replace()) for name, link in stored.links.items()
    }
    other = Stage(robot, left, RobotShapes(robot, RobotBody(links, stored.skipped_pairs)))
    results = [stage.prove(swing) for stage in (Stage(robot, left, shapes), other)]
    of_meshes, of_triangles = (result.nearest.distance_m for result in results)
    assert of_meshes - BODY_M <= of_triangles <= of_meshes + ROUNDING_M


def test_a_body_inside_a_link_is_found_where_nothing_touches(
    robot: Baxter, left: Arm, shapes: RobotShapes
) -> None:
    motion = plan_joint_move(left.neutral, left.neutral + 0.01, left.limits)
    crumb = Body("crumb", (Part(Box((0.002, 0.002, 0.002)), ORIGIN),), at(*INSIDE_AN_ELBOW))
    result = Stage(robot, left, shapes, crumb).prove(motion)
    assert isinstance(result, ContinuousContact)
    assert {result.nearest.first, result.nearest.second} & {"crumb"}


@pytest.mark.parametrize(
    "depth_m", [0.0, pytest.param(1.2 * PRESSING_TOLERANCE_M, marks=pytest.mark.slow)]
)
def test_numpy_finds_the_same_without_a_compiler(
    carry: Carry, depth_m: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    fast = carry.prove(-0.2, depth_m)
    monkeypatch.setattr(proof, "rows_kernel", lambda: None)
    slow = carry.prove(-0.2, depth_m)
    assert fast.is_clear == slow.is_clear
    if isinstance(fast, ContinuousProof) and isinstance(slow, ContinuousProof):
        assert slow.proven_m == pytest.approx(fast.proven_m, rel=0.15)


class Carry:
    """A cube in the hand at neutral, on a support that it may or must not touch."""

    def __init__(self, robot: Baxter, left: Arm, shapes: RobotShapes) -> None:
        self._left, self._shapes, self._q = left, shapes, robot.configuration()

    def prove(
        self,
        bend_rad: float,
        depth_m: float = 0.0,
        *,
        allowed: bool = True,
        margin_m: float = 0.0,
        shape: Shape = SLAB,
    ) -> ContinuousResult:
        """The result for a bending shoulder; positive angles lower the cube."""
        left, T_base_tip = self._left, self._left.T_base_tip(self._left.neutral)
        under = T_base_tip.translation - [0.0, 0.0, 0.025 + 0.005 - depth_m]
        support = Body("support", (Part(shape, ORIGIN),), at(*under))
        cube = Body("cube", (Part(Box((0.05, 0.05, 0.05)), ORIGIN),), at(*T_base_tip.translation))
        held = Attachment("cube", "left_gripper", T_base_tip.inverse() * cube.T_base_body)
        checker = ClearanceChecker(
            self._shapes,
            left,
            Scene.of([support, cube]),
            held=held,
            supports=["support"] if allowed else [],
            touchable="support",
        )
        goal = left.neutral + bend_rad * np.eye(7)[1]
        motion = plan_joint_move(left.neutral, goal, left.limits)
        return prove_clear(checker, motion, self._q, margin_m=margin_m)


@pytest.fixture(scope="module")
def carry(robot: Baxter, left: Arm, shapes: RobotShapes) -> Carry:
    return Carry(robot, left, shapes)


@pytest.mark.parametrize("depth_m", [0.0, 0.5 * PRESSING_TOLERANCE_M])
def test_an_intended_contact_may_press_a_little(carry: Carry, depth_m: float) -> None:
    assert carry.prove(-0.2, depth_m, margin_m=0.002).is_clear  # a contact keeps no margin


def test_an_intended_contact_that_presses_too_deep_is_found(carry: Carry) -> None:
    result = carry.prove(-0.2, 1.2 * PRESSING_TOLERANCE_M)
    assert isinstance(result, ContinuousContact)
    assert result.needed_m == -PRESSING_TOLERANCE_M
    assert result.nearest.distance_m == pytest.approx(-1.2 * PRESSING_TOLERANCE_M, abs=ACCURACY_M)
    result = carry.prove(0.01)
    assert isinstance(result, ContinuousContact)
    assert result.fraction > 0.0


def test_the_same_contact_is_found_when_it_is_not_intended(carry: Carry) -> None:
    result = carry.prove(-0.2, 1e-5, allowed=False)
    assert isinstance(result, ContinuousContact)
    assert {result.nearest.first, result.nearest.second} == {"cube", "support"}


def sheet_at(T_base_tip: pin.SE3) -> Body:
    """A single triangle across the path of the finger tips."""
    sheet = mesh_of([[-0.05, 0.0, -0.01], [0.05, 0.0, -0.01], [0.0, 0.0, 0.05]], [[0, 1, 2]])
    return Body("sheet", (Part(sheet, ORIGIN),), T_base_tip)


def test_a_mesh_without_any_thickness_is_found(
    robot: Baxter, left: Arm, shapes: RobotShapes, swing: Trajectory
) -> None:
    sheet = sheet_at(left.T_base_tip(swing.sample(1.33).q))
    result = Stage(robot, left, shapes, sheet).prove(swing, finger_m=0.0175)
    assert isinstance(result, ContinuousContact)
    assert {result.nearest.first, result.nearest.second} & {"sheet"}


@pytest.mark.parametrize("triangles", [SIDES, SIDES[1:]])
def test_a_body_in_the_hand_is_proven_to_lift_off_a_mesh(carry: Carry, triangles: Any) -> None:
    assert carry.prove(-0.2, shape=mesh_of(CORNERS * [0.03, 0.03, 0.005], triangles)).is_clear
    assert not carry.prove(0.01, shape=mesh_of(CORNERS * [0.03, 0.03, 0.005], triangles)).is_clear


def test_the_arm_in_the_full_configuration_is_not_used(
    robot: Baxter, left: Arm, shapes: RobotShapes, swing: Trajectory
) -> None:
    results = []
    for q in (np.zeros(7), np.full(7, 0.5)):
        stage = Stage(robot, left, shapes)  # one that has measured before need not measure as much
        results.append(prove_clear(stage.checker, swing, stage.full(q)))
    assert results[0] == results[1]


def test_refuses_invalid_arguments(free: Stage, swing: Trajectory, robot: Baxter) -> None:
    right = robot.arm("right")
    asked: list[tuple[str, Any, type[Exception]]] = [
        *(("margin_m", x, MotionError) for x in (-1e-9, np.nan, np.inf, "wide", None, True)),
        *(("q", x, ConfigurationError) for x in (np.zeros(7), np.full(19, np.nan), None, "q")),
        ("q", np.full(19, 1e9), ConfigurationError),
        ("checker", None, SceneError),
        ("trajectory", None, TrajectoryError),
        ("trajectory", Trajectory.stay(right.neutral, right.limits), TrajectoryError),
        ("trajectory", Trajectory.stay(np.full(7, 1e9), swing.limits), TrajectoryError),
    ]
    for name, given_, error in asked:
        arguments: dict[str, Any] = {
            "checker": free.checker,
            "trajectory": swing,
            "q": free.full(np.zeros(7)),
        }
        with pytest.raises(error):
            prove_clear(**{**arguments, name: given_})
