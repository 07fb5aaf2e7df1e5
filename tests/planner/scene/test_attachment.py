"""What a hand holds, and what it cannot."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from baxter_kin.errors import PoseError
from planner.errors import SceneError
from planner.scene.attachment import Attachment
from tests.conftest import at


@pytest.mark.parametrize("pose", [None, np.eye(3), np.full((4, 4), np.nan)])
def test_a_body_cannot_be_held_at_no_pose(pose: Any) -> None:
    with pytest.raises(PoseError):
        Attachment("block", "left_gripper", pose)


@pytest.mark.parametrize("body", [None, 5])
def test_nothing_cannot_be_held(body: Any) -> None:
    with pytest.raises(SceneError):
        Attachment(body, "left_gripper", at(0.0, 0.0, 0.0))


@pytest.mark.parametrize("link", ["middle_gripper", "", "torso", None, 5, ["left"]])
def test_a_body_hangs_on_a_link_of_an_arm(link: Any) -> None:
    with pytest.raises(SceneError, match="link"):
        Attachment("block", link, at(0.0, 0.0, 0.0))


def test_the_pose_does_not_follow_the_one_that_it_was_made_of() -> None:
    T = at(0.0, 0.0, 0.1)
    held = Attachment("block", "left_gripper", T)
    T.translation = np.ones(3)
    assert held.T_link_body.translation.tolist() == [0.0, 0.0, 0.1]


def test_it_says_which_hand_holds_what() -> None:
    assert (
        repr(Attachment("cup", "right_gripper", at(0.0, 0.0, 0.0)))
        == "Attachment(right hand, holds 'cup')"
    )
