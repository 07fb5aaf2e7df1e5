"""Tasks of both hands with one body: a bar on the table, and a tray on a stand."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from planner import (
    Body,
    Box,
    Manipulator,
    PairCarry,
    Part,
    Scene,
    State,
    Upright,
    load_object,
)
from tests.conftest import at
from tests.planner.two_arms.pairs import TABLE_Z_M, started

TILT_RAD = float(np.radians(3.0))

BAR_TIPS = {
    side: pin.SE3(np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]), at_end)
    for side, at_end in (("left", np.array([0.0, 0.2, 0.0])), ("right", np.array([0.0, -0.2, 0.0])))
}
"""Vertical hands above both ends."""

TRAY_TIPS = {
    "left": pin.SE3(np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]), np.array([0.0, 0.22, 0.0])),
    "right": pin.SE3(
        np.array([[-1.0, 0, 0], [0, 0, 1.0], [0, 1.0, 0]]), np.array([0.0, -0.22, 0.0])
    ),
}
"""Level hands that point at each other and close on the tray from above and below."""


def bar(manipulators: Mapping[str, Manipulator]) -> tuple[PairCarry, State]:
    """A bar on the table, carried any way."""
    z = TABLE_Z_M + 0.015
    part = Part(Box((0.03, 0.6, 0.03)), pin.SE3.Identity())
    body = Body("bar", (part,), at(0.6, 0.0, z), is_movable=True)
    task = PairCarry("bar", BAR_TIPS, at(0.7, 0.1, z))
    return task, started(manipulators, Scene.of([_table(), body]))


def tray(manipulators: Mapping[str, Manipulator]) -> tuple[PairCarry, State]:
    """A tray on a stand, carried upright on straight lines."""
    z = TABLE_Z_M + 0.21
    stand = Part(Box((0.5, 0.2, 0.2)), pin.SE3.Identity())
    part = Part(Box((0.2, 0.5, 0.02)), pin.SE3.Identity())
    bodies = [
        _table(),
        Body("stand", (stand,), at(0.7, 0.0, TABLE_Z_M + 0.1)),
        Body("tray", (part,), at(0.6, 0.0, z), is_movable=True),
    ]
    upright = Upright(max_tilt_rad=TILT_RAD)
    task = PairCarry("tray", TRAY_TIPS, at(0.62, 0.03, z), is_straight=True, upright=upright)
    return task, started(manipulators, Scene.of(bodies))


def _table() -> Body:
    return load_object("table", at(1.0, 0.0, -0.93))
