"""Answers as they may come: numbers, joint angles, results; what they are not is said at once."""

from __future__ import annotations

from functools import cache
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin import Arm, Baxter, IKResult
from baxter_kin.errors import quoted
from baxter_kin.validation import FloatArray
from sim.lessons.feedback import Mistake

T = TypeVar("T")

LEAST_DEGREES = 6.0
"""Joint angles are taken for degrees when the largest is above."""


@cache
def stock_robot() -> Baxter:
    """The robot of the notebooks."""
    return Baxter.load()


def number(answer: Any, what: str) -> float:
    """One finite number.

    Args:
        answer: what came.
        what: what is asked for, such as "a time in seconds".

    Raises:
        Mistake: when it is something else.
    """
    return float(numbers(answer, 1, what)[0])


def numbers(answer: Any, count: int, what: str) -> FloatArray:
    """So many finite numbers, shape (count,).

    Raises:
        Mistake: when it is something else; of a pose it says how to take its position.
    """
    if isinstance(answer, pin.SE3):
        raise Mistake(
            f"this should be {what}, and it is a whole pose, whose position is .translation"
        )
    if isinstance(answer, (str, bytes, bool)):
        raise Mistake(f"this should be {what}, and it is {quoted(answer)}")
    try:
        values = np.asarray(answer, dtype=float)
    except (TypeError, ValueError):
        raise Mistake(
            f"this should be {what}, and it is of class {type(answer).__name__}"
        ) from None
    if values.size != count:
        raise Mistake(f"this should be {what}, and it has the shape {values.shape}")
    if not np.isfinite(values).all():
        raise Mistake(f"this should be {what}, and it is {quoted(answer)}")
    return values.reshape(count)


def instance(answer: Any, kind: type[T], how: str) -> T:
    """The answer, if it is of a class.

    Args:
        answer: what came.
        kind: the class.
        how: what makes one, such as "plan_joint_move".

    Raises:
        Mistake: when it is of another class.
    """
    if not isinstance(answer, kind):
        raise Mistake(
            f"this should be a {kind.__name__}, as {how} gives it, and it is of class "
            f"{type(answer).__name__}"
        )
    return answer


def joint_angles(answer: Any, arm: Arm) -> FloatArray:
    """Seven angles inside the limits of an arm, rad; an `IKResult` counts as its `q`.

    Raises:
        Mistake: when it is something else, looks like degrees, or exceeds a limit.
    """
    if isinstance(answer, pin.SE3):
        raise Mistake("this is a pose of the tip; asked for are joint angles: ik.solve(pose).q")
    if isinstance(answer, IKResult) and not answer.is_valid:
        raise Mistake(f"this result is not valid, so its q does not count: {answer.failure}")
    q = numbers(answer.q if isinstance(answer, IKResult) else answer, 7, "seven joint angles")
    if np.abs(q).max() > LEAST_DEGREES:
        raise Mistake(
            "these angles look like degrees; joints are in radians everywhere: np.radians(...)"
        )
    for name, angle, low, high in zip(
        arm.joint_names, q, arm.limits.q_min, arm.limits.q_max, strict=True
    ):
        if not low - 1e-9 <= angle <= high + 1e-9:
            raise Mistake(
                f"{name} is at {angle:.3f} rad, and its limits are {low:.3f} and {high:.3f}; the "
                f"order of the joints is {', '.join(arm.joint_names)}"
            )
    return q


def shown(point: ArrayLike) -> str:
    """A point in a sentence: "(0.700, 0.100, -0.130)"."""
    return f"({', '.join(f'{part:.3f}' for part in np.asarray(point, dtype=float))})"
