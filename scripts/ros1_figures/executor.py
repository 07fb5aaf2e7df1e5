"""Figures of the executor: it drives a simulated Baxter, which is a process of its own."""

from __future__ import annotations

import os
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from planner import Manipulator, PickAndPlace, Plan, plan_pick_and_place
from ros1_figures.figure import Figure
from ros1_figures.robot_process import robot_process
from sim import Simulation, World, read_log
from sim.demo.scene import BLOCK, demo_bodies, overhead
from sim.outcome import Dwell
from sim.ros1.execution.execution import MeasuredOutcome, RosExecutor
from sim.ros1.execution.link import STATE, BaxterLink, command_topic
from sim.ros1.execution.readiness import ExecutionOptions
from sim.ros1.execution.set_points import Pace
from sim.ros1.execution.stops import StopCause
from sim.ros1.node import Node

RUNS = 20
STOPS = 10
LAG_S = 0.4
SAME_PLACE_MM = 1.0
PAUSE_S = 0.13


def figures(duration_s: float) -> Iterator[Figure]:
    """One after the other; shorter than usual where less time is given than ten seconds."""
    runs, stops = (RUNS, STOPS) if duration_s >= 10.0 else (2, 2)
    stage = _Stage()
    yield from _exact(stage, runs)
    yield from _lagging(stage)
    yield from _stopped(stage, stops)
    yield from _paused(stage)


class _Stage:
    """The demo's plan, and where it puts the block in a simulation."""

    def __init__(self) -> None:
        self.robot = Baxter.load()
        world = World(self.robot)
        simulation = Simulation(world)
        for body in demo_bodies("left"):
            simulation.spawn(body)
        arm = self.robot.arm("left")
        world.move_arm("left", arm.start)
        manipulator = Manipulator.of(self.robot, "left", q_others=world.q)
        task = PickAndPlace(BLOCK, overhead((0.7, 0.15, -0.129)), overhead((0.75, 0.0, -0.129)))
        self.plan: Plan = plan_pick_and_place(task, manipulator, world.scene, arm.start)
        simulation.execute(self.plan, unverified=True)
        self.block_m = world.body(BLOCK).T_base_body.translation

    def run(
        self,
        folder: Path,
        pace: Pace,
        *robot_options: str,
        during: Callable[[str], None] | None = None,
    ) -> tuple[MeasuredOutcome, float]:
        """One execution; what came of it, and how far off the block is then, mm."""
        log = folder / "robot.jsonl"
        with robot_process("--record", str(log), *robot_options) as (uri, _), _linked(uri) as link:
            _bring_to_start(self.plan, link)
            executor = RosExecutor(link, options=ExecutionOptions(pace, Dwell(0.5, 0.5)))
            ready = executor.prepare(self.plan).ready
            if ready is None:
                raise SystemExit("the simulated Baxter is not ready")
            executor.enable("left")
            thread = threading.Thread(target=during, args=(uri,)) if during else None
            if thread is not None:
                thread.start()
            outcome = executor.execute(ready)
            if thread is not None:
                thread.join()
            time.sleep(0.3)
        block = read_log(log).recording.body_poses[BLOCK][-1]
        return outcome, 1e3 * float(np.abs(block[:3] - self.block_m).max())


@contextmanager
def _linked(uri: str) -> Iterator[BaxterLink]:
    with Node("/baxter_kin", master_uri=uri, host="127.0.0.1") as node, BaxterLink(node) as link:
        yield link


def _bring_to_start(plan: Plan, link: BaxterLink) -> None:
    """From where a new robot stands, so that the plan alone is measured."""
    alone = evolve(plan, steps=())
    outcome = RosExecutor(link, options=ExecutionOptions(Pace(0.3))).execute(alone)
    if not outcome.is_success:
        raise SystemExit(f"the arm did not come to the start: {outcome.failure}")


