"""Cell: what a map knows of one pose."""

from __future__ import annotations

from dataclasses import dataclass

import pinocchio as pin

from baxter_kin.validation import FloatArray
from planner.atlas.reach_search import NOT_COMPUTED, UNDECIDED, UNREACHABLE

STATUSES = {UNREACHABLE: "unreachable", UNDECIDED: "undecided", NOT_COMPUTED: "not computed"}
"""Of codes."""


@dataclass(frozen=True, slots=True, eq=False)
class Cell:
    """What a map knows of one pose of its grid.

    Attributes:
        side: of the arm.
        T_base_tip: the pose.
        status: "reachable", "unreachable", "undecided" or "not computed".
        margin_rad: of the witness to the nearest joint limit, rounded down; None without one.
        q: the witness, shape (7,), rad; None without one.
    """

    side: str
    T_base_tip: pin.SE3
    status: str
    margin_rad: float | None
    q: FloatArray | None
