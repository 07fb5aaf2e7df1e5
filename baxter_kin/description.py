"""Where the robot's description is found (example-robot-data enters here).

The wheel of example-robot-data is data only, with nothing to import, so its files are found through
the metadata of the installed distribution.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from baxter_kin.errors import DescriptionError

_DISTRIBUTION = "example-robot-data"
_URDF = "robots/baxter_description/urdf/baxter.urdf"
_SRDF = "robots/baxter_description/srdf/baxter_manipulation.srdf"


@dataclass(frozen=True, slots=True)
class RobotDescription:
    """The files that describe the robot.

    Attributes:
        urdf: links, joints, shapes.
        srdf: pairs of links that never need a collision check.
        package_dir: the folder that `package://` in the URDF stands for.
    """

    urdf: Path
    srdf: Path
    package_dir: Path

    def __post_init__(self) -> None:
        """Check that the files are there."""
        for path in (self.urdf, self.srdf):
            if not path.is_file():
                raise DescriptionError(f"the robot description lacks {path}; reinstall its package")

    @classmethod
    def installed(cls) -> RobotDescription:
        """Baxter, as the installed example-robot-data has it.

        Raises:
            DescriptionError: when that package, or Baxter in it, is missing.
        """
        try:
            files = distribution(_DISTRIBUTION).files or []
        except PackageNotFoundError:
            raise DescriptionError(
                f"the package {_DISTRIBUTION} is not installed; run: pip install {_DISTRIBUTION}"
            ) from None
        urdf = next((file for file in files if file.as_posix().endswith(_URDF)), None)
        if urdf is None:
            raise DescriptionError(f"the installed {_DISTRIBUTION} has no {_URDF}; reinstall it")
        root = Path(str(urdf.locate())).parents[len(Path(_URDF).parts) - 1]
        return cls(urdf=root / _URDF, srdf=root / _SRDF, package_dir=root.parent)
