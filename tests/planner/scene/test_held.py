"""What a hand holds, and what it cannot."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from baxter_kin.errors import PoseError, UnknownNameError
from planner.errors import SceneError
from planner.scene.held import Held
from tests.conftest import at


@pytest.mark.parametrize("pose", [None, np.eye(3), np.full((4, 4), np.nan)])
def test_a_body_cannot_be_held_at_no_pose(pose: Any) -> None:
    with pytest.raises(PoseError):
        Held("left", "block", pose)


@pytest.mark.parametrize("body", [None, 5])
def test_nothing_cannot_be_held(body: Any) -> None:
    with pytest.raises(SceneError):
        Held("left", body, at(0.0, 0.0, 0.0))


@pytest.mark.parametrize("side", ["middle", "", None, 5, ["left"]])
def test_only_the_robots_two_hands_hold(side: Any) -> None:
    with pytest.raises(UnknownNameError, match="use one of: left, right"):
        Held(side, "block", at(0.0, 0.0, 0.0))


def test_the_pose_does_not_follow_the_one_that_it_was_made_of() -> None:
    T = at(0.0, 0.0, 0.1)
    held = Held("left", "block", T)
    T.translation = np.ones(3)
    assert held.T_tip_body.translation.tolist() == [0.0, 0.0, 0.1]


def test_it_says_which_hand_holds_what() -> None:
    assert repr(Held("right", "cup", at(0.0, 0.0, 0.0))) == "Held(right hand, holds 'cup')"
