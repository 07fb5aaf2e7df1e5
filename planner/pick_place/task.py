"""PickAndPlace, the task; PlanRequest, the arm, the scene and the requirements of a plan.

```
pick    open - approach - descend - close - retract
place   approach - descend - open - retract
```
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import pinocchio as pin

from baxter_kin.display import millimetres_hint, phrase, position
from baxter_kin.errors import BaxterError
from baxter_kin.fields import field, frozen
from baxter_kin.frames import checked_pose, raised
from baxter_kin.validation import FloatArray, positive_scalar
from planner.errors import TaskError
from planner.manipulator import Manipulator
from planner.motion.straight_line import DEFAULT_TOLERANCE, LineTolerance
from planner.scene.bodies import MAX_DISTANCE_M, Attachment, Scene

PICK_LINES = ("pick: descend", "pick: close", "pick: retract")
"""Stages on the line of the pick, in order."""

PLACE_LINES = ("place: descend", "place: open", "place: retract")
"""Stages on the line of the place, in order."""

SIDEWAYS = ("pick: approach", "place: approach")
"""Stages in which the tip is free; in the other moves it follows lines."""

STAGES = ("pick: open", SIDEWAYS[0], *PICK_LINES, SIDEWAYS[1], *PLACE_LINES)
"""All stages, in order."""

MOVES = tuple(each for each in STAGES if each not in ("pick: open", "pick: close", "place: open"))
"""All stages in which the arm moves, in order."""

DEFAULT_HOVER_M = 0.15
"""Height above the place where the arm ends; the original demo's hover distance."""

DEFAULT_CLEAR_M = 0.05
"""Height above pick and place from which the arm may move sideways: a third of that."""


def checked_height_m(value: object, what: str, error: type[BaxterError]) -> float:
    """A height above zero, at most `MAX_DISTANCE_M`; raises `error` otherwise."""
    height_m = positive_scalar(value, what, error)
    if height_m > MAX_DISTANCE_M:
        hint = millimetres_hint(height_m)
        raise error(f"{what} must be at most {MAX_DISTANCE_M:g} m, got {height_m:g}{hint}")
    return height_m


@frozen(error=TaskError)
class PickAndPlace:
    """One pick and one place.

    Attributes:
        body: name of the body to carry.
        T_base_pick: pose of the tip when the fingers close.
        T_base_place: pose of the tip when they open again.
        hover_m: height above the place where the arm ends, above zero.
        clear_m: height above pick and place from which the arm may move sideways, above zero; at
            most the hover distance counts.

    Raises:
        TaskError: when `body` is not a name, or a height is not a number above zero, or above
            `MAX_DISTANCE_M`.
        PoseError: when a pose is invalid.
    """

    body: str
    T_base_pick: pin.SE3 = field(converter=checked_pose)
    T_base_place: pin.SE3 = field(converter=checked_pose)
    hover_m: float = field(
        default=DEFAULT_HOVER_M,
        converter=partial(checked_height_m, what="hover distance", error=TaskError),
    )
    clear_m: float = field(
        default=DEFAULT_CLEAR_M,
        converter=partial(checked_height_m, what="clear height", error=TaskError),
    )

    @property
    def lift_m(self) -> float:
        """Height of the straight lines above pick and place."""
        return min(self.clear_m, self.hover_m)

    @property
    def T_base_above_pick(self) -> pin.SE3:
        """Where sideways motion begins after the pick, and ends before it."""
        return raised(self.T_base_pick, self.lift_m)

    @property
    def T_base_above_place(self) -> pin.SE3:
        """The same above the place."""
        return raised(self.T_base_place, self.lift_m)

    @property
    def T_base_end(self) -> pin.SE3:
        """Pose at the end of the cycle."""
        return raised(self.T_base_place, self.hover_m)

    def _facts(self) -> tuple[str, ...]:
        way = f"from {position(self.T_base_pick)} to {position(self.T_base_place)}"
        return phrase(self.body), way, f"hover {self.hover_m:g} m"


@dataclass(frozen=True, slots=True, eq=False)
class PlanRequest:
    """The arm, its surroundings, and the requirements of a plan; the planning functions check them.

    Attributes:
        manipulator: the arm and its hand, which is empty.
        scene: all bodies.
        q_start: initial configuration of the arm, within its limits, shape (7,), rad.
        margin_m: distance that everything keeps at all times, except for intended contacts, the
            hand from what it grasps, and links up to two joints apart.
        held: what the other hand holds.
        line_tolerance: maximum deviation of the tip from its straight lines.
    """

    manipulator: Manipulator
    scene: Scene
    q_start: FloatArray
    margin_m: float = 0.0
    held: tuple[Attachment, ...] = ()
    line_tolerance: LineTolerance = DEFAULT_TOLERANCE
