"""Lights echo, buttons come up again, navigators show both."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.ros1.robot.parts.joint_order import BadOrderError
from sim.ros1.robot.parts.panel import INPUTS, NAVIGATORS, OUTPUTS, PRESS_S, PRESSABLE, Panel


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


def test_analog_signals() -> None:
    panel = Panel()
    panel.set_analog("torso_fan", 30)
    assert (panel.analog("torso_fan"), panel.analog("left_hand_range")) == (30.0, 65.535)


def test_the_wheel_turns_by_notches_and_begins_anew_after_a_byte() -> None:
    panel = Panel()
    for _ in range(258):
        panel.press("left", "wheel")
    assert (panel.wheel("left"), panel.wheel("right")) == (2, 0)
