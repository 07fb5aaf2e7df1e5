"""What a map's page decodes: the robot, the cells, and what it needs to find witnesses again."""

from __future__ import annotations

import base64
import zlib
from collections.abc import Iterator
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from baxter_kin import Baxter
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray
from planner.atlas.reach_map import ReachMap
from planner.atlas.reach_search import (
    NOT_COMPUTED,
    RAD_PER_MARGIN,
    RAD_PER_STEP,
    UNDECIDED,
    UNREACHABLE,
)
from sim.view.appearance import Appearance
from sim.view.atlas.directions import direction_names
from sim.view.atlas.packed_witnesses import FIRST_BITS, OTHER_BITS, TOLERANCE, PackedWitnesses, pack
from sim.view.atlas.polishing import MET, SETTINGS, TipChain
from sim.view.atlas.shown_map import ShownMap
from sim.view.meshcat_commands import Command, packed, set_property, shared_geometries
from sim.view.scenegraph import RobotTree, stage_commands

MARGINS_PER_LEVEL = 100
"""Margins of the page are in steps of 0.01 rad, rounded down."""

LEVEL_OF = MappingProxyType({NOT_COMPUTED: 0, UNREACHABLE: 1, UNDECIDED: 2})

FIRST_LEVEL = 3
"""Of a reachable cell without any margin."""


def encoded_map(found: ReachMap, shown: ShownMap) -> str:
    """All that the page needs: msgpack, then zlib, then base64, as ASCII.

    Args:
        found: the map.
        shown: what of it is shown.
    """
    robot, witnesses = found.robot, pack(found, shown)
    tree = RobotTree(robot.model, Appearance.of(robot))
    commands = [*stage_commands(), *tree.commands(), *_posture(robot, tree)]
    content: Command = {
        "geometries": shared_geometries(commands),
        "commands": commands,
        "map": _map(found, shown),
        "witnesses": _witnesses(witnesses),
        "arms": {side: _arm(robot.arm(side), tree) for side in found.arms},
        "polishing": {**SETTINGS, "met": MET, "tolerance": 2.0 * TOLERANCE},
    }
    return base64.b64encode(zlib.compress(packed(content), level=9)).decode("ascii")


def levels(shown: ShownMap) -> NDArray[np.uint8]:
    """Cells as the page has them, shape (arms, rotations, nx, ny, nz): neighbours lie together."""
    codes = np.moveaxis(shown.codes, 4, 1)
    level = (codes // MARGINS_PER_LEVEL + FIRST_LEVEL).clip(0, 255).astype(np.uint8)
    for code, its_level in LEVEL_OF.items():
        level[codes == code] = its_level
    return level


def _map(found: ReachMap, shown: ShownMap) -> Command:
    rotations = found.rotations
    return {
        "low": shown.low_m.tolist(),
        "step": shown.step_m,
        "stepOfMap": found.positions.step_m,
        "every": shown.every,
        "shape": list(shown.codes.shape[1:4]),
        "arms": list(found.arms),
        "levels": levels(shown).reshape(-1),
        "radPerLevel": MARGINS_PER_LEVEL * RAD_PER_MARGIN,
        "directions": direction_names(rotations.R_base_tips),
        "rolls": rotations.rolls.tolist(),
        "rotations": rotations.matrices.reshape(-1, 9).tolist(),
        "cells": len(found),
    }


def _witnesses(witnesses: PackedWitnesses) -> Command:
    """Bytes of a kind lie together, which zlib likes."""
    first = witnesses.first
    return {
        "ofRoll": witnesses.of_roll,
        "firstHigh": (first >> 8).astype(np.uint8),
        "firstLow": (first & 255).astype(np.uint8),
        "others": witnesses.others.reshape(-1),
        "bits": [FIRST_BITS, *6 * [OTHER_BITS]],
        "kept": witnesses.kept,
        "keptSteps": np.rint(witnesses.q_kept / RAD_PER_STEP).astype(np.int32).reshape(-1),
        "radPerStep": RAD_PER_STEP,
    }


def _arm(arm: Arm, tree: RobotTree) -> Command:
    """How the page computes the pose of the tip, and moves the joints that it draws."""
    return {
        "joints": list(arm.joint_names),
        "placements": [_rows(T.homogeneous) for T in arm.model.jointPlacements[1:]],
        "axes": arm.chain.axes.tolist(),
        "tip": _rows(TipChain.of(arm).T_last_tip),
        "low": arm.limits.q_min.tolist(),
        "high": arm.limits.q_max.tolist(),
        "neutral": arm.neutral.tolist(),
        "paths": [tree.moving_node(name) for name in arm.joint_names],
    }


def _rows(T: FloatArray) -> list[float]:
    """The upper three rows of a transform, one after the other."""
    numbers: list[float] = T[:3].reshape(-1).tolist()
    return numbers


def _posture(robot: Baxter, tree: RobotTree) -> Iterator[Command]:
    """Both arms in neutral."""
    for side in robot.arms:
        arm = robot.arm(side)
        for name, value in zip(arm.joint_names, arm.neutral, strict=True):
            joint = robot.model.getJointId(name) - 1
            yield set_property(tree.moving_node(name), *tree.motion(joint, float(value)))
