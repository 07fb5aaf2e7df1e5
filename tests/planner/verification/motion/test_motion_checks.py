"""Joints that leave their limits, jump between knots or moves, or do not stand still."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from planner import Manipulator, Plan, Trajectory, plan_joint_move, verify
from tests.planner.verification.conftest import failed, forged, move_of, spoiled, with_moves


def shifted(array: np.ndarray[Any, Any], row: int, joint: int, by: float) -> Any:
    changed = np.array(array)
    changed[row, joint] += by
    return changed


def test_a_wrong_jerk_does_not_fit_the_knots(plan: Plan) -> None:
    move = move_of(plan, "pick: approach")
    jerks = np.array(move.trajectory.j)
    jerks[0, np.argmax(np.abs(jerks[0]))] *= 0.99  # less, so that no limit is exceeded
    assert failed(verify(spoiled(plan, move.label, j=jerks))) == {
        "position jump at knots",
        "velocity jump at knots",
        "acceleration jump at knots",
    }


def test_a_jerk_above_its_limit_is_found(plan: Plan) -> None:
    move = move_of(plan, "pick: approach")
    peak = move.trajectory.peak_ratios().jerk
    limits = replace(move.trajectory.limits, j_max=move.trajectory.limits.j_max * peak / 1.01)
    found = verify(spoiled(plan, move.label, limits=limits))
    assert failed(found) == {"jerk of limit"}
    assert found["jerk of limit"].value == pytest.approx(1.01)


@pytest.mark.parametrize(
    ("name", "noticed"),
    [
        ("q", {"position jump at knots"}),
        ("v", {"position jump at knots", "velocity jump at knots"}),
        (
            "a",
            {"position jump at knots", "velocity jump at knots", "acceleration jump at knots"},
        ),
    ],
)
def test_a_knot_off_by_a_millionth_is_found(stopping: Plan, name: str, noticed: set[str]) -> None:
    trajectory = move_of(stopping, "place: approach").trajectory
    assert trajectory.knots_s[2] - trajectory.knots_s[1] > 0.2  # long enough to add up
    before = getattr(trajectory, name)
    state = shifted(before, 1, 3, -1e-6 * np.sign(before[1, 3]))  # and no limit is exceeded
    found = verify(spoiled(stopping, "place: approach", **{name: state}))
    assert failed(found) == noticed
    assert "place: approach" in found.failures[0].where
    assert "left_e1" in found.failures[0].where


def test_swapped_moves_do_not_join(plan: Plan) -> None:
    order = [0, 1, 2, 3, 4, 5, 6, 7, 8]
    order[5], order[6] = 6, 5
    swapped = forged(plan, steps=tuple(plan.steps[i] for i in order))
    assert "position jump between moves" in failed(verify(swapped))


def test_a_jump_of_velocity_between_moves_is_found(
    stopping: Plan, manipulator: Manipulator
) -> None:
    move = move_of(stopping, "place: approach").trajectory
    fast = plan_joint_move(move.q_start, move.q_goal, manipulator.limits, v_start=np.full(7, 1e-3))
    found = verify(with_moves(stopping, {"place: approach": fast}))
    assert failed(found) == {"velocity jump between moves"}
    assert found["velocity jump between moves"].value == pytest.approx(1e-3)


def test_a_jump_of_acceleration_between_moves_is_found(
    stopping: Plan, manipulator: Manipulator
) -> None:
    move = move_of(stopping, "place: approach").trajectory
    fast = plan_joint_move(move.q_start, move.q_goal, manipulator.limits, a_start=np.full(7, 1e-3))
    assert failed(verify(with_moves(stopping, {"place: approach": fast}))) == {
        "acceleration jump between moves"
    }


def test_starting_from_rest_where_the_arm_arrives_in_motion_is_found(
    plan: Plan, manipulator: Manipulator
) -> None:
    resting = joined(plan, manipulator, "place: descend")
    found = verify(with_moves(plan, {"place: descend": resting}))
    assert failed(found) >= {"velocity jump between moves", "acceleration jump between moves"}
    arriving = move_of(plan, "place: approach").trajectory.v[-1]
    assert found["velocity jump between moves"].value == pytest.approx(np.abs(arriving).max())


def test_passing_a_waypoint_in_motion_is_fine(stopping: Plan, manipulator: Manipulator) -> None:
    v = np.full(7, 0.01)
    moves = {
        "pick: approach": joined(stopping, manipulator, "pick: approach", v_goal=v),
        "pick: descend": joined(stopping, manipulator, "pick: descend", v_start=v),
    }
    assert verify(with_moves(stopping, moves)).is_valid


def test_closing_the_hand_in_motion_is_found(stopping: Plan, manipulator: Manipulator) -> None:
    v = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1e-4])
    moves = {
        "pick: descend": joined(stopping, manipulator, "pick: descend", v_goal=v),
        "pick: retract": joined(stopping, manipulator, "pick: retract", v_start=v),
    }
    found = verify(with_moves(stopping, moves))
    assert failed(found) == {"velocity at stops"}
    assert found["velocity at stops"].where == "pick: close, left_w2"


def test_ending_in_motion_is_found(stopping: Plan, manipulator: Manipulator) -> None:
    v = np.full(7, 1e-4)
    moves = {"place: retract": joined(stopping, manipulator, "place: retract", v_goal=v)}
    assert "velocity at stops" in failed(verify(with_moves(stopping, moves)))


def joined(plan: Plan, manipulator: Manipulator, label: str, **rates: Any) -> Trajectory:
    move = move_of(plan, label).trajectory
    return plan_joint_move(move.q_start, move.q_goal, manipulator.limits, **rates)


def test_a_velocity_limit_exceeded_for_a_millisecond_is_found(plan: Plan) -> None:
    trajectory = move_of(plan, "pick: approach").trajectory
    knot, joint = np.unravel_index(np.abs(trajectory.v).argmax(), trajectory.v.shape)
    jerk = abs(trajectory.j[knot - 1, joint])
    below = abs(trajectory.v[knot, joint]) - jerk * 0.5e-3**2 / 2  # 0.5 ms to either side
    v_max = np.array(trajectory.limits.v_max)
    v_max[joint] = below
    found = verify(spoiled(plan, "pick: approach", limits=replace(trajectory.limits, v_max=v_max)))
    assert failed(found) == {"velocity of limit"}
    assert trajectory.limits.names[joint] in found["velocity of limit"].where


def test_an_acceleration_limit_is_the_plans(plan: Plan) -> None:
    trajectory = move_of(plan, "pick: descend").trajectory
    limits, peak = trajectory.limits, trajectory.peak_ratios().acceleration
    strict = replace(limits, a_max=limits.a_max * peak * (1 - 1e-6))
    found = verify(spoiled(plan, "pick: descend", limits=strict))
    assert failed(found) == {"acceleration of limit"}


def test_a_joint_beyond_its_range_between_knots_is_found(plan: Plan) -> None:
    trajectory = move_of(plan, "place: approach").trajectory
    reached = trajectory.position_extrema()[1]
    q_max = np.array(trajectory.limits.q_max)
    q_max[3] = reached[3] - 1e-7
    found = verify(spoiled(plan, "place: approach", limits=replace(trajectory.limits, q_max=q_max)))
    assert failed(found) == {"position margin"}
    assert "left_e1" in found["position margin"].where


def test_a_plan_for_the_other_arm_is_found(plan: Plan) -> None:
    assert "foreign joints" in failed(verify(forged(plan, limb="right")))
