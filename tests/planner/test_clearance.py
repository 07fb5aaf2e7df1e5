"""What is found of distances, and how it is told."""

from __future__ import annotations

from planner import Clearance
from planner.clearance import least


def test_the_least_of_clearances_is_the_smallest_and_of_none_is_none() -> None:
    far, near = Clearance(0.2, "a", "b"), Clearance(-0.1, "c", "d")
    assert least([far, near, far]) is near
    assert least([]) is None
