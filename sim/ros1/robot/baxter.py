"""SimulatedBaxter: the simulated Baxter without its network, a world and its parts in ticks."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from baxter_kin.display import OneLine, seconds
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray
from planner import Body
from sim.events import EventKind, Observer
from sim.ros1.robot.arm_motion import ArmMotion, BadOrderError, ContactStop, Following, JointOrder
from sim.ros1.robot.gripper import ElectricGripper, Fingers, GripperOrder
from sim.ros1.robot.panel import Assembly, Head, Panel
from sim.timeline import DEFAULT_TICK_S, Timeline
from sim.world.contacts import ContactWatch
from sim.world.gripper import Gripper
from sim.world.world import World

TICK_S = DEFAULT_TICK_S
"""Between two states; a real Baxter publishes its joints at 100 Hz."""

MAX_TICKS = 25
"""Number of ticks that a late one makes up for at most: after a quarter of a second, clients have
stopped, as the joint states are too old."""

TUCKED_S0_RAD, TUCKED_S1_RAD = (-1.0, 1.0), -2.07
"""Of the left and the right arm when they are tucked, as in the original `tuck_arms`."""

TUCKED_WITHIN_RAD = 0.2
"""Distance from that within which an arm counts as tucked, likewise."""


class SimulatedBaxter(OneLine):
    """A Baxter in its world.

    Attributes:
        world: its world; an arm that stands outside its limits is at its limits there.
        time_s: since it was switched on.
        arms: the joints of both arms, by side.
        grippers: of the hands that have fingers, by side.
        assembly: whether it is enabled.
        head: its head.
        panel: buttons and lights.
    """

    def __init__(
        self,
        world: World,
        observers: Iterable[Observer] = (),
        *,
        following: Following | None = None,
        q_start: Mapping[str, FloatArray] | None = None,
        is_calibrated: bool = True,
    ) -> None:
        """Switch it on, disabled.

        Args:
            world: its world.
            observers: informed of events, and of the world at every tick.
            following: how the arms follow their set-points.
            q_start: positions of arms by side, shape (7,), rad; those in the world when not given.
                A real one may stand outside its limits when it is tucked.
            is_calibrated: whether the grippers are.
        """
        self.world = world
        hands = {side: Gripper(world, side) for side in world.hands}
        self._timeline = Timeline(world, hands, observers, TICK_S)
        watches = {side: ContactWatch(world) for side in LIMBS}
        self.grippers = {
            side: ElectricGripper(
                Fingers(world, side, hand, self._timeline, watches[side]),
                is_calibrated=is_calibrated,
            )
            for side, hand in hands.items()
        }
        self._stops = {side: ContactStop(side, watches[side], self._timeline) for side in LIMBS}
        starts = {side: world.arm_q(side) for side in LIMBS} | dict(q_start or {})
        self.arms = {
            side: ArmMotion(world.robot.arm(side).limits, starts[side], following) for side in LIMBS
        }
        for side in LIMBS:
            self._put(side, starts[side])
        self.assembly, self.head, self.panel = Assembly(), Head(), Panel()
        self._ticks = 0
        self._refresh()
        self._timeline.begin()

    @property
    def time_s(self) -> float:
        """Time since it was switched on."""
        return self._ticks * TICK_S

    @property
    def is_tucked(self) -> bool:
        """Whether an arm is tucked."""
        return any(self._is_tucked(side) for side in LIMBS)

    def _is_tucked(self, side: str) -> bool:
        tucked = np.array([TUCKED_S0_RAD[LIMBS.index(side)], TUCKED_S1_RAD])
        return bool((np.abs(self.arms[side].q[:2] - tucked) <= TUCKED_WITHIN_RAD).all())

    def is_stopped_by_contact(self, side: str) -> bool:
        """Whether an arm's set-points lead into what does not give way."""
        return self._stops[side].is_stopped

    def tick(self, ticks: int = 1, obey: Callable[[int], object] = lambda _: None) -> None:
        """Let time pass, at most `MAX_TICKS` ticks, and show the world once.

        Args:
            ticks: number of ticks.
            obey: called before each tick, with the number of ticks that follow it, to execute what
                had arrived by then.
        """
        for left in reversed(range(min(ticks, MAX_TICKS))):
            obey(left)
            self._ticks += 1
            self._timeline.time_s = self.time_s
            for side in LIMBS:
                self._step_arm(side)
            for gripper in self.grippers.values():
                gripper.step(TICK_S)
            self._step_head()
            self.panel.step(TICK_S)
        self._timeline.show()

    def _step_arm(self, side: str) -> None:
        arm = self.arms[side]
        q = arm.proposal(TICK_S, self.time_s)
        if not (q == arm.q).all():
            here, there = self._inside(side, arm.q), self._inside(side, q)
            allowed = self._stops[side].allowed(here, there)
            q = np.where(allowed == there, q, arm.q)
            self._put(side, q)
        arm.move(q, TICK_S)

    def _put(self, side: str, q: FloatArray) -> None:
        self.world.move_arm(side, self._inside(side, q))

    def _inside(self, side: str, q: FloatArray) -> FloatArray:
        limits = self.world.robot.arm(side).limits
        return np.asarray(np.minimum(np.maximum(q, limits.q_min), limits.q_max))

    def _step_head(self) -> None:
        before = self.head.pan_rad
        self.head.step(TICK_S)
        if self.head.pan_rad != before:
            self.world.turn_head(self.head.pan_rad)

    def order_joints(
        self, side: str, mode: int, names: Sequence[str], command: Sequence[float]
    ) -> tuple[str, ...]:
        """Execute a joint command; a disabled robot checks it and does nothing.

        Returns:
            A phrase for each joint that was clipped.
        """
        arm = self.world.robot.arm(side)
        order = JointOrder.of(arm.joint_names, mode, names, command)
        if not self.assembly.state.is_enabled:
            return ()
        return self.arms[side].order(order, self.time_s)

    def order_gripper(self, side: str, order: GripperOrder) -> None:
        """Execute a command to a gripper."""
        if side not in self.grippers:
            raise BadOrderError(f"the {side} hand has no gripper")
        is_enabled = self.assembly.state.is_enabled
        self.grippers[side].order(order, is_enabled=is_enabled)

    def order_head(self, target_rad: float) -> None:
        """Pan the head, unless the robot is disabled."""
        if self.assembly.state.is_enabled:
            self.head.pan(target_rad)

    def nod(self) -> None:
        """Nod once, unless the robot is disabled."""
        if self.assembly.state.is_enabled:
            self.head.nod()

    def enable(self) -> None:
        """Enable the robot, unless it is."""
        if self.assembly.state.is_enabled:
            return
        refusal = self.assembly.enable(self.time_s, is_tucked=self.is_tucked)
        if refusal is not None:
            raise BadOrderError(f"not enabled: {refusal}")
        self._timeline.notify(EventKind.ENABLED, "robot enabled")

    def disable(self) -> None:
        """Disable the robot: everything stays where it is, and what is held is held."""
        self.assembly.disable()
        self._hold()

    def stop(self) -> None:
        """Stop it until it is reset."""
        self.assembly.stop()
        self._hold()

    def reset(self) -> None:
        """Reset it, which disables it."""
        refusal = self.assembly.reset()
        if refusal is not None:
            raise BadOrderError(f"not reset: {refusal}")
        self._hold()

    def press(self, side: str, button: str) -> None:
        """Press a button, release all, or reset the robot as `enable_robot.py -r` does."""
        if button == "estop":
            self.assembly.press()
            self._hold()
        elif button == "release":
            self.assembly.release()
            self.panel.release()
        elif button == "reset":
            self.reset()
        else:
            self.panel.press(side, button)

    def _hold(self) -> None:
        for arm in self.arms.values():
            arm.hold()
        for gripper in self.grippers.values():
            gripper.stop()
        self.head.hold()

    def spawn(self, body: Body) -> None:
        """Add a body; a movable one falls on what is below it."""
        self._timeline.spawn(body)
        self._refresh()

    def delete(self, name: str) -> None:
        """Remove a body."""
        self._timeline.delete(name)
        self._refresh()

    def _refresh(self) -> None:
        """Rebuild what depends on the bodies of the world."""
        for gripper in self.grippers.values():
            gripper.refresh()
        for side, stop in self._stops.items():
            stop.refresh(self.world.arm_q(side))

    def _facts(self) -> tuple[str, ...]:
        return seconds(self.time_s), repr(self.world)
