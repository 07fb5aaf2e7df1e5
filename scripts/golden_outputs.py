"""Record what the toolkit answers to fixed inputs, and compare two records number by number.

    python scripts/golden_outputs.py record FOLDER [--only KIND ...] [--jobs N]
    python scripts/golden_outputs.py compare BEFORE AFTER [--tolerance 1e-9] [--ignore PATTERN ...]

A refactoring must not change any of these: record before the first commit, record after the last,
compare. Recorded are

- `plans`: random problems of six families (`referee.problems`), some of them for a calibrated
  robot or with other fingers: steps, trajectories, proofs, and the certificate's values,
- `guards`: by how much every move of some of these plans is clear for the guard of an execution,
- `tracking`: what is proven of some of them on an arm that lags,
- `setpoints`: what is sent to a robot along some of them, at two speeds, with and without lead,
- `recordings` and `replays`: what a simulation of some of them records, and what its page contains,
- `demos`: the reports of two demos.

Times that were measured are left out. Floats are compared within the tolerance, absolutely or
relative to the larger magnitude; everything else must be equal. The exit status of `compare` is 1
when anything differs.
"""

from __future__ import annotations

import argparse
import fnmatch
import hashlib
import json
import math
import multiprocessing
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from referee.problems import make_problem, planned
from served_urdf import served_urdf
from tqdm import tqdm

from baxter_kin import Baxter
from baxter_kin.description.hands import ElectricGripper
from baxter_kin.fields import evolve, field_names
from planner import Manipulator, Plan, Response, verify
from planner.pick_place.tracking import prove_tracking
from planner.plan import Move
from sim import Recorder, Recording, Simulation, World
from sim.ros1.execution.guard import NotClearError, clearances_of
from sim.ros1.execution.set_points import Pace, motions_of
from sim.view.replay import replay_content

SEED = 34
FAMILIES = ("plain", "obstacles", "odd bodies", "bins", "margins", "rods")
COUNT = 10
"""Problems of each family."""

CALIBRATED, OTHER_HANDS = (3, 7), (5,)
"""Numbers of the problems that are for a calibrated robot, and for other fingers."""

KINDS = {
    "plans": [(family, number) for family in FAMILIES for number in range(COUNT)],
    "guards": [(family, number) for family in FAMILIES for number in range(COUNT)],
    "tracking": [(family, number) for family in FAMILIES for number in (0, 3)],
    "setpoints": [(family, 0) for family in FAMILIES],
    "recordings": [(family, number) for family in FAMILIES for number in (0, 1)],
    "replays": [(family, number) for family in FAMILIES[:5] for number in (0, 1)],
    "demos": [("default", 0), ("right", 1)],
}
DEMOS = {
    "default": (),
    "right": (
        *("--limb", "right", "--hover", "0.12"),
        *("--add-pose", "0.7", "-0.15", "-0.129"),
        *("--add-pose", "0.6", "-0.3", "-0.129"),
    ),
}
MEASURED_TIMES = {"planning_time_s", "wall_time_s"}
PACES = (Pace(0.3), Pace(1.0, 0.4))
TICK_S = 0.01
LAGGING = Response(lag_s=(0.38, 0.42), settled_error_rad=0.001, speed=0.3)
SHOWN = 40
"""Differences that `compare` prints; it counts all."""


def main(argv: Sequence[str] | None = None) -> int:
    """Record or compare."""
    options = _parser().parse_args(argv)
    if options.command == "record":
        return record(options.folder, options.only or list(KINDS), options.jobs)
    return compare(options.before, options.after, options.tolerance, options.ignore)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    recording = commands.add_parser("record", help="write the outputs of this checkout")
    recording.add_argument("folder", type=Path)
    recording.add_argument("--only", action="append", choices=list(KINDS), help="repeatable")
    recording.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes")
    comparing = commands.add_parser("compare", help="list what differs between two records")
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    comparing.add_argument("--tolerance", type=float, default=1e-9)
    comparing.add_argument(
        "--ignore", action="append", default=[], metavar="PATTERN", help="paths that may differ"
    )
    return parser


