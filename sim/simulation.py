"""Simulation: steps plans through a world and tells observers.

Time is exact: moves and finger travels take what they take, and snapshots are given at whole
ticks, so nothing is rounded to the tick and the same plans give the same snapshots every time.
There are no blind waits: after a grasp the next step begins as soon as the pads are on the body,
plus the dwell that was asked for.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from baxter_kin.arrays import finite_scalar, positive_scalar
from baxter_kin.errors import expect
from planner import Body, Grip, GripperAction, Move, Plan
from planner.errors import expect_all
from planner.plan import Step
from sim.errors import SimulationError
from sim.events import Event, EventKind, Observer, Snapshot
from sim.gripper import Closing, Gripper
from sim.world import World

DEFAULT_TICK_S = 0.01
"""100 Hz, the rate of the original's commands and of its recorder."""

SHORTEST_TICK_S = 1e-6
"""Shorter ticks only fill memory."""

GRAVITY_M_S2 = 9.81

LONGEST_WAIT_S = 86_400.0

START_TOLERANCE_RAD = 1e-6
"""How far an arm may stand from where a plan starts."""


@dataclass(frozen=True, slots=True)
class Dwell:
    """Pauses after gripper actions; none by default, where the original waits a second.

    Attributes:
        after_grasp_s: once both pads are on the body.
        after_release_s: once the fingers are open.
    """

    after_grasp_s: float = 0.0
    after_release_s: float = 0.0

    def __post_init__(self) -> None:
        """Check both."""
        for name in ("after_grasp_s", "after_release_s"):
            if finite_scalar(getattr(self, name), name, SimulationError) < 0.0:
                raise SimulationError(f"{name} must not be negative, got {getattr(self, name)}")


@dataclass(frozen=True, slots=True)
class Outcome:
    """How the execution of a plan ended.

    Attributes:
        failure: None, or why it stopped early, as one sentence.
        duration_s: simulated time it took.
    """

    failure: str | None
    duration_s: float

    @property
    def is_success(self) -> bool:
        """Whether every step was done."""
        return self.failure is None


