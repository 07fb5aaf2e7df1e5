"""Where to put the table, so that a block can be carried across it.

A map of what both arms reach is built for the heights that matter, with the tool pointing down: in
seconds. It is asked for places of the table; the best of them are confirmed by plans that are
verified.
"""

from __future__ import annotations

import math
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from baxter_kin import Baxter, BaxterError
from baxter_kin.command_line import command, option, parse, whole_number
from baxter_kin.parallel import Serial
from planner import Manipulator, load_object, make_block
from planner.atlas import (
    PlacementGrid,
    Placements,
    PositionGrid,
    ReachMap,
    RotationGrid,
    TableTask,
    TableTransfer,
    build_reach_map,
    where,
)

DOWN = np.diag([-1.0, 1.0, -1.0])
TABLE_TOP_M = 0.775
"""Above the floor, where the table's own frame is."""


STORY = "python -m examples.where_to_put_the_table"


@command(
    STORY,
    (__doc__ or "").split("\n", maxsplit=1)[0],
    examples=(STORY, f"{STORY} --wanted 3"),
    end="It needs the extra `atlas`, and Python 3.11 or later. Exit status: 0 a place is "
    "confirmed; 1 none is; 2 wrong usage.",
)
@dataclass(frozen=True, slots=True, kw_only=True)
class TableOptions:
    """How many places are enough."""

    wanted: int = option(
        "--wanted",
        type=whole_number(1),
        default=1,
        metavar="N",
        help="confirmed places that are enough",
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Run it; returns the exit status."""
    options = parse(TableOptions, argv)
    try:
        found = places(Baxter.load(), options.wanted)
    except BaxterError as error:
        print(error, file=sys.stderr)
        return 1
    print(told(found))
    return 0 if found.confirmed else 1


def places(robot: Baxter, wanted: int) -> Placements:
    """Places of the table in front of the robot, turned by 0 or 30 degrees."""
    with tempfile.TemporaryDirectory() as folder:
        return where(
            map_around_the_table(robot, Path(folder) / "table.zarr"),
            across_the_table(robot),
            PlacementGrid.within((0.7, 1.2), (-0.4, 0.4), step_m=0.1, yaw_rad=(0.0, math.pi / 6)),
            wanted=wanted,
        )


def map_around_the_table(robot: Baxter, path: Path) -> ReachMap:
    """Both arms, 10 cm apart, the tool pointing down with 12 rolls: some 20,000 cells."""
    positions = PositionGrid.within((0.2, -0.9, -0.2), (1.3, 0.9, 0.1), 0.1)
    rotations = RotationGrid.about_tool_axis(DOWN, 12)
    return build_reach_map(path, robot, positions, rotations, engine=Serial())


def across_the_table(robot: Baxter) -> TableTask:
    """A block of 5 cm goes 30 cm across the table, to the robot's right."""
    table = load_object("table", pin.SE3.Identity())
    block = make_block("red", on_the_table(-0.3, 0.15))
    hand = Manipulator.of(robot, "left").hand
    transfer = TableTransfer.from_above(hand, block, on_the_table(-0.3, -0.15))
    return TableTask((transfer,), bodies=(table, block))


def on_the_table(x_m: float, y_m: float) -> pin.SE3:
    """Where the centre of the block is, seen from the table."""
    return pin.SE3(np.eye(3), np.array([x_m, y_m, TABLE_TOP_M + 0.025]))


def told(found: Placements) -> str:
    """What came of it, a line for each place that was confirmed or refused."""
    return "\n".join([*map(str, (*found.confirmed, *found.refused)), found.summary])


if __name__ == "__main__":
    sys.exit(main())
