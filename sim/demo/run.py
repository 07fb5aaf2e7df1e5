"""One run of the demo: scene, start, picks, places, clean-up."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from itertools import count

import numpy as np
import pinocchio as pin

from baxter_kin.command_line import log_shown
from baxter_kin.errors import BaxterError
from baxter_kin.fields import evolve
from baxter_kin.kinematics.robot import Baxter
from baxter_kin.validation import FloatArray
from planner import (
    Body,
    LineTolerance,
    Manipulator,
    PickAndPlace,
    Plan,
    Scene,
    Upright,
    plan_pick_and_place,
    plan_start_move,
    save_plan,
    tilt_of,
    transfer_bound_s,
)
from planner.motion.upright import DEFAULT_TILT_RAD
from sim import (
    ClosedLoop,
    Noise,
    NoisyPoses,
    Observer,
    Outcome,
    Simulation,
    Snapshot,
    Transfer,
    TruePoses,
    World,
)
from sim.demo import Interrupt
from sim.demo.options import DemoOptions, Point
from sim.demo.outputs import live_view, outputs, playback
from sim.demo.report import Report
from sim.demo.scene import BLOCK, advice, centred_below, demo_bodies, obstacles, overhead


def run_demo(options: DemoOptions, interrupt: Interrupt) -> int:
    """Run the demo; returns the exit status, or raises KeyboardInterrupt once all is cleaned up."""
    report = Report(options)

    def print_error(text: str) -> None:
        print(f"baxter-demo: {text}", file=sys.stderr, flush=True)

    with log_shown(report.say, print_error, ("baxter_kin", "sim")):
        try:
            _Demo(options, interrupt, report).run()
        except BaxterError as error:
            report.failure = str(error)
    if report.failure is not None:
        print_error(report.failure)
    return 0 if report.failure is None else 1


class InterruptCheck(Observer):
    """Checks at every tick whether Ctrl-C was pressed."""

    def __init__(self, interrupt: Interrupt) -> None:
        self._interrupt = interrupt

    def on_snapshot(self, snapshot: Snapshot) -> None:  # noqa: ARG002 - a tick is enough
        """Raise KeyboardInterrupt if Ctrl-C was pressed."""
        self._interrupt.check()


class _Demo:
    """One run: a simulation, its observers, and its report."""

    def __init__(self, options: DemoOptions, interrupt: Interrupt, report: Report) -> None:
        self._options, self._interrupt, self._report = options, interrupt, report
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
        noise, rng = Noise(options.noise_m, options.noise_rad), np.random.default_rng(options.seed)
        self._poses = NoisyPoses(self._truth, noise, rng)
        self._T_block_tip: pin.SE3 | None = None
        self._upright: Body | None = None
        self._play_back: Callable[[Plan], None] = lambda _: None

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
            observers: list[Observer] = [InterruptCheck(self._interrupt), report, self._truth]
            observers += outputs(options, world, report.say, cleanup)
            self._play_back = playback(options, cleanup)
            viewer = live_view(options, world, report.say, cleanup)
            if viewer is not None:
                observers.append(viewer)  # last, since it waits
            simulation = Simulation(world, observers)
            with self._scene(simulation), viewer or nullcontext():  # shows what is raised
                report.failure = self._execute(simulation)
                if viewer is not None:
                    viewer.close(report.failure or "")
            report.wall_time_s = time.perf_counter() - self._started_s  # before the summary
            report.finish()

    @contextmanager
    def _scene(self, simulation: Simulation) -> Iterator[None]:
        """Spawn obstacles, table and block, and delete them when the block exits."""
        try:
            for body in (*obstacles(self._options.obstacles_m), *demo_bodies(self._options.limb)):
                simulation.spawn(body)
            self._report.block_start_m = self._block_m()
            yield
        finally:
            self._report.block_final_m = self._block_m()
            for name in reversed(tuple(self._world.scene.bodies)):
                simulation.delete(name)

    def _execute(self, simulation: Simulation) -> str | None:
        """Enable, move to the start, then pick and place until done; returns why it failed."""
        simulation.enable()
        arm, q_start = self._manipulator, self._arm.start
        start = self._planned(
            lambda: plan_start_move(
                arm, self._world.scene, self._q(), q_start, margin_m=self._options.margin_m
            )
        )
        if start.failure is not None:
            return str(start.failure)
        simulation.execute(start, unverified=True)
        cycles = self._options.cycles
        for number in count(1) if cycles is None else range(1, cycles + 1):
            failure = self._cycle(number, simulation)
            if failure is not None:
                return failure
        return None

    def _cycle(self, number: int, simulation: Simulation) -> str | None:
        """One pick and place; returns why it failed, or None."""
        options, poses_m, report = self._options, self._options.poses_m, self._report
        ends_m = poses_m[(number - 1) % len(poses_m)], poses_m[number % len(poses_m)]
        report.start_cycle(number, *ends_m)
        task = PickAndPlace(BLOCK, overhead(ends_m[0]), overhead(ends_m[1]), options.hover_m)
        title = f"cycle {number}, "

        def on_attempt(attempt: int) -> None:
            if attempt > 1:
                report.say(f"  tries again, attempt {attempt} of {1 + (options.retries or 0)}")

        def planned(perceived: PickAndPlace, _: Manipulator, scene: Scene, q: FloatArray) -> Plan:
            plan = self._planned_cycle(perceived, scene, q)
            report.add_plan(number, *ends_m, plan, self._transfer_bound_s(task))
            return plan

        plan: Plan | None
        if options.retries is None:
            plan = planned(task, self._manipulator, self._world.scene, self._q())
            if plan.failure is not None:
                return self._with_advice(f"{title}{plan.failure}", ends_m)
            outcome = simulation.execute(plan, title, unverified=True)
        else:
            loop = ClosedLoop(
                simulation,
                self._manipulator,
                self._poses,
                retries=options.retries,
                plan=planned,
                on_attempt=on_attempt,
            )
            started_s = simulation.time_s
            result = loop.pick_and_place(self._transfer(task), title)
            plan, outcome = result.plan, Outcome(result.failure, simulation.time_s - started_s)
        if plan is not None:
            report.end_cycle(plan, outcome, self._block_m())
        if outcome.failure is None:
            return None
        return self._with_advice(f"{title}{outcome.failure}", ends_m)

    def _with_advice(self, failure: str, ends_m: tuple[Point, Point]) -> str:
        hint = advice(self._options, self._robot, ends_m)
        return f"{failure}; {hint}" if hint else failure

    def _transfer(self, task: PickAndPlace) -> Transfer:
        """The task relative to the block, which is grasped and put down by its middle."""
        block = self._world.body(BLOCK)
        if self._T_block_tip is None or self._upright is None:
            self._T_block_tip = centred_below(block, task.T_base_pick).inverse() * task.T_base_pick
            self._upright = block
        goal = centred_below(self._upright, task.T_base_place)
        return Transfer(BLOCK, self._T_block_tip, goal, task.hover_m, task.clear_m)

    def _planned_cycle(self, task: PickAndPlace, scene: Scene, q_start: FloatArray) -> Plan:
        """The plan of a cycle, upright if one is found; the first one is saved."""
        options = self._options
        upright = Upright.of(scene[task.body], DEFAULT_TILT_RAD, is_required=False)
        task = evolve(task, upright=upright)
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
        tilt_rad = tilt_of(plan, manipulator=self._manipulator) if plan.is_valid else 0.0
        if tilt_rad > DEFAULT_TILT_RAD:
            deg = math.degrees(tilt_rad)
            self._report.say(f"  no upright motion was found: {BLOCK} leans by up to {deg:.0f} deg")
        if options.plan is not None and not self._is_plan_saved:
            save_plan(plan, options.plan)
            self._is_plan_saved = True
        return plan

    def _planned(self, make_plan: Callable[[], Plan]) -> Plan:
        started_s = time.perf_counter()
        with self._interrupt.deferred():
            plan = make_plan()
            self._play_back(plan)
        self._report.planning_time_s += time.perf_counter() - started_s
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

    def _q(self) -> FloatArray:
        return self._world.arm_q(self._options.limb)

    def _block_m(self) -> Point | None:
        if BLOCK not in self._world.scene.bodies:
            return None
        return tuple(self._world.body(BLOCK).centre_base.tolist())
