"""What the panel shows: joints against limits, waypoints, the state of grippers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from baxter_kin.validation import FloatArray
from planner import Body, tilt_of
from sim import Workbench
from sim.events import Event, EventKind
from sim.recording.recording import Recording
from sim.view.panel import (
    MAX_ROWS,
    POSITION_STEP,
    ROW_TOLERANCE,
    GripperMood,
    GripperStatus,
    gripper_timelines,
    key_rows,
    moving_arms,
    recorded_arms,
    recorded_bounds,
    waypoints,
)

SINGLE = 1e-6
"""What is left of a number of the recording's size in 32 bits."""


def rows_of(arm: dict[str, Any], name: str) -> FloatArray:
    return np.asarray(arm[name], dtype=np.float64).reshape(-1, 7)


@pytest.fixture(scope="module")
def arm(executed: Recording, robot: Baxter) -> dict[str, Any]:
    """The only arm that moves."""
    assert moving_arms(executed) == ("left",)
    arms = recorded_arms(executed, robot)
    assert list(arms) == ["left"]
    return arms["left"]


def test_the_tilt_of_what_is_kept_upright_is_shown_against_its_limit(robot: Baxter) -> None:
    bench = Workbench(robot)
    bench.add_block("red", 0.70, 0.25)
    task = bench.carry("red", to=(0.70, -0.08), arm="left", upright_deg=3.0)
    assert task.is_done, task
    assert task.plan is not None
    (bound,) = recorded_bounds(bench.recording(), robot)
    assert bound["kind"] == "tilt"
    assert len(bound["spans"]) == sum(bool(move.claims) for move in task.plan.moves)
    greatest = max(span["values"].max() for span in bound["spans"])
    assert {span["limit"] for span in bound["spans"]} == {np.radians(3.0)}
    assert greatest <= np.radians(3.0)
    assert greatest == pytest.approx(tilt_of(task.plan), rel=0.02)


def test_arms_at_rest_have_no_curves(executed: Recording, robot: Baxter) -> None:
    still = evolve(executed, q=np.tile(executed.q[0], (len(executed.q), 1)), moves=())
    assert recorded_arms(still, robot) == {}


def test_rows_are_those_of_the_recording_at_increasing_times(
    arm: dict[str, Any], executed: Recording
) -> None:
    times = np.asarray(arm["times"], dtype=np.float64)
    assert times[[0, -1]] == pytest.approx([0.0, executed.duration_s], abs=SINGLE)
    assert (np.diff(times) > 0.0).all()
    index = [executed.joint_names.index(name) for name in arm["joints"]]
    at = np.abs(executed.times_s[None] - executed.times_s[0] - times[:, None])
    shared = at.min(axis=1) < SINGLE
    assert shared.sum() > 20
    off = np.abs(rows_of(arm, "q") - executed.q[at.argmin(axis=1)][:, index])[shared]
    assert off.max() <= POSITION_STEP / 2 + SINGLE


@pytest.mark.parametrize("name", ["q", "v", "a"])
def test_peaks_are_kept_and_rows_left_out_lie_between_those_kept(
    arm: dict[str, Any], executed: Recording, name: str
) -> None:
    motion = executed.motion("left", with_knots=True)
    values, rows = getattr(motion, name), rows_of(arm, name)
    if name != "q":
        peaks, kept = np.abs(values).max(axis=0), np.abs(rows).max(axis=0)
        assert np.abs(kept - peaks).max() <= 4 * POSITION_STEP + SINGLE
    scale = {"q": np.subtract(arm["q_max"], arm["q_min"]), "v": arm["v_max"], "a": arm["a_max"]}
    times = np.asarray(arm["times"], dtype=np.float64)
    at = motion.times_s - executed.times_s[0]
    between = np.column_stack([np.interp(at, times, column) for column in rows.T])
    off = np.abs(between - values)[at <= executed.duration_s] / scale[name]
    assert off.max() <= ROW_TOLERANCE + 16 * POSITION_STEP


