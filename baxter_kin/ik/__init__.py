"""Inverse kinematics: the nonlinear program, its seeds, and the service on top."""

from baxter_kin.ik.program import Program
from baxter_kin.ik.result import IKFailure, IKResult
from baxter_kin.ik.search import Backend
from baxter_kin.ik.seeds import SeedMode, SeedType
from baxter_kin.ik.service import IKService

__all__ = [
    "Backend",
    "IKFailure",
    "IKResult",
    "IKService",
    "Program",
    "SeedMode",
    "SeedType",
]
