"""One self-contained HTML page of a reach map: no network, no server, no installation.

Meshcat's viewer, the robot and the cells with their witnesses are inside. A page has as many cells
as fit into `MAX_PAGE_BYTES`; of a larger map every n-th position is shown, and the page says so.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from baxter_kin import Baxter
from baxter_kin.display import shown_path
from baxter_kin.errors import FileError
from baxter_kin.files import PathLike, replace_file
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray, expect
from planner.atlas.reach_map import ReachMap
from planner.atlas.reach_search import (
    NOT_COMPUTED,
    RAD_PER_MARGIN,
    RAD_PER_STEP,
    UNDECIDED,
    UNREACHABLE,
)
from planner.errors import AtlasError
from sim.view.appearance import Appearance
from sim.view.atlas.shown_map import ShownMap, shown_part, thinning
from sim.view.atlas.witnesses import (
    FIRST_BITS,
    OTHER_BITS,
    SETTINGS,
    TOLERANCE,
    T_last_tip,
    pack,
)
from sim.view.meshcat_commands import Command, set_property, shared_geometries
from sim.view.scenegraph import RobotTree, stage_commands
from sim.view.webpage import encoded, page

TITLE = "Baxter: what it can reach"

MAX_PAGE_BYTES = 5_000_000

MAX_CELLS = 8_000_000
"""Number of cells that is tried first: 2.5 million cells with 240,000 witnesses take 0.9 MB, and
the rest of the page 2 MB."""

MIN_POSITIONS = 4
"""Positions along the longest side below which a map is not thinned further."""

MARGINS_PER_LEVEL = 100
"""Margins on the page are in steps of 0.01 rad, rounded down."""

FIRST_LEVEL = 3
"""Level of a reachable cell without any margin; lower ones are the codes of other cells."""

SECTORS = (
    "forward",
    "forward left",
    "left",
    "back left",
    "back",
    "back right",
    "right",
    "forward right",
)
"""Names of azimuths, an eighth of a turn each, from base's x axis towards y."""

UPRIGHT_DEG = 0.5
"""Maximum deviation of what is called "up" or "down", or has no elevation."""


def write_atlas_page(path: PathLike, reach_map: ReachMap, *, title: str = TITLE) -> int:
    """Write the page of a map to a file, completely or not at all.

    Args:
        path: the HTML file; an older one is replaced.
        reach_map: the map; cells that are not computed yet are shown as such.
        title: shown on the page, and its name in the browser.

    Returns:
        n, if the page has every n-th position along each axis; 1 when it has all of them.
    """
    expect(reach_map, ReachMap, "reach_map", AtlasError)
    text, every = _atlas_html(reach_map, title)
    try:
        replace_file(path, text.encode())
    except FileError as cause:
        raise AtlasError(f"cannot write the page to {shown_path(path)}: {cause.reason}") from cause
    return every


def _atlas_html(reach_map: ReachMap, title: str) -> tuple[str, int]:
    notice = Appearance.of(reach_map.robot).notice
    every, longest = thinning(reach_map, MAX_CELLS), max(reach_map.positions.shape)
    while every == 1 or longest >= MIN_POSITIONS * every:
        data = encoded(_content(reach_map, shown_part(reach_map, every)))
        text = page("atlas/atlas.html", title=title, notice=notice, data=data)
        if len(text.encode()) <= MAX_PAGE_BYTES:
            return text, every
        every += 1
    raise AtlasError(
        f"no useful part of a map of {len(reach_map):,} cells fits into a page of "
        f"{MAX_PAGE_BYTES / 1e6:g} MB; {len(reach_map.rotations):,} rotations are too many: build "
        "one with fewer"
    )


