"""Events and snapshots: what they refuse, and that they keep what they were given."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter
from planner import Body
from sim import Dwell, Event, EventKind, Observer, Outcome, SimulationError, Snapshot
from sim.events import JOINTS_OF_ROBOT
from sim.world import GripperState, Rest

OPEN = GripperState(100.0, is_gripping=False, has_missed=False)
BOTH = {"left": OPEN, "right": OPEN}


def test_only_appearing_and_disappearing_change_what_there_is() -> None:
    found = [kind for kind in EventKind if Event(0.0, kind, "").is_of_appearance]
    assert found == [EventKind.SPAWNED, EventKind.DELETED]


def test_events_are_equal_by_what_was_reported_not_by_the_facts_behind(block: Body) -> None:
    first = Event(1.0, EventKind.GRASPED, "block grasped", "left", body=block)
    fall = Rest(block.T_base_body, ("table",), 0.1)
    assert first == Event(1.0, EventKind.GRASPED, "block grasped", "left", detail=fall)
    assert first != Event(1.0, EventKind.GRASPED, "block grasped", "right", body=block)


VALID: dict[Any, dict[str, Any]] = {
    Event: {"time_s": 0.0, "kind": EventKind.ENABLED, "text": ""},
    Snapshot: {
        "time_s": 0.0,
        "q": np.zeros(19),
        "T_base_bodies": {},
        "grippers": BOTH,
        "caption": "",
    },
    Dwell: {},
    Outcome: {"failure": None, "duration_s": 1.0},
}


@pytest.mark.parametrize(
    ("cls", "field", "value"),
    [
        *((Event, "side", side) for side in ("middle", "", 5)),
        *((Event, "time_s", time_s) for time_s in (np.nan, np.inf, None)),
        (Event, "kind", "grasped"),
        (Event, "text", None),
        (Event, "body", "block"),
        (Event, "move", 3),
        (Event, "detail", "hit"),
        *((Snapshot, "q", q) for q in (np.zeros(7), np.zeros(18), np.full(19, np.nan), "q")),
        *((Dwell, name, -1e-9) for name in ("after_grasp_s", "after_release_s")),
        (Dwell, "after_grasp_s", None),
        (Outcome, "failure", 5),
        (Outcome, "duration_s", "long"),
        (Outcome, "hits", ["box"]),
    ],
)
def test_a_field_of_the_wrong_type_or_value_is_refused(cls: Any, field: str, value: Any) -> None:
    with pytest.raises(SimulationError, match=field):
        cls(**{**VALID[cls], field: value})


@pytest.mark.parametrize("joints", JOINTS_OF_ROBOT)
def test_a_snapshot_has_the_joints_of_a_robot_with_or_without_fingers(joints: int) -> None:
    assert Snapshot(0.0, np.zeros(joints), {}, BOTH, "").q.shape == (joints,)


def test_a_snapshot_keeps_its_configuration_when_the_callers_changes(robot: Baxter) -> None:
    q = np.array(robot.configuration())
    snapshot = Snapshot(0.0, q, {}, BOTH, "")
    before = snapshot.q.tolist()
    q += 1.0
    assert snapshot.q.tolist() == before
    with pytest.raises(ValueError, match="read-only"):
        snapshot.q[0] = 9.0


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_snapshot_names_the_gripper_that_it_lacks(robot: Baxter, side: str) -> None:
    others = {name: state for name, state in BOTH.items() if name != side}
    with pytest.raises(SimulationError, match=f"the grippers lack {side}"):
        Snapshot(0.0, robot.configuration(), {}, others, "")


def test_an_observer_that_overrides_nothing_is_silent(robot: Baxter) -> None:
    observer = Observer()
    observer.on_event(Event(0.0, EventKind.ENABLED, "robot enabled"))
    observer.on_snapshot(Snapshot(0.0, robot.configuration(), {}, BOTH, ""))
    assert repr(observer) == "Observer()"


def test_a_snapshot_keeps_what_it_was_given_whatever_becomes_of_that() -> None:
    grippers = dict.fromkeys(("left", "right"), GripperState(100.0, False, False))
    poses = {"block": pin.SE3.Identity()}
    snapshot = Snapshot(0.0, np.zeros(19), poses, grippers, "")
    del poses["block"], grippers["left"]
    assert list(snapshot.T_base_bodies) == ["block"]
    assert list(snapshot.grippers) == ["left", "right"]
