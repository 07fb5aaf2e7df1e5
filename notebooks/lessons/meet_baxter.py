"""The exercises of notebook 1: a joint's range, a point in three frames, a velocity of the tip."""

from __future__ import annotations

from typing import Any

import numpy as np

from baxter_kin.frames import T_world_base
from baxter_kin.validation import FloatArray
from lessons.answers import Mistake, exercise, number, numbers, refuse, stock_robot

CUP_WORLD = (0.80, 0.20, 0.75)
"""The cup, in world, m."""

RISE_M_S = 0.05
"""How fast the tip is to rise."""

READ_OFF = 3e-3
"""An answer may be rounded to so large a share of it."""

LARGEST_MISS = 1e-3
"""How far the tip's velocity may be off, m/s and rad/s."""


@exercise("set `answer` to an angle in radians, such as 0.5")
def check_bend(answer: Any) -> str:
    """How far the left elbow can bend from neutral: the highest angle of e1 less the neutral one.

    Args:
        answer: rad.
    """
    arm = stock_robot().arm("left")
    given = number(answer, "one angle in radians")
    room = dict(zip(arm.joint_names, arm.limits.q_max - arm.neutral, strict=True))
    wanted = room.pop("left_e1")
    if abs(given - wanted) < READ_OFF * wanted:
        return f"left_e1 can bend by {wanted:.3f} rad more, {np.degrees(wanted):.0f} degrees"
    elbow = arm.joint_names.index("left_e1")
    refuse(
        given,
        {
            "that is in degrees; angles are in radians everywhere": np.degrees(wanted),
            "that is the way to the lowest angle, and e1 bends towards its highest": (
                arm.neutral[elbow] - arm.limits.q_min[elbow]
            ),
            "that is the highest angle itself; take off where e1 is in neutral": (
                arm.limits.q_max[elbow]
            ),
            "the sign is the other way round: highest less neutral": -wanted,
        }
        | {f"that is the range of {name}, not of left_e1": angle for name, angle in room.items()},
        READ_OFF,
    )
    raise Mistake(
        "take arm.limits.q_max and arm.neutral at the place of left_e1 in arm.joint_names"
    )


@exercise("set `answer` to three numbers in metres, such as (0.1, 0.2, 0.3)")
def check_cup(answer: Any) -> str:
    """Where the left tip sees the cup, the arm in neutral.

    Args:
        answer: shape (3,), x, y, z, m, in the frame of the tip.
    """
    given = numbers(answer, 3, "a point, three numbers in metres")
    cup = np.array(CUP_WORLD)
    T_base_tip = stock_robot().arm("left").T_base_tip(stock_robot().arm("left").neutral)
    T_world_tip = T_world_base() * T_base_tip
    wanted = T_world_tip.actInv(cup)
    if np.abs(given - wanted).max() < LARGEST_MISS:
        return f"the tip sees the cup {wanted[2]:.3f} m ahead of it, along its z axis"
    refuse(
        given,
        {
            "that is in millimetres; lengths are in metres": 1e3 * wanted,
            "that is where world sees it": cup,
            "that is where base sees it; one more step leads to the tip": T_world_base().actInv(
                cup
            ),
            "T_world_tip was used the wrong way: it leads from tip to world, so take its inverse": (
                T_world_tip.act(cup)
            ),
            "the cup was given in world, and this takes it as if it were given in base": (
                T_base_tip.actInv(cup)
            ),
            "world and base are the wrong way round: base is 0.93 m above world, so seen from base "
            "the cup is lower, not higher": T_base_tip.actInv(T_world_base().act(cup)),
            "that is the way from tip to cup, but still along the axes of base; turn it into the "
            "tip's": cup - T_world_tip.translation,
            "that is seen from the tip of the right hand": _seen_from_the_right(cup),
        },
        READ_OFF,
    )
    raise Mistake(
        f"that is {np.linalg.norm(given - wanted):.3f} m off; inner names cancel: T_tip_world is "
        "the inverse of T_world_base * T_base_tip"
    )


@exercise("set `answer` to seven joint velocities in rad/s, one for each of `arm.joint_names`")
def check_rise(answer: Any) -> str:
    """Joint velocities that raise the left tip at 5 cm/s without turning it, the arm in neutral.

    Args:
        answer: shape (7,), rad/s; any that do it, for one motion is left over.
    """
    arm = stock_robot().arm("left")
    if np.size(answer) == 6:
        raise Mistake(
            "six numbers are a velocity of the tip; asked for are those of the seven joints"
        )
    v = numbers(answer, 7, "seven joint velocities in rad/s")
    J, wanted = arm.jacobian(arm.neutral), np.array([0.0, 0.0, RISE_M_S, 0.0, 0.0, 0.0])
    twist = J @ v
    if np.abs(twist - wanted).max() < LARGEST_MISS:
        too_fast = np.abs(v) > arm.limits.v_max
        if too_fast.any():
            name = arm.joint_names[int(np.argmax(too_fast))]
            raise Mistake(f"the tip rises as wanted, but {name} is faster than its limit")
        return f"the tip rises at {100 * twist[2]:.2f} cm/s, and no joint is faster than " + (
            f"{np.abs(v).max():.3f} rad/s"
        )
    refuse(twist, _wrong_twists(wanted, arm.T_base_tip(arm.neutral).rotation), READ_OFF)
    if np.abs(J @ v[::-1] - wanted).max() < LARGEST_MISS:
        raise Mistake(f"the joints are in the wrong order; it is {', '.join(arm.joint_names)}")
    if np.abs((twist - wanted)[:3]).max() < LARGEST_MISS:
        turn = np.linalg.norm(twist[3:])
        raise Mistake(
            f"the tip rises at 5 cm/s, but turns at {turn:.3f} rad/s: the last three must be 0"
        )
    moves = ", ".join(f"{100 * part:.2f}" for part in twist[:3])
    turns = ", ".join(f"{part:.3f}" for part in twist[3:])
    raise Mistake(f"the tip moves at ({moves}) cm/s in base and turns at ({turns}) rad/s")


def _seen_from_the_right(point_world: FloatArray) -> FloatArray:
    arm = stock_robot().arm("right")
    seen: FloatArray = (T_world_base() * arm.T_base_tip(arm.neutral)).actInv(point_world)
    return seen


def _wrong_twists(wanted: FloatArray, R_base_tip: FloatArray) -> dict[str, FloatArray]:
    """What typical mistakes do with the tip, by the sentence about each."""
    return {
        "that is in degrees per second; joints turn in radians per second": np.degrees(wanted),
        "the tip rises 100 times too fast: 5 cm/s are 0.05 m/s": 100.0 * wanted,
        "the tip rises 1,000 times too fast: 50 mm/s are 0.05 m/s": 1000.0 * wanted,
        "the tip sinks; z points up": -wanted,
        "the tip turns about z and stays where it is: linear comes first, then angular": (
            np.roll(wanted, 3)
        ),
        "the tip moves along its own z axis; the Jacobian has the axes of base": np.append(
            RISE_M_S * R_base_tip[:, 2], np.zeros(3)
        ),
    }
