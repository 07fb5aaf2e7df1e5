"""What a hand holds."""

from __future__ import annotations

from dataclasses import dataclass

import pinocchio as pin

from baxter_kin.errors import UnknownNameError, expect, quoted
from baxter_kin.frames import checked_pose
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.value_objects import LONGEST_PART, OneLine
from planner.errors import SceneError


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Held(OneLine):
    """A body in a hand.

    Attributes:
        side: whose hand, "left" or "right".
        body: its name.
        T_tip_body: its pose seen from the tip of that arm.

    Raises:
        UnknownNameError: when there is no such side.
        SceneError: when the body has no name.
        PoseError: when the pose is not a valid one.
    """

    side: str
    body: str
    T_tip_body: pin.SE3

    def __post_init__(self) -> None:
        if not isinstance(self.side, str) or self.side not in LIMBS:
            raise UnknownNameError("limb", self.side, LIMBS)
        expect(self.body, str, "the name of a held body", SceneError)
        object.__setattr__(self, "T_tip_body", checked_pose(self.T_tip_body))

    def _facts(self) -> tuple[str, ...]:
        return f"{self.side} hand", f"holds {quoted(self.body, LONGEST_PART)}"
