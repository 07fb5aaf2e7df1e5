"""Measure random pairs of tasks, one for each arm, done at the same time.

    python scripts/measure_together.py [--count 60] [--seed 1] [--kinds plain middle crossing]

Each arm carries a block of 45 mm from one place on the demo's table to another, with a vertical
hand, from where it starts in the demo. Kinds of pairs take turns:

- plain: each arm picks and places anywhere on its side, up to 10 cm beyond the middle,
- middle: both places are within 10 cm of the middle, so one hand may be in the other's way,
- crossing: each block lies up to 25 cm beyond the middle, so the ways to and from them cross.

Pairs of which an arm has no cycle by itself are drawn again. Printed are, for each pair and in the
median of each kind,

- the slower arm's own cycle, in a world without the other arm, gripper actions included,
- the makespan relative to that; in brackets, both without the time of gripper actions,
- the duration of the same tasks in turn, relative to the makespan, gripper actions included,
- the distance that is proven to be kept between the arms, and CPU seconds of planning.

Samples of every plan, 1 ms apart, are checked by Pinocchio's broad phase to be no nearer than
proven, or than 20 mm where more is proven. The planner's shapes for samples are thicker than
Rethink's meshes, of which proofs consist, so 2 mm less is no contradiction: the check finds a wrong
clock or wrong kinematics, not errors below 2 mm (`scripts/referee` has the meshes). In turn is
planned for comparison only; its CPU time is not counted. The exit status is 1 when a sample
contradicts the proof.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from itertools import cycle, islice
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from baxter_kin import Baxter, pose_from_quaternion
from baxter_kin.kinematics.arm import LIMBS
from planner import (
    Body,
    Box,
    Manipulator,
    Part,
    PickAndPlace,
    Scene,
    State,
    TwoArmPlan,
    load_object,
)
from planner.collision.context import CollisionContext
from planner.motion.paths.straight_line import DEFAULT_TOLERANCE
from planner.two_arms.across import windows_of
from planner.two_arms.arm_cycle import Requirements
from planner.two_arms.pair import PairSearch
from planner.two_arms.problem import Problem
from planner.two_arms.together import DEFAULT_GRIP_S

SIZE_M, TABLE_Z_M, APART_M = 0.045, -0.155, 0.13
"""Edge of a block, height of the table, and minimum distance of the middles of two places."""

X_M, MAX_YAW_RAD = (0.55, 0.85), np.pi / 2

Y_M = {
    "plain": ((-0.1, 0.6), (-0.1, 0.6)),
    "middle": ((0.2, 0.5), (-0.08, 0.1)),
    "crossing": ((-0.25, -0.05), (0.15, 0.5)),
}
"""For each kind, the ranges of pick and place, from the middle outwards to the arm's side."""

DOWN = pose_from_quaternion((0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0))
STEP_S, BODY_M, MAX_CHECKED_M = 1e-3, 2e-3, 0.02
"""Step of the samples; by how much distances of the shapes for samples may be less than those of
meshes, as in tests/planner/collision/test_mover.py; and maximum distance that is checked."""


def drawn(kind: str, rng: np.random.Generator) -> list[pin.SE3]:
    """Poses of the blocks at the left pick and place, and the right ones, away from each other."""
    while True:
        x, yaw = rng.uniform(*X_M, 4), rng.uniform(-MAX_YAW_RAD, MAX_YAW_RAD, 4)
        y = [sign * rng.uniform(*Y_M[kind][which]) for sign in (1, -1) for which in (0, 1)]
        xy = np.stack([x, y], axis=1)
        apart = np.linalg.norm(xy[:, None] - xy, axis=2) + np.eye(4)
        if apart.min() > APART_M:
            middles = np.append(xy, np.full((4, 1), TABLE_Z_M + SIZE_M / 2), axis=1)
            return [
                pin.SE3(pin.utils.rotate("z", angle), p)
                for angle, p in zip(yaw.tolist(), middles, strict=True)
            ]


def problems(
    kind: str, manipulators: Mapping[str, Manipulator], rng: np.random.Generator
) -> Iterator[tuple[PairSearch, Problem]]:
    """Pairs of tasks of which each arm can do its own by itself; endless."""
    table = load_object("table", pin.SE3(np.eye(3), np.array([1.0, 0.0, -0.93])))
    robot, q = manipulators["left"].robot, manipulators["left"].q_others
    joints = dict(zip(robot.joint_names, q.tolist(), strict=True))
    for manipulator in manipulators.values():
        joints |= manipulator.arm.joints(manipulator.arm.start)
    requirements = Requirements(0.0, DEFAULT_GRIP_S, DEFAULT_TOLERANCE)
    while True:
        poses = drawn(kind, rng)
        ends = dict(zip(LIMBS, (poses[:2], poses[2:]), strict=True))
        part = Part(Box((SIZE_M,) * 3), pin.SE3.Identity())
        bodies = [Body(f"{s} block", (part,), ends[s][0], is_movable=True) for s in LIMBS]
        state = State(Scene.of([table, *bodies]), joints)
        handled = {side: frozenset({f"{side} block"}) for side in LIMBS}
        problem = Problem(manipulators, state, handled, requirements)
        search = PairSearch(
            problem,
            {s: PickAndPlace(f"{s} block", *(T * DOWN for T in ends[s])) for s in LIMBS},
        )
        if all(each.plan.is_valid for each in search.cycles.values()):
            yield search, problem


