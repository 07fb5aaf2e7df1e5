"""Pairs of solids along samples, each with its rule, and what breaks it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from referee.clearance import Track, approach, distance_m, inverse
from referee.findings import Finding
from referee.rules import Rule
from referee.solids import Array, Solid

DEEPEST_M = 0.05
"""Deeper is reported as this."""

MEASURED_HITS = 6
"""Of a long contact, how many samples are measured for how deep it is."""

When = Callable[[int], tuple[str, float]]
"""The step and the time in it of a sample."""


@dataclass(frozen=True)
class Span:
    """A rule from one sample up to another, that one left out."""

    first: int
    last: int
    rule: Rule


def broken(one: Track, other: Track, spans: list[Span], when: When) -> Iterator[Finding]:
    """What breaks the rules of a pair; one finding for each span that is broken."""
    for span in spans:
        if span.first >= span.last:
            continue
        a, b = one.part(span.first, span.last), other.part(span.first, span.last)
        shrunk = _eroded(a, b, span.rule.erosion_m)
        if shrunk is None:
            continue
        found = approach(*shrunk, span.rule.needed_m)
        if found.hits:
            yield _finding(a, b, span, found.hits, when)
        elif found.is_near_at_first and _is_inside(*shrunk, 0):
            label, time_s = when(span.first)
            names = one.solid.name, other.solid.name
            yield Finding("inside", label, time_s, *names, float("nan"))


def _finding(
    a: Track, b: Track, span: Span, hits: tuple[tuple[int, float], ...], when: When
) -> Finding:
    label, time_s = when(span.first + hits[0][0])
    names = a.solid.name, b.solid.name
    closest = min(found for _, found in hits)
    if closest > 0.0:
        text = f"{1e3 * span.rule.margin_m:.1f} mm asked"
        return Finding(span.rule.kind, label, time_s, *names, closest, text)
    touching = [sample for sample, found in hits if found == 0.0]
    chosen = touching[:: max(1, len(touching) // MEASURED_HITS)]
    depths = [(depth_m(a, b, sample), sample) for sample in chosen]
    deepest, sample = max(depths)
    deep, last = when(span.first + sample), when(span.first + hits[-1][0])
    text = f"deepest in {deep[0]} at {deep[1]:.3f} s, last seen in {last[0]} at {last[1]:.3f} s"
    return Finding(span.rule.kind, label, time_s, *names, deepest, text)


def depth_m(a: Track, b: Track, sample: int) -> float:
    """How deep a point of the one surface is in the other solid; nan for two mere surfaces."""
    if not (a.solid.is_convex or b.solid.is_convex):
        return float("nan")
    T = inverse(b.at(sample)) @ a.at(sample)
    low, high = 0.0, DEEPEST_M
    while high - low > max(1e-6, 0.02 * low):
        middle = (low + high) / 2
        is_so_deep = _is_deep(a.solid, b.solid, T, middle)
        low, high = (middle, high) if is_so_deep else (low, middle)
    return low


def _is_deep(first: Solid, second: Solid, T: Array, depth: float) -> bool:
    """Whether they still meet when one is eroded."""
    small, other, T_other_small = _smaller(first, second, T)
    left = small.shrink(depth) if small.shrink is not None else None
    return left is not None and distance_m(left, other, T_other_small) == 0.0


def _smaller(first: Solid, second: Solid, T: Array) -> tuple[Solid, Solid, Array]:
    """The solid to erode first: the second where it can be."""
    return (second, first, inverse(T)) if second.is_convex else (first, second, T)


def _eroded(a: Track, b: Track, erosion_m: float) -> tuple[Track, Track] | None:
    """The pair with one of both eroded; None when nothing is left of it."""
    if erosion_m == 0.0:
        return a, b
    if b.solid.is_convex:
        left = b.solid.eroded(erosion_m)
        return None if left is None else (a, b.with_solid(left))
    left = a.solid.eroded(erosion_m)
    return None if left is None else (a.with_solid(left), b)


def _is_inside(a: Track, b: Track, sample: int) -> bool:
    """Whether one is wholly inside the other at a sample where their surfaces do not meet.

    Two surfaces of the robot are not asked: they cannot have got there.
    """
    if not (a.solid.is_convex or b.solid.is_convex):
        return False
    T = inverse(b.at(sample)) @ a.at(sample)
    return _holds(b.solid, a.solid, T) or _holds(a.solid, b.solid, inverse(T))


def _holds(outer: Solid, inner: Solid, T_outer_inner: Array) -> bool:
    low, high = outer.box
    points = inner.vertices if outer.is_convex else inner.centre[None]
    points = points @ T_outer_inner[:3, :3].T + T_outer_inner[:3, 3]
    within = ((points > low) & (points < high)).all(axis=1)
    return bool(within.any()) and bool(np.any(outer.contains(points[within])))
