"""Gripper: fingers that move at a finite speed, grasp what is between them, or miss.

The electric gripper of Baxter takes position commands in per cent, 0 closed .. 100 open, and
reports its position, whether it is gripping, and whether it missed. So does this one.
"""

from __future__ import annotations

from dataclasses import dataclass

from baxter_kin.arrays import finite_scalar
from baxter_kin.errors import expect
from planner import Body, Grasp
from sim.errors import SimulationError
from sim.world import World

FINGER_SPEED_M_S = 0.05
"""Speed of each finger: the whole stroke of 20.8 mm takes 0.42 s. The URDF's 5 m/s is a placeholder
that no hand of this size reaches; Rethink gives no figure for the force-limited default."""


@dataclass(frozen=True, slots=True)
class GripperState:
    """What a gripper reports.

    Attributes:
        percent: position, 0 closed .. 100 open.
        is_gripping: whether both pads are on a body.
        has_missed: whether the last close found nothing.
    """

    percent: float
    is_gripping: bool
    has_missed: bool


@dataclass(frozen=True, slots=True, eq=False)
class Closing:
    """How a close will end.

    Attributes:
        finger_m: finger position at the end.
        body: the body between the pads; None for a miss.
        grasp: where it is then; None for a miss.
    """

    finger_m: float
    body: str | None = None
    grasp: Grasp | None = None


class Gripper:
    """The gripper of one hand in a world."""

    def __init__(self, world: World, side: str) -> None:
        """Take over the hand of that side."""
        self._world = expect(world, World, "world", SimulationError)
        self._side = world.robot.arm(side).side
        self._hand = world.hands[self._side]
        self._has_missed = False

    @property
    def state(self) -> GripperState:
        """What the gripper reports now."""
        return GripperState(
            percent=self._hand.percent(self._world.finger_m(self._side)),
            is_gripping=self._world.holding(self._side) is not None,
            has_missed=self._has_missed,
        )

    @property
    def open_m(self) -> float:
        """Finger position of the open hand."""
        return self._hand.stroke_m

    @property
    def gap_m(self) -> float:
        """Distance between the pads now."""
        return self._hand.closed_gap_m + 2 * self._world.finger_m(self._side)

    def travel_time_s(self, finger_m: float) -> float:
        """How long the fingers take from where they are to a position.

        Raises:
            SimulationError: when the position is not a finite number.
        """
        finger_m = finite_scalar(finger_m, "finger position", SimulationError)
        return abs(finger_m - self._world.finger_m(self._side)) / FINGER_SPEED_M_S

    def closing(self) -> Closing:
        """What a close would find now: of all bodies between the pads the widest, or nothing.

        Raises:
            SimulationError: when the hand already holds something.
        """
        held = self._world.holding(self._side)
        if held is not None:
            raise SimulationError(
                f"the {self._side} hand is closed on {held.body!r}; open it first"
            )
        found = [
            Closing(grasp.finger_m, body.name, grasp)
            for body in self._world.scene
            if body.is_movable and (grasp := self._grasp(body)) is not None
        ]
        return max(found, key=lambda closing: closing.finger_m, default=Closing(0.0))

    def finish(self, closing: Closing) -> None:
        """The fingers have arrived: hold the body, or report a miss.

        Raises:
            SimulationError: when `closing` is none.
        """
        expect(closing, Closing, "closing", SimulationError)
        self._world.set_fingers(self._side, closing.finger_m)
        self._has_missed = closing.grasp is None
        if closing.body is not None and closing.grasp is not None:
            self._world.attach(self._side, closing.body, closing.grasp.T_tip_body)

    def release(self) -> str | None:
        """The fingers begin to open: name of the body that is free now, or None."""
        self._has_missed = False
        return self._world.detach(self._side)

    def _grasp(self, body: Body) -> Grasp | None:
        T_base_tip = self._world.T_base_tip(self._side)
        return self._hand.grasp(T_base_tip, body, self._world.finger_m(self._side))
