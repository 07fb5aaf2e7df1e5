"""The exercises of notebook 6: how far a lag leads, an arm's response, the order of joints."""

from __future__ import annotations

from typing import Any

import numpy as np

from baxter_kin.validation import FloatArray
from lessons.answers import Mistake, exercise, instance, number, numbers, refuse, stock_robot
from planner import Response

LAG_S, SPEED_DEG_S = 0.4, 45.0
"""An arm's lag, and how fast its joint turns."""

ARM = Response(lag_s=(0.35, 0.45), settled_error_rad=float(np.radians(0.1)), speed=0.25)
"""What is to be written down in the second exercise."""

NAMES = ("left_e0", "left_e1", "left_s0", "left_s1", "left_w0", "left_w1", "left_w2")
POSITIONS = (0.10, 1.20, -0.30, -0.80, 0.40, 1.00, 0.50)
"""What a joint state says of the left arm: names in alphabetical order, rad."""

READ_OFF = 5e-3
"""An answer may be rounded to so large a share of it."""


@exercise("set `answer` to an angle in radians, such as 0.1")
def check_lag(answer: Any) -> str:
    """How far a joint that turns at 45 degrees a second is behind, when it lags 0.4 s.

    Args:
        answer: rad.
    """
    given = number(answer, "one angle in radians")
    wanted = LAG_S * np.radians(SPEED_DEG_S)
    if abs(abs(given) - wanted) < READ_OFF * wanted:
        return f"the joint is {wanted:.3f} rad behind, {np.degrees(wanted):.0f} degrees"
    refuse(
        given,
        {
            "that is in degrees; angles are in radians everywhere": LAG_S * SPEED_DEG_S,
            "that is the speed; the joint is behind by what it turns in 0.4 s": (
                np.radians(SPEED_DEG_S)
            ),
            "that is speed over lag; it is speed times lag": np.radians(SPEED_DEG_S) / LAG_S,
            "that is with the lag in milliseconds; it is 0.4 s": 1e3 * wanted,
        },
        READ_OFF,
    )
    raise Mistake("multiply the speed in rad/s by the lag in s")


@exercise("set `answer` to a Response(...)")
def check_response(answer: Any) -> str:
    """An arm that is 350 to 450 ms late and settles within 0.1 degrees, at a quarter of the speed.

    Args:
        answer: a `Response`.
    """
    given = instance(answer, Response, "Response(lag_s=(...), ...)")
    if np.allclose(given.lag_s, 1e3 * ARM.lag_s):
        raise Mistake("lag_s is in seconds: 350 ms are 0.35")
    if np.allclose(given.settled_error_rad, np.degrees(ARM.settled_error_rad)):
        raise Mistake("settled_error_rad is in radians: 0.1 degrees are np.radians(0.1)")
    if not np.allclose(given.lag_s, ARM.lag_s, atol=1e-6):
        raise Mistake("lag_s should be the least and the greatest lag, (0.35, 0.45)")
    if not np.allclose(given.settled_error_rad, ARM.settled_error_rad, rtol=1e-2, atol=0.0):
        raise Mistake("settled_error_rad should be 0.1 degrees, in radians")
    if not np.isclose(given.speed, ARM.speed):
        raise Mistake(f"speed is a share of the plan's: a quarter is 0.25, not {given.speed:g}")
    if given.lead_s > 0.0:
        raise Mistake("nothing was said of a lead; leave lead_s out")
    return "this is what plan_pick_and_place and prove_tracking take as the arm's response"


@exercise("set `answer` to seven angles in the order of arm.joint_names")
def check_order(answer: Any) -> str:
    """The positions of a joint state, in the order of our joints.

    Args:
        answer: shape (7,), rad.
    """
    given = numbers(answer, 7, "seven joint angles in radians")
    order = stock_robot().arm("left").joint_names
    by_name = dict(zip(NAMES, POSITIONS, strict=True))
    wanted = np.array([by_name[name] for name in order])
    if np.allclose(given, wanted, atol=1e-6):
        return f"the order is {', '.join(order)}"
    refuse(given, _wrong_orders(wanted), READ_OFF)
    if np.allclose(np.sort(given), np.sort(wanted), atol=1e-6):
        wrong = order[int(np.argmax(given != wanted))]
        raise Mistake(f"these are the right angles, but {wrong} has another joint's")
    raise Mistake("these are not the angles of the message; look each up by its name")


def _wrong_orders(wanted: FloatArray) -> dict[str, FloatArray]:
    """What typical mistakes give, by the sentence about each."""
    return {
        "that is the order of the message, which is alphabetical; ours begins with s0": (
            np.array(POSITIONS)
        ),
        "these are in degrees; joints are in radians everywhere": np.degrees(wanted),
    }
