"""The demo's runs: of one arm, and, by `sim.demo.both_arms`, of both."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable
from itertools import count

import numpy as np
import pinocchio as pin

from baxter_kin.command_line import log_shown
from baxter_kin.errors import BaxterError
from baxter_kin.fields import evolve
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
    save_plan,
    tilt_of,
    transfer_bound_s,
)
from planner.motion.upright import DEFAULT_TILT_RAD
from sim import ClosedLoop, Noise, NoisyPoses, Outcome, Simulation, Transfer, TruePoses
from sim.demo import Interrupt
from sim.demo.both_arms import BothArms, BothReport
from sim.demo.options import DemoOptions, Point
from sim.demo.report import Report
from sim.demo.scene import BLOCK, advice, centred_below, demo_bodies, overhead
from sim.demo.session import DemoSession


def run_demo(options: DemoOptions, interrupt: Interrupt) -> int:
    """Run the demo; returns the exit status, or raises KeyboardInterrupt once all is cleaned up."""

    def print_error(text: str) -> None:
        print(f"baxter-demo: {text}", file=sys.stderr, flush=True)

    report = BothReport(options) if options.both_arms else Report(options)
    with log_shown(report.say, print_error, ("baxter_kin", "sim")):
        try:
            if isinstance(report, BothReport):
                BothArms(options, interrupt, report).run()
            else:
                _OneArm(options, interrupt, report).run()
        except BaxterError as error:
            report.failure = str(error)
    if report.failure is not None:
        print_error(report.failure)
    return 0 if report.failure is None else 1


class _OneArm(DemoSession):
    """One arm picks a block and places it, in cycles."""

    def __init__(self, options: DemoOptions, interrupt: Interrupt, report: Report) -> None:
        super().__init__(options, interrupt, report)
        self._own = self._manipulator(options.limb)
        self._bounds_s: dict[tuple[bytes, bytes], float] = {}
        self._is_plan_saved = False
        self._truth = TruePoses(self._world)
        self._observers = [self._truth]
        noise, rng = Noise(options.noise_m, options.noise_rad), np.random.default_rng(options.seed)
        self._poses = NoisyPoses(self._truth, noise, rng)
        self._T_block_tip: pin.SE3 | None = None
        self._upright: Body | None = None

    def _bodies(self) -> Iterable[Body]:
        return demo_bodies(self._options.limb)

    def _work(self, simulation: Simulation) -> str | None:
        """Move to the start, then pick and place until done."""
        failure = self._start(simulation, self._own)
        cycles = self._options.cycles
        for number in count(1) if cycles is None else range(1, cycles + 1):
            if failure is not None:
                break
            failure = self._cycle(number, simulation)
        return failure

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
            plan = planned(task, self._own, self._world.scene, self._q())
            if plan.failure is not None:
                return self._with_advice(f"{title}{plan.failure}", ends_m)
            outcome = simulation.execute(plan, title, unverified=True)
        else:
            loop = ClosedLoop(
                simulation,
                self._own,
                self._poses,
                retries=options.retries,
                plan=planned,
                on_attempt=on_attempt,
            )
            started_s = simulation.time_s
            result = loop.pick_and_place(self._transfer(task), title)
            plan, outcome = result.plan, Outcome(result.failure, simulation.time_s - started_s)
        if plan is not None:
            report.end_cycle(plan, outcome, self._blocks_m().get(BLOCK))
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
                self._own,
                scene,
                q_start,
                margin_m=options.margin_m,
                line_tolerance=LineTolerance(*options.line_tolerance),
            )
        )
        tilt_rad = tilt_of(plan, manipulator=self._own) if plan.is_valid else 0.0
        if tilt_rad > DEFAULT_TILT_RAD:
            deg = math.degrees(tilt_rad)
            self._report.say(f"  no upright motion was found: {BLOCK} leans by up to {deg:.0f} deg")
        if options.plan is not None and not self._is_plan_saved:
            save_plan(plan, options.plan)
            self._is_plan_saved = True
        return plan

    def _transfer_bound_s(self, task: PickAndPlace) -> float:
        """Least time from grasp to release, cached by the two poses."""
        pick, place = task.T_base_pick, task.T_base_place
        key = pick.homogeneous.tobytes(), place.homogeneous.tobytes()
        if key not in self._bounds_s:
            with self._interrupt.deferred():
                arm = self._own
                self._bounds_s[key] = transfer_bound_s(arm.ik, arm.limits, pick, place)
        return self._bounds_s[key]

    def _q(self) -> FloatArray:
        return self._world.arm_q(self._options.limb)

    def _blocks_m(self) -> dict[str, Point]:
        return {BLOCK: self._centre_m(BLOCK)} if BLOCK in self._world.scene.bodies else {}
