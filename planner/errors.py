"""What this layer raises; the root is `baxter_kin.errors.BaxterError`.

```
BaxterError
└── PlannerError
    ├── SceneError          a body, shape or name that makes no sense    (also ValueError)
    ├── TrajectoryError     a motion that is none, or a bad sample time  (also ValueError)
    ├── MotionError         states that no motion under the limits joins (also ValueError)
    │   ├── StraightMoveError   a line that the arm cannot follow to its end
    │   └── FreeMoveError       an end that collides, or no way around what is between
    ├── ResponseError       a response that no arm has, or data that tell none (also ValueError)
    ├── TaskError           a pick or place that contradicts itself      (also ValueError)
    ├── PlanFileError       a plan that cannot be saved, or a bad file   (also ValueError)
    └── BodyFileError       the robot's body: data missing or of another version (also ValueError)
```

A task without a solution is a `Plan` that carries its reason, not an exception.
"""

from __future__ import annotations

from baxter_kin import BaxterError


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


class ResponseError(PlannerError, ValueError):
    """A response to set-points that no arm has, or measurements that tell none."""


class TaskError(PlannerError, ValueError):
    """A pick or place whose parts contradict each other."""


class PlanFileError(PlannerError, ValueError):
    """A plan that cannot be saved, or a file that holds none."""


class BodyFileError(PlannerError, ValueError):
    """The data file of the robot's body is missing, unreadable or of another version."""


class AtlasError(PlannerError, ValueError):
    """A map that cannot be built, read or asked: its grid, its files, or what is asked of it."""
