"""A held body and what carries it: touching at first, and when it is put down, never between."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from referee.clearance import Track, distance_m, inverse
from referee.findings import Finding
from referee.pairs import Span, When, broken
from referee.rules import CONTACT_M, FORBIDDEN, PRESSING, SLIDE_M, Rule
from referee.solids import Array


def held_findings(
    held: Track,
    other: Track,
    *,
    ends: tuple[bool, bool],
    lines: tuple[int, int],
    tips: Array,
    rest: Rule,
    when: When,
) -> Iterator[Finding]:
    """What is wrong between a held solid and one of a body that carries it.

    Args:
        held: the held solid, moving.
        other: the one that stands.
        ends: whether it carries the body at the first sample, and at the last.
        lines: up to which sample the way out is straight, and from which the way in is.
        tips: where the tip is, shape (n, 3).
        rest: what is asked of all that must not touch.
        when: the step and time of a sample.
    """
    count = held.count
    leaves = _contact_ends(held, other) if ends[0] else 0
    backwards = Track(held.solid, held.T[::-1])
    meets = count - (_contact_ends(backwards, other) if ends[1] else 0)
    if leaves >= meets:  # it never comes off
        leaves = meets = count
    out, into = max(lines[0], leaves), min(lines[1], meets)
    spans = [
        Span(0, leaves, PRESSING),
        Span(leaves, min(out, meets), FORBIDDEN),
        Span(out, into, rest),
        Span(max(into, leaves, min(out, meets)), meets, FORBIDDEN),
        Span(meets, count, PRESSING),
    ]
    yield from broken(held, other, spans, when)
    for first, last in ((0, leaves), (meets, count)):
        if first < last:
            moved = float(np.ptp(tips[first:last, :2], axis=0).max())
            if moved > SLIDE_M + CONTACT_M:
                names = held.solid.name, other.solid.name
                yield Finding("slides while touching", *when(last - 1), *names, moved)


def _contact_ends(held: Track, other: Track) -> int:
    """How many samples a contact lasts that is there from the first; 0 for none."""
    last = 0
    while last < held.count:
        T_other_held = inverse(other.at(last)) @ held.at(last)
        if distance_m(held.solid, other.solid, T_other_held) > CONTACT_M:
            break
        last += 1
    return last
