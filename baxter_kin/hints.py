"""Suggestions at the end of error messages: another unit, or a similar name."""

from __future__ import annotations

import math
from collections.abc import Iterable
from difflib import SequenceMatcher

from baxter_kin.display import MAX_NAME

MIN_MILLIMETRES, MAX_MILLIMETRES = 10.0, 1e4
"""Lengths given in metres between these are taken for millimetres: nothing on or around Baxter is
10 m long, and nothing is as far away as 10,000 mm."""

MAX_DEGREES = 360.0

MIN_SIMILARITY = 0.6
"""Similarity by difflib from which on a name counts as a misspelling of another."""


def millimetres_hint(*lengths_m: float, least: float = MIN_MILLIMETRES) -> str:
    """The question whether lengths are in millimetres, if the longest looks so, else "".

    Args:
        lengths_m: lengths or coordinates of any sign, as given.
        least: the smallest value that makes no sense in metres.
    """
    longest = max(map(float, lengths_m), key=abs)
    if not least <= abs(longest) <= MAX_MILLIMETRES:
        return ""
    shown = round(longest)
    return f"; are these millimetres? Lengths are in metres: {shown} mm is {1e-3 * shown:g} m"


def degrees_hint(*angles_rad: float, least: float = 2.0 * math.pi) -> str:
    """The question whether angles are in degrees, if the largest looks so, else "".

    Args:
        angles_rad: angles of any sign, as given.
        least: the largest value that makes sense in radians.
    """
    largest = max(map(float, angles_rad), key=abs)
    if not least < abs(largest) <= MAX_DEGREES:
        return ""
    return (
        f"; are these degrees? Angles are in radians: {largest:.4g} deg is "
        f"{math.radians(largest):.4g} rad"
    )


def name_hint(name: object, known: Iterable[str]) -> str:
    """The question whether a similar known name was meant, else ""."""
    near = nearest_name(name, known)
    return f"; did you mean {near}?" if near else ""


def nearest_name(name: object, known: Iterable[str], alike: float = MIN_SIMILARITY) -> str:
    """The known name that is most similar to a given one; "" if none or several are.

    Args:
        name: the given name; upper and lower case are not distinguished.
        known: the existing names.
        alike: minimum similarity by difflib, 0..1.
    """
    if not isinstance(name, str) or len(name) > MAX_NAME:
        return ""
    matcher, by_ratio = SequenceMatcher(b=name.lower()), dict[float, list[str]]()
    for each in known:
        matcher.set_seq1(each.lower())
        by_ratio.setdefault(matcher.ratio(), []).append(each)
    best = max(by_ratio, default=0.0)
    return by_ratio[best][0] if best >= alike and len(by_ratio[best]) == 1 else ""
