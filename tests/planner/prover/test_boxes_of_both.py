"""Rows over boxes of both arms: found by the kernel and by NumPy, concluded by the checker."""

from __future__ import annotations

import numpy as np
import pytest

from baxter_kin import Baxter
from planner.certificate.boxes import Tube, box_gaps_m, box_rows
from planner.certificate.clusters import Clusters, Shape
from planner.certificate.intervals import Interval, Pose
from planner.certificate.robot import Robot
from planner.certificate.rows import Mover, Pair, Step
from planner.certificate.timeline.both_arms import HandToHand
from planner.prover import numpy_boxes
from planner.prover.kernel import Kernel, Trees
from planner.prover.problem import Chain, Outcome

SHARE, CELLS = 0.98, 64
NEUTRAL = np.array([0.0, -0.55, 0.0, 0.75, 0.0, 1.26, 0.0])

Arms = tuple[HandToHand, Clusters, list[Pair]]


@pytest.fixture(scope="module")
def arms(robot: Baxter) -> Arms:
    """A box in each hand and on each elbow, and one that stands."""
    text = robot.description.text
    chain, clusters = HandToHand.of(Robot(text, "left"), Robot(text, "right")), Clusters()
    shape = Shape.of_file({"type": "Box", "size_m": [0.1, 0.06, 0.2]}, "box")

    def mover(level: int, x: float = 0.0) -> Mover:
        T = Pose(Interval(np.eye(3)), Interval(np.array([x, 0.0, 0.0])))
        return Mover(f"box {level}", clusters.add(shape, T), level)

    left, right, stands = [mover(0), mover(4)], [mover(14), mover(10)], mover(7, 0.6)
    pairs = [Pair(a, b, 0.0, 0.0, 1.0) for a in right for b in [*left, stands]]
    return chain, clusters, [*pairs, *(Pair(stands, b, 0.0, 0.0, 1.0) for b in left)]


def tube_of(wide_rad: float) -> Tube:
    """Both hands swing to the middle; the left arm's angles are passed backwards."""
    share = np.linspace(0.0, 1.0, CELLS + 1)[:, None]
    swing = np.array([1.2, 0.1, 0.0, 0.1, 0.0, 0.0, 0.0])
    left, right = NEUTRAL - 0.6 * share * swing, NEUTRAL + 0.7 * share * swing
    q = np.concatenate([-left[:, ::-1], right], axis=1)
    return Tube(q - wide_rad, q + wide_rad)


@pytest.mark.parametrize("wide_rad", [0.0, 0.01, 0.03])
def test_the_checker_concludes_what_was_found(
    own_kernel: Kernel, arms: Arms, wide_rad: float
) -> None:
    (chain, clusters, pairs), tube = arms, tube_of(wide_rad)
    trees, step = Trees.of(own_kernel, clusters), Step("both", pairs, None, np.zeros(14))
    found = own_kernel.search_tube(Chain.of(chain), trees, trees.pairs(step), tube, share=SHARE)
    assert found.outcome == Outcome.PROVEN
    assert found.proven_m >= SHARE * found.nearest.distance_m - 1e-6
    rows, n = box_rows(clusters, pairs, tube, found.trace)
    gaps = box_gaps_m(chain, clusters, pairs, rows, n)
    assert found.proven_m <= gaps.min() <= found.nearest.distance_m + 1e-9
    assert (found.q >= tube.low.min(axis=0)).all()
    assert (found.q <= tube.high.max(axis=0)).all()


def test_a_wide_tube_has_a_contact(own_kernel: Kernel, arms: Arms) -> None:
    (chain, clusters, pairs), tube = arms, tube_of(0.25)
    trees, step = Trees.of(own_kernel, clusters), Step("both", pairs, None, np.zeros(14))
    found = own_kernel.search_tube(Chain.of(chain), trees, trees.pairs(step), tube, share=SHARE)
    assert found.outcome == Outcome.TOO_NEAR


def test_numpy_proves_less_but_truly(own_kernel: Kernel, arms: Arms) -> None:
    (chain, clusters, pairs), tube = arms, tube_of(0.01)
    found = numpy_boxes.search_tube(chain, clusters, pairs, tube)
    assert found.outcome == Outcome.PROVEN
    rows, n = box_rows(clusters, pairs, tube, found.trace)
    assert box_gaps_m(chain, clusters, pairs, rows, n).min() >= found.proven_m > 0.0
    trees, step = Trees.of(own_kernel, clusters), Step("both", pairs, None, np.zeros(14))
    by_kernel = own_kernel.search_tube(Chain.of(chain), trees, trees.pairs(step), tube, share=SHARE)
    assert found.proven_m <= by_kernel.nearest.distance_m
