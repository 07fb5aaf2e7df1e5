"""A recording drawn: what is in the figure, not how it looks."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest

from baxter_kin import Arm
from baxter_kin.errors import UnknownNameError
from baxter_kin.fields import evolve
from sim import Recording, plot_recording
from sim.errors import RecordingError

ROWS, JOINTS = 4, 7


@pytest.fixture(scope="module")
def figure(picked: Recording) -> Any:
    return plot_recording(picked)


def panels(figure: Any) -> Any:
    return np.array(figure.get_axes()).reshape(-1, ROWS, JOINTS)


def drawn(axes: Any, colour: str) -> Any:
    """What the lines of that colour show, one after the other."""
    return [np.asarray(line.get_ydata()) for line in axes.lines if line.get_color() == colour]


def said(figure: Any) -> list[str]:
    return [text.get_text() for part in figure.subfigs for text in part.legends[0].get_texts()]


def test_the_arm_that_moved_is_drawn_joint_by_joint_with_units(figure: Any, left: Arm) -> None:
    grid = panels(figure)
    assert grid.shape == (1, ROWS, JOINTS)
    assert [axes.get_title() for axes in grid[0, 0]] == list(left.joint_names)
    units = [axes.get_ylabel().partition(" ")[2] for axes in grid[0, :, 0]]
    assert units == ["[rad]", "[rad/s]", "[rad/s²]", "[rad/s³]"]
    assert {axes.get_xlabel() for axes in grid[0, -1]} == {"time [s]"}


def test_limits_are_dashed_lines_inside_the_view(figure: Any, left: Arm) -> None:
    limits = left.limits
    bounds = [
        (limits.q_min, limits.q_max),
        *((-most, most) for most in (limits.v_max, limits.a_max, limits.j_max)),
    ]
    for row, (low, high) in enumerate(bounds):
        for i, axes in enumerate(panels(figure)[0, row]):
            dashed = [line for line in axes.lines if line.is_dashed()]
            assert [line.get_ydata()[0] for line in dashed] == [low[i], high[i]]
            bottom, top = axes.get_ylim()
            assert bottom < low[i] < high[i] < top


def test_the_drawn_motion_is_that_of_the_recording(figure: Any, picked: Recording) -> None:
    motion = picked.motion("left", with_knots=True)
    for row, name in enumerate("qvaj"):
        line = panels(figure)[0, row, 3].lines[1]
        known = np.isfinite(line.get_ydata())
        assert known.all()
        assert np.array_equal(line.get_ydata(), getattr(motion, name)[:, 3])
        assert np.array_equal(line.get_xdata(), motion.times_s)


def test_grasp_and_release_are_marked_and_named(figure: Any, picked: Recording) -> None:
    times = [e.time_s for e in picked.events if e.kind.value in ("grasped", "released")]
    assert len(times) == 2
    for axes in panels(figure).flat:
        marks = [line.get_xdata()[0] for line in axes.lines if len(line.get_xdata()) == 2]
        assert set(times) <= set(marks)
    labels = [text.get_text() for text in panels(figure)[0, 0, 0].texts]
    assert labels == ["grasped", "released"]


def test_the_legend_says_where_the_motion_is_from(figure: Any, picked: Recording) -> None:
    assert said(figure) == ["exact, from the recorded moves", "limit", "grasped", "released"]
    assert said(plot_recording(evolve(picked, moves=()), "left")) == [
        "standing still",
        "differences of the recorded positions",
        "limit",
        "grasped",
        "released",
    ]


@pytest.mark.slow
def test_both_arms_are_drawn_when_none_moved_and_one_that_only_trembles_stands_still(
    picked: Recording, left: Arm
) -> None:
    still = evolve(picked, q=np.tile(picked.q[0], (len(picked.q), 1)), moves=())
    assert panels(plot_recording(still)).shape == (2, ROWS, JOINTS)
    noise = np.random.default_rng(1).normal(0.0, 1e-4, picked.q.shape)
    assert panels(plot_recording(evolve(picked, q=picked.q + noise))).shape == (1, ROWS, JOINTS)
    noisy = evolve(picked, q=picked.q + 10.0 * noise, moves=())
    bottom, top = panels(plot_recording(noisy, "left"))[0, 3, 0].get_ylim()
    assert top - bottom < 6.0 * left.limits.j_max[0]


def test_other_limits_can_be_given(picked: Recording, left: Arm) -> None:
    axes = panels(plot_recording(picked, limits=left.limits.scaled(0.5)))[0, 1, 0]
    assert [line.get_ydata()[0] for line in axes.lines if line.is_dashed()] == [-0.75, 0.75]


def test_wrong_arguments_are_refused(picked: Recording, left: Arm) -> None:
    with pytest.raises(RecordingError, match="right arm"):
        plot_recording(picked, "right", limits=left.limits)
    bad: Any = [1.0, 2.0]
    with pytest.raises(RecordingError, match="limits"):
        plot_recording(picked, limits=bad)
    for bad in ("up", 3):
        with pytest.raises(UnknownNameError, match="limb"):
            plot_recording(picked, bad)


@pytest.mark.slow
def test_one_snapshot_can_be_drawn_and_no_window_opens(picked: Recording) -> None:
    one = Recording(
        picked.joint_names,
        picked.times_s[:1],
        picked.q[:1],
        picked.gripper_percent[:1],
        bodies={},
        body_poses={},
        captions=(),
        events=(),
    )
    figure = plot_recording(one, "left")
    assert panels(figure).shape == (1, ROWS, JOINTS)
    assert figure.canvas.manager is None


def test_without_the_package_the_error_says_what_to_install(
    picked: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(RecordingError, match="pip install matplotlib"):
        plot_recording(picked)
