"""What this layer raises; the root is `baxter_kin.errors.BaxterError`.

```
BaxterError
└── PlannerError
    ├── SceneError          a body, shape or name that makes no sense    (also ValueError)
    ├── TrajectoryError     a motion that is none, or a bad sample time  (also ValueError)
    ├── MotionError         states that no motion under the limits joins (also ValueError)
    │   ├── StraightMoveError   a line that the arm cannot follow to its end
    │   └── FreeMoveError       an end that collides, or no way around what is between
    ├── TaskError           a pick or place that contradicts itself      (also ValueError)
    ├── PlanFileError       a plan that cannot be saved, or a bad file   (also ValueError)
    └── BodyFileError       the robot's body: data missing or of another version (also ValueError)
```

A task without a solution is a `Plan` that carries its reason, not an exception.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import islice
from typing import TypeVar

from baxter_kin import BaxterError
from baxter_kin.errors import expect

T = TypeVar("T")

MOST_READ = 1_000_000
"""How many things a sequence may have: what never ends is found out with some megabytes."""


class PlannerError(BaxterError):
    """Root of what the planner raises."""


class SceneError(PlannerError, ValueError):
    """A body, shape or name that makes no sense in a scene."""


class TrajectoryError(PlannerError, ValueError):
    """Numbers that are no motion, or a time outside it."""


class MotionError(PlannerError, ValueError):
    """Start and goal states that no motion under the limits can join."""


class StraightMoveError(MotionError):
    """A straight line that the arm cannot follow to its end.

    Attributes:
        fraction: how much of the line it can follow, 0..1.
        reason: why no further, with names and numbers.
    """

    def __init__(self, fraction: float, reason: str) -> None:
        self.fraction = fraction
        self.reason = reason
        super().__init__(f"the straight line ends after {fraction:.1%} of the way: {reason}")


class FreeMoveError(MotionError):
    """An end that collides, or no way around what is between them; one sentence says which."""


class TaskError(PlannerError, ValueError):
    """A pick or place whose parts contradict each other."""


class PlanFileError(PlannerError, ValueError):
    """A plan that cannot be saved, or a file that holds none."""


def expect_all(values: object, kind: type[T], what: str, error: type[BaxterError]) -> tuple[T, ...]:
    """All `values`, known to be of that class.

    Raises:
        BaxterError: of class `error`, when they are no sequence, one is of another class, or they
            are more than `MOST_READ`.
    """
    if isinstance(values, (str, bytes, Mapping)) or not isinstance(values, Iterable):
        raise error(f"{what} must be a sequence, got {type(values).__name__}")
    first = islice(values, MOST_READ + 1)
    checked = tuple(expect(value, kind, f"each of {what}", error) for value in first)
    if len(checked) > MOST_READ:
        raise error(f"{what} are more than {MOST_READ}, or never end; give fewer")
    return checked


class BodyFileError(PlannerError, ValueError):
    """The data file of the robot's body is missing, unreadable or of another version."""
