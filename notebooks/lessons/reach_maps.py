"""The exercises of notebook 7: where both arms grasp, the widest margin, how near a far pose is."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from baxter_kin import pose_from_quaternion
from baxter_kin.frames import angle_between
from baxter_kin.kinematics.arm import LIMBS
from lessons.answers import Mistake, exercise, instance, number, refuse, shown, stock_robot
from planner.atlas import Cell, NearestPose, PositionGrid, RotationGrid
from planner.atlas.reach_search import RAD_PER_MARGIN, Codes, ReachSearch

DOWN = np.diag([-1.0, 1.0, -1.0])
"""The tip seen from base, pointing straight down."""

STEP_M, ROLLS = 0.1, 12
LOW_M, HIGH_M = (0.2, -0.9, -0.2), (1.3, 0.9, 0.1)
"""Of the notebook's `table_map`."""

AREA_Z_M = -0.1
"""The height of the first two exercises."""

FAR_BASE = (1.10, 0.30, -0.10)
"""Where the tip cannot get to in the third exercise, m."""

SLACK_RAD = 1e-3
"""How far below the widest margin an answer may be; it is stored in steps of 1e-4 rad."""

NEAR_M = 1e-6
SAME_RAD = 1e-6


@exercise("set `answer` to an area in m^2, such as 0.5")
def check_area(answer: Any) -> str:
    """How large the area is in which both arms reach a height, pointing down with some roll.

    Args:
        answer: m^2; each position of the map counts for a square of its step.
    """
    given = number(answer, "one area in m^2")
    left, right = (_margins(side)[:, :, _layer(AREA_Z_M)].max(axis=-1) >= 0 for side in LIMBS)
    square_m2 = STEP_M**2
    wanted = float((left & right).sum()) * square_m2
    if abs(given - wanted) < 0.01 * square_m2:
        return f"both arms reach {(left & right).sum()} positions, {wanted:.2f} m^2"
    other = [
        (_margins(side)[:, :, _layer(-AREA_Z_M)].max(axis=-1) >= 0) * square_m2 for side in LIMBS
    ]
    refuse(
        given,
        {
            "that is how many positions there are; each stands for 0.1 m x 0.1 m": (
                wanted / square_m2
            ),
            "that is the area that either arm reaches; asked for is where both do": (
                (left | right).sum() * square_m2
            ),
            "that is the area of one arm; asked for is where both reach": left.sum() * square_m2,
            "that counts every roll by itself; a position counts once, whatever the roll": (
                sum((_margins(side)[:, :, _layer(AREA_Z_M)] >= 0).sum() for side in LIMBS)
                * square_m2
            ),
            f"that is the area at z = {-AREA_Z_M} m; asked for is z = {AREA_Z_M} m": (
                np.minimum(*other).sum()
            ),
        },
        1e-3,
    )
    raise Mistake("take the layer of z, then `(margins >= 0).any(axis=-1)` for each arm, and `&`")


@exercise("set `answer` to the cell, as table_map.cell(...) gives it")
def check_widest(answer: Any) -> str:
    """The cell at a height whose witness of the left arm is farthest from the joint limits.

    Args:
        answer: a `Cell`.
    """
    cell = instance(answer, Cell, "table_map.cell(side, position, rotation)")
    place = cell.T_base_tip.translation
    if cell.side != "left":
        raise Mistake(f"this cell is of the {cell.side} arm; asked for is the left one")
    if abs(place[2] - AREA_Z_M) > NEAR_M:
        raise Mistake(f"this cell is at z = {place[2]:.1f} m; asked for is z = {AREA_Z_M} m")
    if cell.T_base_tip.rotation[2, 2] > -1.0 + NEAR_M:
        raise Mistake("in this cell the hand does not point down; take it from `table_map`")
    if cell.margin_rad is None:
        raise Mistake(f"the cell at {shown(place)} m is {cell.status}, so it has no margin")
    best = RAD_PER_MARGIN * _margins("left")[:, :, _layer(AREA_Z_M)].max()
    if cell.margin_rad < best - SLACK_RAD:
        raise Mistake(
            f"the witness at {shown(place)} m is {cell.margin_rad:.3f} rad from a limit, and "
            f"another cell's {best:.3f} rad"
        )
    return f"at {shown(place)} m the nearest limit is {cell.margin_rad:.3f} rad away"


@exercise("set `answer` to what nearest_reachable(...) gives")
def check_nearest(answer: Any) -> str:
    """The nearest pose to `FAR_BASE`, pointing down, that the left arm reaches.

    Args:
        answer: a `NearestPose`.
    """
    found = instance(answer, NearestPose, "nearest_reachable(table_map, pose, 'left')")
    asked = pose_from_quaternion(FAR_BASE, (0.0, 1.0, 0.0, 0.0))
    if found.side != "left":
        raise Mistake(f"this is about the {found.side} arm; asked for is the left one")
    if np.linalg.norm(found.T_base_asked.translation - asked.translation) > NEAR_M:
        place = found.T_base_asked.translation
        raise Mistake(f"this is about a pose at {shown(place)} m, not at {shown(FAR_BASE)} m")
    if angle_between(found.T_base_asked.rotation, asked.rotation) > SAME_RAD:
        raise Mistake("the pose that was asked for does not point down as DOWN does")
    if found.T_base_tip is None or found.q is None:
        raise Mistake("nothing was found; ask with the table_map of this notebook")
    if found.angle_rad > SAME_RAD:
        raise Mistake("the hand was turned; leave `keep` out, so that it points down as before")
    off_m = np.linalg.norm(
        stock_robot().arm("left").T_base_tip(found.q).translation - found.T_base_tip.translation
    )
    if off_m > NEAR_M:
        raise Mistake("the joint angles of this answer are not those of its pose")
    return (
        f"{1e3 * found.offset_m:.0f} mm away it can be reached, and nothing nearer than "
        f"{1e3 * found.proven:.0f} mm, which is proven"
    )


@cache
def _margins(side: str) -> Codes:
    """What `table_map` says of an arm, computed here: shape (nx, ny, nz, rolls)."""
    positions = PositionGrid.within(LOW_M, HIGH_M, STEP_M)
    rotations = RotationGrid.about_tool_axis(DOWN, ROLLS)
    cells = ReachSearch(stock_robot().arm(side), rotations).search(
        positions.points().reshape(-1, 3)
    )
    return cells.margins.reshape(*positions.shape, ROLLS)


def _layer(z_m: float) -> int:
    """Which layer of the map is at a height."""
    return round((z_m - LOW_M[2]) / STEP_M)