# Record


def record(folder: Path, kinds: Sequence[str], jobs: int) -> int:
    """Write one JSON file per kind and problem."""
    folder.mkdir(parents=True, exist_ok=True)
    os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))
    tasks = [(kind, *item, str(folder)) for kind in kinds for item in KINDS[kind]]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=context) as pool:
        list(tqdm(pool.map(_record_one, tasks), total=len(tasks), disable=None))
    return 0


def _record_one(task: tuple[str, str, int, str]) -> None:
    kind, name, number, folder = task
    found = _RECORDERS[kind](name, number)
    path = Path(folder) / kind / f"{name.replace(' ', '_')}_{number}.json"
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps(_plain(found), indent=0) + "\n")


def _plan(family: str, number: int) -> Any:
    plan, manipulator = _planned(family, number)
    found: dict[str, Any] = {"failure": str(plan.failure), "limb": plan.limb}
    found["steps"] = [_step(step) for step in plan.steps]
    if plan.is_valid:
        found["certificate"] = verify(plan, description=manipulator.robot.description).as_dict()
    return found


def _step(step: Any) -> dict[str, Any]:
    names = ("label", "proof", "clearance", "is_straight", "T_base_tip", "action", "body")
    found = {name: getattr(step, name, None) for name in (*names, "opening_m")}
    if isinstance(step, Move):
        names = ("knots_s", "q", "v", "a", "j")
        found["trajectory"] = {name: getattr(step.trajectory, name) for name in names}
        found["seed"] = step.seed_label
    return found


def _guard(family: str, number: int) -> Any:
    plan, manipulator = _planned(family, number)
    if not plan.is_valid:
        return None
    try:
        return clearances_of(plan, manipulator)
    except NotClearError as refusal:
        return str(refusal)


def _tracking(family: str, number: int) -> Any:
    plan, manipulator = _planned(family, number)
    if not plan.is_valid:
        return None
    proof = prove_tracking(plan, LAGGING, manipulator=manipulator, seek_speed=False)
    return {"moves": proof.moves, "rates": proof.rate_rad_s, "failure": proof.failure}


def _setpoints(family: str, number: int) -> Any:
    plan, _ = _planned(family, number)
    found = {}
    for pace in PACES:
        motions = motions_of(plan.moves, pace)
        times = [np.arange(0.0, motion.duration_s, TICK_S) * pace.speed for motion in motions]
        found[repr(pace)] = [
            [motion.at(float(t)).q_sent for t in at]
            for motion, at in zip(motions, times, strict=True)
        ]
    return found


def _recorded(family: str, number: int) -> Recording | None:
    plan, manipulator = _planned(family, number)
    if not plan.is_valid:
        return None
    world = World(manipulator.robot)
    world.move_arm(plan.limb, plan.q_start)
    recorder = Recorder(manipulator.robot)
    simulation = Simulation(world, [recorder])
    for body in plan.start.scene:
        simulation.spawn(body)
    simulation.execute(plan, unverified=True)
    simulation.wait(0.1)
    return recorder.recording()


def _recording(family: str, number: int) -> Any:
    recording = _recorded(family, number)
    if recording is None:
        return None
    names = ("times_s", "q", "body_poses", "captions", "joint_names")
    found = {name: getattr(recording, name) for name in names}
    found["events"] = [(event.time_s, event.kind, event.text) for event in recording.events]
    found["moves"] = [(move.start_s, move.label, move.trajectory.q) for move in recording.moves]
    return found


def _replay(family: str, number: int) -> Any:
    recording = _recorded(family, number)
    if recording is None:
        return None
    _, manipulator = _planned(family, number)
    content = replay_content(recording, manipulator.robot)
    drawn = {name: content.pop(name) for name in ("geometries", "commands")}
    text = json.dumps(_plain(drawn), sort_keys=True, default=str)
    return {**content, "drawn": hashlib.sha256(text.encode()).hexdigest()}


