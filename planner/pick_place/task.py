"""PickAndPlace: what goes where, and the poses that lead the tip there and away."""

from __future__ import annotations

from dataclasses import dataclass

import pinocchio as pin

from baxter_kin.errors import BaxterError, expect, millimetres_hint
from baxter_kin.frames import checked_pose, raised
from baxter_kin.validation import positive_scalar
from baxter_kin.value_objects import OneLine, phrase, position
from planner.errors import TaskError
from planner.scene.bodies import FARTHEST_M


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PickAndPlace(OneLine):
    """One pick and one place.

    Attributes:
        body: name of the body to carry.
        T_base_pick: tip pose when the fingers close.
        T_base_place: tip pose when they open again.
        hover_m: height above the place where the arm ends, above zero.
        clear_m: height above pick and place from which it may move sideways, above zero; the hover
            distance where that is less.

    Raises:
        TaskError: when `body` is no name, or a height is not a number above zero, or beyond
            `FARTHEST_M`.
        PoseError: when a pose is not a valid one.
    """

    body: str
    T_base_pick: pin.SE3
    T_base_place: pin.SE3
    hover_m: float = 0.15
    clear_m: float = 0.05

    def __post_init__(self) -> None:
        expect(self.body, str, "name of the body", TaskError)
        checked_height_m(self.hover_m, "hover distance", TaskError)
        checked_height_m(self.clear_m, "clear height", TaskError)
        for name in ("T_base_pick", "T_base_place"):
            object.__setattr__(self, name, checked_pose(getattr(self, name)))

    @property
    def lift_m(self) -> float:
        """How far straight up from pick and place the tip is before it may move sideways."""
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
        """Where the cycle ends."""
        return raised(self.T_base_place, self.hover_m)

    def _facts(self) -> tuple[str, ...]:
        way = f"from {position(self.T_base_pick)} to {position(self.T_base_place)}"
        return phrase(self.body), way, f"hover {self.hover_m:g} m"


def checked_height_m(value: object, what: str, error: type[BaxterError]) -> float:
    """How far the tip is to rise, if that can be: above zero, and not beyond `FARTHEST_M`.

    Raises:
        BaxterError: of class `error`, when it is not.
    """
    height_m = positive_scalar(value, what, error)
    if height_m > FARTHEST_M:
        hint = millimetres_hint(height_m)
        raise error(f"{what} must be at most {FARTHEST_M:g} m, got {height_m:g}{hint}")
    return height_m
