"""Measure motions of both arms: free moves among obstacles, and bodies carried by both hands.

Usage:
    measure_two_arms.py free PROBLEMS.json [--first N] [--last N] [--out OUT.json]
    measure_two_arms.py trays [--count N] [--seed S] [--out OUT.json]

`free` solves problems of MotionBenchMaker (Chamzas et al., "MotionBenchMaker: A tool to generate
and benchmark motion planning datasets", IEEE RA-L 7(2), 2022), in the form of `problems` in the
file: `start` and `goal` by names of joints, and `obstacles`, each with a name, type, dimensions,
position and quaternion in base. Both hands have narrow fingers in slot 3, because stock fingers are
inside the cans at most goals. `trays` moves random trays up, sideways and forward. CPU times are of
this process.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin

from baxter_kin import Baxter, pose_from_quaternion
from baxter_kin.description.hands import ElectricGripper
from planner import Body, Box, Cylinder, Manipulator, Part, Scene, Sphere, State, plan_free_move
from planner.errors import MotionError
from planner.motion import free_search, rrt
from planner.motion.joint_move import plan_joint_move
from planner.two_arms.context import context_of_both, limits_of_both

Found = dict[str, Any]


def main() -> None:
    """Measure, print each result as a line of JSON, and a summary."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=["free", "trays"])
    parser.add_argument("file", nargs="?", type=Path)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--last", type=int)
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    if given.what == "free":
        found = free_moves(json.loads(given.file.read_text())["problems"], given)
    else:
        found = trays(given)
    results = []
    for each in found:
        rounded = {k: round(v, 6) if isinstance(v, float) else v for k, v in each.items()}
        print(json.dumps(rounded), flush=True)
        results.append(each)
        if given.out:
            given.out.write_text(json.dumps(results))
    summarise(results)


def summarise(results: list[Found]) -> None:
    """Print shares and medians."""
    tried = [each for each in results if "not_tried" not in each]
    solved = [each for each in tried if "duration_s" in each]
    print(f"{len(solved)} of {len(tried)} solved; {len(results)} in all")
    if solved:
        ratios = [each["duration_s"] / each["bound_s"] for each in solved]
        cpu, cpu_all = ([each["cpu_s"] for each in group] for group in (solved, tried))
        print(f"CPU: median {np.median(cpu):.2f} s, of all {np.median(cpu_all):.2f} s")
        print(
            f"duration / bound: median {np.median(ratios):.3f}, p75 {np.quantile(ratios, 0.75):.3f}"
        )


def free_moves(problems: list[Found], given: argparse.Namespace) -> Iterator[Found]:
    """Solve problems of MotionBenchMaker."""
    free_search.time = rrt.time = SimpleNamespace(monotonic=time.process_time)  # type: ignore[attr-defined]
    gripper = ElectricGripper("narrow", 3)
    robot = Baxter.load(hands={"left": gripper, "right": gripper})
    arms = {side: Manipulator.of(robot, side) for side in ("left", "right")}
    limits = limits_of_both(arms)
    for problem in problems[given.first : given.last]:
        found: Found = {"set": problem["set"], "id": problem["id"]}
        scene = Scene.of(body_of(obstacle) for obstacle in problem["obstacles"])
        context = context_of_both(arms, State.of(arms["left"], scene))
        q_start, q_goal = (
            np.array([problem[end][name] for name in limits.names]) for end in ("start", "goal")
        )
        for which, q in (("start", q_start), ("goal", q_goal)):
            if limits.violations(q):
                found["not_tried"] = f"{which} outside its limits"
            elif not context.is_free(q):
                found["not_tried"] = f"{which}: {context.clearance(q).text}"
        if "not_tried" not in found:
            found["bound_s"] = plan_joint_move(q_start, q_goal, limits).duration
            started = time.process_time()
            try:
                motion = plan_free_move(q_start, q_goal, limits, context)
                found["duration_s"] = motion.duration
            except MotionError as cause:
                found["failure"] = str(cause)
            found["cpu_s"] = time.process_time() - started
            if "duration_s" in found:
                proof = context.prove(motion)
                found["is_clear"] = proof.is_clear
                found["proven_mm"] = 1e3 * getattr(proof, "proven_m", np.nan)
        yield found


def body_of(obstacle: Mapping[str, Any]) -> Body:
    """The body of an obstacle."""
    sizes = obstacle["dimensions_m"]
    shape = {
        "box": lambda: Box(tuple(sizes)),
        "cylinder": lambda: Cylinder(radius_m=sizes[1], length_m=sizes[0]),
        "sphere": lambda: Sphere(sizes[0]),
    }[obstacle["type"]]()
    T = pose_from_quaternion(obstacle["position_m"], obstacle["quat_xyzw"])
    return Body(obstacle["name"], (Part(shape, pin.SE3.Identity()),), T)


def trays(given: argparse.Namespace) -> Iterator[Found]:
    """Move random trays."""
    raise NotImplementedError


if __name__ == "__main__":
    main()
