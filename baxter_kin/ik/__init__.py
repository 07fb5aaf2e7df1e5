"""Inverse kinematics: the service, all solutions of a pose, its self-motion, objectives."""

from baxter_kin.ik.result import IKFailure, IKResult
from baxter_kin.ik.search.ipopt import Program
from baxter_kin.ik.search.searcher import Backend
from baxter_kin.ik.seeds import SeedMode, SeedType
from baxter_kin.ik.self_motion.objectives import (
    FarthestFromLimits,
    MostManipulable,
    NearestTo,
    Objective,
    Scope,
    best_on,
)
from baxter_kin.ik.self_motion.tracing import SelfMotion, trace_self_motion
from baxter_kin.ik.service import IKService
from baxter_kin.ik.solution_set import distinct_solutions, sample_solutions, solutions
from baxter_kin.ik.tolerance import Tolerance

__all__ = [
    "Backend",
    "FarthestFromLimits",
    "IKFailure",
    "IKResult",
    "IKService",
    "MostManipulable",
    "NearestTo",
    "Objective",
    "Program",
    "Scope",
    "SeedMode",
    "SeedType",
    "SelfMotion",
    "Tolerance",
    "best_on",
    "distinct_solutions",
    "sample_solutions",
    "solutions",
    "trace_self_motion",
]
