"""Conclusions of rows hold for random points at random instants."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from planner.certificate.body import Body
from planner.certificate.clusters import Clusters, Shape
from planner.certificate.errors import NotCertifiedError
from planner.certificate.intervals import Interval, Pose
from planner.certificate.motion import Polynomials
from planner.certificate.robot import Robot
from planner.certificate.rows import (
    BY_DIRECTION,
    BY_MIDDLES,
    CUT_FIRST,
    CUT_TIME,
    Advice,
    Judge,
    Mover,
    Pair,
    Step,
    Tasks,
    Trace,
    certified_m,
)
from tests.planner.certificate.conftest import frames, lowest

ROWS, INSTANTS = 400, 25

ROUNDING_M = 1e-12
"""Of the distances that are compared with; what rows conclude is below by their own bounds."""


@pytest.fixture(scope="module")
def clusters() -> Clusters:
    return Clusters()


@pytest.fixture(scope="module")
def movers(clusters: Clusters, own: Robot, body: Body, planned: Any) -> list[Mover]:
    """Links of the arm and of the rest, each a mover of its own."""
    places = own.places(planned.start.joints)
    found = []
    for each in body.shapes:
        where = own.attached(each.link, places)
        root = clusters.add(each.shape, where.T * each.T_link_shape)
        if where.finger is None:
            found.append(Mover(each.link, root, where.level))
    return found


@pytest.fixture
def step(document: dict[str, Any], movers: list[Mover]) -> Step:
    motion = Polynomials.of_plan(document["plan"]["steps"][1]["trajectory"], "move")
    end_s = motion.duration_s
    pairs = [
        Pair(first, second, 0.0, 0.0, end_s)
        for first in movers
        for second in movers
        if first.level > second.level
    ]
    return Step("move", pairs, motion, motion.start[0])


def random_tasks(judge: Judge, clusters: Clusters, rng: np.random.Generator) -> Tasks:
    """Nodes some levels below the roots, in cells of 1 to 500 ms."""
    roots = judge.tasks().only(rng.integers(len(judge.step.pairs), size=ROWS))
    sides = []
    for nodes in (roots.first, roots.second):
        chosen = nodes.copy()
        for _ in range(int(rng.integers(6))):
            children = clusters.children(chosen)
            picked = children[np.arange(ROWS), rng.integers(2, size=ROWS)]
            chosen = np.where(picked >= 0, picked, chosen)
        sides.append(chosen)
    duration_s = judge.step.duration_s
    length = 10 ** rng.uniform(-3.0, -0.3, ROWS)
    start = rng.uniform(0.0, np.maximum(duration_s - length, 0.0))
    end = np.minimum(start + length, duration_s)
    return Tasks(roots.pair, sides[0], sides[1], start, end)


def test_no_instant_is_below_what_a_row_concludes(
    own: Robot, clusters: Clusters, step: Step
) -> None:
    rng = np.random.default_rng(35)
    judge = Judge(own, clusters, step)
    tasks = random_tasks(judge, clusters, rng)
    judge.place(np.unique(np.concatenate([tasks.start_s, tasks.end_s])))
    n = judge.between_middles(tasks)
    odd = rng.random(ROWS) < 0.3
    n[odd] = rng.integers(-127, 128, (int(odd.sum()), 3))
    gaps = judge.gaps_m(tasks, n)
    assert step.motion is not None
    nearest = np.inf
    for row in range(ROWS):
        times_s = np.concatenate(
            [
                rng.uniform(tasks.start_s[row], tasks.end_s[row], INSTANTS),
                [tasks.start_s[row], tasks.end_s[row]],
            ]
        )
        pair = step.pairs[int(tasks.pair[row])]
        T = frames(own, step.motion.at(times_s).centred()[0])
        first, second = T[pair.first.level], T[pair.second.level]
        along = np.einsum("tij,j->ti", second[0], n[row])
        gap = lowest(clusters, int(tasks.first[row]), along, first)
        gap += lowest(clusters, int(tasks.second[row]), -along, second)
        gap /= np.linalg.norm(n[row])
        assert (gap >= gaps[row] - ROUNDING_M).all()
        nearest = min(nearest, float((gap - gaps[row]).min()))
    assert nearest < 1e-3  # else the bound would say nothing


def test_zero_directions_conclude_nothing(own: Robot, clusters: Clusters, step: Step) -> None:
    judge = Judge(own, clusters, step)
    tasks = judge.tasks()
    judge.place(np.unique(np.concatenate([tasks.start_s, tasks.end_s])))
    for n in (np.zeros((len(tasks), 3)), np.full((len(tasks), 3), np.nan)):
        gaps = judge.gaps_m(tasks, n)
        assert not (gaps > 0.0).any()


def pair_of_boxes(clusters: Clusters, apart_m: float) -> Step:
    """Two cubes of 2 cm that stand still, with a gap along x."""
    cube = Shape.of_file({"type": "Box", "size_m": [0.02, 0.02, 0.02]}, "cube")
    roots = [
        clusters.add(cube, Pose(Interval(np.eye(3)), Interval([x, 0.0, 0.0])))
        for x in (0.0, 0.02 + apart_m)
    ]
    first, second = (Mover(name, root, 0) for name, root in zip("ab", roots, strict=True))
    return Step("still", [Pair(first, second, 0.001, 0.0, 1.0)], None, np.zeros(7))


def letters(*values: int) -> Trace:
    """Letters without a stated direction."""
    return Trace(np.array(values, np.intp), np.zeros((0, 3)), np.zeros((0, 3)))


def test_a_gap_is_certified_to_the_last_digits(own: Robot) -> None:
    clusters = Clusters()
    step = pair_of_boxes(clusters, 0.01)
    found = certified_m(own, clusters, step, Advice(letters(BY_MIDDLES)))
    assert found == pytest.approx(0.01, abs=1e-10)
    assert found < 0.01


@pytest.mark.parametrize(
    ("apart_m", "given", "reason"),
    [
        (0.0009, letters(BY_MIDDLES), "1.000 mm is required"),
        (0.01, letters(), "ends too soon"),
        (0.01, letters(BY_DIRECTION), "ends too soon"),
        (0.01, letters(6), "malformed"),
        (0.01, letters(-1), "malformed"),
        (0.01, letters(CUT_FIRST), "cannot be cut"),
        (0.01, letters(CUT_TIME, BY_MIDDLES), "ends too soon"),
        (0.01, letters(*[CUT_TIME] * 200_000), "more rows"),
    ],
)
def test_an_insufficient_witness_is_refused(
    own: Robot, apart_m: float, given: Trace, reason: str
) -> None:
    clusters = Clusters()
    step = pair_of_boxes(clusters, apart_m)
    with pytest.raises(NotCertifiedError, match=reason):
        certified_m(own, clusters, step, Advice(given))


def test_pairs_that_the_theorem_does_not_cover_are_refused(
    own: Robot, clusters: Clusters, step: Step, movers: list[Mover]
) -> None:
    moving = max(movers, key=lambda mover: mover.level)
    resting = min(movers, key=lambda mover: mover.level)
    inner = next(mover for mover in movers if 0 < mover.level < moving.level)
    for first, second, reason in (
        (resting, moving, "wrong order"),
        (inner, inner, "one frame"),
        (replace(inner, slide_m=(0.0, 0.01)), resting, "only what the last joint carries slides"),
    ):
        pair = Pair(first, second, 0.0, 0.0, 1.0)
        with pytest.raises(NotCertifiedError, match=reason):
            Judge(own, clusters, replace(step, pairs=[pair]))
