"""What a check says of an answer: right, not yet, or not answered."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from functools import wraps
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin.errors import BaxterError
from baxter_kin.value_objects import OneLine


class Verdict(str, Enum):
    """How an answer is judged."""

    RIGHT = "Right"
    WRONG = "Not yet"
    OPEN = "Not answered yet"


@dataclass(frozen=True, slots=True, repr=False)
class Feedback(OneLine):
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
    """Make a check of a function that returns what is right about an answer, or raises `Mistake`.

    An answer that is still `...` or None, or a sequence of these, is not judged.

    Args:
        wanted: what the answer has to be, as an order: "set answer to one number, in rad".
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
    """Name a typical mistake.

    Args:
        answer: one or more numbers.
        mistakes: what a mistake leads to, by the sentence about it.
        tolerance: how near the answer must be to it, as a share of its largest number.

    Raises:
        Mistake: with the sentence of the first that fits.
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
