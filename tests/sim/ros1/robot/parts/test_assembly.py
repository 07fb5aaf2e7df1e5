"""The robot as a whole: enabled, stopped, reset."""

from __future__ import annotations

import hypothesis.strategies as st
from hypothesis import given
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from sim.ros1.robot.parts.assembly import Assembly, AssemblyState, EStopButton, EStopSource


def test_begins_disabled_and_well() -> None:
    assert Assembly().state == AssemblyState(False, False, EStopButton(0), EStopSource(0))


def test_a_stop_lasts_until_it_is_reset() -> None:
    robot = Assembly()
    assert robot.enable(0.0, is_tucked=False) is None
    robot.stop()
    assert robot.state == AssemblyState(False, True, EStopButton(0), EStopSource(2))
    assert "reset it first" in str(robot.enable(0.0, is_tucked=False))
    assert robot.reset() is None
    assert robot.state == AssemblyState()
    assert robot.enable(0.0, is_tucked=False) is None


def test_no_reset_while_the_emergency_stop_is_pressed() -> None:
    robot = Assembly()
    robot.press()
    assert robot.state == AssemblyState(False, True, EStopButton(1), EStopSource(1))
    assert "release it first" in str(robot.reset())
    robot.stop()
    assert robot.state.button is EStopButton.PRESSED
    robot.release()
    assert robot.state == AssemblyState(False, True, EStopButton(3), EStopSource(1))
    assert robot.reset() is None
    assert robot.state == AssemblyState()


def test_tucked_arms_are_enabled_only_while_collision_avoidance_is_suppressed() -> None:
    robot = Assembly()
    assert "suppress_collision_avoidance" in str(robot.enable(10.0, is_tucked=True))
    robot.suppress_collision_avoidance(10.0)
    assert robot.enable(10.4, is_tucked=True) is None
    robot.disable()
    assert robot.enable(10.6, is_tucked=True) is not None


@given(st.booleans())
def test_releasing_what_is_not_pressed_changes_nothing(is_enabled: bool) -> None:
    robot = Assembly()
    if is_enabled:
        robot.enable(0.0, is_tucked=False)
    before = robot.state
    robot.release()
    assert robot.state == before


class AnyButtons(RuleBasedStateMachine):
    """Whatever is pressed and sent in whatever order."""

    def __init__(self) -> None:
        super().__init__()
        self.robot = Assembly()
        self.is_pressed = False

    @rule()
    def press(self) -> None:
        self.robot.press()
        self.is_pressed = True

    @rule()
    def release(self) -> None:
        self.robot.release()
        self.is_pressed = False

    @rule(order=st.sampled_from(["enable", "disable", "stop", "reset"]))
    def send(self, order: str) -> None:
        was_stopped = self.robot.state.is_stopped
        if order == "enable":
            self.robot.enable(0.0, is_tucked=False)
        else:
            getattr(self.robot, order)()
        if was_stopped and order != "reset":
            assert self.robot.state.is_stopped

    @invariant()
    def what_is_stopped_is_disabled(self) -> None:
        state = self.robot.state
        assert not (state.is_stopped and state.is_enabled)
        assert (state.button is EStopButton.PRESSED) == self.is_pressed
        assert state.is_stopped or state.source is EStopSource.NONE


TestAnyButtons = AnyButtons.TestCase
