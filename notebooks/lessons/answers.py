"""Answers to exercises: how they are read, and the feedback on them.

A check takes an answer and returns `Feedback`: right, or one sentence on what to correct.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from functools import cache, wraps
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin import Arm, Baxter, BaxterError, IKResult
from baxter_kin.display import quoted
from baxter_kin.validation import FloatArray

T = TypeVar("T")

MIN_DEGREES = 6.0
"""Joint angles are taken for degrees when the largest is above this."""


class Verdict(str, Enum):
    """How an answer is judged."""

    RIGHT = "Right"
    WRONG = "Not yet"
    OPEN = "Not answered yet"


@dataclass(frozen=True, slots=True, repr=False)
class Feedback:
    """The judgement of an answer, shown as a sentence.

    Attributes:
        verdict: right, not yet, or not answered yet.
        text: what is right, what to mend, or what to give.
    """

    verdict: Verdict
    text: str

    @property
    def is_right(self) -> bool:
        """Whether the exercise is solved."""
        return self.verdict is Verdict.RIGHT

    def __str__(self) -> str:
        return f"{self.verdict.value}: {self.text}"

    def __repr__(self) -> str:
        return str(self)


class Mistake(Exception):  # noqa: N818 - the learner's, not the program's
    """What is wrong with an answer, in one sentence."""


def exercise(wanted: str) -> Callable[[Callable[[Any], str]], Callable[[Any], Feedback]]:
    """Make a check of a function that returns what is right about an answer or raises `Mistake`.

    An answer that is still `...` or None, or a sequence of these, is not judged.

    Args:
        wanted: what to give, as an imperative: "set answer to one number, in rad".
    """

    def as_check(judge: Callable[[Any], str]) -> Callable[[Any], Feedback]:
        @wraps(judge)
        def check(answer: Any) -> Feedback:
            if _is_open(answer):
                return Feedback(Verdict.OPEN, f"{wanted}.")
            try:
                return Feedback(Verdict.RIGHT, judge(answer))
            except (Mistake, BaxterError) as found:
                return Feedback(Verdict.WRONG, f"{str(found).rstrip('.')}.")

        check.__annotations__ = {"answer": "Any", "return": "Feedback"}
        return check

    return as_check


def refuse(answer: ArrayLike, mistakes: Mapping[str, ArrayLike], tolerance: float) -> None:
    """Raise the sentence of the first typical mistake that leads to an answer.

    Args:
        answer: one or more numbers.
        mistakes: what a mistake leads to, by the sentence about it.
        tolerance: how near the answer must be to it, as a share of its largest number.
    """
    for sentence, outcome in mistakes.items():
        wrong = np.asarray(outcome, dtype=float)
        if np.shape(answer) == wrong.shape:
            near = tolerance * max(1e-3, float(np.abs(wrong).max()))
            if np.allclose(answer, wrong, rtol=0.0, atol=near):
                raise Mistake(sentence)


def _is_open(answer: object) -> bool:
    if isinstance(answer, (list, tuple)):
        return any(part is ... or part is None for part in answer)
    return answer is ... or answer is None


@cache
def stock_robot() -> Baxter:
    """The robot of the notebooks."""
    return Baxter.load()


def number(answer: Any, what: str) -> float:
    """The answer as one finite number.

    Args:
        answer: as it was given.
        what: what is asked for, such as "a time in seconds".
    """
    return float(numbers(answer, 1, what)[0])


def numbers(answer: Any, count: int, what: str) -> FloatArray:
    """The answer as finite numbers, shape (count,)."""
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
    """The answer as an instance of a class.

    Args:
        answer: as it was given.
        kind: the class.
        how: what makes one, such as "plan_joint_move".
    """
    if not isinstance(answer, kind):
        raise Mistake(
            f"this should be a {kind.__name__}, as {how} gives it, and it is of class "
            f"{type(answer).__name__}"
        )
    return answer


def joint_angles(answer: Any, arm: Arm) -> FloatArray:
    """The answer, which may be an `IKResult`, as angles inside the limits of an arm, rad."""
    if isinstance(answer, pin.SE3):
        raise Mistake("this is a pose of the tip; asked for are joint angles: ik.solve(pose).q")
    if isinstance(answer, IKResult) and not answer.is_valid:
        raise Mistake(f"this result is not valid, so its q does not count: {answer.failure}")
    q = numbers(answer.q if isinstance(answer, IKResult) else answer, 7, "seven joint angles")
    if np.abs(q).max() > MIN_DEGREES:
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
    """A point as text: "(0.700, 0.100, -0.130)"."""
    return f"({', '.join(f'{part:.3f}' for part in np.asarray(point, dtype=float))})"