def _content(reach_map: ReachMap, shown: ShownMap) -> Command:
    """What the page decodes: the robot, the cells, and how to find witnesses again."""
    robot, rotations = reach_map.robot, reach_map.rotations
    tree = RobotTree(robot.model, Appearance.of(robot))
    commands = [*stage_commands(), *tree.commands(), *_posture(robot, tree)]
    geometries, commands = shared_geometries(commands)
    return {
        "geometries": geometries,
        "commands": commands,
        "map": {
            "low": shown.low_m.tolist(),
            "step": shown.step_m,
            "stepOfMap": reach_map.positions.step_m,
            "every": shown.every,
            "shape": list(shown.codes.shape[1:4]),
            "arms": list(reach_map.arms),
            "levels": _levels(shown).reshape(-1),
            "radPerLevel": MARGINS_PER_LEVEL * RAD_PER_MARGIN,
            "directions": direction_names(rotations.R_base_tips),
            "rolls": rotations.rolls.tolist(),
            "rotations": rotations.matrices.reshape(-1, 9).tolist(),
            "cells": len(reach_map),
        },
        "witnesses": _witnesses(reach_map, shown),
        "arms": {side: _arm(robot.arm(side), tree) for side in reach_map.arms},
        "polishing": {**SETTINGS, "tolerance": 2.0 * TOLERANCE},
    }


def _levels(shown: ShownMap) -> NDArray[np.uint8]:
    """Cells as the page reads them, shape (arms, rotations, nx, ny, nz), neighbours adjacent."""
    codes = np.moveaxis(shown.codes, 4, 1)
    levels = (codes // MARGINS_PER_LEVEL + FIRST_LEVEL).clip(0, 255).astype(np.uint8)
    for level, code in enumerate((NOT_COMPUTED, UNREACHABLE, UNDECIDED)):
        levels[codes == code] = level
    return levels


def _witnesses(reach_map: ReachMap, shown: ShownMap) -> Command:
    """The packed witnesses; bytes of one kind are adjacent, which compresses better."""
    witnesses = pack(reach_map, shown)
    return {
        "ofRoll": witnesses.of_roll,
        "firstHigh": (witnesses.first >> 8).astype(np.uint8),
        "firstLow": (witnesses.first & 255).astype(np.uint8),
        "others": witnesses.others.reshape(-1),
        "bits": [FIRST_BITS, *6 * [OTHER_BITS]],
        "kept": witnesses.kept,
        "keptSteps": np.rint(witnesses.q_kept / RAD_PER_STEP).astype(np.int32).reshape(-1),
        "radPerStep": RAD_PER_STEP,
    }


def _arm(arm: Arm, tree: RobotTree) -> Command:
    """The arm's kinematics, and the nodes of its joints. Transforms are three rows of four."""
    return {
        "joints": list(arm.joint_names),
        "placements": arm.chain.T_parent_joints[:, :3].reshape(-1, 12).tolist(),
        "axes": arm.chain.axes.tolist(),
        "tip": T_last_tip(arm)[:3].reshape(-1).tolist(),
        "low": arm.limits.q_min.tolist(),
        "high": arm.limits.q_max.tolist(),
        "neutral": arm.neutral.tolist(),
        "paths": [tree.moving_node(name) for name in arm.joint_names],
    }


def _posture(robot: Baxter, tree: RobotTree) -> Iterator[Command]:
    """Both arms in neutral."""
    for arm in robot.arms.values():
        for name, value in zip(arm.joint_names, arm.neutral.tolist(), strict=True):
            joint = robot.model.getJointId(name) - 1
            yield set_property(tree.moving_node(name), *tree.motion(joint, value))


def direction_names(R_base_tips: FloatArray) -> list[str]:
    """Names of the directions of tools, such as "down" or "forward left, 42° down".

    Names that would be the same get the azimuth in degrees.

    Args:
        R_base_tips: shape (d, 3, 3); the tool points along z.
    """
    x, y, z = R_base_tips[:, :, 2].T
    azimuths = np.degrees(np.arctan2(y, x)) % 360.0
    elevations = np.degrees(np.arcsin(np.clip(z, -1.0, 1.0)))
    angles = list(zip(azimuths.tolist(), elevations.tolist(), strict=True))
    names = [_direction_name(*each) for each in angles]
    counts = Counter(names)
    return [
        name if counts[name] == 1 else f"{name}, azimuth {azimuth:.0f}°"
        for name, (azimuth, _) in zip(names, angles, strict=True)
    ]


def _direction_name(azimuth_deg: float, elevation_deg: float) -> str:
    vertical = "up" if elevation_deg > 0.0 else "down"
    if abs(elevation_deg) > 90.0 - UPRIGHT_DEG:
        return vertical
    sector = SECTORS[round(azimuth_deg / 45.0) % len(SECTORS)]
    is_level = abs(elevation_deg) < UPRIGHT_DEG
    return sector if is_level else f"{sector}, {abs(elevation_deg):.0f}° {vertical}"
