"""Stretches of a pick and place: how dense their samples are, and which pairs they check."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from baxter_kin.description import RobotDescription
from planner import Plan
from planner.trajectory import CONTINUITY_TOLERANCE
from planner.verification.body.robot_body import robot_body
from planner.verification.body.stretch import FINGER, IN_HAND, arm_level, lever_arms
from planner.verification.body.stretches import FINGER_STEP_M, Stretches
from planner.verification.fingers import Fingers
from planner.verification.story import FingerMove, Run, Story
from planner.verification.urdf_robot import UrdfRobot

STEP_M = 0.01
ROUNDING_M = 1e-9
"""Of travels found by bisection."""


@pytest.fixture(scope="module")
def story(cube_plan: Plan, urdf: UrdfRobot) -> Story:
    solids = robot_body(RobotDescription.installed()).solids
    return Story(cube_plan, cube_plan.start, urdf, Fingers(urdf, solids))


@pytest.fixture(scope="module")
def stretches(cube_plan: Plan, urdf: UrdfRobot) -> Stretches:
    solids = robot_body(RobotDescription.installed()).solids
    return Stretches(urdf, solids, urdf.standing(cube_plan.start.joints), [], ())


@pytest.fixture(scope="module")
def runs(story: Story) -> list[Run]:
    return [stage for stage in story.stages if isinstance(stage, Run) and stage.moves]


@pytest.fixture(scope="module")
def travels(story: Story) -> list[FingerMove]:
    return [stage for stage in story.stages if isinstance(stage, FingerMove)]


def test_between_samples_nothing_travels_more_than_a_step(
    stretches: Stretches, runs: list[Run], urdf: UrdfRobot
) -> None:
    for run in runs:
        stretch = stretches.of_run(run, STEP_M)
        steps = np.diff(stretch.gone, axis=0)
        for solid in (*robot_body(RobotDescription.installed()).solids, *stretch.held):
            assert (steps @ lever_arms(urdf, solid)).max() <= STEP_M + ROUNDING_M


def test_the_samples_of_a_run_begin_and_end_where_its_moves_do(
    stretches: Stretches, runs: list[Run], urdf: UrdfRobot
) -> None:
    where = [urdf.model.joints[joint].idx_q for joint in urdf.arm_joints]
    for run in runs:
        stretch = stretches.of_run(run, STEP_M)
        for section, move in zip(stretch.sections, run.moves, strict=True):
            ends = stretch.q[[section.first, section.last]][:, where]
            wanted = np.array([move.trajectory.q_start, move.trajectory.q_goal])
            assert ends == pytest.approx(wanted, abs=CONTINUITY_TOLERANCE)


def test_fingers_go_by_small_steps_from_where_they_are_to_where_they_end(
    stretches: Stretches, travels: list[FingerMove], urdf: UrdfRobot
) -> None:
    for travel in travels:
        stretch = stretches.of_travel(travel)
        openings = [urdf.opening(q) for q in stretch.q]
        assert openings[0] == pytest.approx(travel.begin_m, abs=ROUNDING_M)
        assert openings[-1] == pytest.approx(travel.end_m, abs=ROUNDING_M)
        assert np.abs(np.diff(openings)).max() <= FINGER_STEP_M + ROUNDING_M
        assert stretch.gone[-1, FINGER] == pytest.approx(abs(travel.end_m - travel.begin_m))


def test_every_pair_of_a_run_has_a_shape_that_moves_and_is_there_once(
    stretches: Stretches, runs: list[Run], urdf: UrdfRobot
) -> None:
    for run in runs:
        pairs = stretches.pairs_of_run(run, stretches.of_run(run, STEP_M))
        assert len({frozenset((id(pair.first), id(pair.second))) for pair in pairs}) == len(pairs)
        for pair in pairs:
            assert max(arm_level(urdf, solid.joint) for solid in (pair.first, pair.second)) > 0


def test_the_hand_is_not_checked_against_what_it_holds(
    stretches: Stretches, runs: list[Run], urdf: UrdfRobot
) -> None:
    laden = next(run for run in runs if run.carried is not None)
    pairs = stretches.pairs_of_run(laden, stretches.of_run(laden, STEP_M))
    with_held = [pair for pair in pairs if pair.first.joint == IN_HAND]
    assert {"table", "torso", "left_lower_forearm"} <= {pair.second.name for pair in with_held}
    hand = {urdf.wrist, *urdf.fingers}
    assert not [pair for pair in with_held if pair.second.joint in hand]


def test_fingers_may_touch_the_body_only_on_the_lines_next_to_the_grip(
    stretches: Stretches, runs: list[Run]
) -> None:
    touched = {
        section.step.label: section.touched
        for run in runs
        for section in stretches.of_run(run, STEP_M).sections
    }
    assert {label for label, names in touched.items() if names} == {
        "pick: descend",
        "place: retract",
    }
    assert touched["pick: descend"] == touched["place: retract"] == {"block"}


def test_fingers_may_touch_nothing_on_a_way_that_is_not_straight(
    stretches: Stretches, runs: list[Run]
) -> None:
    for run in runs:
        curved = replace(run, moves=tuple(replace(m, is_straight=False) for m in run.moves))
        assert not any(s.touched for s in stretches.of_run(curved, STEP_M).sections)


def test_what_stands_still_has_one_sample(
    stretches: Stretches, story: Story, urdf: UrdfRobot
) -> None:
    stretch = stretches.of_rest(story.scene)
    assert len(stretch.q) == 1
    names = {str(pair) for pair in stretches.pairs_of_rest(stretch)}
    assert "right_wrist with table" in names
    assert not [name for name in names if "left_" in name and "arm_mount" not in name]
