"""Plans made of recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from baxter_kin import Arm, Baxter, BaxterError
from baxter_kin.errors import UnknownNameError
from baxter_kin.fields import evolve
from planner import (
    Body,
    Box,
    Grip,
    GripperAction,
    Manipulator,
    Move,
    Part,
    Plan,
    Scene,
    Trajectory,
)
from planner.trajectory import joined
from sim import Recording, World, read_recording, save_recording
from sim.errors import RecordingError
from sim.recording import RecordedPlan, motion_from
from sim.recording.recorder import planned_recording
from tests.conftest import at

TOLERANCE_RAD = 0.01
CLOSING_S, OPEN, CLOSED = 1.0, 100.0, 20.0
SAME_S = 0.011
"""A file of samples ends with the last tick, not with the last move."""


@pytest.fixture(scope="module")
def recording(plan: Plan) -> Recording:
    return planned_recording(plan)


def moves_of(made: RecordedPlan) -> tuple[Move, ...]:
    assert made.plan.failure is None, made.plan.failure
    return made.plan.moves


@pytest.mark.parametrize("suffix", [".mcap", ".csv", ".bag"])
def test_a_recording_of_any_format_becomes_its_moves_and_grips(
    recording: Recording, plan: Plan, left: Arm, tmp_path: Path, suffix: str
) -> None:
    """Near the original motion at its own times, and within the limits."""
    file = tmp_path / f"run{suffix}"
    save_recording(recording, file)
    made = motion_from(read_recording(file).recording, "left", tolerance_rad=TOLERANCE_RAD)
    assert made.deviation_rad <= 0.6 * TOLERANCE_RAD
    kinds = [step.action if isinstance(step, Grip) else None for step in made.plan]
    assert kinds == [None, GripperAction.CLOSE, None, GripperAction.OPEN, None]
    for move, original in zip(moves_of(made), motions_of(plan), strict=True):
        motion = move.trajectory
        assert abs(motion.duration - original.duration) <= 2.0 * SAME_S
        times_s = np.linspace(0.0, min(original.duration, motion.duration), 200)
        off_rad = motion.sample(times_s).q - original.sample(times_s).q
        assert np.abs(off_rad).max() <= TOLERANCE_RAD + left.limits.v_max.max() * SAME_S
        assert max(motion.peak_ratios(left.limits)) <= 1.0
    assert all(step.opening_m is None for step in made.plan if isinstance(step, Grip))


def motions_of(plan: Plan) -> list[Trajectory]:
    """The motions between the grips."""
    motions, moves = list[Trajectory](), list[Trajectory]()
    for step in (*plan.steps, None):
        if isinstance(step, Move):
            moves.append(step.trajectory)
        elif moves:
            motions.append(joined(moves))
            moves = []
    return motions


def test_changes_of_the_opening_are_actions_and_noise_is_not(
    recording: Recording, robot: Baxter
) -> None:
    """The hand begins wide open, closes to 20 %, trembles, and opens to 60 %.

    The arm moves by up to 0.12 rad meanwhile, which is within the tolerance.
    """
    rng, percent = np.random.default_rng(0), np.array(recording.gripper_percent)
    third = len(percent) // 3
    levels = np.repeat([100.0, 20.0, 60.0], [third, third, len(percent) - 2 * third])
    ramped = np.convolve(np.pad(levels, 10, mode="edge"), np.full(21, 1 / 21), mode="valid")
    percent[:, 0] = ramped + 0.1 * rng.normal(size=len(percent))
    given = evolve(recording, gripper_percent=percent)
    made = motion_from(given, "left", tolerance_rad=0.2, speed="fastest")
    grips = [step for step in made.plan if isinstance(step, Grip)]
    assert [grip.action for grip in grips] == [GripperAction.CLOSE, GripperAction.OPEN]
    stroke_m = Manipulator.of(robot, "left").hand.stroke_m
    assert grips[1].opening_m == pytest.approx(0.6 * stroke_m, abs=0.01 * stroke_m)


def test_the_plan_can_be_executed_and_recorded_again(recording: Recording) -> None:
    """Without its grips, which miss without the block; its recording, too, becomes a plan."""
    once = motion_from(recording, "left", tolerance_rad=TOLERANCE_RAD)
    bare = evolve(once.plan, steps=[step for step in once.plan if isinstance(step, Move)])
    again = planned_recording(bare)
    assert motion_from(again, "left", tolerance_rad=TOLERANCE_RAD).is_valid


def test_a_ratio_scales_the_recorded_time(recording: Recording) -> None:
    full, half = (
        motion_from(recording, "left", tolerance_rad=TOLERANCE_RAD, speed=speed)
        for speed in ("recorded", 0.5)
    )
    assert half.duration_s == pytest.approx(2.0 * full.duration_s)
    assert half.deviation_rad < full.deviation_rad


def test_an_arm_that_did_not_move_has_no_moves_at_the_fastest(recording: Recording) -> None:
    made = motion_from(recording, "right", tolerance_rad=TOLERANCE_RAD, speed="fastest")
    assert moves_of(made) == ()


def test_where_the_limits_forbid_the_speed_it_is_said_by_how_much(recording: Recording) -> None:
    """The fastest plan is offered; and a tolerance of the stated size would do."""
    made = motion_from(recording, "left", tolerance_rad=TOLERANCE_RAD, speed=2.0)
    assert not made.is_valid
    assert made.excess_rad == made.deviation_rad - TOLERANCE_RAD > 0.0
    assert made.fastest is not None
    assert made.fastest.is_valid
    assert made.fastest.excess_rad == 0.0
    assert made.fastest.duration_s < recording.duration_s
    wider = motion_from(recording, "left", tolerance_rad=1.01 * made.deviation_rad, speed=2.0)
    assert wider.is_valid


def test_a_failed_search_for_the_fastest_motion_does_not_blame_the_limits(robot: Baxter) -> None:
    """A joint jumps to and fro by 40 mrad every 50 ms, which 10 mrad do not allow to smooth."""
    times_s = np.arange(0.0, 2.0, 0.01)
    q = np.tile(World(robot).q, (len(times_s), 1))
    q[:, robot.joint_names.index("left_s0")] += 0.02 * (-1.0) ** (np.arange(len(q)) // 5)
    percent = np.full((len(q), 2), OPEN)
    given = Recording(robot.joint_names, times_s, q, percent, {}, {}, (), ())
    made = motion_from(given, "left", tolerance_rad=TOLERANCE_RAD, speed="fastest")
    assert made.fastest is None
    assert made.excess_rad > 0.0
    assert made.plan.failure is not None
    assert "no fastest motion was found" in made.plan.failure.reason
    assert "limits" not in made.plan.failure.reason


def boxed(name: str, place: Any) -> Body:
    return Body(name, (Part(Box((0.1, 0.1, 0.1)), at(0.0, 0.0, 0.0)),), place)


def test_with_a_scene_the_plan_is_certified_or_refused(
    recording: Recording, plan: Plan, left: Arm
) -> None:
    tip = left.T_base_tip(plan.moves[1].trajectory.q_goal)
    far, near = boxed("far", at(0.5, -0.9, 0.0)), boxed("near", tip)
    for body, is_clear in ((far, True), (near, False)):
        made = motion_from(recording, "left", tolerance_rad=TOLERANCE_RAD, scene=Scene.of([body]))
        assert made.certificate is not None
        assert made.certificate.is_valid == made.is_valid == is_clear


def test_what_stands_between_the_fingers_is_grasped(recording: Recording, plan: Plan) -> None:
    held = next(step.body for step in plan if isinstance(step, Grip) and step.body)
    for given, bodies in ((plan.start.scene, [held, held]), (None, [None, None])):
        made = motion_from(recording, "left", tolerance_rad=TOLERANCE_RAD, scene=given)
        assert [step.body for step in made.plan if isinstance(step, Grip)] == bodies


def gapped(recording: Recording) -> Recording:
    """Without the samples of 0.6 s in which the arm moves."""
    times_s = recording.times_s
    kept = (times_s < 0.1) | (times_s > 0.7)
    arrays = {name: getattr(recording, name)[kept] for name in ("times_s", "q", "gripper_percent")}
    return evolve(recording, **arrays, body_poses={}, moves=(), events=(), captions=())


def moving_while_closing(
    robot: Baxter, name: str, amount_rad: float, *, returns: bool
) -> Recording:
    """The gripper closes from 1 s to 2 s while a joint moves; it stands before and after that."""
    times_s = np.arange(0.0, 3.0, 0.01)
    share = np.clip(times_s - 1.0, 0.0, CLOSING_S) / CLOSING_S
    q = np.tile(World(robot).q, (len(times_s), 1))
    shape = np.sin(np.pi * share) ** 2 if returns else share
    q[:, robot.joint_names.index(name)] += amount_rad * shape
    percent = np.full((len(times_s), 2), OPEN)
    percent[:, 0] -= (OPEN - CLOSED) * share
    return Recording(robot.joint_names, times_s, q, percent, {}, {}, (), ())


@pytest.mark.parametrize("speed", ["recorded", "fastest"])
@pytest.mark.parametrize("returns", [True, False])
def test_an_arm_that_moves_while_its_gripper_acts_is_refused(
    robot: Baxter, speed: Any, returns: bool
) -> None:
    """The error names the joint, its distance and the time; within the tolerance it may move."""
    given = moving_while_closing(robot, "left_s0", 0.3, returns=returns)
    at_s = "1.50" if returns else "2.00"
    with pytest.raises(RecordingError, match=rf"left_s0 moved by 0.3 rad \(at {at_s} s\)"):
        motion_from(given, "left", tolerance_rad=TOLERANCE_RAD, speed=speed)
    slight = moving_while_closing(robot, "left_s0", 0.5 * TOLERANCE_RAD, returns=returns)
    assert motion_from(slight, "left", tolerance_rad=TOLERANCE_RAD).is_valid


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        ({"recording": "run.csv"}, RecordingError),
        ({"limb": "middle"}, UnknownNameError),
        ({"limb": None}, UnknownNameError),
        *(({"tolerance_rad": value}, RecordingError) for value in (0.0, -1.0, 0.6, np.nan, "0.1")),
        *(({"speed": value}, RecordingError) for value in ("slow", 0.0, 1e-3, 200.0, np.inf, None)),
        ({"scene": [1]}, RecordingError),
        ({"manipulator": "left"}, RecordingError),
    ],
)
def test_impossible_requests_are_refused(
    recording: Recording, changes: dict[str, Any], error: type[BaxterError]
) -> None:
    default: dict[str, Any] = {"recording": recording, "limb": "left", "tolerance_rad": 0.01}
    with pytest.raises(error):
        motion_from(**(default | changes))


def test_recordings_that_do_not_say_what_the_arm_did_are_refused(
    recording: Recording, robot: Baxter
) -> None:
    alone, gap = evolve(recording, limbs=("right",)), gapped(recording)
    right = Manipulator.of(robot, "right")
    for given, arm in ((alone, None), (gap, None), (recording, right)):
        with pytest.raises(RecordingError):
            motion_from(given, "left", tolerance_rad=TOLERANCE_RAD, manipulator=arm)


def test_a_recording_of_one_snapshot_is_refused(robot: Baxter) -> None:
    world = World(robot)
    recording = Recording(
        robot.joint_names, np.zeros(1), world.q[None], np.full((1, 2), 100.0), {}, {}, (), ()
    )
    with pytest.raises(RecordingError):
        motion_from(recording, "left", tolerance_rad=TOLERANCE_RAD)
