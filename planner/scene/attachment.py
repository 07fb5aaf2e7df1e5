"""What hangs on what: a body in a hand."""

from __future__ import annotations

from dataclasses import dataclass

import pinocchio as pin

from baxter_kin.display import MAX_PART, OneLine, quoted
from baxter_kin.frames import checked_pose
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import expect
from planner.errors import SceneError


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Attachment(OneLine):
    """A body that moves with a link, such as one in a hand.

    Attributes:
        body: its name.
        link: the link of an arm that it moves with, such as "left_gripper", the tip of that arm.
        T_link_body: its pose seen from that link.

    Raises:
        SceneError: when the body has no name, or the link is not one of an arm.
        PoseError: when the pose is not a valid one.
    """

    body: str
    link: str
    T_link_body: pin.SE3

    def __post_init__(self) -> None:
        expect(self.body, str, "the name of an attached body", SceneError)
        if expect(self.link, str, "link", SceneError).split("_")[0] not in LIMBS:
            raise SceneError(
                f"{quoted(self.body)} cannot hang on {quoted(self.link)}; it must be a link of an "
                "arm, such as 'left_gripper'"
            )
        object.__setattr__(self, "T_link_body", checked_pose(self.T_link_body))

    @property
    def side(self) -> str:
        """Whose hand it is in, "left" or "right"."""
        return self.link.split("_")[0]

    def _facts(self) -> tuple[str, ...]:
        return f"{self.side} hand", f"holds {quoted(self.body, MAX_PART)}"
