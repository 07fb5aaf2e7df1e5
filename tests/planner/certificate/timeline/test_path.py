"""Paths of the tip: deviation and speed at every instant, against samples by other code."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter
from planner import (
    Arc,
    LineTolerance,
    Manipulator,
    Move,
    PathMove,
    Plan,
    Polyline,
    Scene,
    complete,
    load_plan,
    plan_path_move,
    save_plan,
    verify,
)
from planner.certificate.checking import check
from planner.certificate.errors import NotCertifiedError
from planner.plan_file import plan_document
from planner.state import State
from planner.verification import certificate_of
from tests.conftest import overhead

CENTRE, RADIUS_M, SPEED_M_S = np.array([0.70, 0.15, 0.0]), 0.06, 0.05
WIDE = LineTolerance(1e-3, math.radians(0.5))
CIRCLE = Arc(overhead(0.76, 0.15, 0.0), CENTRE, np.array([0.0, 0.0, 1.0]), 2.0 * math.pi)
TURNING = pin.SE3(pin.utils.rotate("z", 0.2), np.array([0.0, 0.08, 0.01]))
CORNERED = Polyline(
    [
        overhead(0.66, 0.15, 0.0),
        overhead(0.74, 0.15, 0.0),
        overhead(0.74, 0.15, 0.0) * TURNING,
        overhead(0.62, 0.20, 0.05),
    ]
)


def planned(manipulator: Manipulator, move: PathMove) -> Plan:
    """A plan of one move that states its path."""
    start = State.of(manipulator, Scene.of(), q=move.trajectory.q_start)
    step = Move("follow", move.trajectory, path=move.path)
    return complete(Plan(start, (step,)), manipulator=manipulator)


def checkable(plan: Plan) -> dict[str, Any]:
    """The document of a plan, with its certificate."""
    return {**plan_document(plan), "certificate": certificate_of(plan)}


@pytest.fixture(scope="module")
def steady(manipulator: Manipulator) -> PathMove:
    return plan_path_move(manipulator, None, CIRCLE, speed_m_s=SPEED_M_S)


@pytest.fixture(scope="module")
def circle(manipulator: Manipulator, steady: PathMove) -> dict[str, Any]:
    return checkable(planned(manipulator, steady))


def test_a_circle_is_certified_to_just_above_what_samples_show(
    robot: Baxter, manipulator: Manipulator, steady: PathMove, circle: dict[str, Any]
) -> None:
    times_s = np.linspace(0.0, steady.trajectory.duration, 20_001)
    tips = manipulator.arm.T_base_tips(steady.trajectory.sample(times_s).q)
    spokes = tips[:, :3, 3] - CENTRE
    off_m = np.hypot(np.linalg.norm(spokes[:, :2], axis=1) - RADIUS_M, spokes[:, 2]).max()
    certified_m, label = check(circle, robot.description.text).worst["distance from path"]
    assert label == "follow"
    assert off_m < certified_m < off_m + 1e-5


@pytest.mark.parametrize(
    "tolerance",
    [
        WIDE,
        pytest.param(LineTolerance.about("z", position_m=1e-3), marks=pytest.mark.slow),
        pytest.param(LineTolerance.position_only(1e-3), marks=pytest.mark.slow),
    ],
)
def test_rounded_corners_are_certified(manipulator: Manipulator, tolerance: LineTolerance) -> None:
    context = manipulator.context(Scene.of())
    move = plan_path_move(manipulator, None, CORNERED, tolerance=tolerance, context=context)
    certificate = verify(planned(manipulator, move))
    assert certificate.is_valid
    assert certificate["distance from path"].bound == 1e-3
    assert certificate["distance from path"].value > 5e-4  # corners use what is allowed


def test_a_plan_file_keeps_the_path(tmp_path: Any, manipulator: Manipulator, steady: Any) -> None:
    plan = planned(manipulator, steady)
    save_plan(plan, tmp_path / "circle.json")
    (move,) = load_plan(tmp_path / "circle.json").moves
    assert move.path is not None
    assert move.path.speed_m_s == SPEED_M_S
    np.testing.assert_array_equal(move.path.ends_s, steady.path.ends_s)
    np.testing.assert_array_equal(move.path.slower_s, steady.path.slower_s)


def _shift(path: dict[str, Any]) -> None:
    """Move all pieces by 0.2 mm."""
    for piece in path["pieces"]:
        piece["T_base_start"]["translation"][2] += 2e-4


def _bend(path: dict[str, Any]) -> None:
    """Move the middle of one piece by 0.19 mm, and neither of its ends."""
    piece = path["pieces"][3]["coefficients"]
    piece[0][2] += 7.5e-4
    piece[1][2] -= 7.5e-4


def _lean(path: dict[str, Any]) -> None:
    """Turn all pieces by 1 mrad."""
    for piece in path["pieces"]:
        R = np.array(piece["T_base_start"]["rotation"])
        piece["T_base_start"]["rotation"] = (R @ pin.utils.rotate("x", 1e-3)).tolist()


def _turn(path: dict[str, Any]) -> None:
    """Let one piece turn by 1 mrad."""
    path["pieces"][4]["turn"] = [0.0, 1e-3, 0.0]


def _set(**values: Any) -> Callable[[dict[str, Any]], None]:
    return lambda path: path.update(values)


def _late(path: dict[str, Any]) -> None:
    """Let the fourth piece end 0.1 s later."""
    path["ends_s"][3] += 0.1


EDITS = {
    "shifted": (_shift, "off its way"),
    "bent between its ends": (_bend, "off its way"),
    "leaning": (_lean, "off its way"),
    "turned": (_turn, "gap"),
    "swapped": (lambda path: path["pieces"].reverse(), "gap"),
    "without a piece": (lambda path: path["pieces"].pop(), "no pieces"),
    "another time": (_late, "off its way"),
    "too early an end": (lambda path: path["ends_s"].__setitem__(-1, 7.0), "another time"),
    "never slower": (_set(slower_s={"shape": [0, 2]}), "off its speed"),
    "a little faster": (_set(speed_m_s=0.0515), "off its speed"),
    "a little slower": (_set(speed_m_s=0.0485), "off its speed"),
    "no speed": (_set(speed_m_s=math.nan), "malformed"),
    "any tolerance": (_set(tolerance={"position_m": math.inf, "rotation_rad": 1.0}), "malformed"),
    "an unknown axis": (
        _set(tolerance={"position_m": 1e-3, "rotation_rad": 1.0, "free_about": "w"}),
        "no axis",
    ),
}


@pytest.mark.parametrize("name", EDITS)
def test_a_path_that_is_not_followed_is_refused(
    robot: Baxter, circle: dict[str, Any], name: str
) -> None:
    edit, reason = EDITS[name]
    document = copy.deepcopy(circle)
    edit(document["plan"]["steps"][0]["path"])
    with pytest.raises(NotCertifiedError, match=reason):
        check(document, robot.description.text)
