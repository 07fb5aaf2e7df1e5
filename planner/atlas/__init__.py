"""Maps of what Baxter can reach: every "yes" has a witness, every "no" a proof."""

import baxter_kin.kinematics.pinocchio_loading  # noqa: F401 - says what it lacks, before all others
from planner.atlas.building import BlockReport, Cost, estimate
from planner.atlas.positions import PositionGrid
from planner.atlas.questions.arm_choice import ArmChoice, PoseAnswer, which_arm
from planner.atlas.questions.calibrated import CalibratedCells, TipDeviation, for_calibrated
from planner.atlas.questions.nearest import Keep, NearestPose, nearest_reachable
from planner.atlas.questions.placement import (
    Placement,
    PlacementGrid,
    Placements,
    PlacementStatus,
)
from planner.atlas.questions.placing import where
from planner.atlas.questions.table_task import TableTask, TableTransfer, Visit
from planner.atlas.questions.task_file import load_task
from planner.atlas.reach_map import (
    ArmContents,
    Cell,
    ReachDefinition,
    ReachMap,
    build_reach_map,
    count_contents,
)
from planner.atlas.rotations import RotationGrid

__all__ = [
    "ArmChoice",
    "ArmContents",
    "BlockReport",
    "CalibratedCells",
    "Cell",
    "Cost",
    "Keep",
    "NearestPose",
    "Placement",
    "PlacementGrid",
    "PlacementStatus",
    "Placements",
    "PoseAnswer",
    "PositionGrid",
    "ReachDefinition",
    "ReachMap",
    "RotationGrid",
    "TableTask",
    "TableTransfer",
    "TipDeviation",
    "Visit",
    "build_reach_map",
    "count_contents",
    "estimate",
    "for_calibrated",
    "load_task",
    "nearest_reachable",
    "where",
    "which_arm",
]
