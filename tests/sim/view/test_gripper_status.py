from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin.fields import evolve
from planner import Body
from sim.events import Event, EventKind
from sim.recording.recording import Recording
from sim.view.gripper_status import GripperMood, GripperStatus, gripper_timelines


def told(kind: EventKind, side: str | None = "left", body: Body | None = None) -> Event:
    return Event(0.0, kind, "the right pads hold block 2", side, body=body)


def named(block: Body, name: str) -> Body:
    return evolve(block, name=name)


def story_of(*percents: float, side: str = "left") -> GripperStatus:
    """What is told of a gripper that was seen at those positions, the other one closed."""
    story = GripperStatus()
    other = {"left": "right", "right": "left"}[side]
    for percent in percents:
        story.on_percents({side: percent, other: 0.0})
    return story


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
    assert story_of(*percents).phases["left"].words == words


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("name", ["block", "pads", "the right"])
def test_hand_and_body_are_those_of_the_event(block: Body, side: str, name: str) -> None:
    """Whatever its text says, and whichever fingers moved last."""
    story = story_of(100.0, 60.0, side="right")
    story.on_event(told(EventKind.GRASPED, side, named(block, name)))
    assert story.phases[side].words == f"holding {name}"
    assert [phase.is_holding for phase in story.phases.values()].count(True) == 1


def test_it_holds_on_while_the_fingers_settle(block: Body) -> None:
    story = story_of(100.0, 60.0)
    story.on_event(told(EventKind.GRASPED, body=block))
    story.on_percents({"left": 59.0, "right": 0.0})
    assert story.phases["left"].mood is GripperMood.HOLDING


def test_a_miss_is_told_until_the_hand_opens() -> None:
    story = story_of(100.0, 10.0)
    story.on_event(told(EventKind.MISSED))
    story.on_percents({"left": 0.0, "right": 0.0})
    story.on_percents({"left": 0.0, "right": 0.0})
    assert story.phases["left"].mood is GripperMood.MISSED
    story.on_percents({"left": 5.0, "right": 0.0})
    assert story.phases["left"].words == "opening"


def test_one_hand_lets_go_while_the_other_holds(block: Body) -> None:
    story = story_of(100.0, 60.0)
    story.on_event(told(EventKind.GRASPED, body=block))
    story.on_percents({"left": 60.0, "right": 60.0})
    story.on_event(told(EventKind.GRASPED, "right", named(block, "block 2")))
    story.on_event(told(EventKind.RELEASED, body=block))
    assert story.phases["left"].words == "opening"
    assert story.phases["right"].words == "holding block 2"


def test_an_event_of_no_side_tells_nothing(block: Body) -> None:
    """As of recordings that kept none."""
    story = story_of(100.0, 60.0)
    story.on_event(told(EventKind.GRASPED, None, block))
    assert story.phases["left"].words == "closing"


def test_the_timeline_of_a_pick_and_place_reads_as_it_should(executed: Recording) -> None:
    words = [phase.words for _, phase in gripper_timelines(executed)["left"]]
    assert words == ["open", "closing", "holding block", "opening", "open"]


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


def test_the_other_hand_has_nothing_to_tell(executed: Recording) -> None:
    assert [phase.words for _, phase in gripper_timelines(executed)["right"]] == ["open"]


def without_left_fingers(recording: Recording) -> Recording:
    """The same motion of a robot that has a tool, such as a pen, on its left flange."""
    kept = [i for i, name in enumerate(recording.joint_names) if not name.startswith("l_gripper")]
    names = tuple(recording.joint_names[i] for i in kept)
    return evolve(recording, joint_names=names, q=recording.q[:, kept], robot=None, events=())


def test_a_hand_without_fingers_has_no_gripper_status(executed: Recording) -> None:
    timelines = gripper_timelines(without_left_fingers(executed))
    assert timelines["left"] == []
    assert [phase.words for _, phase in timelines["right"]] == ["open"]


def test_an_arm_that_was_not_recorded_has_no_gripper_status(executed: Recording) -> None:
    left_alone = evolve(executed, limbs=("left",))
    assert gripper_timelines(left_alone)["right"] == []


@given(st.lists(st.floats(-0.04, 0.04), min_size=1, max_size=50))
def test_a_resting_real_gripper_does_not_move(noise: list[float]) -> None:
    story = GripperStatus()
    for each in noise:
        story.on_percents({"left": 50.3 + each})
        assert story.phases["left"].words == "50 % open"


@pytest.mark.parametrize(("step", "words"), [(0.03, "opening"), (-0.03, "closing")])
def test_slow_motion_is_motion(step: float, words: str) -> None:
    story = GripperStatus()
    for i in range(100):
        story.on_percents({"left": 50.0 + step * i})
        assert i < 5 or story.phases["left"].words == words


def test_a_grasp_at_the_last_time_is_in_the_timeline(executed: Recording, block: Body) -> None:
    end_s = float(executed.times_s[-1])
    grasp = evolve(told(EventKind.GRASPED, body=block), time_s=end_s)
    phases = gripper_timelines(evolve(executed, events=(*executed.events, grasp)))["left"]
    assert phases[-1][0] == end_s
    assert phases[-1][1].is_holding
