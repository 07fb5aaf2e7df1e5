"""Conclusions of rows hold anywhere in their boxes, and traces lead through all of a tube."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from baxter_kin.fields import evolve
from planner.certificate.body import Body
from planner.certificate.boxes import (
    CUT_FIRST,
    CUT_JOINT,
    CUT_TIME,
    SEPARATED,
    Boxes,
    BoxTrace,
    Tube,
    box_gaps_m,
    box_rows,
)
from planner.certificate.clusters import Clusters, Shape
from planner.certificate.errors import NotCertifiedError
from planner.certificate.intervals import Array, Interval, Pose
from planner.certificate.robot import Robot
from planner.certificate.rows import Mover, Pair
from planner.certificate.timeline.both_arms import HandToHand
from tests.planner.certificate.conftest import frames, lowest

ROWS, PLACES = 300, 40

ROUNDING_M = 1e-12

SHAPES: list[dict[str, Any]] = [
    {"type": "Box", "size_m": [0.1, 0.04, 0.06]},
    {"type": "Sphere", "radius_m": 0.05},
    {"type": "Cylinder", "radius_m": 0.03, "length_m": 0.12},
]


@pytest.fixture(scope="module")
def clusters() -> Clusters:
    return Clusters()


@pytest.fixture(scope="module")
def pairs(clusters: Clusters, own: Robot, body: Body, planned: Any) -> list[Pair]:
    """Links of one chain, links and the rest, and bodies in the hand, of which some slide."""
    places, movers = own.places(planned.start.joints), []
    for each in body.shapes:
        where = own.attached(each.link, places)
        root = clusters.add(each.shape, where.T * each.T_link_shape)
        slide = (0.01, 0.01) if where.finger else (0.0, 0.0)
        movers.append(Mover(each.link, root, where.level, slide))
    for number, data in enumerate(SHAPES):
        T = Pose(Interval(np.eye(3)), Interval(np.array([0.02, -0.01 * number, 0.3])))
        held = clusters.add(Shape.of_file(data, "held"), T)
        movers.append(Mover("held", held, 7))
        movers.append(Mover("standing", held, 0))
    return [Pair(a, b, 0.0, 0.0, 1.0) for a in movers for b in movers if a.level > b.level]


def random_boxes(
    pairs: list[Pair],
    clusters: Clusters,
    rng: np.random.Generator,
    count: int = ROWS,
    joints: int = 7,
) -> Boxes:
    """Nodes some levels below the roots, in boxes of up to 0.4 rad, some of no width."""
    numbers = rng.integers(len(pairs), size=count)
    sides = []
    for side in ("first", "second"):
        nodes = np.array([getattr(pairs[i], side).root for i in numbers])
        for _ in range(int(rng.integers(6))):
            children = clusters.children(nodes)[np.arange(count), rng.integers(2, size=count)]
            nodes = np.where(children >= 0, children, nodes)
        sides.append(nodes)
    middle = rng.uniform(-2.0, 2.0, (count, joints))
    widths = 10 ** rng.uniform(-3.0, -0.7, (count, joints)) * rng.integers(0, 2, (count, joints))
    still = np.zeros(count, np.intp)
    first, second = sides
    bounds = middle - widths, middle + widths
    return Boxes(numbers, first, second, still, still + 1, *bounds)


def gaps_at(
    clusters: Clusters,
    pair: Pair,
    nodes: tuple[int, int],
    n: Array,
    T: list[tuple[Array, Array]],
    *,
    base: int = 0,
) -> Array:
    """The gap that a direction leaves, over its length, where frames are at poses.

    It is fixed in the frame of the second mover, or in base where that comes after.
    """
    of = min(max(base, pair.second.level), pair.first.level)
    (R, p), turned = T[pair.second.level], T[of][0] @ n
    y = np.eye(3)[1]
    first = lowest(clusters, nodes[0], turned, T[pair.first.level])
    first += np.einsum("ti,ti->t", turned, T[pair.first.level][0] @ y) * pair.first.slide_m[0]
    second = lowest(clusters, nodes[1], -turned, (R, p))
    second -= np.einsum("ti,ti->t", turned, R @ y) * pair.second.slide_m[0]
    found: Array = (first + second) / np.linalg.norm(n)
    return found


def test_no_place_in_a_box_is_below_what_a_row_concludes(
    own: Robot, clusters: Clusters, pairs: list[Pair]
) -> None:
    rng = np.random.default_rng(5)
    boxes = random_boxes(pairs, clusters, rng)
    n = rng.normal(size=(ROWS, 3)) * 10 ** rng.uniform(-1, 2, (ROWS, 1))
    gaps = box_gaps_m(own, clusters, pairs, boxes, n)
    for row in range(ROWS):
        pair = pairs[int(boxes.pair[row])]
        nodes = int(boxes.first[row]), int(boxes.second[row])
        shares = rng.uniform(size=(PLACES, 7))
        shares[: PLACES // 2] = np.rint(shares[: PLACES // 2])  # corners
        q = boxes.low[row] + shares * (boxes.high[row] - boxes.low[row])
        assert (
            gaps_at(clusters, pair, nodes, n[row], frames(own, q)).min() >= gaps[row] - ROUNDING_M
        )


@pytest.fixture(scope="module")
def both(text: str, own: Robot) -> HandToHand:
    return HandToHand.of(own, Robot(text, "right"))


@pytest.fixture(scope="module")
def across(clusters: Clusters, body: Body) -> list[Pair]:
    """Shapes on all frames from the left hand to the right one, each with those behind it."""
    movers = [
        Mover("shape", clusters.add(each.shape, Pose.identity()), level, (slide_m, slide_m))
        for each in body.shapes[:3]
        for level in range(15)
        for slide_m in (0.0, 0.02)
    ]
    return [Pair(a, b, 0.0, 0.0, 1.0) for a in movers for b in movers if a.level > b.level]


@pytest.mark.parametrize("is_wide", [True, False])
def test_no_places_of_two_arms_are_below_what_a_row_concludes(
    both: HandToHand, clusters: Clusters, across: list[Pair], is_wide: bool
) -> None:
    rng = np.random.default_rng(15)
    boxes = random_boxes(across, clusters, rng, joints=14)
    boxes = boxes if is_wide else evolve(boxes, high=boxes.low)
    n = rng.normal(size=(ROWS, 3))
    gaps = box_gaps_m(both, clusters, across, boxes, n)
    for row in range(ROWS):
        pair = across[int(boxes.pair[row])]
        nodes = int(boxes.first[row]), int(boxes.second[row])
        shares = np.rint(rng.uniform(size=(PLACES, 14)))
        q = boxes.low[row] + shares * (boxes.high[row] - boxes.low[row])
        true = gaps_at(clusters, pair, nodes, n[row], frames(both, q), base=both.base).min()
        assert true >= gaps[row] - ROUNDING_M
        assert is_wide or true <= gaps[row] + 1e-8


def test_a_box_of_no_width_has_the_gap_itself(
    own: Robot, clusters: Clusters, pairs: list[Pair]
) -> None:
    rng = np.random.default_rng(6)
    boxes = random_boxes(pairs, clusters, rng, 50)
    boxes = evolve(boxes, low=boxes.high)
    n = rng.normal(size=(50, 3))
    gaps = box_gaps_m(own, clusters, pairs, boxes, n)
    for row in range(50):
        pair = pairs[int(boxes.pair[row])]
        nodes = int(boxes.first[row]), int(boxes.second[row])
        true = gaps_at(clusters, pair, nodes, n[row], frames(own, boxes.low[row, None]))
        assert gaps[row] == pytest.approx(true[0], abs=1e-8)


def test_joints_that_move_both_do_not_count(
    own: Robot, clusters: Clusters, pairs: list[Pair]
) -> None:
    rng = np.random.default_rng(7)
    boxes = random_boxes(pairs, clusters, rng, 100)
    n = rng.normal(size=(100, 3))
    levels = [(pairs[i].second.level, pairs[i].first.level) for i in boxes.pair.tolist()]
    counts = np.array([[m <= joint < k for joint in range(7)] for m, k in levels])
    other = evolve(
        boxes, low=np.where(counts, boxes.low, -1.0), high=np.where(counts, boxes.high, 1.0)
    )
    one, another = (box_gaps_m(own, clusters, pairs, each, n) for each in (boxes, other))
    assert np.array_equal(one, another)


@pytest.fixture
def tube() -> Tube:
    middle = np.linspace(0.0, 0.2, 9)[:, None] * np.ones(7)
    return Tube(middle - 0.01, middle + 0.01)


def traced(letters: list[int], apart: int) -> BoxTrace:
    return BoxTrace(np.array(letters, np.intp), np.tile([0.0, 0.0, 1.0], (apart, 1)))


def test_halves_cover_the_tube(clusters: Clusters, pairs: list[Pair], tube: Tube) -> None:
    trace = traced([CUT_TIME, CUT_JOINT + 3, CUT_TIME, *4 * [SEPARATED]], 4)
    rows, _ = box_rows(clusters, pairs[:1], tube, trace)
    assert rows.start.tolist() == [0, 0, 4, 6]
    assert rows.end.tolist() == [4, 4, 6, 8]
    assert rows.high[0, 3] == rows.low[1, 3] == 0.05
    rng = np.random.default_rng(8)
    for at in range(9):
        for q in rng.uniform(tube.low[at], tube.high[at], (20, 7)):
            inside = (rows.low <= q) & (q <= rows.high)
            assert (inside.all(axis=1) & (rows.start <= at) & (at <= rows.end)).any()


def test_an_empty_half_is_left_out(clusters: Clusters, pairs: list[Pair], tube: Tube) -> None:
    letters = [CUT_JOINT, CUT_TIME, SEPARATED, SEPARATED, CUT_TIME, SEPARATED]
    rows, _ = box_rows(clusters, pairs[:1], tube, traced(letters, 3))
    spans = list(zip(rows.start.tolist(), rows.end.tolist(), strict=True))
    assert spans == [(0, 8), (0, 4), (4, 6)]


@pytest.mark.parametrize(
    ("letters", "apart"),
    [
        ([], 0),
        ([SEPARATED, SEPARATED], 1),
        ([SEPARATED], 0),
        ([99], 0),
        ([CUT_TIME, SEPARATED], 1),
        ([*(CUT_FIRST for _ in range(200))], 0),
    ],
)
def test_a_malformed_trace_is_refused(
    clusters: Clusters, pairs: list[Pair], tube: Tube, letters: list[int], apart: int
) -> None:
    with pytest.raises(NotCertifiedError):
        box_rows(clusters, pairs[:1], tube, traced(letters, apart))


def test_cuts_of_leaves_and_points_are_refused(clusters: Clusters, pairs: list[Pair]) -> None:
    q = np.zeros((2, 7))
    for letter in (CUT_TIME, CUT_JOINT + 2):
        with pytest.raises(NotCertifiedError, match="cannot be cut"):
            box_rows(clusters, pairs[:1], Tube(q, q), traced([letter], 0))


def test_a_direction_without_a_length_is_refused(
    own: Robot, clusters: Clusters, pairs: list[Pair]
) -> None:
    boxes = random_boxes(pairs, clusters, np.random.default_rng(9), 1)
    for n in (0.0, np.nan):
        with pytest.raises(NotCertifiedError, match="direction"):
            box_gaps_m(own, clusters, pairs, boxes, np.full((1, 3), n))


def test_movers_that_slide_while_joints_move_are_refused(
    own: Robot, clusters: Clusters, pairs: list[Pair]
) -> None:
    sliding = evolve(pairs[0], first=evolve(pairs[0].first, slide_m=(0.0, 0.01)))
    boxes = random_boxes([sliding], clusters, np.random.default_rng(9), 1)
    with pytest.raises(NotCertifiedError, match="slides"):
        box_gaps_m(own, clusters, [sliding], boxes, np.ones((1, 3)))


def test_no_rows_have_no_conclusions(own: Robot, clusters: Clusters, pairs: list[Pair]) -> None:
    none = random_boxes(pairs, clusters, np.random.default_rng(9), 1).only([])
    assert box_gaps_m(own, clusters, [], none, np.zeros((0, 3))).shape == (0,)
