"""One run of the demo: a simulation, its observers, its scene, and its report."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from typing import TypeVar

from baxter_kin.errors import BaxterError
from baxter_kin.kinematics.robot import Baxter
from planner import Body, Manipulator, Plan, TwoArmPlan, plan_start_move
from sim import Observer, Simulation, Snapshot, World
from sim.demo import Interrupt
from sim.demo.options import DemoOptions, Point
from sim.demo.outputs import live_view, outputs, playback
from sim.demo.report import Report
from sim.demo.scene import obstacles

PlanT = TypeVar("PlanT", Plan, TwoArmPlan)


class InterruptCheck(Observer):
    """Checks at every tick whether Ctrl-C was pressed."""

    def __init__(self, interrupt: Interrupt) -> None:
        self._interrupt = interrupt

    def on_snapshot(self, snapshot: Snapshot) -> None:  # noqa: ARG002 - a tick is enough
        """Raise KeyboardInterrupt if Ctrl-C was pressed."""
        self._interrupt.check()


class DemoSession(ABC):
    """One run: a simulation, its observers, and its report; subclasses say what is done in it."""

    def __init__(self, options: DemoOptions, interrupt: Interrupt, report: Report) -> None:
        self._options, self._interrupt, self._report = options, interrupt, report
        self._started_s = time.perf_counter()
        self._robot = Baxter.load(options.urdf, hands=options.hands)
        self._world = World(self._robot)
        self._observers: list[Observer] = []
        self._play_back: Callable[[Plan], None] = lambda _: None

    @abstractmethod
    def _bodies(self) -> Iterable[Body]:
        """What is spawned at first, besides obstacles."""

    @abstractmethod
    def _work(self, simulation: Simulation) -> str | None:
        """All that is done once the scene is there; returns why it failed, or None."""

    @abstractmethod
    def _blocks_m(self) -> dict[str, Point]:
        """The centre of every block that is there, in base."""

    def run(self) -> None:
        """Run all of it; the report says how it ended, and is written in any case."""
        report = self._report
        try:
            self._run()
        except KeyboardInterrupt:
            report.failure = "stopped by Ctrl-C"
            raise
        except BaxterError as error:
            report.failure = str(error)
        except OSError as error:
            report.failure = f"operating system error: {error}"
            raise
        finally:
            report.wall_time_s = time.perf_counter() - self._started_s
            if self._options.report is not None:
                report.write(self._options.report)

    def _run(self) -> None:
        options, world, report = self._options, self._world, self._report
        with ExitStack() as cleanup:
            observers = [InterruptCheck(self._interrupt), report, *self._observers]
            observers += outputs(options, world, report.say, cleanup)
            self._play_back = playback(options, cleanup)
            viewer = live_view(options, world, report.say, cleanup)
            if viewer is not None:
                observers.append(viewer)  # last, since it waits
            simulation = Simulation(world, observers)
            with self._scene(simulation), viewer or nullcontext():  # shows what is raised
                simulation.enable()
                report.failure = self._work(simulation)
                if viewer is not None:
                    viewer.close(report.failure or "")
            report.wall_time_s = time.perf_counter() - self._started_s  # before the summary
            report.finish()

    @contextmanager
    def _scene(self, simulation: Simulation) -> Iterator[None]:
        """Spawn obstacles, table and blocks, and delete them when the block exits."""
        try:
            for body in (*obstacles(self._options.obstacles_m), *self._bodies()):
                simulation.spawn(body)
            self._report.blocks_start_m = self._blocks_m()
            yield
        finally:
            self._report.blocks_final_m = self._blocks_m()
            for name in reversed(tuple(self._world.scene.bodies)):
                simulation.delete(name)

    def _manipulator(self, side: str) -> Manipulator:
        """An arm as the options have it, the other one where it stands now."""
        options, arm = self._options, self._robot.arm(side)
        return Manipulator.of(
            self._robot,
            side,
            speed_ratio=options.speed_ratio,
            limits=arm.limits.preset(options.limits),
            q_others=self._world.q,
        )

    def _start(self, simulation: Simulation, arm: Manipulator) -> str | None:
        """Move an arm to its start; returns why it failed, or None."""
        q, q_start = self._world.arm_q(arm.arm.side), arm.arm.start
        start = self._planned(
            lambda: plan_start_move(
                arm, self._world.scene, q, q_start, margin_m=self._options.margin_m
            )
        )
        if start.failure is not None:
            return str(start.failure)
        simulation.execute(start, unverified=True)
        return None

    def _planned(self, make_plan: Callable[[], PlanT]) -> PlanT:
        started_s = time.perf_counter()
        with self._interrupt.deferred():
            plan = make_plan()
            if isinstance(plan, Plan):
                self._play_back(plan)
        self._report.planning_time_s += time.perf_counter() - started_s
        return plan

    def _centre_m(self, name: str) -> Point:
        return tuple(self._world.body(name).centre_base.tolist())
