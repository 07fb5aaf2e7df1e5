from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin.fields import evolve
from planner import Body
from sim.events import Event, EventKind
from sim.recording.recording import Recording
from sim.view.gripper_status import GripperMood, GripperStatus, gripper_timelines


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
def test_positions_tell_what_the_fingers_do(percents: tuple[float, ...], words: str) -> None:
    assert status_after(*percents).phases["left"].words == words


@pytest.mark.parametrize(("side", "name"), [("left", "block"), ("right", "pads")])
def test_hand_and_body_are_those_of_the_event_until_it_opens(
    block: Body, side: str, name: str
) -> None:
    """Whatever its text says, and whichever fingers moved last."""
    status = status_after(100.0, 60.0, side="right")
    status.on_event(event_of(EventKind.GRASPED, side, evolve(block, name=name)))
    status.on_percents({side: 59.0})
    assert status.phases[side].words == f"holding {name}"
    assert [phase.is_holding for phase in status.phases.values()].count(True) == 1


def test_a_miss_is_told_until_the_hand_opens() -> None:
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


def test_what_came_before_a_cut_recording_is_not_told(executed: Recording) -> None:
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
