"""plan_together: both arms at once, proven clear of each other; or in turn; or a reason."""

from __future__ import annotations

from itertools import pairwise, product
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter, BaxterError
from baxter_kin.errors import ConfigurationError
from baxter_kin.fields import evolve
from planner import (
    Grip,
    Manipulator,
    Move,
    PickAndPlace,
    Plan,
    Scene,
    TwoArmPlan,
    plan_together,
)
from planner.clearance import ContinuousContact, ContinuousProof
from planner.errors import MotionError, SceneError, TaskError
from planner.plan import PlanFailure
from planner.two_arms.across import Across, episodes_of, windows_of
from planner.two_arms.plan import begins_of
from tests.planner.two_arms.pairs import (
    SIDES,
    SIZE_M,
    Measured,
    PairOfTasks,
    block,
    carry,
    pair,
)

LOOKS, MAX_CHECKED_M = 150, 0.03
"""Number of times at which both arms are measured, and maximum distance that is checked: distances
of meshes that are farther apart take long."""

BODY_M, FOUND_M = 1e-3, 4e-3
"""Twice half a millimetre: the shapes of links contain Rethink's meshes, of which proofs consist.
And by how much the smallest distance that a proof states may differ from the one measured."""


@pytest.fixture(params=["plain", "crossing"])
def solved(request: pytest.FixtureRequest) -> tuple[PairOfTasks, TwoArmPlan]:
    """A pair of tasks, and its plan."""
    names = request.param, f"{request.param}_plan"
    problem, plan = map(request.getfixturevalue, names)
    return problem, plan


def test_both_arms_move_at_once(solved: tuple[PairOfTasks, TwoArmPlan]) -> None:
    problem, plan = solved
    assert plan.is_valid
    assert plan.in_turn == ""
    for side in SIDES:
        own = plan.plans[side]
        assert own.is_valid
        assert all(step.proof is not None and step.state is not None for step in own)
        other = {task.body for key, task in problem.tasks.items() if key != side}
        assert other.isdisjoint(own.start.scene.bodies)
    each_s = [sum(end - begin for begin, end, *_ in plan.steps_of(side)) for side in SIDES]
    assert max(each_s) - 1e-9 <= plan.duration_s < 0.8 * sum(each_s)
    assert max(plan.trajectory.peak_ratios()) <= 1.0 + 1e-6


def test_no_sample_is_nearer_than_proven(
    robot: Baxter, solved: tuple[PairOfTasks, TwoArmPlan]
) -> None:
    """Placed by Pinocchio and tested by coal, with fingers and bodies anywhere on their ways."""
    problem, plan = solved
    assert plan.proof is not None
    measured, rng = Measured(plan, robot, problem.manipulators), np.random.default_rng(0)
    times = rng.uniform(0.0, plan.duration_s, LOOKS).tolist()
    nearest, within_m = plan.proof.nearest, min(plan.proof.proven_m - BODY_M, MAX_CHECKED_M)
    assert not any(measured.are_within(t, rng.random(), within_m) for t in times)
    assert nearest.time_s is not None
    assert measured.are_within(nearest.time_s, 0.5, nearest.distance_m + FOUND_M)


def across_of(problem: PairOfTasks, plan: TwoArmPlan, margin_m: float = 0.0) -> Across:
    """Both arms of a plan against each other."""
    episodes = {
        side: episodes_of(plan.plans[side], problem.manipulators[side], {problem.tasks[side].body})
        for side in SIDES
    }
    q_others = problem.manipulators["left"].robot.configuration(dict(problem.state.joints))
    return Across(problem.manipulators, episodes, q_others, margin_m)


def test_windows_cover_the_clock(solved: tuple[PairOfTasks, TwoArmPlan]) -> None:
    problem, plan = solved
    windows = windows_of(plan, across_of(problem, plan).episodes)
    assert 5 <= len(windows) <= 9
    assert [windows[0].begin_s, windows[-1].end_s] == [0.0, plan.duration_s]
    for one, following in pairwise(windows):
        assert one.end_s == following.begin_s
        assert one.episodes != following.episodes


