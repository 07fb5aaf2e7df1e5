"""Exceptions of this layer; the root is `baxter_kin.errors.BaxterError`.

```
BaxterError
└── PlannerError
    ├── SceneError          an invalid body, shape or name               (also ValueError)
    ├── TrajectoryError     an invalid motion or sample time             (also ValueError)
    ├── MotionError         no motion under the limits joins two states  (also ValueError)
    │   ├── StraightMoveError   a line that the arm cannot follow to its end
    │   ├── PathMoveError   a path that the arm cannot follow to its end
    │   └── FreeMoveError       an end that collides, or no path around the obstacles
    ├── ResponseError       an impossible response, or insufficient data (also ValueError)
    ├── TaskError           a pick or place that contradicts itself      (also ValueError)
    ├── PlanFileError       a plan that cannot be saved, or a bad file   (also ValueError)
    ├── BodyFileError       the robot's body: data missing or of another version (also ValueError)
    └── AtlasError          an invalid map: its grid, its files, or a query (also ValueError)
```

A task without a solution is a `Plan` that carries its reason, not an exception.
"""

from __future__ import annotations

from baxter_kin import BaxterError


class PlannerError(BaxterError):
    """Root of the planner's exceptions."""


class SceneError(PlannerError, ValueError):
    """An invalid body, shape or name in a scene."""


class TrajectoryError(PlannerError, ValueError):
    """An invalid motion, or a time outside it."""


class MotionError(PlannerError, ValueError):
    """Start and goal states that no motion under the limits can join."""


class StraightMoveError(MotionError):
    """A straight line that the arm cannot follow to its end.

    Attributes:
        fraction: of the line that it can follow, 0..1.
        reason: why it stops there, with names and numbers.
    """

    def __init__(self, fraction: float, reason: str) -> None:
        self.fraction = fraction
        self.reason = reason
        super().__init__(f"the straight line ends after {fraction:.1%} of the way: {reason}")


class PathMoveError(MotionError):
    """A path that the arm cannot follow to its end.

    Attributes:
        length_m: of the path up to the point that it cannot pass.
        reason: why it stops there.
    """

    def __init__(self, length_m: float, reason: str) -> None:
        self.length_m = length_m
        self.reason = reason
        super().__init__(f"the path ends after {1e3 * length_m:.0f} mm: {reason}")


class FreeMoveError(MotionError):
    """An end that collides, or no path around the obstacles; the message says which."""


class ResponseError(PlannerError, ValueError):
    """An impossible response to set-points, or measurements that do not determine it."""


class TaskError(PlannerError, ValueError):
    """A pick or place whose parts contradict each other."""


class PlanFileError(PlannerError, ValueError):
    """A plan that cannot be saved, or a file that contains none."""


class BodyFileError(PlannerError, ValueError):
    """The data file of the robot's body is missing, unreadable or of another version."""


class AtlasError(PlannerError, ValueError):
    """A map that cannot be built, read or queried: its grid, its files, or the query."""
