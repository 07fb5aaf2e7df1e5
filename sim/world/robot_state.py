"""The robot at one moment: where its arms stand, and how far its fingers are open."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin import Baxter
from baxter_kin.errors import expect
from baxter_kin.validation import FloatArray, finite_scalar
from baxter_kin.value_objects import OneLine
from planner import Hand
from planner.collision.robot.robot_body import RobotBody
from planner.collision.robot.robot_shapes import RobotShapes
from sim.errors import SimulationError

ROUNDING_RAD = 1e-9
"""How far a trajectory may leave the joint limits by rounding."""


class RobotState(OneLine):
    """A robot that is put from one configuration into another.

    Attributes:
        robot: the robot.
        shapes: its shapes.
        hands: left and right hand by side; a side without fingers has none.
    """

    def __init__(self, robot: Baxter, body: RobotBody | None = None) -> None:
        """In neutral, the hands open.

        Args:
            robot: the robot.
            body: what it is taken to be; `RobotBody.load()` when not given.

        Raises:
            SimulationError: when the robot is of another class.
        """
        self.robot = expect(robot, Baxter, "robot", SimulationError)
        self.shapes = RobotShapes(robot, body)
        self.hands = {
            side: Hand.of(robot, arm, self.shapes)
            for side, arm in robot.arms.items()
            if Hand.is_on(robot, side)
        }
        self._limits = {side: arm.limits for side, arm in robot.arms.items()}
        self._arm_indices = {
            s: np.array(robot.indices(a.joint_names)) for s, a in robot.arms.items()
        }
        self._head = robot.indices(("head_pan",))[0]
        self._finger_indices = {
            s: list(robot.indices(h.joint_names)) for s, h in self.hands.items()
        }
        self._q = np.array(robot.configuration())
        for side, hand in self.hands.items():
            self.set_fingers(side, hand.stroke_m)

    @property
    def q(self) -> FloatArray:
        """The full configuration, shape (19,), rad and m; a copy."""
        return self._q.copy()

    def arm_q(self, side: str) -> FloatArray:
        """Where an arm stands, shape (7,), rad."""
        q: FloatArray = self._q[self._arm_indices[self._side(side)]]
        return q

    def T_base_tip(self, side: str) -> pin.SE3:
        """Where the tip of an arm is."""
        return self.robot.arm(side).T_base_tip(self.arm_q(side))

    def finger_m(self, side: str) -> float:
        """Finger position of a hand, 0 closed .. stroke; 0 where there are no fingers."""
        where = self._finger_indices.get(self._side(side))
        return 0.0 if where is None else float(self._q[where[0]])

    def hand(self, side: str) -> Hand:
        """The hand of a side.

        Raises:
            UnknownNameError: when there is no such side.
            SimulationError: when it has no fingers.
        """
        hand = self.hands.get(self._side(side))
        if hand is None:
            raise SimulationError(f"the {side} hand of this robot has no fingers")
        return hand

    def move_arm(self, side: str, q: ArrayLike) -> None:
        """Put an arm somewhere.

        Args:
            side: "left" or "right".
            q: shape (7,), rad, inside the limits.

        Raises:
            ConfigurationError: when `q` is malformed or outside the limits.
        """
        limits = self._limits[self._side(side)]
        self._q[self._arm_indices[side]] = limits.check(q, "q", tolerance=ROUNDING_RAD)

    def turn_head(self, pan_rad: float) -> None:
        """Turn the head, rad, positive to the robot's left.

        Raises:
            SimulationError: when it is not a finite number.
        """
        self._q[self._head] = finite_scalar(pan_rad, "pan_rad", SimulationError)

    def set_fingers(self, side: str, finger_m: float) -> None:
        """Put the fingers of a hand somewhere; they do not push.

        Raises:
            SimulationError: when the position is outside 0 .. stroke, or there are no fingers.
        """
        hand = self.hand(side)
        x = finite_scalar(finger_m, "finger position", SimulationError)
        if not -1e-12 <= x <= hand.stroke_m + 1e-12:
            raise SimulationError(
                f"finger position {1e3 * x:.3f} mm is outside 0 .. {1e3 * hand.stroke_m:.3f} mm"
            )
        self._q[self._finger_indices[side]] = list(hand.finger_joints(x).values())

    def _side(self, side: str) -> str:
        """The side, if it is one."""
        is_known = type(side) is str and side in self._arm_indices
        return side if is_known else self.robot.arm(side).side
