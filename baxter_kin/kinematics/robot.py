"""The whole robot: its description, the tree of its joints, and both arms."""

from __future__ import annotations

import logging
from collections.abc import Mapping

import pinocchio as pin

from baxter_kin.description import HandMount, RobotDescription, UrdfSource
from baxter_kin.display import count
from baxter_kin.errors import BaxterError, ConfigurationError, DescriptionError, UnknownNameError
from baxter_kin.fields import FrozenMapping, frozen
from baxter_kin.kinematics.arm import LIMBS, Arm, known_limb
from baxter_kin.validation import FloatArray, expect, finite_array

logger = logging.getLogger(__name__)


@frozen(error=DescriptionError)
class Baxter:
    """The whole robot.

    Attributes:
        description: which robot it is.
        model: the kinematic tree of all joints: head, arms and fingers, 19 with both grippers.
        arms: both arms by side.
    """

    description: RobotDescription
    model: pin.Model
    arms: Mapping[str, Arm]

    @classmethod
    def load(
        cls, urdf: UrdfSource | None = None, *, hands: Mapping[str, HandMount] | None = None
    ) -> Baxter:
        """Read the kinematics of a Baxter; no mesh is touched.

        Joint limits are those of the URDF, be they narrower or wider than the stock robot's. What
        to know about how the URDF was read, wider limits among it, is logged as warnings and kept
        in `description.notes`.

        Args:
            urdf: the robot's own description, as it serves it: the path of a URDF, or its text, as
                text that begins with "<" or as bytes. The stock robot when not given.
            hands: by side what is on the flange: an `ElectricGripper`, a `Tool`, or None for
                nothing. A side that is not named is as the URDF has it; the stock robot has
                `ElectricGripper()` on both.

        Raises:
            DescriptionError: when it cannot be read or is not a Baxter's, or the hands are not such
                a mapping; one sentence says why.
        """
        description = RobotDescription.of(urdf, hands)
        for note in description.notes:
            logger.warning("%s: %s", description.source, note)
        model = pin.buildModelFromXML(description.text)
        arms = FrozenMapping({side: Arm(side, model) for side in LIMBS})
        return cls(description=description, model=model, arms=arms)

    @property
    def digest(self) -> str:
        """SHA-256 over kinematics, hands and limits, 64 hexadecimal digits.

        The same for the same numbers in the URDF, in every process and on every platform.
        """
        return self.description.identity.digest

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints, in the order of a full configuration; 19 with both grippers."""
        return tuple(self.model.names)[1:]

    def arm(self, side: str) -> Arm:
        """The arm of that side."""
        return self.arms[known_limb(side)]

    def configuration(self, joints: Mapping[str, float] | None = None) -> FloatArray:
        """A full configuration, rad and m: neutral arms, closed hands, then `joints`."""
        values = dict.fromkeys(self.joint_names, 0.0)
        for arm in self.arms.values():
            values.update(arm.joints(arm.neutral))
        given = {} if joints is None else joints
        expect(given, Mapping, "joints", ConfigurationError)  # type: ignore[type-abstract]
        for name, position in given.items():
            if name not in values:
                raise UnknownNameError("joint", name, self.joint_names)
            values[name] = position
        count = len(values)
        return finite_array(list(values.values()), (count,), "joints", ConfigurationError)

    def indices(self, names: tuple[str, ...]) -> tuple[int, ...]:
        """Where those joints stand in a full configuration."""
        positions = {name: i for i, name in enumerate(self.joint_names)}
        for name in expect(names, tuple, "names", ConfigurationError):
            if not isinstance(name, str) or name not in positions:
                raise UnknownNameError("joint", name, self.joint_names)
        return tuple(positions[name] for name in names)

    def _facts(self) -> tuple[str, ...]:
        return f"arms {' and '.join(self.arms)}", count(len(self.joint_names), "joint")


def given_or_stock(robot: Baxter | None, error: type[BaxterError]) -> Baxter:
    """The robot that was given, or the stock robot."""
    return Baxter.load() if robot is None else expect(robot, Baxter, "robot", error)
