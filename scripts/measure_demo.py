"""Print the figures of the demo: `python scripts/measure_demo.py [RUNS]`.

Each run is a process of its own; times are medians over the runs.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from baxter_kin import Baxter, pose_from_quaternion
from baxter_kin.command_line import OneSentenceParser, whole_number
from planner import Manipulator, PickAndPlace, plan_pick_and_place, plan_start_move
from sim import Recorder, Simulation, World
from sim.demo.options import DEFAULT_POSES_M
from sim.demo.scene import OVERHEAD_XYZW, demo_bodies

DEMO = [sys.executable, "-m", "baxter_kin.demo", "--headless", "--quiet"]
SIMULATED_S = 300.0
CYCLES = 10


def main() -> None:
    """Run, measure, print."""
    parser = OneSentenceParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("runs", nargs="?", type=whole_number(1), default=5, help="default: 5")
    runs = parser.parse_args().runs
    with tempfile.TemporaryDirectory() as folder:
        report, html = Path(folder) / "report.json", Path(folder) / "replay.html"
        measured = [_process([*DEMO, "--report", str(report)]) for _ in range(runs)]
        _print_processes(measured)
        _print_report(json.loads(report.read_text("utf-8")))
        _process([*DEMO, "--html", str(html)])
        print(f"replay page                 {html.stat().st_size / 1e6:.2f} MB")
    _print_load()
    _print_simulation()


def _process(command: list[str]) -> tuple[int, float, float]:
    """Exit status, wall time in s and memory in MB of a process."""
    started = time.perf_counter()
    process = subprocess.Popen(command)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    return process.returncode, time.perf_counter() - started, usage.ru_maxrss / 1024


def _print_processes(measured: list[tuple[int, float, float]]) -> None:
    statuses, walls, memories = zip(*measured, strict=True)
    print(f"exit statuses               {sorted(set(statuses))}")
    print(
        f"whole process               {statistics.median(walls):.2f} s wall (max {max(walls):.2f})"
    )
    print(f"memory                      {max(memories):.0f} MB")


def _print_report(report: dict[str, Any]) -> None:
    waypoints = [w for cycle in report["cycles"] for w in cycle["waypoints"]]
    moves = [move for cycle in report["cycles"] for move in cycle["moves"]]
    position = max(w["position_error_m"] for w in waypoints)
    orientation = max(w["orientation_error_rad"] for w in waypoints)
    print(f"greatest IK residual        {position:.1e} m, {orientation:.1e} rad")
    for kind in ("velocity", "acceleration", "jerk"):
        peak = max(move[f"peak_{kind}_ratio"] for move in moves)
        print(f"greatest {kind + ' ratio':<19}1 {peak - 1.0:+.1e}")
    offset = np.array(report["block"]["final_m"]) - [*report["cycles"][-1]["place_m"][:2], -0.130]
    print("block off its place         {:.2f}, {:.2f}, {:.4f} mm".format(*(1e3 * offset)))
    print(f"nearest approach            {1e3 * report['min_clearance_m']:.1f} mm")
    print(f"steady pick and place       {report['cycles'][-1]['duration_s']:.2f} s simulated")
    print(f"motion of all cycles        {report['motion_time_s']:.3f} s")
    print(f"planning                    {report['planning_time_s']:.2f} s")


def _print_load() -> None:
    started = time.perf_counter()
    Baxter.load()
    print(f"Baxter.load()               {1e3 * (time.perf_counter() - started):.0f} ms")


def _print_simulation() -> None:
    """Simulated over real time, with a recording and a CSV being made."""
    robot = Baxter.load()
    manipulator, world = Manipulator.of(robot, "left"), World(robot)
    there = plan_start_move(
        manipulator, world.scene, manipulator.arm.neutral, manipulator.arm.start
    )
    back = plan_start_move(manipulator, world.scene, manipulator.arm.start, manipulator.arm.neutral)
    with tempfile.TemporaryDirectory() as folder:
        csv = Recorder(robot, Path(folder) / "motion.csv")
        simulation = Simulation(world, [csv])
        started = time.perf_counter()
        while simulation.time_s < SIMULATED_S:
            simulation.execute(there, unverified=True)
            simulation.execute(back, unverified=True)
        ratio = simulation.time_s / (time.perf_counter() - started)
        print(f"simulation                  {ratio:.0f} x real time, recording")
        print(
            f"simulation of whole cycles  {_cycles_ratio(manipulator, simulation):.0f} x real time"
        )
        csv.close()


def _cycles_ratio(manipulator: Manipulator, simulation: Simulation) -> float:
    """The same for picks and places, grasps and releases included, planning left out."""
    world, wall_s = simulation.world, 0.0
    for body in demo_bodies("left"):
        simulation.spawn(body)
    ends = [pose_from_quaternion(position, OVERHEAD_XYZW) for position in DEFAULT_POSES_M]
    begin_s = simulation.time_s
    for number in range(CYCLES):
        pick, place = ends[number % 2], ends[1 - number % 2]
        task, q = PickAndPlace("block", pick, place), world.arm_q("left")
        plan = plan_pick_and_place(task, manipulator, world.scene, q)
        started = time.perf_counter()
        simulation.execute(plan, unverified=True)
        wall_s += time.perf_counter() - started
    return (simulation.time_s - begin_s) / wall_s


if __name__ == "__main__":
    main()