class Simulation:
    """A world in time.

    Attributes:
        world: what is moved.
        time_s: simulated time since the start.
        grippers: left and right gripper by side.
    """

    def __init__(
        self,
        world: World,
        observers: Iterable[Observer] = (),
        *,
        tick_s: float = DEFAULT_TICK_S,
        dwell: Dwell | None = None,
    ) -> None:
        """At time zero.

        Args:
            world: what is moved.
            observers: who is told, in this order.
            tick_s: time between snapshots, at least `SHORTEST_TICK_S`.
            dwell: pauses after gripper actions.

        Raises:
            SimulationError: when `tick_s` is not such a number.
        """
        self.world = expect(world, World, "world", SimulationError)
        self.time_s = 0.0
        self.grippers = {side: Gripper(world, side) for side in world.hands}
        self._observers = expect_all(observers, Observer, "the observers", SimulationError)
        self._tick_s = _checked_tick(tick_s)
        self._dwell = Dwell() if dwell is None else expect(dwell, Dwell, "dwell", SimulationError)
        self._next_tick = 0
        self._caption = ""

    def enable(self) -> None:
        """Switch the robot on, as the original does before it moves."""
        self._tell(EventKind.ENABLED, "robot enabled")

    def spawn(self, body: Body) -> None:
        """Add a body; a movable one falls on what is below it.

        Raises:
            SceneError: when the name is taken.
        """
        support = self.world.spawn(body)
        on = f", at rest on {support}" if body.is_movable else ""
        settled = self.world.body(body.name)
        self._tell(EventKind.SPAWNED, f"{body.name} spawned{on}", body=settled)

    def delete(self, name: str) -> None:
        """Remove a body.

        Raises:
            SceneError: when it is not there.
        """
        body = self.world.body(name)
        self.world.delete(name)
        self._tell(EventKind.DELETED, f"{name} deleted", body=body)

    def wait(self, duration_s: float) -> None:
        """Let time pass.

        Raises:
            SimulationError: when the duration is negative or no number.
        """
        if finite_scalar(duration_s, "duration_s", SimulationError) < 0.0:
            raise SimulationError(f"time only goes forward; cannot wait {duration_s} s")
        if duration_s > LONGEST_WAIT_S:
            raise SimulationError(f"wait at most {LONGEST_WAIT_S:g} s at once, got {duration_s:g}")
        self._advance(duration_s, lambda _: None)

    def execute(self, plan: Plan, title: str = "") -> Outcome:
        """Do every step of a plan, or stop at the first that fails.

        Args:
            plan: a valid plan that starts where the arm stands.
            title: put before each caption.

        Raises:
            SimulationError: when the plan is invalid or starts elsewhere; nothing has moved then.
        """
        self._check_start(expect(plan, Plan, "plan", SimulationError))
        started = self.time_s
        failure = None
        for step in plan:
            self._caption = f"{title}{step.label}"
            failure = self._do(plan.limb, step)
            if failure is not None:
                break
        return Outcome(failure, self.time_s - started)

    def _check_start(self, plan: Plan) -> None:
        if plan.failure is not None:
            raise SimulationError(f"an invalid plan cannot be executed: {plan.failure}")
        offset = float(np.abs(self.world.arm_q(plan.limb) - plan.q_start).max())
        if offset > START_TOLERANCE_RAD:
            raise SimulationError(
                f"the plan starts {offset:.3g} rad from where the {plan.limb} arm stands; plan "
                "from there"
            )

    def _do(self, limb: str, step: Step) -> str | None:
        """One step; returns why it failed, or None. Only a close can fail."""
        if isinstance(step, Grip) and step.action is GripperAction.CLOSE:
            return self._close(limb, step)
        if isinstance(step, Move):
            self._move(limb, step)
        else:
            self._open(limb)
        return None

    def _move(self, limb: str, move: Move) -> None:
        if move.ik is not None:
            self._caption += f" (IK: {move.ik.label})"
        self._tell(EventKind.MOVE_STARTED, self._caption, move)
        duration_s = move.trajectory.duration
        ticks = self._tick_s * np.array(self._ticks_within(duration_s), dtype=np.float64)
        times = np.clip(np.append(ticks - self.time_s, duration_s), 0.0, duration_s)
        path = iter(move.trajectory.sample(times).q)
        self._advance(duration_s, lambda _: self.world.move_arm(limb, next(path)))

    def _close(self, limb: str, grip: Grip) -> str | None:
        gripper = self.grippers[limb]
        closing = gripper.closing()
        self._slide(limb, closing.finger_m)
        gripper.finish(closing)
        if closing.grasp is None:
            return self._missed(limb, grip)
        self._grasped(closing, gripper.state.percent)
        self.wait(self._dwell.after_grasp_s)
        if grip.body is not None and closing.body != grip.body:
            return f"{grip.label}: grasped {closing.body} instead of {grip.body}"
        return None

    def _grasped(self, closing: Closing, percent: float) -> None:
        width = 0.0 if closing.grasp is None else closing.grasp.width_m
        self._tell(
            EventKind.GRASPED,
            f"{closing.body} grasped, {1e3 * width:.1f} mm between the pads ({percent:.0f} % open)",
        )

    def _missed(self, limb: str, grip: Grip) -> str:
        gap = 1e3 * self.grippers[limb].gap_m
        wanted = f" on {grip.body}" if grip.body else ""
        text = f"missed: the fingers closed fully{wanted}, {gap:.1f} mm apart, and hold nothing"
        self._tell(EventKind.MISSED, text)
        return f"{grip.label}: {text}"

    def _open(self, limb: str) -> None:
        gripper = self.grippers[limb]
        name = gripper.release()
        if name is None:
            self._slide(limb, gripper.open_m)
            self._tell(EventKind.OPENED, f"{limb} gripper open")
        else:
            self._tell(EventKind.RELEASED, f"{name} released")
            self._let_go(limb, name)
        self.wait(self._dwell.after_release_s)

    def _let_go(self, limb: str, name: str) -> None:
        """Open the fingers while the body falls to its rest."""
        rest = self.world.rest(name)
        T_from = self.world.body(name).T_base_body
        fall_s = math.sqrt(2 * rest.fall_m / GRAVITY_M_S2)

        def fall(t: float) -> None:
            if t < fall_s:
                drop = np.array([0.0, 0.0, GRAVITY_M_S2 * t * t / 2])
                self.world.place_body(name, pin.SE3(T_from.rotation, T_from.translation - drop))
            else:
                self.world.place_body(name, rest.T_base_body)

        self._slide(limb, self.grippers[limb].open_m, fall, at_least_s=fall_s)
        support = self.world.settle(name).support
        self._tell(EventKind.SETTLED, f"{name} at rest on {support}")

    def _slide(
        self,
        limb: str,
        finger_m: float,
        meanwhile: Callable[[float], None] = lambda _: None,
        *,
        at_least_s: float = 0.0,
    ) -> None:
        """Move the fingers to a position at their speed."""
        begin = self.world.finger_m(limb)
        travel_s = self.grippers[limb].travel_time_s(finger_m)

        def update(t: float) -> None:
            share = 1.0 if t >= travel_s else t / travel_s
            self.world.set_fingers(limb, begin + share * (finger_m - begin))
            meanwhile(t)

        self._advance(max(travel_s, at_least_s), update)

    def _advance(self, duration_s: float, update: Callable[[float], None]) -> None:
        """Let time pass: bring the world to each tick, show it, and end exactly at the end."""
        begin_s = self.time_s
        for tick in self._ticks_within(duration_s):
            self.time_s = tick * self._tick_s
            self._next_tick = tick + 1
            update(self.time_s - begin_s)
            self._show()
        update(duration_s)
        self.time_s = begin_s + duration_s

    def _ticks_within(self, duration_s: float) -> range:
        """Numbers of the ticks from now until then."""
        last = math.floor((self.time_s + duration_s) / self._tick_s)
        return range(self._next_tick, last + 1)

    def _show(self) -> None:
        snapshot = Snapshot(
            time_s=self.time_s,
            q=self.world.q,
            T_base_bodies=self.world.body_poses(),
            grippers={side: gripper.state for side, gripper in self.grippers.items()},
            caption=self._caption,
        )
        for observer in self._observers:
            observer.on_snapshot(snapshot)

    def _tell(
        self, kind: EventKind, text: str, step: Step | None = None, body: Body | None = None
    ) -> None:
        event = Event(self.time_s, kind, text, step, body)
        for observer in self._observers:
            observer.on_event(event)


def _checked_tick(tick_s: float) -> float:
    checked = positive_scalar(tick_s, "tick_s", SimulationError)
    if checked < SHORTEST_TICK_S:
        raise SimulationError(f"tick_s must be at least {SHORTEST_TICK_S:g} s, got {checked:g}")
    return checked
