"""Rows over boxes: found by the kernel and by NumPy, concluded by the checker's code alone."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from baxter_kin.description import RobotDescription
from baxter_kin.fields import evolve
from planner import Plan
from planner.certificate.boxes import Tube, box_gaps_m, box_rows
from planner.certificate.rows import Pair, Step
from planner.certificate.timeline import Timeline
from planner.plan_file import plan_document
from planner.prover import numpy_boxes
from planner.prover.kernel import Kernel, Trees
from planner.prover.problem import BoxesFound, Chain, Outcome
from planner.verification.witness import SoughtTimeline

SHARE = 0.98
CELLS = 200


@pytest.fixture(scope="module")
def timeline(tracked_plan: Plan) -> Timeline:
    return SoughtTimeline(plan_document(tracked_plan), RobotDescription.of().text)


@pytest.fixture(scope="module", params=[0, -1], ids=["free hand", "a body held"])
def step(timeline: Timeline, request: pytest.FixtureRequest) -> Step:
    """A move of the arm, and what must keep apart in it but for contacts on purpose."""
    moves = [step for step in timeline.steps if step.motion is not None]
    held = [step for step in moves if any(pair.first.name == "block" for pair in step.pairs)]
    found = (held or moves)[0] if request.param else moves[0]
    return evolve(found, pairs=[pair for pair in found.pairs if pair.is_counted])


def tube_of(step: Step, wide_rad: float) -> Tube:
    """Around the move, as wide at every instant."""
    assert step.motion is not None
    q = step.motion.at(np.linspace(0.0, step.duration_s, CELLS + 1)).centred()[0]
    return Tube(q - wide_rad, q + wide_rad)


def sought(kernel: Kernel, timeline: Timeline, step: Step, tube: Tube, **asked: Any) -> BoxesFound:
    trees = Trees.of(kernel, timeline.clusters)
    return kernel.search_tube(
        Chain.of(timeline.robot), trees, trees.pairs(step), tube, **{"share": SHARE, **asked}
    )


def met_m(kernel: Kernel, timeline: Timeline, step: Step, q: np.ndarray[Any, Any]) -> float:
    """The least distance at one configuration: that of a tube of no width, to a thousandth."""
    still = Tube(*2 * (np.tile(q, (2, 1)),))
    return sought(kernel, timeline, step, still, share=0.999).nearest.distance_m


@pytest.mark.slow
@pytest.mark.parametrize("wide_rad", [0.0, 0.003, 0.01])
def test_the_checker_concludes_what_was_found(
    own_kernel: Kernel, timeline: Timeline, step: Step, wide_rad: float
) -> None:
    tube = tube_of(step, wide_rad)
    found = sought(own_kernel, timeline, step, tube)
    assert found.outcome == Outcome.PROVEN
    assert found.proven_m >= SHARE * found.nearest.distance_m - 1e-6
    rows, n = box_rows(timeline.clusters, step.pairs, tube, found.trace)
    gaps = box_gaps_m(timeline.robot, timeline.clusters, step.pairs, rows, n)
    assert found.proven_m <= gaps.min() <= found.nearest.distance_m + 1e-9


def test_no_place_in_a_tube_is_nearer_than_proven(
    own_kernel: Kernel, timeline: Timeline, step: Step
) -> None:
    rng, tube = np.random.default_rng(1), tube_of(step, 0.01)
    found = sought(own_kernel, timeline, step, tube)
    for at in rng.integers(CELLS + 1, size=40):
        corner = rng.choice([0.0, 1.0], 7) if rng.random() < 0.7 else rng.random(7)
        q = tube.low[at] + corner * (tube.high[at] - tube.low[at])
        assert met_m(own_kernel, timeline, step, q) >= found.proven_m


def test_a_wider_tube_is_proven_no_better(
    own_kernel: Kernel, timeline: Timeline, step: Step
) -> None:
    found = [sought(own_kernel, timeline, step, tube_of(step, wide)) for wide in (0.0, 0.005, 0.01)]
    nearest = [each.nearest.distance_m for each in found]
    assert found[1].proven_m <= nearest[0]
    assert found[2].proven_m <= nearest[1]


def test_a_contact_is_found_where_the_joints_may_be(
    own_kernel: Kernel, timeline: Timeline, step: Step
) -> None:
    tube = tube_of(step, 0.08)
    found = sought(own_kernel, timeline, step, tube)
    assert found.outcome == Outcome.TOO_NEAR
    assert found.stopped.distance_m <= 0.0
    assert 0 <= found.stopped.time_s <= CELLS


def test_nothing_to_prove_is_proven(own_kernel: Kernel, timeline: Timeline, step: Step) -> None:
    none: list[Pair] = []
    found = sought(own_kernel, timeline, evolve(step, pairs=none), tube_of(step, 0.1))
    assert found.outcome == Outcome.PROVEN
    assert found.proven_m == np.inf


def test_threads_find_the_same(own_kernel: Kernel, timeline: Timeline, step: Step) -> None:
    tube = tube_of(step, 0.005)
    with ThreadPoolExecutor(4) as pool:
        found = list(
            pool.map(lambda _: sought(own_kernel, timeline, step, tube).proven_m, range(3))
        )
    assert len(set(found)) == 1


def test_numpy_proves_less_but_truly(own_kernel: Kernel, timeline: Timeline, step: Step) -> None:
    tube = tube_of(step, 0.003)
    pairs = step.pairs
    found = numpy_boxes.search_tube(timeline.robot, timeline.clusters, pairs, tube)
    assert found.outcome == Outcome.PROVEN
    rows, n = box_rows(timeline.clusters, pairs, tube, found.trace)
    gaps = box_gaps_m(timeline.robot, timeline.clusters, pairs, rows, n)
    assert gaps.min() >= found.proven_m > 0.0
    assert found.proven_m <= sought(own_kernel, timeline, step, tube).nearest.distance_m


def test_cells_without_proof_are_those_in_which_something_touches(
    own_kernel: Kernel, timeline: Timeline, step: Step
) -> None:
    """A tube that is wide for a while only, so that something is touched there."""
    tube = tube_of(step, 0.0)
    wide = np.zeros((CELLS + 1, 1))
    wide[170:191] = 0.12
    tube = Tube(tube.low - wide, tube.high + wide)
    trees, chain = Trees.of(own_kernel, timeline.clusters), Chain.of(timeline.robot)
    found = own_kernel.unproven_cells(chain, trees, trees.pairs(step), tube, 1)
    assert found.any()
    assert not found[:169].any()
    assert not found[191:].any()
    slow = numpy_boxes.unproven_cells(timeline.robot, timeline.clusters, step.pairs, tube, 1)
    assert (slow >= found).all()
