"""RosExecutor: carries out a plan on a Baxter, as `Simulation.execute` does in a world."""

from __future__ import annotations

import time
from collections.abc import Iterable

from baxter_kin.display import OneLine
from baxter_kin.fields import NotCopied
from baxter_kin.validation import expect, expect_all
from planner import Plan
from sim.errors import SimulationError
from sim.events import Observer
from sim.ros1.execution.execution import Execution, MeasuredOutcome
from sim.ros1.execution.guard.watch import Watch
from sim.ros1.execution.link.baxter_link import BaxterLink
from sim.ros1.execution.link.channel import ArmChannel
from sim.ros1.execution.readiness import check_still_there, look_at_plan
from sim.ros1.execution.ready_plan import ExecutionOptions, NotReadyError, Readiness, ReadyPlan
from sim.ros1.execution.stops import StopCause

ENABLE_S, ENABLE_HZ = 5.0, 20.0
"""How long, and how often, a robot is told to switch its motors on."""


class RosExecutor(NotCopied, OneLine):
    """Drives an arm of a Baxter along plans."""

    def __init__(
        self,
        link: BaxterLink,
        observers: Iterable[Observer] = (),
        *,
        options: ExecutionOptions | None = None,
    ) -> None:
        """Send nothing yet.

        Args:
            link: to the robot.
            observers: who is told, in this order, by a thread of its own; a `SampleObserver` sees
                every set-point as well.
            options: how plans are carried out.

        Raises:
            SimulationError: when an argument has the wrong type.
        """
        self._link = expect(link, BaxterLink, "link", SimulationError)
        self._observers = expect_all(observers, Observer, "the observers", SimulationError)
        given = ExecutionOptions() if options is None else options
        self.options = expect(given, ExecutionOptions, "options", SimulationError)
        self._begin_s = time.monotonic()
        self._watch: Watch | None = None
        self._requested: StopCause | None = None

    @property
    def time_s(self) -> float:
        """Since it was made."""
        return time.monotonic() - self._begin_s

    def prepare(self, plan: Plan) -> Readiness:
        """Whether a plan may be carried out on the robot as it stands; nothing is sent.

        Raises:
            SimulationError: when the plan is invalid.
            RosError: when the master cannot be reached.
        """
        return look_at_plan(self._link, plan, self.options)

    def stop(self, cause: StopCause = StopCause.SIGINT) -> None:
        """Ask for a stop, from another thread or a signal handler; the arm then holds."""
        self._requested = cause
        if self._watch is not None:
            self._watch.request(cause)

    def enable(self, limb: str) -> None:
        """Switch the motors on, if they are off.

        Raises:
            SimulationError: when the robot is not enabled in time.
        """
        arm = f"{limb}_s0"
        if self._is_enabled():
            return
        with ArmChannel(self._link, limb, (arm,)) as channel:
            end_s = time.monotonic() + ENABLE_S
            while not self._is_enabled():
                if time.monotonic() > end_s:
                    raise SimulationError(
                        f"the robot is not enabled after {ENABLE_S:g} s; a tucked one must be "
                        "untucked first"
                    )
                channel.enable()
                self._link.wait_until(self._is_enabled, 1.0 / ENABLE_HZ)

    def execute(self, plan: Plan | ReadyPlan, title: str = "") -> MeasuredOutcome:
        """Do every step of a plan, or stop at the first that fails.

        Args:
            plan: a valid plan, or one that was prepared right before.
            title: put before each caption.

        Raises:
            NotReadyError: when a condition does not hold; nothing was sent then.
            SimulationError: when the plan is invalid, the arm was moved since it was prepared, or
                the robot cannot be enabled.
            RosError: when the master cannot be reached.
        """
        expect(title, str, "title", SimulationError)
        ready = plan if isinstance(plan, ReadyPlan) else self._prepared(plan)
        check_still_there(self._link, ready)
        self.enable(ready.plan.limb)
        with Execution(self._link, self._observers, self.options, ready, title) as execution:
            self._watch = execution.watch
            if self._requested is not None:
                execution.watch.request(self._requested)
            try:
                return execution.run(self.time_s)
            finally:
                self._watch = None

    def _prepared(self, plan: Plan) -> ReadyPlan:
        readiness = self.prepare(plan)
        if readiness.ready is None:
            raise NotReadyError(readiness)
        return readiness.ready

    def _is_enabled(self) -> bool:
        report = self._link.robot
        return report is not None and report.is_enabled

    def _facts(self) -> tuple[str, ...]:
        return repr(self._link), repr(self.options.pace)