def test_limits_are_those_that_the_moves_were_planned_with(
    arm: dict[str, Any], executed: Recording
) -> None:
    assert (np.abs(rows_of(arm, "a")) <= np.array(arm["a_max"]) + 8 * POSITION_STEP).all()
    assert arm["v_max"] == executed.moves[0].trajectory.limits.v_max.tolist()


def test_a_long_recording_has_no_more_rows_than_allowed(robot: Baxter, executed: Recording) -> None:
    rng, n = np.random.default_rng(0), 4000
    q = np.tile(executed.q[0], (n, 1))
    index = [executed.joint_names.index(name) for name in robot.arm("left").joint_names]
    q[:, index] += np.cumsum(rng.normal(0.0, 1e-3, (n, 7)), axis=0)
    times = np.array([0.01 * row for row in range(n)])
    long = Recording(executed.joint_names, times, q, np.zeros((n, 2)), {}, {}, (), ())
    arm = recorded_arms(long, robot)["left"]
    assert len(arm["times"]) <= MAX_ROWS
    motion = long.motion("left")
    rows = key_rows(motion, arm)
    for values in (motion.v, motion.a):
        assert np.abs(values[rows]).max(axis=0) == pytest.approx(np.abs(values).max(axis=0))


def waypoints_of(recording: Recording) -> list[dict[str, Any]]:
    return waypoints(recording.moves, *recording.times_s[[0, -1]].tolist())


def test_each_move_has_a_waypoint_with_its_result_of_inverse_kinematics(
    executed: Recording,
) -> None:
    listed = waypoints_of(executed)
    assert [each["label"] for each in listed] == [move.label for move in executed.moves]
    ends = [min(move.end_s, float(executed.times_s[-1])) for move in executed.moves]
    assert [each["end"] for each in listed] == pytest.approx(ends)
    for waypoint, move in zip(listed, executed.moves, strict=True):
        if move.ik is None:
            assert waypoint["position_error_m"] is None
            assert waypoint["seed"] == ""
        else:
            assert waypoint["position_error_m"] == move.ik.position_error_m
            assert waypoint["orientation_error_rad"] == move.ik.orientation_error_rad
            assert waypoint["seed"] == move.move.seed_label


def test_a_move_that_was_cut_off_ends_with_the_recording(executed: Recording) -> None:
    half = np.flatnonzero(executed.times_s > executed.moves[2].start_s)[1]
    cut = evolve(
        executed,
        times_s=executed.times_s[:half],
        q=executed.q[:half],
        gripper_percent=executed.gripper_percent[:half],
        body_poses={name: poses[:half] for name, poses in executed.body_poses.items()},
        moves=executed.moves[:3],
    )
    assert waypoints_of(cut)[-1]["end"] == pytest.approx(cut.duration_s)


def event_of(kind: EventKind, side: str | None = "left", body: Body | None = None) -> Event:
    return Event(0.0, kind, "the right pads hold block 2", side, body=body)


def status_after(*percents: float, side: str = "left") -> GripperStatus:
    """The status of a gripper that was at these positions, the other one closed."""
    status = GripperStatus()
    other = {"left": "right", "right": "left"}[side]
    for percent in percents:
        status.on_percents({side: percent, other: 0.0})
    return status


@pytest.mark.parametrize(
    ("percents", "words"),
    [
        ((100.0,), "open"),
        ((0.0,), "closed"),
        ((40.0,), "40 % open"),
        ((100.0, 90.0), "closing"),
        ((0.0, 10.0), "opening"),
        ((90.0, 100.0, 100.0), "open"),
    ],
)
def test_positions_determine_the_phase_of_empty_hands(
    percents: tuple[float, ...], words: str
) -> None:
    assert status_after(*percents).phases["left"].words == words


@pytest.mark.parametrize(("side", "name"), [("left", "block"), ("right", "pads")])
def test_an_event_gives_the_held_body_until_the_hand_opens(
    block: Body, side: str, name: str
) -> None:
    """Whatever its text says, and whichever fingers moved last."""
    status = status_after(100.0, 60.0, side="right")
    status.on_event(event_of(EventKind.GRASPED, side, evolve(block, name=name)))
    status.on_percents({side: 59.0})
    assert status.phases[side].words == f"holding {name}"
    assert [phase.is_holding for phase in status.phases.values()].count(True) == 1