def test_another_clock_is_not_proven(
    robot: Baxter, crossing: PairOfTasks, crossing_plan: TwoArmPlan
) -> None:
    """Both arms as they are, but one of them delayed: what is refused is confirmed by coal."""
    across, contacts = across_of(crossing, crossing_plan), []
    for delay_s in (0.5, 1.0, 1.5):
        for side in SIDES:
            begins = {**crossing_plan.begins_s}
            begins[side] = tuple(delay_s + each for each in begins[side])
            other = evolve(crossing_plan, begins_s=begins)
            result = across.prove(other)
            if isinstance(result, ContinuousContact):
                contacts.append(result)
                assert result.is_found
                assert result.nearest.time_s is not None
                measured = Measured(other, robot, crossing.manipulators)
                assert measured.are_within(result.nearest.time_s, 0.5, 1e-4)
    assert contacts


def test_a_hand_that_grips_is_as_thick_as_its_way(
    plain: PairOfTasks, plain_plan: TwoArmPlan
) -> None:
    """In each episode, every state of fingers and bodies is within the thickness."""
    for side in SIDES:
        manipulator, plan = plain.manipulators[side], plain_plan.plans[side]
        finger = manipulator.hand.joint_names[0]
        episodes = episodes_of(plan, manipulator, {plain.tasks[side].body})
        assert [each.is_grip for each in episodes] == [False, True, False, True, False]
        following = [*plan.steps[1:], None]
        for episode in episodes:
            for step, after in list(zip(plan, following, strict=True))[
                episode.first : episode.last + 1
            ]:
                states = [step.state] if isinstance(step, Move) else []
                if isinstance(step, Grip) and after is not None:
                    states = [step.state, after.state]
                for state in states:
                    assert state is not None
                    off_m = abs(state.joints[finger] - episode.state.finger_m)
                    assert off_m <= episode.state.thicker_m + 1e-9


def test_each_arm_s_own_world_lacks_the_other_arm(plain: PairOfTasks) -> None:
    left, right = plain.manipulators["left"], plain.manipulators["right"]
    alone = evolve(left, shapes=left.shapes.without("right"))
    context = alone.context(plain.state.scene)
    of_right = left.shapes.of_arm(right.arm)
    assert of_right.isdisjoint(context.checker.pairs.ravel().tolist())
    of_both = left.context(plain.state.scene).checker.pairs
    kept = [pair for pair in of_both.tolist() if of_right.isdisjoint(pair)]
    assert sorted(kept) == sorted(context.checker.pairs.tolist())


def test_ends_that_block_each_other_are_said(manipulators: dict[str, Manipulator]) -> None:
    """Both hands would hover at the same height, 6 cm apart."""
    left, right = ((0.7, 0.3, 0.0), (0.7, 0.03, 0.0)), ((0.7, -0.3, 0.0), (0.7, -0.03, 0.0))
    plan = plan_together(*pair(manipulators, left, right).arguments, may_withdraw=False)
    assert plan.failure is not None
    assert "both hands cannot be at" in str(plan.failure)
    assert "none of" in str(plan.failure)
    assert not plan.plans["left"].steps


def test_arms_take_turns_where_no_program_applies(crossing: PairOfTasks) -> None:
    """Lines of a twentieth of a millimetre are too short for the motion program."""
    tasks = {side: evolve(task, clear_m=5e-5) for side, task in crossing.tasks.items()}
    plan = plan_together(tasks, *crossing.arguments[1:])
    assert plan.is_valid
    assert "no motion of both arms at once was found" in plan.in_turn
    busy = {side: [each[:2] for each in plan.steps_of(side)] for side in SIDES}
    for (a, b), (c, d) in product(busy["left"], busy["right"]):
        assert max(a, c) >= min(b, d) - 1e-9


def test_tasks_are_done_in_the_given_order(manipulators: dict[str, Manipulator]) -> None:
    """The left arm has two, the right one a single task."""
    first, second = (0.65, 0.2, 0.0), (0.7, 0.42, 0.0)
    left, right = (first, (0.8, 0.3, 0.0)), ((0.75, -0.2, 0.3), (0.65, -0.4, 0.0))
    problem = pair(manipulators, left, right)
    scene = problem.state.scene.with_body(block("third", second))
    lists: dict[str, PickAndPlace | list[PickAndPlace]] = {
        "left": [problem.tasks["left"], carry("third", second, first)],
        "right": problem.tasks["right"],
    }
    plan = plan_together(lists, manipulators, evolve(problem.state, scene=scene))
    assert plan.is_valid
    grasped = [
        s.body for s in plan.plans["left"] if isinstance(s, Grip) and s.label == "pick: close"
    ]
    assert grasped == ["left", "third"]
    assert isinstance(plan.proof, ContinuousProof)


