from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from baxter_kin.hints import degrees_hint, millimetres_hint


def test_lengths_of_a_workcell_in_millimetres_are_asked_about() -> None:
    assert millimetres_hint(700.0, 150.0, -129.0) == (
        "; are these millimetres? Lengths are in metres: 700 mm is 0.7 m"
    )
    assert millimetres_hint(0.0, -50.0).endswith("-50 mm is -0.05 m")


@given(st.floats(-9.99, 9.99) | st.floats(min_value=1.01e4) | st.floats(max_value=-1.01e4))
def test_no_other_length_is(length: float) -> None:
    assert millimetres_hint(length) == millimetres_hint(0.0, length) == ""


def test_angles_in_degrees_are_asked_about() -> None:
    assert degrees_hint(0.0, -90.0) == (
        "; are these degrees? Angles are in radians: -90 deg is -1.571 rad"
    )
    assert degrees_hint(5.0, least=math.pi / 2).endswith("5 deg is 0.08727 rad")


@given(st.floats(-math.tau, math.tau) | st.floats(min_value=360.1) | st.floats(max_value=-360.1))
def test_no_other_angle_is(angle: float) -> None:
    assert degrees_hint(angle) == degrees_hint(0.0, angle) == ""
