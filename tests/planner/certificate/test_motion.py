"""Bounds on a motion hold at instants drawn at random; what exceeds a limit is refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter
from planner import Plan, Trajectory
from planner.certificate.errors import NotCertifiedError
from planner.certificate.motion import Polynomials, carried, stated_limits
from planner.certificate.robot import Robot

SAMPLES = 2000
ROUNDING = 1e-12
STEP_S = 1e-4
"""Of the differences that velocities and accelerations of points are estimated by."""


@pytest.fixture
def data(document: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = document["plan"]["steps"][1]["trajectory"]
    return found


@pytest.fixture(scope="module")
def trajectory(planned: Plan) -> Trajectory:
    return planned.moves[0].trajectory


def times(trajectory: Trajectory, count: int = SAMPLES) -> np.ndarray[Any, Any]:
    drawn = np.random.default_rng(7).uniform(0.0, trajectory.duration, count)
    return np.unique(np.concatenate([trajectory.knots_s, drawn]))


def limited(own: Robot, data: Any) -> None:
    motion, greatest = Polynomials.of_plan(data, "move"), (np.full(7, 2.0), np.full(7, 20.0))
    motion.require_limits(*stated_limits(own, data["limits"], *greatest, "move"))


def test_positions_contain_those_of_the_trajectory(
    data: dict[str, Any], trajectory: Trajectory
) -> None:
    t = times(trajectory)
    q = Polynomials.of_plan(data, "move").at(t)
    sampled = trajectory.sample(t).q
    assert (q.low - ROUNDING <= sampled).all()
    assert (sampled <= q.high + ROUNDING).all()
    assert float((q.high - q.low).max()) < ROUNDING


def test_no_speed_or_acceleration_in_a_cell_is_above_its_bound(
    data: dict[str, Any], trajectory: Trajectory
) -> None:
    motion, t = Polynomials.of_plan(data, "move"), times(trajectory)
    edges = np.linspace(0.0, trajectory.duration, 24)
    v, a, _ = motion.peaks(edges[:-1], edges[1:])
    cell = np.clip(np.searchsorted(edges, t, side="right") - 1, 0, len(edges) - 2)
    sampled = trajectory.sample(t)
    assert (np.abs(sampled.v) <= v[cell] + ROUNDING).all()
    assert (np.abs(sampled.a) <= a[cell] + ROUNDING).all()


def test_no_point_of_the_hand_moves_faster_than_its_bound(
    robot: Baxter, own: Robot, data: dict[str, Any], trajectory: Trajectory
) -> None:
    """Second differences of a point 20 cm beyond the wrist, against u and w of the whole move."""
    arm, motion = robot.arm("left"), Polynomials.of_plan(data, "move")
    v, a, _ = motion.peaks(np.array([0.0]), np.array([trajectory.duration]))
    lever = float(np.linalg.norm(own.tip.p.magnitude))
    u, w = carried(v, a, np.array([lever]), own.offsets)
    t = np.arange(0.0, trajectory.duration, STEP_S)
    points = np.array([arm.T_base_tip(q).translation for q in trajectory.sample(t).q])
    speeds = np.linalg.norm(np.diff(points, axis=0), axis=1) / STEP_S
    second = np.linalg.norm(np.diff(points, 2, axis=0), axis=1) / STEP_S**2
    assert speeds.max() <= u[0]
    assert second.max() <= w[0] + 1e-6
    assert speeds.max() > 0.1 * u[0]


def test_a_planned_move_is_within_its_limits(own: Robot, data: dict[str, Any]) -> None:
    limited(own, data)


def scaled(key: str, by: float) -> Callable[[dict[str, Any]], None]:
    def change(data: dict[str, Any]) -> None:
        data["limits"][key] = (by * np.array(data["limits"][key])).tolist()

    return change


def faster(data: dict[str, Any]) -> None:
    """The same way in a thousandth less time."""
    s = 0.999
    for key, power in (("v", 1), ("a", 2), ("j", 3)):
        data[key] = (np.array(data[key]) / s**power).tolist()
    data["knots_s"] = (s * np.array(data["knots_s"])).tolist()


def jumping(data: dict[str, Any]) -> None:
    data["q"][3][2] += 1e-6


def backwards(data: dict[str, Any]) -> None:
    data["knots_s"][2] = data["knots_s"][4]


def not_a_number(data: dict[str, Any]) -> None:
    data["j"][0][0] = float("nan")


def cut_off(data: dict[str, Any]) -> None:
    data["q"].pop()


def nameless(data: dict[str, Any]) -> None:
    del data["a"]


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (scaled("v_max", 0.5), "velocity beyond"),
        (scaled("a_max", 0.5), "acceleration beyond"),
        (scaled("j_max", 0.5), "jerk beyond"),
        (scaled("q_max", -1.0), "position beyond"),
        (faster, "beyond"),
        (jumping, "jumps at a knot"),
        (backwards, "do not increase"),
        (not_a_number, "not finite"),
        (cut_off, "do not fit"),
        (nameless, "malformed"),
    ],
)
def test_a_motion_that_breaks_a_rule_is_refused(
    own: Robot, data: dict[str, Any], change: Callable[[dict[str, Any]], None], reason: str
) -> None:
    change(data)
    with pytest.raises(NotCertifiedError, match=reason):
        limited(own, data)