def test_no_body_is_stacked_on_one_of_the_other_arm(manipulators: dict[str, Manipulator]) -> None:
    """Without the lower one, which is not in the left arm's own world, it would fall."""
    left, right = ((0.65, 0.2, 0.0), (0.8, 0.3, 0.0)), ((0.75, -0.3, 0.0), (0.7, -0.1, 0.0))
    problem = pair(manipulators, left, right)
    scene = problem.state.scene.with_body(block("third", (0.7, 0.42, 0.0)))
    on_top = pin.SE3(np.eye(3), np.array([0.0, 0.0, SIZE_M]))
    third = carry("third", (0.7, 0.42, 0.0), (0.7, -0.1, 0.0))
    stacked = evolve(third, T_base_place=on_top * third.T_base_place)
    lists = {"left": [problem.tasks["left"], stacked], "right": [problem.tasks["right"]]}
    plan = plan_together(lists, manipulators, evolve(problem.state, scene=scene))
    assert plan.failure is not None
    assert "third would stand on a body that the right arm handles" in str(plan.failure)


def test_an_arm_without_a_plan_is_named(plain: PairOfTasks) -> None:
    far = carry("right", (0.75, -0.2, 0.3), (1.6, -0.2, 0.0))
    plan = plan_together({**plain.tasks, "right": far}, *plain.arguments[1:])
    assert plan.failure is not None
    assert "the right arm by itself" in str(plan.failure)


def test_arms_in_contact_at_the_start_are_refused(plain: PairOfTasks) -> None:
    joints = dict(plain.state.joints)
    joints |= {"left_s0": -0.97, "right_s0": 0.98}
    for side, sign in (("left", -1.0), ("right", 1.0)):
        arm = plain.manipulators[side].arm
        joints |= arm.joints(arm.neutral) | {f"{side}_s0": 1.3 * sign}
    plan = plan_together(*plain.arguments[:2], evolve(plain.state, joints=joints))
    assert isinstance(plan.failure, PlanFailure)


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        ({"tasks": None}, TaskError),
        ({"tasks": {}}, TaskError),
        ({"tasks": {"left": "left", "right": "right"}}, TaskError),
        ({"tasks": {"left": (), "right": ()}}, TaskError),
        ({"manipulators": {}}, TaskError),
        ({"manipulators": None}, TaskError),
        ({"state": None}, TaskError),
        ({"grip_s": 0.1}, TaskError),  # the fingers take longer
        ({"grip_s": np.nan}, TaskError),
        ({"margin_m": -0.01}, MotionError),
        ({"line_tolerance": 0.1}, MotionError),
        ({"may_withdraw": 1}, TaskError),
    ],
)
def test_bad_input_is_refused(
    plain: PairOfTasks, changes: dict[str, Any], error: type[BaxterError]
) -> None:
    names = "tasks", "manipulators", "state"
    given: dict[str, Any] = dict(zip(names, plain.arguments, strict=True))
    with pytest.raises(error):
        plan_together(**given | changes)


def test_contradictory_problems_are_refused(plain: PairOfTasks) -> None:
    tasks, manipulators, state = plain.arguments
    fixed = Scene.of([evolve(body, is_movable=False) for body in state.scene])
    outside = evolve(state, joints={**state.joints, "left_s0": 3.0})
    swapped = dict(zip(SIDES, reversed(manipulators.values()), strict=True))
    held = state.held_by("left_gripper", "left", tasks["left"].T_base_pick)
    for given, error in (
        (({**tasks, "right": evolve(tasks["right"], body="left")}, manipulators, state), TaskError),
        (({**tasks, "right": evolve(tasks["right"], body="x")}, manipulators, state), SceneError),
        ((tasks, swapped, state), TaskError),
        ((tasks, manipulators, evolve(state, scene=fixed)), TaskError),
        ((tasks, manipulators, outside), ConfigurationError),
        ((tasks, manipulators, held), TaskError),
    ):
        with pytest.raises(error):
            plan_together(*given)


def test_steps_begin_as_early_as_possible(plain_plan: TwoArmPlan) -> None:
    plan: Plan = plain_plan.plans["left"]
    begins = begins_of(plan, 0.5, {1: 0.25})
    assert begins[:2] == (0.0, 0.75)
    assert np.diff(begins)[1:] == pytest.approx(np.diff(begins_of(plan, 0.5, {}))[1:])
