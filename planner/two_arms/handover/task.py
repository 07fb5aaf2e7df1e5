"""Handover, the task, and what each arm does in it.

```
giver   open - approach - descend - close - retract - carry - (wait) - open - retreat
taker   open - (wait) - approach - reach - close - (wait) - carry - descend - open - retract
```

The giver holds the body still in the air. The taker's hand approaches along its own axis and closes
on the body; then the giver's hand opens and retreats along its axis. So the task of each arm by
itself is a pick and place with one end in the air.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import pinocchio as pin

from baxter_kin.display import phrase, position
from baxter_kin.errors import UnknownNameError
from baxter_kin.fields import field, frozen
from baxter_kin.frames import checked_pose
from baxter_kin.kinematics.arm import LIMBS, other_than
from baxter_kin.validation import finite_array
from planner.errors import TaskError
from planner.pick_place.task import (
    DEFAULT_CLEAR_M,
    DEFAULT_HOVER_M,
    DOWN,
    TOOL,
    Leg,
    Line,
    PickAndPlace,
    checked_height_m,
    inwards,
    outwards,
)

DEFAULT_REACH_M = 0.08
"""Length of the lines along the axes of the hands in the air: the fingers, and some clearance."""


def _pose_or_none(value: object) -> pin.SE3 | None:
    return None if value is None else checked_pose(value)


def _point_or_none(value: Any) -> tuple[float, ...] | None:
    if value is None:
        return None
    point = finite_array(value, (3,), "where a body is handed over", TaskError)
    return tuple(point.tolist())


@frozen(error=TaskError)
class Handover:
    """A body that one arm picks up, hands over in the air, and the other arm puts down.

    Attributes:
        body: its name.
        T_base_goal: its final pose in base.
        giver: the arm that picks it up, "left" or "right".
        T_body_giver: pose of the giver's tip that grasps it, seen from the body; chosen when None.
        T_body_taker: pose of the taker's tip, likewise.
        where: position of the body's frame in base when it is handed over, shape (3,), m; that of
            the shortest motions that are found when None.
        reach_m: length of the lines along which the taker's hand comes to the body, and the giver's
            leaves it, above zero.
        hover_m: height above the place where the taker ends, above zero.
        clear_m: height above pick and place from which the arms may move sideways, above zero.

    Raises:
        UnknownNameError: when `giver` is no arm.
        TaskError: when another value is invalid.
        PoseError: when a pose is invalid.
    """

    body: str
    T_base_goal: pin.SE3 = field(converter=checked_pose)
    giver: str = LIMBS[0]
    T_body_giver: pin.SE3 | None = field(default=None, converter=_pose_or_none)
    T_body_taker: pin.SE3 | None = field(default=None, converter=_pose_or_none)
    where: tuple[float, ...] | None = field(default=None, converter=_point_or_none)
    reach_m: float = field(
        default=DEFAULT_REACH_M,
        converter=partial(checked_height_m, what="length of the lines", error=TaskError),
    )
    hover_m: float = field(
        default=DEFAULT_HOVER_M,
        converter=partial(checked_height_m, what="hover distance", error=TaskError),
    )
    clear_m: float = field(
        default=DEFAULT_CLEAR_M,
        converter=partial(checked_height_m, what="clear height", error=TaskError),
    )

    def __attrs_post_init__(self) -> None:
        if self.giver not in LIMBS:
            raise UnknownNameError("limb", self.giver, LIMBS)

    @property
    def taker(self) -> str:
        """The arm that puts the body down."""
        return other_than(self.giver)

    def _facts(self) -> tuple[str, ...]:
        goal = f"to {position(self.T_base_goal)}"
        return phrase(self.body), f"from the {self.giver} to the {self.taker} hand", goal


@frozen(error=TaskError)
class Giving(PickAndPlace):
    """What the giver does: the place is in the air, and the other hand holds the body there.

    Attributes:
        reach_m: length of the line away from there.
    """

    reach_m: float = field(default=DEFAULT_REACH_M, kw_only=True)

    @property
    def legs(self) -> tuple[Leg, ...]:
        """The motions of the giver, in order."""
        down, back = (Line(DOWN, self.clear_m),), (Line(TOOL, self.reach_m),)
        pick, place = self.T_base_pick, self.T_base_place
        return (
            *inwards(("pick: approach", "pick: descend"), pick, down),
            *outwards("pick: retract", pick, (down[0].reversed(),), rests=False),
            Leg("place: approach", "place: approach", place, rests=True),
            *outwards("place: retract", place, back, rests=True),
        )


@frozen(error=TaskError)
class Taking(PickAndPlace):
    """What the taker does: the pick is in the air, and the arm moves freely from there.

    Attributes:
        reach_m: length of the line to there.
    """

    reach_m: float = field(default=DEFAULT_REACH_M, kw_only=True)

    @property
    def legs(self) -> tuple[Leg, ...]:
        """The motions of the taker, in order."""
        down, hover = (Line(DOWN, min(self.clear_m, self.hover_m)),), (Line(DOWN, self.hover_m),)
        pick, place = self.T_base_pick, self.T_base_place
        return (
            *inwards(("pick: approach", "pick: descend"), pick, (Line(TOOL, self.reach_m),)),
            *inwards(("place: approach", "place: descend"), place, down),
            *outwards("place: retract", place, (hover[0].reversed(),), rests=True),
        )
