"""Gripper: fingers that move at a finite speed, grasp what is between them, or miss.

The electric gripper of Baxter takes position commands in per cent, 0 closed .. 100 open, and
reports its position, whether it is gripping, and whether it missed. So does this one.
"""

from __future__ import annotations

from dataclasses import dataclass

from baxter_kin.errors import expect
from baxter_kin.validation import Checked, finite_scalar
from baxter_kin.value_objects import OneLine, millimetres
from planner.grasping.finger_travel import FINGER_SPEED_M_S
from sim.errors import SimulationError
from sim.world.finger_closing import Closing, closing_of
from sim.world.world import World


@dataclass(frozen=True, slots=True, repr=False)
class GripperState(Checked, OneLine, error=SimulationError):
    """What a gripper reports.

    Attributes:
        percent: position, 0 closed .. 100 open.
        is_gripping: whether both pads are on a body.
        has_missed: whether the last close found nothing.
    """

    percent: float
    is_gripping: bool
    has_missed: bool


NO_GRIPPER = GripperState(0.0, is_gripping=False, has_missed=False)
"""What a flange without a gripper counts as, where something must be said of it."""


class Gripper(OneLine):
    """The gripper of one hand in a world."""

    def __init__(self, world: World, side: str) -> None:
        """Take over the hand of that side.

        Raises:
            SimulationError: when it has no fingers.
        """
        self._world = expect(world, World, "world", SimulationError)
        self._side = world.robot.arm(side).side
        self._hand = world.hand(side)
        self._has_missed = False
        self._last: tuple[float, bool, bool] | None = None
        self._state = GripperState(100.0, is_gripping=False, has_missed=False)

    @property
    def state(self) -> GripperState:
        """What the gripper reports now."""
        is_gripping = self._world.holding(self._side) is not None
        now = self._world.finger_m(self._side), is_gripping, self._has_missed
        if now != self._last:  # it is asked at every tick, and mostly nothing has changed
            self._last = now
            self._state = GripperState(self._hand.percent(now[0]), *now[1:])
        return self._state

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

    def closing(self, wanted: str | None = None) -> Closing:
        """What a close would do now: see `sim.world.finger_closing`. Nothing moves.

        Args:
            wanted: name of the body that it is about; a miss tells of that one.

        Raises:
            SimulationError: when the hand already holds something, or the name is not text.
        """
        if wanted is not None:
            expect(wanted, str, "the name of the wanted body", SimulationError)
        held = self._world.holding(self._side)
        if held is not None:
            raise SimulationError(
                f"the {self._side} hand is closed on {held.body!r}; open it first"
            )
        return closing_of(self._world, self._side, wanted)

    def close_to(self, closing: Closing, finger_m: float) -> None:
        """Put the fingers at a position on their way, and what they push where it is then.

        Raises:
            SimulationError: when the position is outside 0 .. stroke, or `closing` no `Closing`.
        """
        expect(closing, Closing, "closing", SimulationError)
        self._world.set_fingers(self._side, finger_m)
        for push in closing.pushes:
            self._world.slide(push.body, push.pose(finger_m))

    def finish(self, closing: Closing) -> None:
        """The fingers have arrived: hold the body, or report a miss.

        Raises:
            SimulationError: when `closing` is of another class.
        """
        expect(closing, Closing, "closing", SimulationError)
        self.close_to(closing, closing.finger_m)
        self._has_missed = closing.grasp is None
        if closing.body is not None and closing.grasp is not None:
            self._world.attach(self._side, closing.body, closing.grasp.T_tip_body)

    def release(self) -> str | None:
        """The fingers begin to open: name of the body that is free now, or None."""
        self._has_missed = False
        return self._world.detach(self._side)

    def _facts(self) -> tuple[str, ...]:
        state = (
            "gripping" if self.state.is_gripping else "missed" if self.state.has_missed else "empty"
        )
        return self._side, f"fingers at {millimetres(self.open_m)}", state
