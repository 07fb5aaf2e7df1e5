from __future__ import annotations

from dataclasses import replace

import pytest

from planner import Body
from sim.events import Event, EventKind
from sim.gripper_story import GripperMood, GripperStory, gripper_timelines
from sim.recording import Recording


def told(kind: EventKind, text: str, time_s: float = 0.0) -> Event:
    return Event(time_s, kind, text)


def story_of(*percents: float, side: str = "left") -> GripperStory:
    """What is told of a gripper that was seen at those positions, the other one closed."""
    story = GripperStory(["block", "block 2"])
    other = {"left": "right", "right": "left"}[side]
    for percent in percents:
        story.see({side: percent, other: 0.0})
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
def test_the_hand_that_closed_has_grasped(side: str) -> None:
    story = story_of(100.0, 60.0, side=side)
    story.hear(told(EventKind.GRASPED, "block grasped, 40 mm between the pads"))
    assert story.phases[side].words == "holding block"
    assert [phase.is_holding for phase in story.phases.values()].count(True) == 1


def test_it_holds_on_while_the_fingers_settle() -> None:
    story = story_of(100.0, 60.0)
    story.hear(told(EventKind.GRASPED, "block grasped"))
    story.see({"left": 59.0, "right": 0.0})
    assert story.phases["left"].mood is GripperMood.HOLDING


def test_the_longest_name_in_the_text_is_meant() -> None:
    story = story_of(100.0, 60.0)
    story.hear(told(EventKind.GRASPED, "block 2 grasped"))
    assert story.phases["left"].words == "holding block 2"


def test_a_body_that_appears_is_known_by_name(block: Body) -> None:
    story = GripperStory()
    story.hear(Event(0.0, EventKind.SPAWNED, "block spawned", body=block))
    story.hear(told(EventKind.GRASPED, "block grasped"))
    assert story.phases["left"].words == "holding block"


def test_a_miss_is_told_until_the_hand_opens() -> None:
    story = story_of(100.0, 10.0)
    story.hear(told(EventKind.MISSED, "missed: the fingers closed fully"))
    story.see({"left": 0.0, "right": 0.0})
    story.see({"left": 0.0, "right": 0.0})
    assert story.phases["left"].mood is GripperMood.MISSED
    story.see({"left": 5.0, "right": 0.0})
    assert story.phases["left"].words == "opening"


def test_the_hand_that_holds_the_body_releases_it() -> None:
    story = story_of(100.0, 60.0)
    story.hear(told(EventKind.GRASPED, "block grasped"))
    story.see({"left": 60.0, "right": 100.0})
    story.see({"left": 60.0, "right": 60.0})
    story.hear(told(EventKind.GRASPED, "block 2 grasped"))
    story.hear(told(EventKind.RELEASED, "block released"))
    assert story.phases["left"].words == "opening"
    assert story.phases["right"].words == "holding block 2"


def test_the_timeline_of_a_pick_and_place_reads_as_it_should(executed: Recording) -> None:
    words = [phase.words for _, phase in gripper_timelines(executed)["left"]]
    assert words == ["open", "closing", "holding block", "opening", "open"]


def test_what_came_before_a_cut_recording_is_not_told(executed: Recording) -> None:
    grasped = next(event for event in executed.events if event.kind is EventKind.GRASPED)
    rows = executed.times_s > grasped.time_s
    cut = replace(
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
