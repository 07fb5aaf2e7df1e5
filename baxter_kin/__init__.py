"""Baxter and its kinematics: model, limits, frames, and inverse kinematics.

Names are loaded when they are first used, so that importing the package costs nothing, reads no
file and starts nothing, and so that a program may catch Ctrl-C before the libraries below have
loaded.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from baxter_kin.lazy import lazy

if TYPE_CHECKING:
    from baxter_kin.description import ElectricGripper as ElectricGripper
    from baxter_kin.description import Tool as Tool
    from baxter_kin.errors import BaxterError as BaxterError
    from baxter_kin.frames import Frame as Frame
    from baxter_kin.frames import NamedFrame as NamedFrame
    from baxter_kin.frames import StampedPose as StampedPose
    from baxter_kin.frames import pose_from_quaternion as pose_from_quaternion
    from baxter_kin.frames import quaternion_xyzw as quaternion_xyzw
    from baxter_kin.ik import IKFailure as IKFailure
    from baxter_kin.ik import IKResult as IKResult
    from baxter_kin.ik import IKService as IKService
    from baxter_kin.ik import SeedMode as SeedMode
    from baxter_kin.ik import SeedType as SeedType
    from baxter_kin.ik import Tolerance as Tolerance
    from baxter_kin.kinematics.arm import Arm as Arm
    from baxter_kin.kinematics.limits import JointLimits as JointLimits
    from baxter_kin.kinematics.robot import Baxter as Baxter

    __version__: str

__all__, _load = lazy(
    __name__,
    {
        "Arm": "baxter_kin.kinematics.arm",
        "Baxter": "baxter_kin.kinematics.robot",
        "BaxterError": "baxter_kin.errors",
        "ElectricGripper": "baxter_kin.description",
        "Frame": "baxter_kin.frames",
        "IKFailure": "baxter_kin.ik",
        "IKResult": "baxter_kin.ik",
        "IKService": "baxter_kin.ik",
        "JointLimits": "baxter_kin.kinematics.limits",
        "NamedFrame": "baxter_kin.frames",
        "SeedMode": "baxter_kin.ik",
        "SeedType": "baxter_kin.ik",
        "StampedPose": "baxter_kin.frames",
        "Tolerance": "baxter_kin.ik",
        "Tool": "baxter_kin.description",
        "pose_from_quaternion": "baxter_kin.frames",
        "quaternion_xyzw": "baxter_kin.frames",
    },
)


def __getattr__(name: str) -> object:
    if name == "__version__":
        from baxter_kin.distribution.version import version  # noqa: PLC0415 - reads files

        return version()
    return _load(name)