def _exact(stage: _Stage, runs: int) -> Iterator[Figure]:
    outcomes, off_mm = [], []
    for number in range(runs):
        with tempfile.TemporaryDirectory() as folder:
            outcome, block_mm = stage.run(Path(folder), Pace(1.0 if number % 2 else 0.3))
        outcomes.append(outcome)
        off_mm.append(block_mm if outcome.is_success else np.inf)
    there = sum(off <= SAME_PLACE_MM for off in off_mm)
    worst = max(off_mm)
    yield Figure(
        f"block within {SAME_PLACE_MM:g} mm of the simulation's, speeds 0.3 and 1",
        f"{runs} of {runs}",
        f"{there} of {runs}, {worst:.3f} mm at most",
        there == runs,
    )
    median = 1e3 * float(np.median([outcome.lateness_s[0] for outcome in outcomes]))
    late = 1e3 * max(outcome.lateness_s[1] for outcome in outcomes)
    yield Figure(
        "joint_command lateness p50 / p99",
        "<= 1 / 20 ms",
        f"{median:.2f} / {late:.1f} ms, the worst of {runs} runs",
        median <= 1.0 and late <= 20.0,
    )
    for which, speed in (("0.3", 0), ("1", 1)):
        chosen = outcomes[speed::2]
        if not chosen:
            continue
        joints = [outcome.joint_deviation_rad for outcome in chosen]
        tips_mm = [1e3 * outcome.tip_deviation_m for outcome in chosen]
        joint, tip_mm = float(np.median(joints)), float(np.median(tips_mm))
        yield Figure(
            f"deviation at speed {which}, exact: joint / tip off path",
            "<= 0.03 rad / 0.2 mm" if speed == 0 else "",
            f"{joint:.4f} rad / {tip_mm:.2f} mm, median of {len(chosen)} runs; the worst "
            f"{max(joints):.4f} rad / {max(tips_mm):.2f} mm",
            (joint <= 0.03 and tip_mm <= 0.2) if speed == 0 else None,
        )


def _lagging(stage: _Stage) -> Iterator[Figure]:
    lag = ("--follow", "lag", "--lag-s", str(LAG_S))
    for pace in (Pace(0.3), Pace(0.1), Pace(1.0, LAG_S), Pace(0.5, LAG_S)):
        with tempfile.TemporaryDirectory() as folder:
            outcome, off_mm = stage.run(Path(folder), pace, *lag)
        found = outcome.failure or (
            f"{outcome.joint_deviation_rad:.3f} rad / {1e3 * outcome.tip_deviation_m:.1f} mm, "
            f"block {off_mm:.2f} mm off"
        )
        yield Figure(
            f"lag {LAG_S} s, speed {pace.speed:g}, lead {pace.lead_s:g} s: joint / tip off path",
            "guard silent",
            found,
            outcome.is_success,
        )


def _stopped(stage: _Stage, runs: int) -> Iterator[Figure]:
    delays_s = []
    for _ in range(runs):
        with robot_process() as (uri, _), _linked(uri) as link, ExitStack() as stack:
            delays_s.append(_stop_delay_s(stage, link, uri, stack))
    yield Figure(
        "stop message to last command",
        "<= 30 ms",
        f"{1e3 * max(delays_s):.1f} ms, the worst of {runs}",
        max(delays_s) <= 0.03,
    )


def _stop_delay_s(stage: _Stage, link: BaxterLink, uri: str, stack: ExitStack) -> float:
    """From the first state that says stopped to the last set-point that arrives after it."""
    sent, told = list[float](), list[float]()
    other = stack.enter_context(Node("/other", master_uri=uri, host="127.0.0.1"))
    other.subscribe(
        command_topic("left"), "baxter_core_msgs/JointCommand", lambda m: sent.append(m.time_s)
    )
    other.subscribe(
        STATE,
        "baxter_core_msgs/AssemblyState",
        lambda m: told.append(m.time_s) if m.message.stopped else None,
    )
    executor = RosExecutor(link, options=ExecutionOptions(Pace(0.5), Dwell(0.0, 0.0)))
    ready = executor.prepare(stage.plan).ready
    if ready is None:
        raise SystemExit("the simulated Baxter is not ready")

    def stop() -> None:
        while len(sent) < 100:
            time.sleep(0.01)
        publisher = other.advertise("/robot/set_super_stop", "std_msgs/Empty")
        while not told:
            publisher.send()
            time.sleep(0.01)

    thread = threading.Thread(target=stop)
    thread.start()
    outcome = executor.execute(ready)
    thread.join()
    if outcome.stop is None or outcome.stop.cause is not StopCause.STOPPED:
        raise SystemExit(f"it ended otherwise: {outcome.failure}")
    time.sleep(0.2)
    return max(0.0, sent[-1] - told[0])


def _paused(stage: _Stage) -> Iterator[Figure]:
    """The whole process stands still for a while, as on a busy computer."""

    def pause(_: str) -> None:
        time.sleep(3.0)
        stop, go = (f"kill -{name} {os.getpid()}" for name in (signal.SIGSTOP.name[3:], "CONT"))
        subprocess.run(["sh", "-c", f"{stop}; sleep {PAUSE_S}; {go}"], check=True)

    with tempfile.TemporaryDirectory() as folder:
        outcome, off_mm = stage.run(Path(folder), Pace(0.5), during=pause)
    latest = 1e3 * outcome.lateness_s[2]
    yield Figure(
        f"a pause of {1e3 * PAUSE_S:.0f} ms",
        "survived",
        outcome.failure or f"{latest:.0f} ms late at most, block {off_mm:.3f} mm off",
        outcome.is_success and latest > 1e3 * PAUSE_S * 0.8,
    )
