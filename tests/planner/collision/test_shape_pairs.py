"""Pairs of shapes: which are checked in a situation, and which of them may touch."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

from baxter_kin import Arm, Baxter
from planner import Body, Box, Manipulator, Part, RobotShapes, Scene, Sphere
from planner.collision import ClearanceChecker
from planner.collision.robot.robot_body import RobotBody
from planner.collision.shape_pairs import CheckedPairs, ShapePairsBuilder
from planner.scene.bodies import Attachment
from planner.scene.contact import PRESSING_TOLERANCE_M
from tests.conftest import at
from tests.planner.collision.conftest import ORIGIN, ball, full

DISTANCE_TOLERANCE_M = 2e-6
"""Difference of two runs of GJK on one pair; its default tolerance is 1e-6."""

Z = np.array([0.0, 0.0, 1.0])

MARGIN_M = 0.01

FloatArray = NDArray[np.float64]


class TestAllowedContacts:
    """Fingers and the body they grasp; a held body and its support."""

    @pytest.fixture
    def shapes(self, robot: Baxter, plain: RobotBody) -> RobotShapes:
        """Fingers with boxes as pads."""
        return RobotShapes(robot, plain)

    @pytest.fixture
    def manipulator(self, robot: Baxter, plain: RobotBody) -> Manipulator:
        """Fingers with boxes as pads."""
        return Manipulator.of(robot, "left", body=plain)

    @pytest.fixture
    def q(self, robot: Baxter, left: Arm) -> FloatArray:
        return full(robot, left, left.neutral)

    def at_left_pad(self, manipulator: Manipulator, left: Arm, depth_m: float) -> Body:
        """A ball between the fingers, at some depth in the +y pad."""
        radius = 0.01
        inner_face = manipulator.hand.closed_gap_m / 2 + 0.02
        point_tip = np.array([0.0, inner_face - radius + depth_m, -0.015])
        x, y, z = left.T_base_tip(left.neutral).act(point_tip)
        return ball("ball", x, y, z, radius)

    def test_the_fingers_may_touch_the_touchable_body(
        self, manipulator: Manipulator, left: Arm, shapes: RobotShapes, q: FloatArray
    ) -> None:
        touching = Scene.of([self.at_left_pad(manipulator, left, 0.0)])
        counted = ClearanceChecker(shapes, left, touching).clearance(q)
        allowed = ClearanceChecker(shapes, left, touching, touchable="ball").clearance(q)
        assert counted.distance_m == pytest.approx(0.0, abs=DISTANCE_TOLERANCE_M)
        assert allowed.distance_m > 0.01

    def test_the_fingers_must_not_press_into_it(
        self, manipulator: Manipulator, left: Arm, shapes: RobotShapes, q: FloatArray
    ) -> None:
        for depth, is_allowed in (
            (0.8 * PRESSING_TOLERANCE_M, True),
            (1.2 * PRESSING_TOLERANCE_M, False),
        ):
            pressed = Scene.of([self.at_left_pad(manipulator, left, depth)])
            found = ClearanceChecker(shapes, left, pressed, touchable="ball").clearance(q)
            assert (found.distance_m > 0.0) is is_allowed

    def test_the_fingers_must_not_touch_other_bodies(
        self, manipulator: Manipulator, left: Arm, shapes: RobotShapes, q: FloatArray
    ) -> None:
        ball_body = self.at_left_pad(manipulator, left, 1e-4)
        scene = Scene.of([ball_body, ball("target", 5, 5, 5)])
        found = ClearanceChecker(shapes, left, scene, touchable="target").clearance(q)
        assert found.distance_m < 0.0

    def test_the_rest_of_the_arm_must_not_touch_the_touchable_body(
        self, robot: Baxter, left: Arm, shapes: RobotShapes, q: FloatArray
    ) -> None:
        data = robot.model.createData()
        pin.framesForwardKinematics(robot.model, data, q)
        elbow = data.oMf[robot.model.getFrameId("left_lower_elbow")].translation
        scene = Scene.of([ball("ball", *elbow)])
        found = ClearanceChecker(shapes, left, scene, touchable="ball").clearance(q)
        assert found.distance_m < 0.0

    def test_a_held_body_is_not_checked_against_the_hand(
        self, block: Body, left: Arm, shapes: RobotShapes, q: FloatArray
    ) -> None:
        held = Attachment("block", "left_gripper", at(-0.025, -0.025, -0.025))
        found = ClearanceChecker(shapes, left, Scene.of([block]), held=held).clearance(q)
        assert found.distance_m > 0.01

    def test_a_held_body_must_not_touch_other_bodies(
        self, manipulator: Manipulator, block: Body
    ) -> None:
        left, robot = manipulator.arm, manipulator.robot
        held = Attachment("block", "left_gripper", at(-0.025, -0.025, -0.025))
        T_base_tip = left.T_base_tip(left.neutral)
        low = block.at(T_base_tip * held.T_link_body).extent_m(Z)[0]
        x, y, _ = T_base_tip.translation
        shelf = Body("shelf", (Part(Box((0.1, 0.1, 0.02)), ORIGIN),), at(x, y, low - 0.001 - 0.01))
        scene = Scene.of([shelf, block])
        checker = ClearanceChecker(manipulator.shapes, left, scene, held=held, supports=["table"])
        found = checker.clearance(full(robot, left, left.neutral))
        assert (found.first, found.second) == ("block", "shelf")
        assert found.distance_m == pytest.approx(0.001, abs=DISTANCE_TOLERANCE_M)

    def test_a_held_body_is_checked_against_the_robot(
        self, left: Arm, shapes: RobotShapes, q: FloatArray
    ) -> None:
        tip = left.T_base_tip(left.neutral)
        huge = Body("huge", (Part(Sphere(float(np.linalg.norm(tip.translation))), ORIGIN),), ORIGIN)
        held = Attachment("huge", "left_gripper", ORIGIN)
        found = ClearanceChecker(shapes, left, Scene.of([huge]), held=held).clearance(q)
        assert found.distance_m < 0.0
        assert "huge" in (found.first, found.second)

    def test_a_body_named_like_a_link_allows_no_contact_with_the_link(
        self, left: Arm, shapes: RobotShapes, q: FloatArray
    ) -> None:
        names = {str(shape.name).rsplit("_", 1)[0] for shape in shapes.model.geometryObjects}
        tip = left.T_base_tip(left.neutral)
        reach = float(np.linalg.norm(tip.translation)) - 0.3
        huge = Body("huge", (Part(Sphere(reach), ORIGIN),), ORIGIN)
        held = Attachment("huge", "left_gripper", ORIGIN)
        without = ClearanceChecker(shapes, left, Scene.of([huge]), held=held).clearance(q)
        like_links = Scene.of([huge, *(ball(name, 9, 9, 9) for name in sorted(names))])
        with_names = ClearanceChecker(shapes, left, like_links, held=held).clearance(q)
        assert with_names.distance_m == pytest.approx(without.distance_m, abs=DISTANCE_TOLERANCE_M)


def needs_m(checked: CheckedPairs, body: str) -> dict[str, set[float]]:
    """Distances that links and bodies must exceed to a body: owner of the shape -> distances."""
    found: dict[str, set[float]] = defaultdict(set)
    for number, need_m in enumerate(checked.required_m(MARGIN_M).tolist()):
        near = checked.clearance_of(number, 0.0)
        if body in (near.first, near.second):
            found[near.first if near.second == body else near.second].add(need_m)
    return found


def checked(
    shapes: RobotShapes, left: Arm, touchable: str | None = None, *, may_press: bool = False
) -> CheckedPairs:
    pairs = ShapePairsBuilder(shapes, left)
    scene = Scene.of([ball("ball", 0.7, 0.2, 0.1)])
    pairs.add_scene(scene, touchable, may_press=may_press, supports=frozenset())
    return pairs.build()


def test_standing_bodies_keep_the_margin_from_each_link_of_the_arm(
    shapes: RobotShapes, left: Arm
) -> None:
    found = needs_m(checked(shapes, left), "ball")
    assert set(found) == {shapes.links[i] for i in shapes.of_arm(left) & shapes.wholes}
    assert all(needs == {MARGIN_M} for needs in found.values())


@pytest.mark.parametrize("may_press", [False, True])
def test_the_hand_alone_may_come_near_a_touchable_body_and_its_pads_press_on_it(
    shapes: RobotShapes, left: Arm, may_press: bool
) -> None:
    found = needs_m(checked(shapes, left, "ball", may_press=may_press), "ball")
    hand, pads = (
        {shapes.links[i] for i in numbers}
        for numbers in (shapes.of_hand(left), shapes.of_pads(left))
    )
    assert pads < hand < set(found)
    for link, needs in found.items():
        if link not in hand:
            assert needs == {MARGIN_M}
        else:
            presses = may_press and link in pads
            assert needs <= ({0.0, -PRESSING_TOLERANCE_M} if presses else {0.0})
            assert (-PRESSING_TOLERANCE_M in needs) is presses


def test_a_held_body_is_paired_with_all_bodies_and_links_but_its_hand(
    shapes: RobotShapes, left: Arm
) -> None:
    pairs = ShapePairsBuilder(shapes, left)
    others = [ball("stand", 0.7, 0.2, 0.1), ball("other", 0.5, 0.2, 0.1)]
    bodies = pairs.add_scene(Scene.of(others), None, may_press=False, supports={"stand"})
    pairs.add_held(ball("held", 0, 0, 0), ORIGIN, bodies, {"stand"})
    found = needs_m(pairs.build(), "held")
    hand = {shapes.links[i] for i in shapes.of_hand(left)}
    assert set(found) == (set(shapes.links) - hand) | {"stand", "other"}
    assert found["stand"] == {-PRESSING_TOLERANCE_M}
    assert found["other"] == found["torso"] == {MARGIN_M}


def test_the_robots_own_pairs_come_first_and_are_those_of_its_arm(
    shapes: RobotShapes, left: Arm
) -> None:
    own = list(shapes.pairs_of(left))
    assert checked(shapes, left).pairs[: len(own)].tolist() == [list(pair) for pair in own]
