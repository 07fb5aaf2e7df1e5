"""Buttons, lights, the head, and the robot as a whole: enabled, stopped, reset."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from sim.ros1.robot.arm_motion import BadOrderError
from sim.ros1.robot.panel import (
    INPUTS,
    NAVIGATORS,
    OUTPUTS,
    PRESS_S,
    PRESSABLE,
    Assembly,
    AssemblyState,
    EStopButton,
    EStopSource,
    Head,
    Panel,
)


@given(st.lists(st.tuples(st.sampled_from(OUTPUTS), st.booleans())))
def test_outputs_echo_what_they_were_told_last(orders: list[tuple[str, bool]]) -> None:
    panel = Panel()
    for name, is_on in orders:
        panel.set_output(name, is_on)
    told = dict(orders)
    assert {name: panel.is_on(name) for name in OUTPUTS} == {
        name: told.get(name, False) for name in OUTPUTS
    }


def test_a_navigator_shows_its_own_lights() -> None:
    panel = Panel()
    panel.set_output("torso_left_outer_light", True)
    assert panel.lights("torso_left") == [False, True]
    assert all(panel.lights(other) == [False, False] for other in NAVIGATORS if other[0] != "t")


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("button", [name for name in PRESSABLE if name != "wheel"])
def test_a_button_is_pressed_for_a_moment(side: str, button: str) -> None:
    panel = Panel()
    panel.press(side, button)
    pressed = [panel.buttons(side).index(True)] if any(panel.buttons(side)) else []
    assert pressed == {"ok": [0], "cancel": [1], "show": [2]}.get(button, [])
    cuffs = {"cuff": "lower_cuff", "circle": "lower_button", "dash": "upper_button"}
    assert [name for name in INPUTS if panel.is_on(name)] == [
        f"{side}_{name}" for which, name in cuffs.items() if which == button
    ]
    assert not any(panel.buttons("right" if side == "left" else "left"))
    for _ in range(round(PRESS_S / 0.01) + 1):
        panel.step(0.01)
    assert not any(panel.buttons(side))
    assert not any(panel.is_on(name) for name in INPUTS)


def test_what_is_no_output_is_refused_by_name() -> None:
    panel = Panel()
    with pytest.raises(BadOrderError, match="'left_lower_cuff' is an input"):
        panel.set_output("left_lower_cuff", True)
    with pytest.raises(BadOrderError, match="'kitchen_light' is no digital output"):
        panel.set_output("kitchen_light", True)
    with pytest.raises(BadOrderError, match="no button 'left' 'teapot'"):
        panel.press("left", "teapot")
    with pytest.raises(BadOrderError, match="no analog output"):
        panel.set_analog("left_hand_range", 1)
    with pytest.raises(BadOrderError, match="finite"):
        panel.set_analog("torso_fan", math.inf)


def test_the_wheel_turns_by_notches_and_begins_anew_after_a_byte() -> None:
    panel = Panel()
    for _ in range(258):
        panel.press("left", "wheel")
    assert (panel.wheel("left"), panel.wheel("right")) == (2, 0)
    panel.set_analog("torso_fan", 30)
    assert (panel.analog("torso_fan"), panel.analog("left_hand_range")) == (30.0, 65.535)


@given(st.floats(-1.3963, 1.3963), st.integers(1, 100))
def test_is_a_first_order_element_of_a_fifth_of_a_second(angle: float, ticks: int) -> None:
    head = Head()
    head.pan(angle)
    for _ in range(ticks):
        head.step(0.01)
    assert head.pan_rad == pytest.approx(angle * (1 - math.exp(-ticks * 0.05)), abs=1e-12)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_never_looks_farther_than_its_joint_turns(angle: float) -> None:
    head = Head()
    head.pan(angle)
    head.step(10.0)
    assert abs(head.pan_rad) <= 1.3963
    assert not head.is_turning


def test_a_nod_takes_a_second_and_no_other_begins_meanwhile() -> None:
    head = Head()
    head.nod()
    seen = []
    for _ in range(150):
        seen.append(head.is_nodding)
        head.step(0.01)
        if head.is_nodding:
            head.nod()
    assert sum(seen) == pytest.approx(100, abs=1)
    assert not head.is_nodding


def test_refuses_an_angle_that_is_no_number_and_holds_on() -> None:
    head = Head()
    with pytest.raises(BadOrderError, match="got nan"):
        head.pan(math.nan)
    head.pan(1.0)
    head.step(0.1)
    head.hold()
    before = head.pan_rad
    head.step(5.0)
    assert head.pan_rad == before


def test_a_stop_lasts_until_it_is_reset() -> None:
    robot = Assembly()
    assert robot.state == AssemblyState(False, False, EStopButton(0), EStopSource(0))
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
