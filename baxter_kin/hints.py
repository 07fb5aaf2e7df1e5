"""Suggestions that refusals add: another unit, or the name that was probably meant."""

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
"""Ratio of difflib from which on two names are taken for the same, misspelt."""


def millimetres_hint(*lengths_m: float, least: float = MIN_MILLIMETRES) -> str:
    """What a refusal adds where the longest of some lengths seems to be in millimetres, else "".

    Args:
        lengths_m: lengths or coordinates, of any sign, as they came.
        least: from where on no such length makes sense in metres.
    """
    longest = max(map(float, lengths_m), key=abs)
    if not least <= abs(longest) <= MAX_MILLIMETRES:
        return ""
    shown = round(longest)
    return f"; are these millimetres? Lengths are in metres: {shown} mm is {1e-3 * shown:g} m"


def degrees_hint(*angles_rad: float, least: float = 2.0 * math.pi) -> str:
    """What a refusal adds where the largest of some angles seems to be in degrees, else "".

    Args:
        angles_rad: angles of any sign, as they came.
        least: up to where such an angle makes sense in radians.
    """
    largest = max(map(float, angles_rad), key=abs)
    if not least < abs(largest) <= MAX_DEGREES:
        return ""
    return (
        f"; are these degrees? Angles are in radians: {largest:.4g} deg is "
        f"{math.radians(largest):.4g} rad"
    )


def name_hint(name: object, known: Iterable[str]) -> str:
    """What a refusal adds where a name that does not exist is nearly one that does, else ""."""
    near = nearest_name(name, known)
    return f"; did you mean {near}?" if near else ""


def nearest_name(name: object, known: Iterable[str], alike: float = MIN_SIMILARITY) -> str:
    """The name that may have been meant by one that does not exist; "" where none is near.

    Args:
        name: what came; whether its letters are large or small counts for nothing.
        known: the names that exist. Where several are equally near, none is guessed.
        alike: how alike they must be, by difflib's ratio, 0..1.
    """
    if not isinstance(name, str) or len(name) > MAX_NAME:
        return ""
    matcher, by_ratio = SequenceMatcher(b=name.lower()), dict[float, list[str]]()
    for each in known:
        matcher.set_seq1(each.lower())
        by_ratio.setdefault(matcher.ratio(), []).append(each)
    best = max(by_ratio, default=0.0)
    return by_ratio[best][0] if best >= alike and len(by_ratio[best]) == 1 else ""
