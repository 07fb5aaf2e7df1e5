"""Surroundings: the same verdicts as the checker's and the swept proof's, with a margin."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner import Body, Manipulator, MotionError, Scene, TaskError, plan_joint_move
from planner.surroundings import Surroundings
from tests.planner.walls import wall

MARGIN_M = 0.03


@pytest.fixture
def walled(manipulator: Manipulator, scene: Scene) -> Surroundings:
    return around(manipulator, scene)


def around(manipulator: Manipulator, scene: Scene, margin_m: float = MARGIN_M) -> Surroundings:
    hand = manipulator.hand
    return Surroundings(
        manipulator, scene.with_body(wall()), finger_m=hand.stroke_m, margin_m=margin_m
    )


def test_free_is_what_keeps_the_margin(manipulator: Manipulator, walled: Surroundings) -> None:
    rng = np.random.default_rng(3)
    qs = [manipulator.arm.random_configuration(rng) for _ in range(200)]
    distances = [walled.clearance(q).distance_m for q in qs]
    assert any(0.0 < distance < MARGIN_M for distance in distances)
    for q, distance in zip(qs, distances, strict=True):
        assert walled.is_free(q) == (distance > MARGIN_M)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=15)
def test_what_is_clear_is_proven_so(manipulator: Manipulator, table: Body, seed: int) -> None:
    surroundings, rng = around(manipulator, Scene.of([table])), np.random.default_rng(seed)
    start, goal = (manipulator.arm.random_configuration(rng) for _ in range(2))
    motion = plan_joint_move(start, goal, manipulator.limits)
    proof = surroundings.prove(motion)
    assert surroundings.is_clear(motion) == proof.is_clear
    if proof.is_clear:
        assert surroundings.looks_clear(motion)


@pytest.mark.parametrize("margin", [-0.1, np.nan, None, "1 mm"])
def test_a_margin_that_is_none_is_refused(
    manipulator: Manipulator, scene: Scene, margin: Any
) -> None:
    with pytest.raises(MotionError, match="margin"):
        around(manipulator, scene, margin)


def test_a_manipulator_that_is_none_is_refused(scene: Scene) -> None:
    bad: Any = "left"
    with pytest.raises(TaskError, match="manipulator"):
        Surroundings(bad, scene, finger_m=0.0)
