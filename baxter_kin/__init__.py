"""Baxter and its kinematics: model, limits, frames, and inverse kinematics.

Names are loaded when they are first used, so that importing the package costs nothing, reads no
file and starts nothing, and so that a program may catch Ctrl-C before the libraries below have
loaded.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from baxter_kin.lazy import loader

if TYPE_CHECKING:
    from baxter_kin.description import ElectricGripper, Tool
    from baxter_kin.errors import BaxterError
    from baxter_kin.frames import (
        Frame,
        NamedFrame,
        StampedPose,
        pose_from_quaternion,
        quaternion_xyzw,
    )
    from baxter_kin.ik import IKFailure, IKResult, IKService, SeedMode, SeedType, Tolerance
    from baxter_kin.kinematics.arm import Arm
    from baxter_kin.limits import JointLimits
    from baxter_kin.model import Baxter

    __version__: str

__all__ = [
    "Arm",
    "Baxter",
    "BaxterError",
    "ElectricGripper",
    "Frame",
    "IKFailure",
    "IKResult",
    "IKService",
    "JointLimits",
    "NamedFrame",
    "SeedMode",
    "SeedType",
    "StampedPose",
    "Tolerance",
    "Tool",
    "pose_from_quaternion",
    "quaternion_xyzw",
]

_MODULES = (
    "errors",
    "kinematics.pinocchio_loading",
    "frames",
    "ik",
    "limits",
    "kinematics.arm",
    "model",
    "description",
)
"""In the order of loading: what is missing is said before it is needed."""

_load = loader(__name__, [f"{__name__}.{module}" for module in _MODULES])


def __getattr__(name: str) -> object:
    if name == "__version__":
        from baxter_kin.distribution.version import version  # noqa: PLC0415 - looks it up

        return version()
    return _load(name)
