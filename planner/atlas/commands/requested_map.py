"""Which map a command line asks for: options that were given, then the map that is there."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

from baxter_kin import Baxter
from baxter_kin.command_line import (
    Options,
    add_hands,
    add_urdf,
    hands_of,
    number,
    number_within,
    whole_number,
)
from baxter_kin.kinematics.arm import LIMBS
from planner.atlas.building import check_same, check_size
from planner.atlas.commands.exit_status import asked_for
from planner.atlas.commands.rotation_files import read_rotations
from planner.atlas.map_files import check_vacant, check_writable, is_map
from planner.atlas.positions import PositionGrid
from planner.atlas.reach_map import ARRAYS, ReachMap
from planner.atlas.rotations import RotationGrid

STEP_M, LEAST_STEP_M, MOST_STEP_M = 0.025, 1e-4, 2.0

ARMS = {side: (side,) for side in LIMBS} | {"both": LIMBS}


@dataclass(frozen=True, slots=True, eq=False)
class RequestedMap:
    """What to build.

    Attributes:
        path: a folder.
        robot: whose map.
        positions: its grid.
        rotations: at every position.
        arms: which.
        found: the map that is there already.
    """

    path: Path
    robot: Baxter
    positions: PositionGrid
    rotations: RotationGrid
    arms: tuple[str, ...]
    found: ReachMap | None

    def __len__(self) -> int:
        return len(self.arms) * len(self.positions) * len(self.rotations)


def add_map_options(parser: Options) -> None:
    """Add what a map is of; `requested_map` reads it."""
    grid = parser.add_argument_group("poses")
    grid.add_argument(
        "--step-m",
        type=number_within(LEAST_STEP_M, MOST_STEP_M, "m"),
        metavar="M",
        help=f"between positions (default: {STEP_M:g})",
    )
    grid.add_argument(
        "--box",
        type=number,
        nargs=6,
        metavar=("X", "Y", "Z", "X", "Y", "Z"),
        help="lowest and highest corner of the positions in base, m (default: all that a tip of "
        "the robot can get to)",
    )
    rotations = grid.add_mutually_exclusive_group()
    rotations.add_argument(
        "--hopf",
        type=whole_number(0),
        metavar="LEVEL",
        help="an even grid of 72 * 8^LEVEL rotations (default: 1, which has 576)",
    )
    rotations.add_argument(
        "--rotations",
        type=Path,
        metavar="FILE",
        help="rotations of your own: text or CSV with a quaternion x, y, z, w on each line, or an "
        ".npy of shape (n, 4)",
    )
    robot = parser.add_argument_group("robot")
    robot.add_argument("--arm", choices=tuple(ARMS), help="which (default: both)")
    add_urdf(robot)
    add_hands(robot)


def requested_map(arguments: argparse.Namespace) -> RequestedMap:
    """What the arguments ask for. Of a map that is there, what was not given is as it is.

    Raises:
        UsageError: when the grid has no cell, or too many, or the rotations cannot be read.
        AtlasError: when what is at the path is another map, or no map, or is damaged.
    """
    path: Path = arguments.path
    if not is_map(path):
        check_vacant(path, ARRAYS)
    found = ReachMap(path) if is_map(path) else None
    robot = _robot(arguments, found)
    with asked_for():
        positions, arms = _positions(arguments, robot, found), _arms(arguments, found)
        rotations = _rotations(arguments, found)
        check_size(
            len(arms) * len(positions) * len(rotations), arguments.most_cells, "--most-cells"
        )
    if found is None:
        positions = positions.in_blocks_for(len(rotations))
    else:
        check_same(found, robot, positions, rotations, arms)
        if found.missing_blocks():
            check_writable(path, path / "margins")
        positions = found.positions
    return RequestedMap(path, robot, positions, rotations, arms, found)


def most_cells(text: str) -> int:
    """The type of how many cells a map may have; 1e12 is a way to write it."""
    value = number(text)
    if not 1.0 <= value <= 1e18 or value != int(value):
        raise argparse.ArgumentTypeError(f"{text} is not a whole number from 1 to 1e18")
    return int(value)


def _robot(arguments: argparse.Namespace, found: ReachMap | None) -> Baxter:
    hands = hands_of(arguments)
    if found is not None and arguments.urdf is None and not hands:
        return found.robot
    return Baxter.load(arguments.urdf, hands=hands)


def _positions(
    arguments: argparse.Namespace, robot: Baxter, found: ReachMap | None
) -> PositionGrid:
    if found is not None and arguments.step_m is None and arguments.box is None:
        return found.positions
    kept_m = STEP_M if found is None else found.positions.step_m
    step_m = kept_m if arguments.step_m is None else arguments.step_m
    if arguments.box is None:
        return PositionGrid.around(robot, step_m)
    return PositionGrid.within(arguments.box[:3], arguments.box[3:], step_m)


def _rotations(arguments: argparse.Namespace, found: ReachMap | None) -> RotationGrid:
    if arguments.rotations is not None:
        return read_rotations(arguments.rotations)
    if arguments.hopf is not None:
        return RotationGrid.hopf(arguments.hopf)
    return RotationGrid.hopf() if found is None else found.rotations


def _arms(arguments: argparse.Namespace, found: ReachMap | None) -> tuple[str, ...]:
    if arguments.arm is not None:
        return ARMS[arguments.arm]
    return LIMBS if found is None else found.arms
