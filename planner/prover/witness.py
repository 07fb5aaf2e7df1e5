"""What leads the checker through a plan: the rows of all steps, and what each step keeps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from planner.certificate.checking import Witness
from planner.certificate.rows import Step, Trace
from planner.certificate.timeline import StepWitness, Timeline
from planner.prover.kernel import Chain, Rows, Trees, rows_kernel
from planner.prover.numpy_search import rows_of


def witness_of(
    timeline: Timeline,
    body: str,
    steps: Sequence[StepWitness],
    *,
    margins_m: Sequence[float] | None = None,
    share: float = 0.0,
) -> Witness:
    """A certificate of a plan whose steps are known.

    Args:
        timeline: made with the same witnesses.
        body: digest of the file of clusters.
        steps: what the certificate says of each step of the plan, but for its margin.
        margins_m: what each step must keep; 0 when not given.
        share: how much of the least distance that is met shall be proven; without a C compiler,
            margins alone count.
    """
    asked = [0.0] * len(steps) if margins_m is None else margins_m
    kernel = rows_kernel()
    trees = None if kernel is None else Trees.of(kernel, timeline.clusters)
    chain = Chain.of(timeline.robot)

    def rows(step: Step, margin_m: float) -> Rows:
        if kernel is None or trees is None:
            return rows_of(timeline.robot, timeline.clusters, step, margin_m)
        return kernel.rows(chain, trees, step, margin_m=margin_m, share=share)

    kept = [np.inf] * len(steps)
    traces = []
    for step, number in zip(timeline.steps, timeline.numbers, strict=True):
        found = rows(step, 0.0 if number is None else asked[number])
        traces.append(found.trace)
        if number is not None:
            kept[number] = min(kept[number], found.proven_m)
    proven = [max(0.0, margin) if np.isfinite(margin) else 0.0 for margin in kept]
    witnesses = tuple(replace(s, margin_m=m) for s, m in zip(steps, proven, strict=True))
    return Witness(body, witnesses, Trace.joined(traces))