def test_a_miss_is_shown_until_the_hand_opens() -> None:
    status = status_after(100.0, 10.0)
    status.on_event(event_of(EventKind.MISSED))
    for _ in range(2):
        status.on_percents({"left": 0.0, "right": 0.0})
    assert status.phases["left"].mood is GripperMood.MISSED
    status.on_percents({"left": 5.0, "right": 0.0})
    assert status.phases["left"].words == "opening"


def test_one_hand_lets_go_while_the_other_holds(block: Body) -> None:
    status = status_after(100.0, 60.0)
    status.on_event(event_of(EventKind.GRASPED, body=block))
    status.on_percents({"left": 60.0, "right": 60.0})
    status.on_event(event_of(EventKind.GRASPED, "right", evolve(block, name="block 2")))
    status.on_event(event_of(EventKind.RELEASED, body=block))
    assert status.phases["left"].words == "opening"
    assert status.phases["right"].words == "holding block 2"


def test_an_event_of_no_side_changes_nothing(block: Body) -> None:
    """Files of earlier versions have such events."""
    status = status_after(100.0, 60.0)
    status.on_event(event_of(EventKind.GRASPED, None, block))
    assert status.phases["left"].words == "closing"


def test_the_timelines_of_a_pick_and_place(executed: Recording) -> None:
    timelines = gripper_timelines(executed)
    assert [phase.words for _, phase in timelines["left"]] == [
        "open",
        "closing",
        "holding block",
        "opening",
        "open",
    ]
    assert [phase.words for _, phase in timelines["right"]] == ["open"]


def test_events_before_a_cut_recording_have_no_effect(executed: Recording) -> None:
    grasped = next(event for event in executed.events if event.kind is EventKind.GRASPED)
    rows = executed.times_s > grasped.time_s
    cut = evolve(
        executed,
        times_s=executed.times_s[rows],
        q=executed.q[rows],
        gripper_percent=executed.gripper_percent[rows],
        body_poses={name: poses[rows] for name, poses in executed.body_poses.items()},
    )
    words = [phase.words for _, phase in gripper_timelines(cut)["left"]]
    assert words[1:] == ["opening", "open"]


def test_a_grasp_at_the_last_time_is_in_the_timeline(executed: Recording, block: Body) -> None:
    end_s = float(executed.times_s[-1])
    grasp = evolve(event_of(EventKind.GRASPED, body=block), time_s=end_s)
    last_s, phase = gripper_timelines(evolve(executed, events=(*executed.events, grasp)))["left"][
        -1
    ]
    assert (last_s, phase.is_holding) == (end_s, True)


def without_left_fingers(recording: Recording) -> Recording:
    """The same motion of a robot that has a tool, such as a pen, on its left flange."""
    kept = [i for i, name in enumerate(recording.joint_names) if not name.startswith("l_gripper")]
    names = tuple(recording.joint_names[i] for i in kept)
    return evolve(recording, joint_names=names, q=recording.q[:, kept], robot=None, events=())


def test_a_hand_without_fingers_or_not_recorded_has_no_status(executed: Recording) -> None:
    timelines = gripper_timelines(without_left_fingers(executed))
    assert timelines["left"] == []
    assert [phase.words for _, phase in timelines["right"]] == ["open"]
    assert gripper_timelines(evolve(executed, limbs=("left",)))["right"] == []


@given(st.lists(st.floats(-0.04, 0.04), min_size=1, max_size=50))
def test_a_resting_real_gripper_does_not_move(noise: list[float]) -> None:
    status = GripperStatus()
    for each in noise:
        status.on_percents({"left": 50.3 + each})
        assert status.phases["left"].words == "50 % open"


@pytest.mark.parametrize(("step", "words"), [(0.03, "opening"), (-0.03, "closing")])
def test_slow_motion_is_motion(step: float, words: str) -> None:
    status = GripperStatus()
    for i in range(100):
        status.on_percents({"left": 50.0 + step * i})
        assert i < 5 or status.phases["left"].words == words
