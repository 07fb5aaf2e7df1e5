"""Plans as they are made step by step, and where they end."""

from __future__ import annotations

import numpy as np
import pytest

from planner import (
    Grip,
    Line,
    LineTolerance,
    Manipulator,
    Scene,
    plan_joint_move,
    plan_start_move,
    verify,
)
from planner.collision.context import CollisionContext
from planner.pick_place.plan_builder import (
    NoSolutionError,
    PlanBuilder,
    free_motion,
    proven,
    refuse_blocked,
)
from planner.pick_place.task import UP, PlanRequest
from tests.conftest import overhead
from tests.planner.pick_place.conftest import box, labels

REACHED_M = 1e-6
"""How near to its goal a straight move ends."""


@pytest.fixture
def builder(manipulator: Manipulator, scene: Scene) -> PlanBuilder:
    return PlanBuilder(PlanRequest(manipulator, scene, manipulator.arm.start))


@pytest.fixture(scope="module")
def context(manipulator: Manipulator, scene: Scene) -> CollisionContext:
    return manipulator.context(scene)


@pytest.mark.slow
def test_the_start_move_goes_around_a_wall(manipulator: Manipulator, scene: Scene) -> None:
    wall = box("wall", (0.3, 0.02, 0.2), 0.72, 0.0, -0.055)
    one, other = (manipulator.ik.solve(overhead(0.7, y, -0.08)).q for y in (-0.15, 0.15))
    plan = plan_start_move(manipulator, scene.with_body(wall), one, other)
    assert plan.is_valid, str(plan.failure)
    assert verify(plan).is_valid


def test_the_arm_stands_where_the_last_move_ended(
    builder: PlanBuilder, manipulator: Manipulator, context: CollisionContext
) -> None:
    arm = manipulator.arm
    assert builder.q.tolist() == arm.start.tolist()
    builder.add_free_move("there", arm.neutral, context)
    builder.add_open("open", manipulator.hand.stroke_m)
    assert builder.q.tolist() == arm.neutral.tolist()


def test_a_rise_ends_straight_above_where_the_arm_stood(
    builder: PlanBuilder, manipulator: Manipulator, context: CollisionContext
) -> None:
    before = manipulator.arm.T_base_tip(builder.q)
    builder.add_retreat("up", [Line(UP, 0.05)], context)
    after = manipulator.arm.T_base_tip(builder.q)
    moved = after.translation - before.translation
    np.testing.assert_allclose(moved, [0.0, 0.0, 0.05], atol=REACHED_M)
    (move,) = builder.plan().moves
    assert move.is_straight


def test_a_rise_out_of_reach_is_refused_at_its_stage(
    builder: PlanBuilder, context: CollisionContext
) -> None:
    with pytest.raises(NoSolutionError, match=r"^up: the straight line ends after .* of the way"):
        builder.add_retreat("up", [Line(UP, 2.0)], context)
    assert not builder.steps


def test_a_motion_that_collides_is_refused(
    builder: PlanBuilder, manipulator: Manipulator, context: CollisionContext
) -> None:
    below = manipulator.ik.solve(overhead(0.65, 0.2, -0.25), current=builder.q).q
    with pytest.raises(NoSolutionError) as stop:
        proven("dive", plan_joint_move(builder.q, below, manipulator.limits), context)
    assert stop.value.failure.contact is not None
    assert stop.value.failure.contact.nearest.second == "table"


@pytest.mark.parametrize(("share", "told"), [(1.0, None), (0.5, 0.5)])
def test_an_opening_is_told_where_it_is_not_all_the_way(
    builder: PlanBuilder, manipulator: Manipulator, share: float, told: float | None
) -> None:
    stroke_m = manipulator.hand.stroke_m
    builder.add_open("open", share * stroke_m)
    (grip,) = builder.steps
    assert isinstance(grip, Grip)
    assert grip.opening_m == (told if told is None else told * stroke_m)


def test_a_plan_that_ends_early_has_the_steps_before(
    builder: PlanBuilder, manipulator: Manipulator
) -> None:
    builder.add_open("open", manipulator.hand.stroke_m)
    plan = builder.plan(NoSolutionError.at("up", "it is too high").failure)
    assert labels(plan) == ["open"]
    assert not plan.is_valid
    assert str(plan.failure) == "up: it is too high"


def test_a_plan_states_what_was_asked_for(manipulator: Manipulator, scene: Scene) -> None:
    wide = LineTolerance(0.002, 0.01)
    request = PlanRequest(manipulator, scene, manipulator.arm.start, line_tolerance=wide)
    plan = PlanBuilder(request).plan()
    assert plan.line_tolerance is wide
    assert [body.name for body in plan.start.scene] == [body.name for body in scene]


def test_the_proof_of_a_motion_is_above_the_margin_of_its_situation(
    manipulator: Manipulator, scene: Scene
) -> None:
    arm, guarded = manipulator.arm, manipulator.context(scene, margin_m=0.01)
    motion = free_motion("there", (arm.start, arm.neutral), manipulator, guarded)
    assert motion.proof.proven_m > 0.01
    assert proven("there", motion.trajectory, guarded).proof.proven_m == motion.proof.proven_m


@pytest.mark.parametrize(("margin_m", "is_refused"), [(0.1, False), (0.2, True)])
def test_a_margin_that_the_robots_own_body_cannot_keep_is_told_to_be_so(
    manipulator: Manipulator, margin_m: float, is_refused: bool
) -> None:
    """At the start the upper arm is 149.5 mm from the screen."""
    alone, q = manipulator.context(Scene.of(), margin_m=margin_m), manipulator.arm.start
    if not is_refused:
        refuse_blocked("wait", q, alone, "here")
        return
    with pytest.raises(
        NoSolutionError, match="the robot's own links cannot keep this margin there"
    ) as e:
        refuse_blocked("wait", q, alone, "here")
    assert e.value.failure.is_certain
