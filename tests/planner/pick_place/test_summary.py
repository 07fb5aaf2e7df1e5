"""Tallies: how many solutions collide, counted again pair by pair."""

from __future__ import annotations

import numpy as np
import pytest

from baxter_kin.errors import ConfigurationError
from baxter_kin.ik import sample_solutions
from planner import Body, Box, Manipulator, Part, Scene
from planner.collision.context import CollisionContext
from planner.pick_place.summary import MOST_MEASURED, MOST_NAMED, CollisionCount, CollisionSummary
from tests.conftest import at, overhead

COAL_M = 1e-6
"""Where coal's iterations end; they start from where the last query ended."""

PICK = overhead(0.70, 0.15, -0.129)


def post(name: str, x: float, y: float) -> Body:
    return Body(name, (Part(Box((0.03, 0.03, 0.6)), at(0.0, 0.0, 0.0)),), at(x, y, 0.2))


@pytest.fixture
def posts(manipulator: Manipulator, scene: Scene) -> CollisionContext:
    crowded = scene.with_body(post("front", 0.45, 0.25)).with_body(post("side", 0.6, 0.42))
    return manipulator.context(crowded, finger_m=manipulator.hand.stroke_m, touchable="block")


def test_counts_are_those_of_a_check_pair_by_pair(
    manipulator: Manipulator, posts: CollisionContext
) -> None:
    qs = sample_solutions(manipulator.ik, PICK)
    summary = CollisionSummary.of("pick: descend", qs, posts)
    nearest = [posts.clearance(q) for q in qs]
    blocked = [near for near in nearest if near.distance_m <= 0.0]
    assert summary.solutions == len(qs) <= MOST_MEASURED
    assert 0 < summary.colliding < summary.solutions
    assert summary.colliding == len(blocked)
    for collision in summary.collisions:
        alike = [n for n in blocked if (n.first, n.second) == (collision.first, collision.second)]
        assert collision.count == len(alike)
        nearest_m = max(near.distance_m for near in alike)
        assert collision.distance_m == pytest.approx(nearest_m, abs=COAL_M)


def test_it_reads_as_one_sentence(manipulator: Manipulator, posts: CollisionContext) -> None:
    qs = sample_solutions(manipulator.ik, PICK)
    summary = CollisionSummary.of("pick: descend", qs, posts)
    text = str(summary)
    assert text.startswith(
        f"{summary.colliding} of {summary.solutions} IK solutions collide: left_"
    )
    assert "mm deep" in text


def test_only_the_most_frequent_are_named() -> None:
    counts = tuple(CollisionCount("link", f"post {i}", 9 - i, -0.001) for i in range(5))
    text = str(CollisionSummary("pick: descend", 50, counts))
    assert text.count("link with post") == MOST_NAMED
    assert text.endswith("; 2 other pairs")


def test_of_a_margin_it_tells_the_distance(manipulator: Manipulator, scene: Scene) -> None:
    around = manipulator.context(
        scene, finger_m=manipulator.hand.stroke_m, touchable="block", margin_m=0.05
    )
    text = str(CollisionSummary.of("pick: descend", sample_solutions(manipulator.ik, PICK), around))
    assert "finger_tip with table, at best 22.1 mm apart" in text


def test_many_solutions_are_thinned_evenly(
    manipulator: Manipulator, posts: CollisionContext
) -> None:
    qs = sample_solutions(manipulator.ik, PICK, turns=400)
    assert len(qs) > MOST_MEASURED
    assert CollisionSummary.of("pick: descend", qs, posts).solutions == MOST_MEASURED


def test_malformed_solutions_are_refused(posts: CollisionContext) -> None:
    for bad in ("qs", [[np.nan] * 7], [[0.0] * 6]):
        with pytest.raises(ConfigurationError):
            CollisionSummary.of("pick: descend", bad, posts)
