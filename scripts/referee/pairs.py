"""Pairs of solids along samples: what is asked of them, and the samples that break it.

By meaning, not by what a planner allows:
- Fingers and the body that they grasp: from the moment they close until they have opened again, and
  then they press by at most the depth of `PRESSING`; on the straight line in and out, `BRUSHING`.
- The rest of the hand and that body: never. No margin is asked of the two on these lines, as how
  far a body reaches into the hand is chosen with the grasp.
- A held body and what carries it: from the grasp until it is lifted, and when it is put down.
- Nothing else. Contact is what is deeper than `CONTACT_M`.
- Links up to two joints apart, as palm and fingers of a hand, keep no margin, because the robot's
  design gives their distance; they must not meet.

Between two samples no point of the one moves farther, seen from the other, than the corners of the
box around it do: how far a point moves between two poses is the length of an affine function of the
point, which is greatest at a corner. So after a distance `d` all samples are passed over until the
corners may have moved by what `d` exceeds the needed distance (conservative advancement, Mirtich
1996).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from referee.solids import (
    TOUCHING_M,
    Array,
    Solid,
    depth_m,
    distance_m,
    eroded,
    inverse,
    is_inside,
    placed,
)

CONTACT_M = 1e-5
MAX_SLIDE_M = 1e-3
"""How far a body may move aside while it touches what carries it."""

AFTER_A_HIT, MAX_HITS = 5, 200
"""Samples passed over after one that breaks a rule, which is reported in any case; and how many
are looked for."""

MEASURED_HITS = 6
"""Of a long contact, the number of samples whose depth is measured."""


@dataclass(frozen=True)
class Finding:
    """A fault of a plan.

    Attributes:
        kind: such as "touches" or "closer than the margin".
        label: of the step.
        first: link or body.
        second: link or body; empty when the fault is of one alone.
        amount: depth, distance or excess, m or rad; else nan.
        time_s: since the step began.
        detail: more numbers.
    """

    kind: str
    label: str
    first: str
    second: str = ""
    amount: float = np.nan
    time_s: float = 0.0
    detail: str = ""

    def __str__(self) -> str:
        pair = f"{self.first} - {self.second}" if self.second else self.first
        more = f", {self.detail}" if self.detail else ""
        return f"{self.label} at {self.time_s:.3f} s: {pair}: {self.kind} ({self.amount:.3g}{more})"


@dataclass(frozen=True)
class Rule:
    """What is asked of a pair.

    Attributes:
        kind: of the finding when it is broken.
        max_depth_m: how deep they may be inside each other.
        margin_m: how far apart they must stay, if more is asked than not to touch.
    """

    kind: str = "touches"
    max_depth_m: float = CONTACT_M
    margin_m: float = 0.0

    @property
    def needed_m(self) -> float:
        """The distance below which it is broken; 0 for an intersection."""
        return max(self.margin_m - CONTACT_M, 0.0)


FORBIDDEN = Rule()
BRUSHING = Rule("brushes too deep", 1e-4)
PRESSING = Rule("presses too deep", 5e-4)


def margin_rule(margin_m: float) -> Rule:
    """A margin is asked for, unless it is zero."""
    return Rule("closer than the margin", margin_m=margin_m) if margin_m > 0.0 else FORBIDDEN


@dataclass(frozen=True)
class Span:
    """A rule from one sample up to another, that one left out."""

    first: int
    last: int
    rule: Rule


When = Callable[[int], tuple[str, float]]
"""The step of a sample, and the time in it."""


@dataclass(eq=False)
class Track:
    """A solid and its pose in base at every sample, shape (n, 4, 4), or (4, 4) if it stands."""

    solid: Solid
    T: Array

    @property
    def moves(self) -> bool:
        """Whether it has a pose for every sample."""
        return self.T.ndim == 3

    @cached_property
    def swept(self) -> Array:
        """The box in base around it at all samples, shape (2, 3)."""
        corners = placed(self.T, self.solid.corners).reshape(-1, 3)
        return np.array([corners.min(axis=0), corners.max(axis=0)])

    def part(self, first: int, last: int) -> Track:
        """The same from one sample up to another, that one left out."""
        whole = not self.moves or (first == 0 and last == len(self.T))
        return self if whole else Track(self.solid, self.T[first:last])


def broken(
    one: Iterable[Track], other: Iterable[Track], spans: Iterable[Span], when: When
) -> Iterator[Finding]:
    """What breaks the rules of two bodies; one finding for each span and pair of their solids."""
    for a, b in ((a, b) for a in one for b in other):
        for span in spans:
            if span.first < span.last:
                yield from _broken(a, b, span, when)


def _broken(one: Track, other: Track, span: Span, when: When) -> Iterator[Finding]:
    a, b, rule = one.part(span.first, span.last), other.part(span.first, span.last), span.rule
    pair = eroded(a.solid, b.solid, rule.max_depth_m if rule.needed_m == 0.0 else 0.0)
    if pair is None or _are_far(a.swept, b.swept, rule.needed_m):
        return
    T = inverse(b.T) @ a.T
    T = T if T.ndim == 3 else T[None]
    hits = _hits(*pair, T, rule.needed_m)
    names = a.solid.name, b.solid.name
    label, time_s = when(span.first + (hits[0][0] if hits else 0))
    if not hits:
        if is_inside(*pair, T[0]):
            yield Finding("inside", label, *names, time_s=time_s)
        return
    closest = min(distance for _, distance in hits)
    if closest > 0.0:
        text = f"{1e3 * rule.margin_m:.1f} mm asked"
        yield Finding(rule.kind, label, *names, closest, time_s, text)
        return
    touching = [sample for sample, distance in hits if distance == 0.0]
    chosen = touching[:: max(1, len(touching) // MEASURED_HITS)]
    depth, deepest = max((depth_m(a.solid, b.solid, T[i]), i) for i in chosen)
    deep, last = when(span.first + deepest), when(span.first + hits[-1][0])
    text = f"deepest in {deep[0]} at {deep[1]:.3f} s, last seen in {last[0]} at {last[1]:.3f} s"
    yield Finding(rule.kind, label, *names, depth, time_s, text)


def _hits(a: Solid, b: Solid, T: Array, needed_m: float) -> list[tuple[int, float]]:
    """Samples at which two solids are closer than needed, or intersect if that is 0.

    Args:
        a: the one solid.
        b: the other one.
        T: poses of the first seen from the second, shape (n, 4, 4).
        needed_m: their distance must not be less.

    Returns:
        Samples and distances; not all of a long contact.
    """
    steps = np.linalg.norm(np.diff(placed(T, a.corners), axis=0), axis=2).max(axis=1)
    way = np.append(0.0, np.cumsum(steps))
    hits, sample = list[tuple[int, float]](), 0
    while sample < len(T) and len(hits) < MAX_HITS:
        distance = distance_m(a, b, T[sample])
        if distance <= TOUCHING_M or distance < needed_m:
            hits.append((sample, distance))
            sample += AFTER_A_HIT
        else:
            free_m = max(distance - needed_m, TOUCHING_M)
            sample = int(np.searchsorted(way, way[sample] + free_m))
    return hits


def _are_far(box: Array, other: Array, needed_m: float) -> bool:
    gap = np.maximum(np.maximum(other[0] - box[1], box[0] - other[1]), 0.0)
    return bool(np.linalg.norm(gap) > needed_m)


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
    """Faults of a held solid with one that carries it: they touch at the ends, never between.

    Args:
        held: the held solid, moving.
        other: the one that stands.
        ends: whether it carries the body at the first sample, and at the last.
        lines: the sample up to which the way out is straight, and from which the way in is.
        tips: position of the tip, shape (n, 3).
        rest: what is asked of all that must not touch.
        when: step and time of a sample.
    """
    T = inverse(other.T) @ held.T
    count = len(T)
    leaves = _contact_ends(held.solid, other.solid, T) if ends[0] else 0
    meets = count - (_contact_ends(held.solid, other.solid, T[::-1]) if ends[1] else 0)
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
    yield from broken([held], [other], spans, when)
    for first, last in ((0, leaves), (meets, count)):
        moved = float(np.ptp(tips[first:last, :2], axis=0).max()) if first < last else 0.0
        if moved > MAX_SLIDE_M + CONTACT_M:
            label, time_s = when(last - 1)
            names = held.solid.name, other.solid.name
            yield Finding("slides while touching", label, *names, moved, time_s)


def _contact_ends(held: Solid, other: Solid, T: Array) -> int:
    """How many samples a contact lasts that is there from the first; 0 for none."""
    far = (n for n, pose in enumerate(T) if distance_m(held, other, pose) > CONTACT_M)
    return next(far, len(T))
