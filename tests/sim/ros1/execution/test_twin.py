"""Twin: observers get the plan's state as it is, then what is measured."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from planner import Body, Box, Part, Scene
from planner.scene.bodies import Attachment
from planner.state import State
from sim import EventKind, Observer, Recorder, World
from sim.errors import RecordingError
from sim.ros1.execution.twin import Twin
from tests.conftest import at
from tests.sim.runs import Witness


def cube(name: str, z: float) -> Body:
    return Body(name, (Part(Box((0.05,) * 3), at(0, 0, 0)),), at(0.7, 0.2, z), is_movable=True)


BASE, TOP, HANGING = cube("base", 0.1), cube("top", 0.15), cube("hanging", 0.4)


class Starts(Witness):
    def __init__(self) -> None:
        super().__init__()
        self.states: list[State] = []

    def on_start(self, state: State) -> None:
        assert not self.received
        self.states.append(state)


@pytest.fixture
def state(robot: Baxter) -> State:
    """The left hand holds a block; others hang in the air."""
    return evolve(
        World(robot).state,
        scene=Scene.of([TOP, BASE, HANGING, cube("held", -0.5)]),
        attachments=(Attachment("held", robot.arm("left").tip_frame, at(0, 0, 0.01)),),
    )


def test_observers_first_get_the_state_at_the_start(robot: Baxter, state: State) -> None:
    starts, recorder = Starts(), Recorder(robot)
    twin = Twin(robot, state, [starts, recorder])
    twin.begin()
    twin.put(twin.update, 0.0, {"left_s0": 0.1}, {}, "moving")
    twin.end()
    assert twin.error is None
    assert EventKind.SPAWNED not in starts.kinds
    assert starts.states[0].joints == state.joints
    assert [held.body for held in starts.states[0].attachments] == ["held"]
    recorded = recorder.recording()
    assert recorded.start is not None
    assert [held.body for held in recorded.start.attachments] == ["held"]
    assert set(recorded.body_poses) == set(state.scene.bodies)


@pytest.mark.parametrize("bodies", list(permutations([BASE, TOP, HANGING])))
def test_no_body_moves_in_whatever_order_they_are_listed(
    robot: Baxter, bodies: tuple[Body, ...]
) -> None:
    twin = Twin(robot, evolve(World(robot).state, scene=Scene.of(bodies)), [])
    for body in bodies:
        pose = twin.world.body(body.name).T_base_body
        assert np.array_equal(pose.homogeneous, body.T_base_body.homogeneous)
    assert twin.world.supports == {"top": ("base",)}


def test_nothing_is_reported_after_an_observer_has_failed(robot: Baxter, state: State) -> None:
    class Full(Observer):
        def on_start(self, state: State) -> None:  # noqa: ARG002
            raise RecordingError("no space left on the disk")

    witness = Witness()
    twin = Twin(robot, state, [Full(), witness])
    twin.begin()
    twin.put(twin.update, 0.0, {}, {}, "")
    twin.end()
    assert isinstance(twin.error, RecordingError)
    assert not witness.received