def _demo(name: str, _: int) -> Any:
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        command = [sys.executable, "-m", "baxter_kin.demo", "--headless", "-q"]
        subprocess.run([*command, *DEMOS[name], "--report", str(report)], check=True)
        found = json.loads(report.read_text())
    return {key: value for key, value in found.items() if key not in MEASURED_TIMES}


_RECORDERS = {
    "plans": _plan,
    "guards": _guard,
    "tracking": _tracking,
    "setpoints": _setpoints,
    "recordings": _recording,
    "replays": _replay,
    "demos": _demo,
}


@cache
def _planned(family: str, number: int) -> tuple[Plan, Manipulator]:
    problem = make_problem(family, number, SEED)
    problem = evolve(problem, manipulator=_manipulator(problem.manipulator.arm.side, number))
    return planned(problem), problem.manipulator


@cache
def _manipulator(limb: str, number: int) -> Manipulator:
    return Manipulator.of(_robot(number), limb)


def _robot(number: int) -> Baxter:
    if number in CALIBRATED:
        rng = np.random.default_rng(number)
        return Baxter.load(urdf=served_urdf(rng, apart_m=0.001, turned_rad=0.002))
    if number in OTHER_HANDS:
        hand = ElectricGripper("narrow", 3, "half_round")
        return Baxter.load(hands={"left": hand, "right": hand})
    return Baxter.load()


def _plain(value: Any) -> Any:
    """A value as JSON has it; of values of our own, all fields."""
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if isinstance(value, (pin.SE3, Enum)):
        return value.value if isinstance(value, Enum) else value.homogeneous.tolist()
    if names := field_names(value):
        value = {name: getattr(value, name) for name in names}
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    return [_plain(each) for each in value] if isinstance(value, (list, tuple)) else value


# Compare


def compare(before: Path, after: Path, tolerance: float, ignored: Sequence[str]) -> int:
    """Print what differs."""
    names = sorted(
        {
            path.relative_to(top).as_posix()
            for top in (before, after)
            for path in top.rglob("*.json")
        }
    )
    found = [
        line
        for name in names
        for line in _file_differences(before / name, after / name, name, tolerance)
        if not any(fnmatch.fnmatch(line.split(":", maxsplit=1)[0], each) for each in ignored)
    ]
    for line in found[:SHOWN]:
        print(line)
    print(f"{len(names)} files compared, {len(found)} differences")
    return int(bool(found) or not names)


def _file_differences(before: Path, after: Path, name: str, tolerance: float) -> Iterator[str]:
    if not before.exists() or not after.exists():
        yield f"{name}: only in {'the second' if after.exists() else 'the first'} record"
        return
    first, second = (json.loads(path.read_text()) for path in (before, after))
    yield from _differences(first, second, name.removesuffix(".json"), tolerance)


def _differences(first: Any, second: Any, at: str, tolerance: float) -> Iterator[str]:
    if isinstance(first, dict) and isinstance(second, dict):
        for key in sorted({*first, *second}):
            if key not in first or key not in second:
                yield f"{at}.{key}: only in {'the second' if key in second else 'the first'} record"
            else:
                yield from _differences(first[key], second[key], f"{at}.{key}", tolerance)
    elif isinstance(first, list) and isinstance(second, list):
        if len(first) != len(second):
            yield f"{at}: {len(first)} entries, then {len(second)}"
            return
        for index, pair in enumerate(zip(first, second, strict=True)):
            yield from _differences(*pair, f"{at}.{index}", tolerance)
    elif not _are_equal(first, second, tolerance):
        yield f"{at}: {first!r}, then {second!r}"


def _are_equal(first: Any, second: Any, tolerance: float) -> bool:
    if isinstance(first, float) and isinstance(second, (float, int)):
        is_near = math.isclose(first, second, rel_tol=tolerance, abs_tol=tolerance)
        return is_near or (math.isnan(first) and math.isnan(second))
    return type(first) is type(second) and bool(first == second)


if __name__ == "__main__":
    sys.exit(main())
