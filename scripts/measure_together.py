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

Every plan is judged by the referee (`scripts/referee/both_arms.py`): Rethink's meshes every
millisecond of the clock, each arm by itself, and one against the other, which must be no nearer
than proven. In turn is planned for comparison only; neither counts in CPU seconds. The exit status
is 1 when a plan is contradicted.
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
from referee.both_arms import check_two_arm_plan

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
from planner.motion.paths.straight_line import DEFAULT_TOLERANCE
from planner.two_arms.pair import PairSearch
from planner.two_arms.problem import Problem, Requirements
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

SHOWN = 3
"""Maximum number of printed findings of a plan; the file has all."""

DOWN = pose_from_quaternion((0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0))


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


def contradictions(plan: TwoArmPlan) -> list[str]:
    """What the referee finds against a valid plan, and against what its proof says."""
    apart_m = 0.0 if plan.proof is None else plan.proof.proven_m
    return list(map(str, check_two_arm_plan(plan, apart_m=apart_m)))


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
        "wrong": contradictions(plan),
    }


def shown(found: Mapping[str, Any]) -> str:
    """One line of the table."""
    start = f"{found['kind']:9} own {found['own_s']:5.2f} s, cpu {found['cpu_s']:5.1f} s"
    if "failure" in found:
        return f"{start}, refused: {found['failure']}"
    more = "".join(f", {side} withdraws" for side in found["withdrawn"])
    more += f", in turn: {found['in_turn']}" if found["in_turn"] else ""
    more += "".join(f"\n    CONTRADICTED: {each}" for each in found["wrong"][:SHOWN])
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
    judged = [each["wrong"] for each in results if "failure" not in each]
    wrong = sum(map(bool, judged))
    print(f"the referee contradicts {wrong} of {len(judged)} plans")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
