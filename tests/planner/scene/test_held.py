"""What a hand holds, and what it cannot."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from baxter_kin import PoseError
from planner import SceneError
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
