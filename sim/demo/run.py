"""One run of the demo: scene, start, picks, places, clean-up."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from itertools import count

import numpy as np
import pinocchio as pin

from baxter_kin.command_line import log_shown
from baxter_kin.errors import BaxterError
from baxter_kin.model import Baxter
from baxter_kin.validation import FloatArray
from planner import (
    LineTolerance,
    Manipulator,
    PickAndPlace,
    Plan,
    Scene,
    plan_pick_and_place,
    plan_start_move,
    save_plan,
    transfer_bound_s,
)
from sim import (
    ClosedLoop,
    Noise,
    NoisyPoses,
    Observer,
    Outcome,
    Simulation,
    Transfer,
    TruePoses,
    World,
)
from sim.demo.advice import advice
from sim.demo.interrupt import Interrupt
from sim.demo.narration import Narrator
from sim.demo.options import DemoOptions
from sim.demo.outputs import StopWatch, live_view, outputs, playback, shown
from sim.demo.report import Json, Point, Report
from sim.demo.scene import BLOCK, centred_below, demo_bodies, obstacles, overhead


def run_demo(options: DemoOptions, interrupt: Interrupt) -> int:
    """Run the demo; returns the exit status, or raises KeyboardInterrupt once all is cleaned up."""
    narrator = Narrator(options.verbosity)

    def complain(text: str) -> None:
        narrator.complain(f"baxter-demo: {text}")

    with log_shown(narrator.say, complain, ("baxter_kin", "sim")):
        try:
            failure = _Demo(options, interrupt, narrator).run()
        except BaxterError as error:
            failure = str(error)
    if failure is not None:
        complain(failure)
    return 0 if failure is None else 1


class _Demo:
    """One run: a simulation, its observers, and its report."""

    def __init__(self, options: DemoOptions, interrupt: Interrupt, narrator: Narrator) -> None:
        self._options = options
        self._interrupt = interrupt
        self._narrator = narrator
        self._report = Report(options)
        self._started_s = time.perf_counter()
        self._robot = Baxter.load(options.urdf, hands=options.hands)
        self._arm = self._robot.arm(options.limb)
        self._world = World(self._robot)
        self._manipulator = Manipulator.of(
            self._robot,
            options.limb,
            speed_ratio=options.speed_ratio,
            limits=self._arm.limits.preset(options.limits),
            q_others=self._world.q,
        )
        self._bounds_s: dict[tuple[bytes, bytes], float] = {}
        self._is_plan_saved = False
        self._truth = TruePoses(self._world)
        rng = np.random.default_rng(options.seed)
        noise = Noise(options.noise_m, options.noise_rad)
        self._poses = NoisyPoses(self._truth, noise, rng)
        self._T_block_tip: pin.SE3 | None = None

    def run(self) -> str | None:
        """Run all of it; returns None, or why it failed. Outputs are written in either case."""
        try:
            self._run()
        except KeyboardInterrupt:
            self._report.failure = "stopped by Ctrl-C"
            raise
        except BaxterError as error:
            self._report.failure = str(error)
        except OSError as error:
            self._report.failure = f"cannot write its output: {error.strerror}"
            raise
        finally:
            self._write_report()
        return self._report.failure

    def _run(self) -> None:
        with ExitStack() as cleanup:
            first = StopWatch(self._interrupt), self._narrator, self._report, self._truth
            files = outputs(self._options, self._world, self._narrator, cleanup)
            observers: list[Observer] = [*first, *files]
            self._play_back = playback(self._options, cleanup)
            views = live_view(self._options, self._world, self._narrator, cleanup)
            observers += views  # last, since it waits
            simulation = Simulation(self._world, observers)
            with self._scene(simulation), shown(views, lambda: self._report.failure):
                self._execute(simulation)
            self._report.totals.wall_time_s = time.perf_counter() - self._started_s
            self._narrator.finish(self._report.totals)

    def _execute(self, simulation: Simulation) -> None:
        """Enable, move to start, then pick and place until done, failed or stopped."""
        simulation.enable()
        start = self._planned(
            lambda: plan_start_move(
                self._manipulator,
                self._world.scene,
                self._arm_q(),
                self._arm.start,
                margin_m=self._options.margin_m,
            )
        )
        if start.failure is not None:
            self._report.failure = str(start.failure)
            return
        simulation.execute(start, unverified=True)
        cycles = self._options.cycles
        for number in count(1) if cycles is None else range(1, cycles + 1):
            failure = self._cycle(number, simulation)
            if failure is not None:
                self._report.failure = failure
                return
        self._report.failure = None

    def _cycle(self, number: int, simulation: Simulation) -> str | None:
        """One pick and place; returns why it failed, or None."""
        poses = self._options.poses_m
        ends_m = poses[(number - 1) % len(poses)], poses[number % len(poses)]
        self._narrator.start_cycle(number, *ends_m)
        cycle = _Cycle(number, ends_m, self._options.hover_m)
        done = self._closed_cycle if self._options.is_closed_loop else self._open_cycle
        failure = done(cycle, simulation)
        hint = "" if failure is None else advice(self._options, self._robot, ends_m)
        return f"{failure}; {hint}" if hint else failure

    def _open_cycle(self, cycle: _Cycle, simulation: Simulation) -> str | None:
        """Plan with the true poses, and execute."""
        world = self._world
        plan = self._planned_cycle(cycle, cycle.task, world.scene, self._arm_q())
        if plan.failure is not None:
            return f"{cycle.title}{plan.failure}"
        outcome = simulation.execute(plan, cycle.title, unverified=True)
        return self._ended(cycle, plan, outcome)

    def _closed_cycle(self, cycle: _Cycle, simulation: Simulation) -> str | None:
        """Plan with the perceived poses, execute, and try again after a miss."""
        numbers, most = count(1), 1 + (self._options.retries or 0)

        def plan(task: PickAndPlace, _: Manipulator, scene: Scene, q: FloatArray) -> Plan:
            if (number := next(numbers)) > 1:
                self._narrator.say(f"  looks again, attempt {number} of {most}")
            return self._planned_cycle(cycle, task, scene, q)

        loop = ClosedLoop(simulation, self._manipulator, self._poses, retries=most - 1, plan=plan)
        started_s = simulation.time_s
        result = loop.pick_and_place(self._transfer(cycle), cycle.title)
        last, outcome = result.plan, Outcome(result.failure, simulation.time_s - started_s)
        if last is None:
            return f"{cycle.title}{result.failure}"
        return self._ended(cycle, last, outcome)

    def _transfer(self, cycle: _Cycle) -> Transfer:
        """The cycle's task relative to the block, which is grasped and put down by its middle."""
        block, task = self._world.body(BLOCK), cycle.task
        if self._T_block_tip is None:
            self._T_block_tip = centred_below(block, task.T_base_pick).inverse() * task.T_base_pick
            self._upright = block
        goal = centred_below(self._upright, task.T_base_place)
        return Transfer(BLOCK, self._T_block_tip, goal, task.hover_m, task.clear_m)

    def _planned_cycle(
        self, cycle: _Cycle, task: PickAndPlace, scene: Scene, q_start: FloatArray
    ) -> Plan:
        """The plan of a cycle, which is added to the report, and saved when it is the first."""
        options = self._options
        plan = self._planned(
            lambda: plan_pick_and_place(
                task,
                self._manipulator,
                scene,
                q_start,
                margin_m=options.margin_m,
                line_tolerance=LineTolerance(*options.line_tolerance),
            )
        )
        if options.plan is not None and not self._is_plan_saved:
            save_plan(plan, options.plan)
            self._is_plan_saved = True
        cycle.bound_s = self._transfer_bound_s(cycle.task)
        cycle.entry = self._report.add_cycle(cycle.number, cycle.ends_m, plan, cycle.bound_s)
        return plan

    def _ended(self, cycle: _Cycle, plan: Plan, outcome: Outcome) -> str | None:
        """Complete a cycle's entry in the report; returns why it failed, or None."""
        self._report.totals.add(plan, outcome, cycle.bound_s)
        entry = cycle.entry
        entry["success"], entry["failure"] = outcome.is_success, outcome.failure
        entry["duration_s"], entry["block_m"] = outcome.duration_s, self._block_m()
        return None if outcome.is_success else f"{cycle.title}{outcome.failure}"

    def _planned(self, make_plan: Callable[[], Plan]) -> Plan:
        started_s = time.perf_counter()
        with self._interrupt.deferred():
            plan = make_plan()
            self._play_back(plan)
        self._report.totals.planning_time_s += time.perf_counter() - started_s
        return plan

    def _transfer_bound_s(self, task: PickAndPlace) -> float:
        """Least time from grasp to release, cached by the two poses."""
        pick, place = task.T_base_pick, task.T_base_place
        key = pick.homogeneous.tobytes(), place.homogeneous.tobytes()
        if key not in self._bounds_s:
            with self._interrupt.deferred():
                arm = self._manipulator
                self._bounds_s[key] = transfer_bound_s(arm.ik, arm.limits, pick, place)
        return self._bounds_s[key]

    @contextmanager
    def _scene(self, simulation: Simulation) -> Iterator[None]:
        """Spawn table and block, and delete them when the block exits."""
        try:
            for body in (
                *obstacles(self._options.obstacles_m),
                *demo_bodies(self._options.limb),
            ):
                simulation.spawn(body)
            self._report.totals.block_start_m = self._block_m()
            yield
        finally:
            self._report.totals.block_final_m = self._block_m()
            for name in reversed(tuple(self._world.scene.bodies)):
                simulation.delete(name)

    def _write_report(self) -> None:
        totals = self._report.totals
        totals.wall_time_s = time.perf_counter() - self._started_s
        if self._options.report is not None:
            self._report.write(self._options.report)

    def _arm_q(self) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
        return self._world.arm_q(self._options.limb)

    def _block_m(self) -> Point | None:
        if BLOCK not in self._world.scene.bodies:
            return None
        return tuple(self._world.body(BLOCK).centre_base.tolist())


@dataclass(slots=True, eq=False)
class _Cycle:
    """One pick and place of the demo.

    Attributes:
        number: counted from 1.
        ends_m: where the tip picks and places, in base.
        hover_m: height above the place where it ends.
        bound_s: least time from grasp to release.
        entry: its latest entry in the report.
    """

    number: int
    ends_m: tuple[Point, Point]
    hover_m: float
    bound_s: float = math.inf
    entry: Json = field(default_factory=dict)

    @property
    def title(self) -> str:
        """Prefix of captions and failures."""
        return f"cycle {self.number}, "

    @property
    def task(self) -> PickAndPlace:
        """The original demo's task, by poses of the tip."""
        pick, place = (overhead(position) for position in self.ends_m)
        return PickAndPlace(BLOCK, pick, place, self.hover_m)