def contradictions(plan: TwoArmPlan, problem: Problem) -> tuple[int, int]:
    """Samples at which both arms are nearer than proven, and the number of samples.

    None are taken where less than `BODY_M` is proven, as they would say nothing.
    """
    across, motion, found, count = problem.across(plan.plans), plan.trajectory, 0, 0
    if plan.proof is None or plan.proof.proven_m < BODY_M:
        return 0, 0
    for window in windows_of(plan, across.episodes):
        context = across.context(window.episodes)
        near = CollisionContext(
            context.checker,
            context.q_others,
            margin_m=min(plan.proof.proven_m - BODY_M, MAX_CHECKED_M),
        )
        times = np.arange(window.begin_s, window.end_s, STEP_S)
        found += sum(not near.is_free(q) for q in motion.sample(times).q)
        count += len(times)
    return found, count


def measured(kind: str, search: PairSearch, problem: Problem) -> dict[str, Any]:
    """The figures of one pair; own cycles are planned anew, so that their time counts."""
    fresh = PairSearch(problem, search.tasks)
    started = time.process_time()
    plan = fresh.plan()
    cpu_s = time.process_time() - started
    grip_s = plan.grip_s
    own_s = [sum(m.duration for m in each.motions) for each in fresh.cycles.values()]
    grips_s = 3 * grip_s
    figures: dict[str, Any] = {"kind": kind, "own_s": max(own_s) + grips_s, "cpu_s": cpu_s}
    if plan.failure is not None:
        return figures | {"failure": str(plan.failure)}
    wrong, samples = contradictions(plan, problem)
    turns = fresh.in_turn("for comparison")
    withdrawn = [s for s, own in plan.plans.items() if own.moves[-1].label == "withdraw"]
    return figures | {
        "makespan_s": plan.duration_s,
        "ratio": plan.duration_s / (max(own_s) + grips_s),
        "ratio_of_motion": (plan.duration_s - grips_s) / max(own_s),
        "in_turn": plan.in_turn,
        "alternate_s": turns.duration_s if turns.is_valid else np.nan,
        "alternate_ratio": turns.duration_s / plan.duration_s if turns.is_valid else np.nan,
        "no_alternate": str(turns.failure or ""),
        "proven_mm": 1e3 * plan.proof.proven_m if plan.proof else np.nan,
        "withdrawn": withdrawn,
        "wrong": wrong,
        "samples": samples,
    }


def shown(found: Mapping[str, Any]) -> str:
    """One line of the table."""
    start = f"{found['kind']:9} own {found['own_s']:5.2f} s, cpu {found['cpu_s']:5.1f} s"
    if "failure" in found:
        return f"{start}, refused: {found['failure']}"
    more = "".join(f", {side} withdraws" for side in found["withdrawn"])
    more += f", in turn: {found['in_turn']}" if found["in_turn"] else ""
    return (
        f"{start}, makespan {found['makespan_s']:5.2f} s, {found['ratio']:.3f} of own "
        f"({found['ratio_of_motion']:.3f}), alternate / together {found['alternate_ratio']:.2f}, "
        f"{found['proven_mm']:.1f} mm proven{more}"
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--count", type=int, default=60, help="number of pairs (default: 60)")
    parser.add_argument("--seed", type=int, default=1, help="of the random numbers (default: 1)")
    parser.add_argument("--kinds", nargs="+", choices=Y_M, default=list(Y_M), help="of pairs")
    parser.add_argument("--json", type=Path, help="file for the figures")
    arguments = parser.parse_args(argv)
    robot = Baxter.load()
    manipulators = {side: Manipulator.of(robot, side) for side in LIMBS}
    seed = arguments.seed
    pairs = {k: problems(k, manipulators, np.random.default_rng(seed)) for k in arguments.kinds}
    results = []
    for kind in islice(cycle(arguments.kinds), arguments.count):
        results.append(measured(kind, *next(pairs[kind])))
        print(shown(results[-1]), flush=True)
        if arguments.json is not None:
            arguments.json.write_text(json.dumps(results, indent=1, default=float))
    for kind in arguments.kinds:
        of_kind = [each for each in results if each["kind"] == kind]
        solved = [each for each in of_kind if "failure" not in each]
        at_once = [each for each in solved if not each["in_turn"]]
        medians = {
            name: np.nanmedian([each[name] for each in at_once] or [np.nan])
            for name in ("ratio", "ratio_of_motion", "alternate_ratio")
        }
        cpu = np.median([each["cpu_s"] for each in of_kind] or [np.nan])
        print(
            f"{kind}: {len(of_kind)} pairs, {len(at_once)} at once, "
            f"{len(solved) - len(at_once)} in turn, {len(of_kind) - len(solved)} refused; medians: "
            f"{medians['ratio']:.3f} of own ({medians['ratio_of_motion']:.3f}), alternate / "
            f"together {medians['alternate_ratio']:.2f}, cpu {cpu:.1f} s"
        )
    wrong = sum(each.get("wrong", 0) for each in results)
    print(
        f"{wrong} of {sum(each.get('samples', 0) for each in results)} samples contradict a proof"
    )
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
