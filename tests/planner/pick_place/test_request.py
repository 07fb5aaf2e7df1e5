"""What a plan is made for, and what it cannot be made for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from baxter_kin.errors import ConfigurationError
from planner import LineTolerance, Manipulator, Scene
from planner.errors import MotionError, SceneError, TaskError
from planner.pick_place.task import PlanRequest
from planner.scene.attachment import Attachment
from tests.conftest import at

ORIGIN = at(0.0, 0.0, 0.0)


def test_the_start_is_a_copy_that_cannot_be_changed(manipulator: Manipulator, scene: Scene) -> None:
    given = np.array(manipulator.arm.start)
    request = PlanRequest(manipulator, scene, given)
    given[:] = 0.0
    np.testing.assert_array_equal(request.q_start, manipulator.arm.start)
    with pytest.raises(ValueError, match="read-only"):
        request.q_start[0] = 0.0


def test_the_other_hand_may_hold_something(manipulator: Manipulator, scene: Scene) -> None:
    held = Attachment("block", "right_gripper", ORIGIN)
    assert PlanRequest(manipulator, scene, manipulator.arm.start, held=[held]).held == (held,)


def test_the_hand_that_plans_must_be_empty(manipulator: Manipulator, scene: Scene) -> None:
    held = Attachment("block", "left_gripper", ORIGIN)
    with pytest.raises(TaskError, match="the left hand holds 'block'; it must be empty"):
        PlanRequest(manipulator, scene, manipulator.arm.start, held=[held])


def test_a_start_is_refused_by_the_name_that_its_caller_gives_it(
    manipulator: Manipulator, scene: Scene
) -> None:
    with pytest.raises(ConfigurationError, match="q_now"):
        PlanRequest(manipulator, scene, [0.0] * 6, q_name="q_now")


def test_a_start_outside_the_limits_is_refused_naming_the_joint(
    manipulator: Manipulator, scene: Scene
) -> None:
    beyond = np.array(manipulator.arm.start)
    beyond[3] = manipulator.arm.limits.q_max[3] + 0.1
    with pytest.raises(ConfigurationError, match="left_e1"):
        PlanRequest(manipulator, scene, beyond)


def test_a_negative_margin_is_refused(manipulator: Manipulator, scene: Scene) -> None:
    with pytest.raises(MotionError, match=r"a safety margin is not negative, got -0\.001 m"):
        PlanRequest(manipulator, scene, manipulator.arm.start, -0.001)


@pytest.mark.parametrize(
    ("given", "error", "match"),
    [
        ({"manipulator": "left"}, TaskError, "manipulator must be of class Manipulator"),
        ({"scene": None}, SceneError, "scene must be of class Scene"),
        ({"line_tolerance": 1e-3}, MotionError, "line_tolerance must be of class LineTolerance"),
        ({"held": ["block"]}, TaskError, "what the hands hold"),
    ],
)
def test_what_is_of_another_class_is_refused_by_name(
    manipulator: Manipulator,
    scene: Scene,
    given: dict[str, Any],
    error: type[Exception],
    match: str,
) -> None:
    asked: dict[str, Any] = {
        "manipulator": manipulator,
        "scene": scene,
        "q_given": manipulator.arm.start,
        "line_tolerance": LineTolerance(),
    }
    with pytest.raises(error, match=match):
        PlanRequest(**asked | given)
