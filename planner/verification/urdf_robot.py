"""The whole robot straight from its URDF: joints, limits, tip, and one arm with its fingers.

Nothing here comes from `baxter_kin.model`, so that an error there shows: the tree, the names of the
arm's joints and the fingers are read from the description's text through Pinocchio.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from functools import cache, lru_cache

import numpy as np
import pinocchio as pin

from baxter_kin.description import RobotDescription
from baxter_kin.errors import DescriptionError
from baxter_kin.validation import FloatArray
from planner.errors import TaskError


@lru_cache(maxsize=8)
def read_model(description: RobotDescription) -> pin.Model:
    """The tree of all joints, read once for the same robot; nobody changes it.

    Raises:
        DescriptionError: when it cannot be read.
    """
    try:
        return pin.buildModelFromXML(description.text)
    except (RuntimeError, ValueError) as cause:
        raise DescriptionError(f"cannot read {description.source}: {cause}") from cause


@cache
def _installed() -> RobotDescription:
    return RobotDescription.installed()


@lru_cache(maxsize=8)
def _reshaped(own_text: str, drawn_text: str) -> frozenset[str]:
    """The links that show something else than the drawing on either side."""
    own, drawn = (
        {
            str(link.get("name")): "".join(ET.tostring(part, "unicode").strip() for part in link)
            for link in ET.fromstring(text).iter("link")
        }
        for text in (own_text, drawn_text)
    )
    sides = {"l_gripper_": "r_gripper_", "r_gripper_": "l_gripper_"}
    other = {name: sides.get(name[:10], name[:10]) + name[10:] for name in own}
    return frozenset(n for n in own if own[n] not in {drawn.get(n, ""), drawn.get(other[n], "")})


class UrdfRobot:
    """One arm as part of the whole robot.

    Attributes:
        model: the tree of all joints.
        stock: that of the stock robot, for which more was measured beforehand.
        limb: "left" or "right".
        arm_joints: the arm's joints from shoulder to wrist, as numbers in the model.
        fingers: its finger joints, as numbers in the model.
        other_hand: the last joint of the other arm and its fingers', likewise.
        reshaped: the links that look otherwise than on either side of the drawn robot.
        stroke_m: how far a finger goes from closed to open.
    """

    def __init__(self, description: RobotDescription, limb: str) -> None:
        """Read the URDF.

        Raises:
            DescriptionError: when it cannot be read, or has no such arm, or that has no fingers.
        """
        self.model, self.stock = read_model(description), read_model(_installed())
        self.reshaped = _reshaped(description.text, RobotDescription.drawn().text)
        tip = f"{limb}_gripper"
        if not self.model.existFrame(tip):
            raise DescriptionError(f"the URDF is not Baxter's: it lacks the link {tip}")
        self.limb = limb
        self._tip = self.model.getFrameId(tip)
        self._data = self.model.createData()
        self.wrist = int(self.model.frames[self._tip].parentJoint)
        self.arm_joints = [int(joint) for joint in self.model.supports[self.wrist]][1:]
        self.fingers = [int(j) for j in self.model.subtrees[self.wrist] if int(j) != self.wrist]
        upper, lower = self.model.upperPositionLimit, self.model.lowerPositionLimit
        if not self.fingers:
            raise DescriptionError(f"the {limb} hand of this robot has no fingers")
        where = self._indices(self.fingers)
        self.other_hand = self._hand("right" if limb == "left" else "left")
        self.stroke_m = float((upper - lower)[where].min())
        self._opening = np.where(upper[where] > 0.0, 1.0, -1.0)

    @property
    def arm_names(self) -> tuple[str, ...]:
        """Names of the arm's joints."""
        return tuple(str(self.model.names[joint]) for joint in self.arm_joints)

    @property
    def q_range(self) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest positions of the arm's joints, rad."""
        where = self._indices(self.arm_joints)
        return self.model.lowerPositionLimit[where], self.model.upperPositionLimit[where]

    @property
    def v_max(self) -> FloatArray:
        """Greatest speeds of the arm's joints, rad/s."""
        fastest: FloatArray = self.model.velocityLimit[self._indices(self.arm_joints)]
        return fastest

    @property
    def tip_reach_m(self) -> FloatArray:
        """How far the tip is from each joint of the arm at most, shape (n,), m."""
        steps = [
            float(np.linalg.norm(self.model.jointPlacements[j].translation))
            for j in self.arm_joints[1:]
        ]
        steps.append(float(np.linalg.norm(self.T_wrist_tip().translation)))
        return np.cumsum(steps[::-1])[::-1].copy()

    def finger_positions(self, q: FloatArray) -> list[tuple[str, float, float]]:
        """Name, position and how far outside its stroke it is of every finger of both hands, m."""
        low, high = self.model.lowerPositionLimit, self.model.upperPositionLimit
        found = []
        for joint in range(1, self.model.njoints):
            where = int(self.model.joints[joint].idx_q)
            if self.model.joints[joint].shortname().startswith("JointModelP"):
                outside = max(low[where] - q[where], q[where] - high[where])
                found.append((str(self.model.names[joint]), float(q[where]), float(outside)))
        return found

    def finger_skew_m(self, q: FloatArray) -> float:
        """How much farther one finger of the arm's hand is open than the other, m."""
        return float(np.ptp(q[self._indices(self.fingers)] * self._opening))

    def standing(self, joints: Mapping[str, float]) -> FloatArray:
        """A full configuration from joints by name.

        Raises:
            TaskError: when a joint is unknown or missing.
        """
        names = [str(name) for name in self.model.names][1:]
        for name in [*joints, *names]:
            if name not in joints or name not in names:
                raise TaskError(
                    f"the state {'lacks' if name in names else 'has an unknown'} joint "
                    f"{name!r}; the robot has: {', '.join(names)}"
                )
        return np.array([joints[name] for name in names])

    def opening(self, q: FloatArray) -> float:
        """How far the fingers of a full configuration are open, m."""
        return float((q[self._indices(self.fingers)] * self._opening).mean())

    def finger_values(self, finger_m: float) -> dict[str, float]:
        """The finger joints of the arm's hand that is so far open, by name, m."""
        names = (str(self.model.names[joint]) for joint in self.fingers)
        return dict(zip(names, (finger_m * self._opening).tolist(), strict=True))

    def configurations(self, q_standing: FloatArray, qs: FloatArray, finger_m: float) -> FloatArray:
        """Full configurations for arm configurations, shape (k, 7), and an opening of the hand."""
        full = np.tile(q_standing, (len(qs), 1))
        full[:, self._indices(self.arm_joints)] = qs
        full[:, self._indices(self.fingers)] = finger_m * self._opening
        return full

    def finger_configurations(
        self, q_standing: FloatArray, q_arm: FloatArray, fingers_m: FloatArray
    ) -> FloatArray:
        """Full configurations for one arm configuration and openings of the hand, shape (k,)."""
        full = np.tile(self.configurations(q_standing, q_arm[None], 0.0), (len(fingers_m), 1))
        full[:, self._indices(self.fingers)] = np.outer(fingers_m, self._opening)
        return full

    def T_base_tip(self, q_standing: FloatArray, q_arm: FloatArray) -> pin.SE3:
        """Where the tip is."""
        full = self.configurations(q_standing, q_arm[None], 0.0)[0]
        pin.forwardKinematics(self.model, self._data, full)
        return pin.SE3(pin.updateFramePlacement(self.model, self._data, self._tip))

    def T_base_other_tip(self, q_standing: FloatArray, limb: str) -> pin.SE3:
        """Where the tip of an arm that stands still is."""
        pin.forwardKinematics(self.model, self._data, q_standing)
        tip = self.model.getFrameId(f"{limb}_gripper")
        return pin.SE3(pin.updateFramePlacement(self.model, self._data, tip))

    def T_wrist_tip(self) -> pin.SE3:
        """Where the tip sits on the last joint of the arm."""
        return pin.SE3(self.model.frames[self._tip].placement)

    def _hand(self, limb: str) -> list[int]:
        """The last joint of an arm, and its fingers'; of a robot with one arm, none."""
        if not self.model.existFrame(f"{limb}_gripper"):
            return []
        wrist = int(self.model.frames[self.model.getFrameId(f"{limb}_gripper")].parentJoint)
        return [int(joint) for joint in self.model.subtrees[wrist]]

    def _indices(self, joints: list[int]) -> list[int]:
        return [int(self.model.joints[joint].idx_q) for joint in joints]
