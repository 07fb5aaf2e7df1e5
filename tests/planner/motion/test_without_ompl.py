"""What works without OMPL, and what the rest says."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from baxter_kin.errors import MissingLibraryError
from planner import Manipulator, Scene
from planner.errors import FreeMoveError
from planner.motion import free_search, rrt
from planner.motion.joint_move import plan_joint_move
from planner.motion.rrt import search_corners
from planner.pick_place.plan_builder import NoSolutionError, free_motion
from tests.planner import toy_world
from tests.planner.motion.test_free_move import (
    DISTANT,
    is_straight,
    plan,
)
from tests.planner.toy_world import ARM_LIMITS
from tests.planner.walls import Room, wall

WITHOUT = """
import runpy, sys
class NoOmpl:
    def find_spec(self, name, *_):
        if name.partition(".")[0] == "ompl":
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, NoOmpl())
runpy.run_module(sys.argv.pop(1), run_name="__main__", alter_sys=True)
"""
"""Runs a module where there is no OMPL."""


@pytest.fixture
def without_ompl(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not installed, though it could be."""
    monkeypatch.setattr(rrt, "NEWEST_PYTHON", sys.version_info[:2])
    monkeypatch.setitem(sys.modules, "ompl", None)


@pytest.fixture
def unled(monkeypatch: pytest.MonkeyPatch) -> None:
    """The motion program finds nothing, so that only a search is left."""
    monkeypatch.setattr(free_search, "led_around", lambda *_, **__: [])


@pytest.mark.slow
def test_the_demo_needs_none_even_to_pass_a_wall() -> None:
    obstacle = "--obstacle", "0.72", "0.075", "-0.055", "0.3", "0.02", "0.2"
    command = sys.executable, "-c", WITHOUT, "baxter_kin.demo", "--headless", "--cycles", "1"
    done = subprocess.run([*command, *obstacle], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_it_is_loaded_by_a_search_and_not_before() -> None:
    program = (
        "import sys, planner, sim; planner.plan_pick_and_place, sim.Simulation;"
        "print('ompl' in sys.modules)"
    )
    assert subprocess.check_output([sys.executable, "-c", program]).strip() == b"False"


@pytest.mark.usefixtures("without_ompl")
def test_a_move_whose_straight_line_is_free_needs_none() -> None:
    assert is_straight(plan(DISTANT))


@pytest.mark.usefixtures("without_ompl")
def test_a_search_says_what_is_missing_and_what_to_do() -> None:
    rng = np.random.default_rng(1)
    ends = toy_world.LEFT, toy_world.RIGHT
    with pytest.raises(
        MissingLibraryError, match=r"need OMPL, which is not installed; run: .*ompl$"
    ):
        search_corners(*ends, toy_world.LIMITS, lambda _: True, rng=rng, timeout_s=1.0)


@pytest.mark.usefixtures("without_ompl", "unled")
def test_a_free_move_says_so_where_it_would_have_to_search() -> None:
    with pytest.raises(FreeMoveError, match=r"^the straight line is blocked, and .* need OMPL"):
        plan()


@pytest.mark.usefixtures("without_ompl")
def test_a_slower_motion_that_was_found_is_better_than_an_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    slow = plan_joint_move(ARM_LIMITS.q_min, ARM_LIMITS.q_max, ARM_LIMITS)
    monkeypatch.setattr(free_search, "led_around", lambda *_, **__: [(slow,)])
    assert plan(is_clear=lambda _: True) is slow


@pytest.mark.usefixtures("without_ompl", "unled")
def test_a_plan_that_needs_a_search_fails_with_the_sentence(
    manipulator: Manipulator, scene: Scene
) -> None:
    room = Room.of(manipulator, scene.with_body(wall()))
    ends = room.beside(0.2), room.beside(-0.2)
    with pytest.raises(NoSolutionError) as caught:
        free_motion("place: approach", ends, manipulator, room.space)
    assert caught.value.failure.stage == "place: approach"
    assert "ways around obstacles need OMPL, which is not installed" in str(caught.value)


def test_a_python_that_is_too_new_is_told_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rrt, "sys", SimpleNamespace(version_info=(3, 14, 0, "final", 0)))
    monkeypatch.setitem(sys.modules, "ompl", None)
    with pytest.raises(
        MissingLibraryError, match=r"no wheel for this Python yet; use Python 3\.10"
    ):
        rrt._load()


TESTS_OF_SEARCHES = """
import sys, pytest
sys.modules["ompl"] = None
from planner.motion import rrt
rrt.NEWEST_PYTHON = eval(sys.argv[1])
sys.exit(pytest.main(["-q", "-p", "no:cacheprovider", *sys.argv[2:]]))
"""
"""Runs tests without OMPL, as if wheels of it ended with a Python."""


@pytest.mark.parametrize(
    ("newest", "status", "reason"),
    [
        ((3, 9), 0, r"skipped \d\d: OMPL, which searches need, has no wheel for this Python"),
        pytest.param(
            *((3, 99), 1, r"MissingLibraryError: .* need OMPL, which is not installed"),
            marks=pytest.mark.campaign,
        ),
    ],
)
def test_tests_of_searches_are_skipped_only_where_it_has_no_wheel(
    newest: tuple[int, int], status: int, reason: str
) -> None:
    tests = str(Path(__file__).with_name("test_rrt.py"))
    command = [sys.executable, "-c", TESTS_OF_SEARCHES, str(newest), tests, "-x"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == status, done.stdout
    assert re.search(reason, done.stdout)


def test_a_copy_that_does_not_load_is_told_with_its_reason(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "ompl", None)
    reason = ImportError("libboost_serialization.so: cannot open", name="ompl._ompl")
    assert rrt._what_to_do(reason).endswith("cannot be loaded here: " + str(reason))
