"""Checks of what a plan states of its own clearance: nothing of it is believed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

from planner.plan import Grip, Move
from planner.swept_result import SweptProof
from planner.verification.certificate import Check, Worst, greatest, least
from planner.verification.clearance import StepFound

STATED_M = 2e-5
"""How much of a stated distance is the accuracy of who measured it."""

NO_PROOFS = "nothing is stated"


def proof_checks(found: Iterable[StepFound]) -> Iterator[Check]:
    """What each step states, against the least distance measured of the pairs that it counts.

    The distance that it says it measured is compared at the moment that it says; it may be more
    than the least, which need not lie at a moment that was looked at.
    """
    steps = list(found)
    beyond = greatest(_beyond(steps), NO_PROOFS, -math.inf)
    yield beyond.at_most(STATED_M, "stated proofs beyond what is measured", "m")
    order = greatest(_out_of_order(steps), NO_PROOFS, -math.inf)
    yield order.at_most(STATED_M, "stated proofs that contradict themselves", "m")
    kept = least(_kept(steps), NO_PROOFS)
    yield kept.at_least(-STATED_M, "clearance beyond the stated margin", "m")


def _beyond(steps: list[StepFound]) -> Iterator[Worst]:
    for step in steps:
        proof = _proof(step.step)
        if proof is not None:
            yield _excess(step, proof.proven_m)
        if step.stated is not None:
            yield step.stated


def _excess(step: StepFound, stated_m: float) -> Worst:
    text = f"{1e3 * stated_m:.3f} mm proven, {1e3 * step.counted.value:.3f} mm measured"
    return Worst(stated_m - step.counted.value, f"{step.step.label}: {text}: {step.counted.where}")


def _out_of_order(steps: list[StepFound]) -> Iterator[Worst]:
    """A margin is at most what is proven, and that at most the nearest that was met."""
    for step in steps:
        proof = _proof(step.step)
        if proof is None:
            continue
        near = proof.nearest.distance_m
        yield Worst(proof.margin_m - proof.proven_m, f"{step.step.label}: margin above proof")
        yield Worst(proof.proven_m - near, f"{step.step.label}: proof above nearest")


def _kept(steps: list[StepFound]) -> Iterator[Worst]:
    for step in steps:
        proof = _proof(step.step)
        if proof is not None:
            text = f"{1e3 * proof.margin_m:.3f} mm asked for, {step.counted.where}"
            yield Worst(step.counted.value - proof.margin_m, text)


def _proof(step: Move | Grip) -> SweptProof | None:
    return step.proof
