from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.errors import UnknownNameError
from planner import Body
from sim.errors import ViewerError
from sim.view.live.tip_target import TipTarget
from sim.view.live.viewer import Viewer

POSE = (0.7, 0.2, 0.1, math.pi, 0.0, 0.0)
TOO_FAR = (1.6, 0.2, 0.1, math.pi, 0.0, 0.0)
REACHED = 1e-6
"""What IK promises, in m and as parts of a rotation matrix."""


class WatchedViewer(Viewer):
    """Remembers what it was told to show."""

    captions: list[str]
    seeds: list[str]
    bodies: list[Body]

    def __init__(self, robot: Baxter) -> None:
        self.captions, self.seeds, self.bodies = [], [], []
        super().__init__(robot)

    def add_body(self, body: Body) -> None:
        self.bodies.append(body)
        super().add_body(body)

    def show(self, q: Any, T_base_bodies: Any, caption: str = "", **more: Any) -> None:
        self.captions.append(caption)
        self.seeds.append(more.get("seed", ""))
        super().show(q, T_base_bodies, caption, **more)


@pytest.fixture
def viewer(robot: Baxter) -> Iterator[WatchedViewer]:
    viewer = WatchedViewer(robot)
    with viewer:
        yield viewer


def tip_shown(viewer: Viewer, robot: Baxter, side: str) -> Any:
    arm = robot.arm(side)
    return arm.T_base_tip(viewer.q[list(robot.indices(arm.joint_names))])


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_arm_shown_follows_the_target(viewer: WatchedViewer, robot: Baxter, side: str) -> None:
    target = TipTarget(viewer, robot, side)
    sign = 1.0 if side == "left" else -1.0
    assert target.set(0.7, sign * 0.2, 0.1, math.pi, 0.0, 0.3).is_valid
    shown = tip_shown(viewer, robot, side)
    assert np.abs(shown.homogeneous - target.T_base_target.homogeneous).max() < REACHED


def test_it_begins_at_the_tip_and_turns_about_the_fixed_axes_of_base(
    viewer: WatchedViewer, robot: Baxter
) -> None:
    target = TipTarget(viewer, robot, "left")
    assert target.T_base_target.isApprox(tip_shown(viewer, robot, "left"), 1e-12)
    target.set(0.7, 0.2, 0.1, math.pi, 0.0, math.pi / 2)
    assert target.T_base_target.rotation[:, 0] == pytest.approx([0.0, 1.0, 0.0], abs=1e-12)


def test_out_of_reach_the_arm_stays_the_axes_are_red_and_the_caption_has_the_reason(
    viewer: WatchedViewer, robot: Baxter
) -> None:
    target = TipTarget(viewer, robot, "left")
    assert [len({part.rgba for part in body.parts}) for body in viewer.bodies] == [3]
    target.set(*POSE)
    assert viewer.captions[-1] == "left tip at its target"
    assert viewer.seeds[-1] == "Current Joint Angles"
    before = viewer.q
    assert not target.set(*TOO_FAR).is_valid
    assert np.array_equal(viewer.q, before)
    assert "out of reach" in viewer.captions[-1]
    assert len({part.rgba for part in viewer.bodies[-1].parts}) == 1


def test_both_arms_have_targets_of_their_own(viewer: WatchedViewer, robot: Baxter) -> None:
    left, right = TipTarget(viewer, robot, "left"), TipTarget(viewer, robot, "right")
    left.set(*POSE)
    right.set(0.7, -0.2, 0.1, math.pi, 0.0, 0.0)
    shown = tip_shown(viewer, robot, "left")
    assert np.abs(shown.translation - POSE[:3]).max() < REACHED


def test_sliders_begin_at_the_tip_and_move_the_target_until_it_is_removed(
    viewer: WatchedViewer, robot: Baxter
) -> None:
    target = TipTarget(viewer, robot, "left")
    sliders = target.sliders().children
    position = [slider.value for slider in sliders[:3]]
    assert target.T_base_target.translation == pytest.approx(position)
    sliders[2].value += 0.1
    assert target.T_base_target.translation[2] == pytest.approx(sliders[2].value)
    assert target.result is not None
    target.remove()
    with pytest.raises(ViewerError, match="left target"):
        target.remove()


def test_missing_ipywidgets_is_a_clear_error(
    viewer: WatchedViewer, robot: Baxter, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "ipywidgets", None)
    with pytest.raises(ViewerError, match="pip install ipywidgets"):
        TipTarget(viewer, robot, "left").sliders()


def test_wrong_arguments_are_refused(viewer: WatchedViewer, robot: Baxter) -> None:
    wrong: Any
    for wrong in (None, 5, "left", ()):
        with pytest.raises(ViewerError):
            TipTarget(viewer, wrong, "left")
    wrong = None
    with pytest.raises(ViewerError, match="viewer"):
        TipTarget(wrong, robot, "left")
    with pytest.raises(UnknownNameError, match="limb"):
        TipTarget(viewer, robot, "middle")
    with pytest.raises(ViewerError, match="yaw"):
        TipTarget(viewer, robot, "left").set(0.7, 0.2, 0.1, 0.0, 0.0, math.nan)
