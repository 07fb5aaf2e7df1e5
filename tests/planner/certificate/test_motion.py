"""Bounds on a motion hold at random instants; a motion beyond a limit is refused."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from math import factorial
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


@pytest.fixture
def pieces() -> dict[str, Any]:
    """Quintics and lines with kinks between some of them, of sizes from 1e-3 to 1."""
    rng = np.random.default_rng(11)
    t = np.concatenate([[0.0], np.cumsum(rng.uniform(0.05, 0.6, 40))])
    derivatives = rng.normal(size=(40, 6, 7)) * [[1.0], [1.0], [2.0], [10.0], [60.0], [300.0]]
    derivatives[rng.random(40) < 0.3, 2:] = 0.0
    derivatives[:, 1] *= 10.0 ** rng.uniform(-3.0, 0.0, (40, 1))
    for i, h in enumerate(np.diff(t)[:-1]):
        powers = h ** np.arange(6) / [1.0, 1.0, 2.0, 6.0, 24.0, 120.0]
        derivatives[i + 1, 0] = powers @ derivatives[i]
        if i % 3:
            derivatives[i + 1, 1] = powers[:-1] @ derivatives[i, 1:]
    return {"knots_s": t.tolist(), "derivatives": derivatives.tolist()}


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


# Motions of polynomials


def exactly(own: Any, order: int, since: Fraction) -> list[Fraction]:
    """A derivative of a piece in rationals, of the seven joints."""
    return [
        sum(
            (
                Fraction(own[k][joint]) * since ** (k - order) / factorial(k - order)
                for k in range(order, len(own))
            ),
            Fraction(0),
        )
        for joint in range(7)
    ]


def test_values_and_bounds_enclose_exact_rationals(pieces: dict[str, Any]) -> None:
    """At 16 instants of each piece, positions, and all derivatives in their bounds."""
    motion = Polynomials.of_pieces(pieces, "motion")
    t, shares = motion.t, np.linspace(0.0, 0.999, 16)
    tightness = []
    for i, own in enumerate(pieces["derivatives"]):
        times_s = t[i] + shares * (t[i + 1] - t[i])
        q = motion.at(times_s)
        v, a, _ = motion.peaks(times_s[:1], times_s[-1:])
        fastest = np.zeros((2, 7))
        for number, time_s in enumerate(times_s):
            since = Fraction(time_s) - Fraction(t[i])
            for joint, x in enumerate(exactly(own, 0, since)):
                assert Fraction(q.low[number, joint]) <= x <= Fraction(q.high[number, joint])
            for order, peak in ((1, v[0]), (2, a[0])):
                for joint, x in enumerate(exactly(own, order, since)):
                    assert abs(x) <= Fraction(peak[joint])
                    fastest[order - 1, joint] = max(fastest[order - 1, joint], abs(float(x)))
        tightness.append(fastest / np.array([v[0], a[0]]))
    assert float((q.high - q.low).max()) < ROUNDING
    assert float(np.median(tightness)) > 0.9


def test_jumps_of_velocity_are_counted_once_each(pieces: dict[str, Any]) -> None:
    motion, exact = Polynomials.of_pieces(pieces, "motion"), []
    for i in range(39):
        since = Fraction(motion.t[i + 1]) - Fraction(motion.t[i])
        before = exactly(pieces["derivatives"][i], 1, since)
        after = exactly(pieces["derivatives"][i + 1], 1, Fraction(0))
        exact.append([abs(float(x - y)) for x, y in zip(before, after, strict=True)])
    is_kink = np.max(exact, axis=1) > 1e-8
    assert list(motion.kinks_s) == list(motion.t[1:-1][is_kink])
    assert 10 < len(motion.kinks_s) < 39
    rng = np.random.default_rng(2)
    starts, ends = np.sort(rng.uniform(0.0, motion.duration_s, (200, 2)), axis=1).T
    starts[:20] = motion.kinks_s[rng.integers(len(motion.kinks_s), size=20)]
    ends[:20] = motion.duration_s
    jumps = motion.peaks(starts, ends)[2]
    for start, end, found in zip(starts, ends, jumps, strict=True):
        inside = is_kink & (motion.t[1:-1] > start) & (motion.t[1:-1] < end)
        expected = np.array(exact)[inside].sum(axis=0)
        np.testing.assert_allclose(found, expected, atol=1e-11)
        assert (found >= expected * (1.0 - 1e-15)).all()


def test_cells_are_cut_at_kinks_first_and_then_in_the_middle(pieces: dict[str, Any]) -> None:
    motion, cuts = Polynomials.of_pieces(pieces, "motion"), []
    open_ = [(0.0, motion.duration_s)]
    while open_:
        starts, ends = (np.array(column) for column in zip(*open_, strict=True))
        middles = motion.cuts_s(starts, ends)
        inside = [((motion.kinks_s > s) & (motion.kinks_s < e)).any() for s, e in open_]
        cuts += list(middles[inside])
        for start, end, middle, has_kink in zip(starts, ends, middles, inside, strict=True):
            assert start < middle < end
            assert has_kink or middle == 0.5 * (start + end)
        cells = zip(starts, ends, middles, inside, strict=True)
        halves = [((s, m), (m, e)) for s, e, m, has_kink in cells if has_kink]
        open_ = [cell for pair in halves for cell in pair]
    assert sorted(cuts) == list(motion.kinks_s)


def test_limits_of_polynomials_are_judged_at_their_extremes(own: Robot) -> None:
    """1.4 rad/s at the middle of a quintic from rest to rest, which has 15/8 of the mean speed."""
    way = np.zeros(7)
    way[0], T = 1.4 * 8.0 / 15.0, 1.0
    derivatives = np.zeros((1, 6, 7))
    derivatives[0, 3:] = way * np.array([[60.0], [-360.0], [720.0]])
    motion = Polynomials.of_pieces(
        {"knots_s": [0.0, T], "derivatives": derivatives.tolist()}, "quintic"
    )
    low, high = np.full(7, -3.0), np.full(7, 3.0)

    def bound(x: float) -> tuple[Any, Any]:
        return np.full(7, -x), np.full(7, x)

    peak_a, peak_j = 10.0 / np.sqrt(3.0) * way[0], 60.0 * way[0]
    motion.require_limits(
        (low, high), bound(1.4001), bound(1.0001 * peak_a), bound(1.0001 * peak_j)
    )
    for order, limits in enumerate((1.3999, 0.9999 * peak_a, 0.9999 * peak_j)):
        bounds: list[Any] = [(low, high), None, None, None]
        bounds[order + 1] = bound(limits)
        with pytest.raises(NotCertifiedError, match="beyond its limit, joint 1 at"):
            motion.require_limits(*bounds)
    high[0] = 0.999 * way[0]
    with pytest.raises(NotCertifiedError, match="position beyond"):
        motion.require_limits((low, high))
