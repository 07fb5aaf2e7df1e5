"""Pairs of shapes: which are checked in a situation, and which of them may touch."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

from baxter_kin import Arm, Baxter
from planner import (
    Body,
    Box,
    ClearanceChecker,
    Manipulator,
    Part,
    RobotShapes,
    Scene,
    SceneError,
    Sphere,
)
from planner.collision.robot.robot_body import RobotBody
from planner.scene.contact import PRESSING_TOLERANCE_M
from planner.scene.held import Held
from tests.conftest import at
from tests.planner.collision.conftest import ORIGIN, ball, full

DISTANCE_TOLERANCE_M = 2e-6
"""Two runs of GJK on the same pair; its default tolerance is 1e-6."""

Z = np.array([0.0, 0.0, 1.0])

FloatArray = NDArray[np.float64]


class TestAllowedContacts:
    """Fingers and the body they grasp; a held body and what it stands on."""

    @pytest.fixture
    def shapes(self, robot: Baxter, plain: RobotBody) -> RobotShapes:
        """With boxes for pads."""
        return RobotShapes(robot, plain)

    @pytest.fixture
    def manipulator(self, robot: Baxter, plain: RobotBody) -> Manipulator:
        """With boxes for pads."""
        return Manipulator.of(robot, "left", body=plain)

    @pytest.fixture
    def q(self, robot: Baxter, left: Arm) -> FloatArray:
        return full(robot, left, left.neutral)

    def at_left_pad(self, manipulator: Manipulator, left: Arm, depth_m: float) -> Body:
        """A ball between the fingers, pressed into the +y pad by some depth."""
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

    def test_other_bodies_stay_forbidden_to_the_fingers(
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
        held = Held("left", "block", at(-0.025, -0.025, -0.025))
        found = ClearanceChecker(shapes, left, Scene.of([block]), held=held).clearance(q)
        assert found.distance_m > 0.01

    @pytest.mark.parametrize(("gap", "is_allowed"), [(0.0, True), (-1e-4, True), (-1e-3, False)])
    def test_a_held_body_may_stand_on_something_but_not_in_it(
        self, manipulator: Manipulator, block: Body, gap: float, is_allowed: bool
    ) -> None:
        left, robot = manipulator.arm, manipulator.robot
        held = Held("left", "block", at(-0.025, -0.025, -0.025))
        T_base_tip = left.T_base_tip(left.neutral)
        low = block.at(T_base_tip * held.T_tip_body).extent_m(Z)[0]
        x, y, _ = T_base_tip.translation
        slab = Body("slab", (Part(Box((0.1, 0.1, 0.02)), ORIGIN),), at(x, y, low - gap - 0.01))
        scene = Scene.of([slab, block])
        checker = ClearanceChecker(manipulator.shapes, left, scene, held=held, supports=["slab"])
        found = checker.clearance(full(robot, left, left.neutral))
        assert (found.distance_m > 0.0) is is_allowed

    def test_a_held_body_must_not_touch_what_it_does_not_stand_on(
        self, manipulator: Manipulator, block: Body
    ) -> None:
        left, robot = manipulator.arm, manipulator.robot
        held = Held("left", "block", at(-0.025, -0.025, -0.025))
        T_base_tip = left.T_base_tip(left.neutral)
        low = block.at(T_base_tip * held.T_tip_body).extent_m(Z)[0]
        x, y, _ = T_base_tip.translation
        shelf = Body("shelf", (Part(Box((0.1, 0.1, 0.02)), ORIGIN),), at(x, y, low - 0.001 - 0.01))
        scene = Scene.of([shelf, block])
        checker = ClearanceChecker(manipulator.shapes, left, scene, held=held, supports=["table"])
        found = checker.clearance(full(robot, left, left.neutral))
        assert (found.first, found.second) == ("block", "shelf")
        assert found.distance_m == pytest.approx(0.001, abs=DISTANCE_TOLERANCE_M)

    def test_a_held_body_counts_against_the_robot(
        self, left: Arm, shapes: RobotShapes, q: FloatArray
    ) -> None:
        tip = left.T_base_tip(left.neutral)
        huge = Body("huge", (Part(Sphere(float(np.linalg.norm(tip.translation))), ORIGIN),), ORIGIN)
        held = Held("left", "huge", ORIGIN)
        found = ClearanceChecker(shapes, left, Scene.of([huge]), held=held).clearance(q)
        assert found.distance_m < 0.0
        assert "huge" in (found.first, found.second)

    def test_a_body_named_like_a_link_excuses_no_contact_with_the_link(
        self, left: Arm, shapes: RobotShapes, q: FloatArray
    ) -> None:
        names = {str(shape.name).rsplit("_", 1)[0] for shape in shapes.model.geometryObjects}
        tip = left.T_base_tip(left.neutral)
        reach = float(np.linalg.norm(tip.translation)) - 0.3
        huge = Body("huge", (Part(Sphere(reach), ORIGIN),), ORIGIN)
        held = Held("left", "huge", ORIGIN)
        without = ClearanceChecker(shapes, left, Scene.of([huge]), held=held).clearance(q)
        like_links = Scene.of([huge, *(ball(name, 9, 9, 9) for name in sorted(names))])
        with_names = ClearanceChecker(shapes, left, like_links, held=held).clearance(q)
        assert with_names.distance_m == pytest.approx(without.distance_m, abs=DISTANCE_TOLERANCE_M)

    def test_an_unknown_touchable_body_is_refused(
        self, left: Arm, shapes: RobotShapes, scene: Scene
    ) -> None:
        with pytest.raises(SceneError, match="no body 'brick' in the scene"):
            ClearanceChecker(shapes, left, scene, touchable="brick")

    def test_a_held_body_that_the_scene_lacks_is_refused(
        self, left: Arm, shapes: RobotShapes, scene: Scene
    ) -> None:
        with pytest.raises(SceneError, match="no body 'brick' in the scene"):
            ClearanceChecker(shapes, left, scene, held=Held("left", "brick", ORIGIN))

    def test_what_the_other_hand_holds_is_not_carried(
        self, left: Arm, shapes: RobotShapes, scene: Scene
    ) -> None:
        with pytest.raises(SceneError, match="in the right hand; the left arm cannot carry it"):
            ClearanceChecker(shapes, left, scene, held=Held("right", "block", ORIGIN))

    def test_a_held_body_cannot_stand_there_to_be_touched(
        self, left: Arm, shapes: RobotShapes, scene: Scene
    ) -> None:
        held = Held("left", "block", ORIGIN)
        with pytest.raises(SceneError, match="'block' is in the hand"):
            ClearanceChecker(shapes, left, scene, held=held, touchable="block")
