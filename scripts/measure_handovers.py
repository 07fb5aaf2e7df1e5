"""Measure random handovers to places that only the other arm reaches.

    python scripts/measure_handovers.py [--count 100] [--seed 1] [--kinds stick board bottle]

A body lies or stands on one side of a bench, and goes to the other side, out of the reach of the
arm that picks it up: inverse kinematics has no solution there for any overhead grasp of that arm.
Grasps and the place of the handover are chosen by the planner. Kinds of bodies take turns:

- stick: 120 x 40 x 40 mm, lies, and stands at the end,
- board: 200 x 30 x 50 mm, lies at both ends,
- bottle: a cylinder of 40 mm and 150 mm, stands at both ends.

The giver is the left arm, then the right one. Printed are, for each handover and in the median, the
CPU time of planning, the duration on the clock, and the distance that is proven to be kept between
the arms. Each plan is certified (`verify_both`) and executed, and the body must end at its place;
and it is judged by the referee (`scripts/referee/both_arms.py`): Rethink's meshes every millisecond
of the clock, and where each hand has the body. The exit status is 1 when a plan is not found, not
certified, not executed, or contradicted by the referee.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from itertools import cycle, islice

import numpy as np
import pinocchio as pin
from referee.both_arms import check_two_arm_plan

from baxter_kin import Baxter
from baxter_kin.kinematics.arm import LIMBS
from planner import (
    Body,
    Box,
    Cylinder,
    Handover,
    Manipulator,
    Part,
    Scene,
    State,
    overhead_grasp,
    plan_handover,
    verify_both,
)
from sim import Simulation, World

TABLE_Z_M = -0.155
BENCH_M = (0.9, 2.0, 0.06)

SHAPES = {
    "stick": Box((0.12, 0.04, 0.04)),
    "board": Box((0.2, 0.03, 0.05)),
    "bottle": Cylinder(0.02, 0.15),
}
HEIGHTS_M = {"stick": (0.04, 0.12), "board": (0.05, 0.05), "bottle": (0.15, 0.15)}
"""Heights of the bodies at the pick and at the place."""

PICK_M, PLACE_M = ((0.6, 0.75), (0.25, 0.5)), ((0.5, 0.7), (0.55, 0.75))
"""Ranges of x, and of y outwards from the middle, of picks and places."""

MAX_TURN_RAD = 0.3
ENDED_M = 1e-6

SHOWN = 3
"""Maximum number of printed contradictions of a plan."""


def tasks(
    kinds: list[str], manipulators: dict[str, Manipulator], rng: np.random.Generator
) -> Iterator[tuple[str, Handover, State]]:
    """Random tasks whose places the giver does not reach; endless."""
    robot = manipulators["left"].robot
    joints = dict(zip(robot.joint_names, manipulators["left"].q_others.tolist(), strict=True))
    for manipulator in manipulators.values():
        joints |= manipulator.arm.joints(manipulator.arm.start)
    bench = Body(
        "bench",
        (Part(Box(BENCH_M), pin.SE3.Identity()),),
        pin.SE3(np.eye(3), np.array([0.95, 0.0, TABLE_Z_M - BENCH_M[2] / 2])),
    )
    for number, kind in enumerate(cycle(kinds)):
        giver = LIMBS[number % 2]
        side = 1.0 if giver == "left" else -1.0
        while True:
            pick = _at(PICK_M, HEIGHTS_M[kind][0], side, side * -np.pi / 2, rng)
            goal = _at(PLACE_M, HEIGHTS_M[kind][1], -side, 0.0, rng)
            if kind == "stick":
                goal = goal * pin.SE3(pin.utils.rotate("y", -np.pi / 2), np.zeros(3))
            body = Body(kind, (Part(SHAPES[kind], pin.SE3.Identity()),), pick, is_movable=True)
            if not _reaches(manipulators[giver], body.at(goal)):
                yield kind, Handover(kind, goal, giver), State(Scene.of([bench, body]), joints)
                break


def _reaches(manipulator: Manipulator, body: Body) -> bool:
    yaws = np.arange(0.0, 2.0 * np.pi, np.pi / 2).tolist()
    poses = (overhead_grasp(manipulator.hand, body, yaw_rad=yaw) for yaw in yaws)
    return any(manipulator.ik.solve(T).is_valid for T in poses)


def _at(
    ranges_m: tuple[tuple[float, float], tuple[float, float]],
    height_m: float,
    side: float,
    yaw_rad: float,
    rng: np.random.Generator,
) -> pin.SE3:
    (x, y), turn = (rng.uniform(*each) for each in ranges_m), rng.uniform(-1.0, 1.0)
    R = pin.utils.rotate("z", yaw_rad + MAX_TURN_RAD * turn)
    return pin.SE3(R, np.array([x, side * y, TABLE_Z_M + height_m / 2]))


def main(arguments: list[str] | None = None) -> int:
    """Measure, and print."""
    summary = (__doc__ or "").split("\n", 1)[0]
    parser = argparse.ArgumentParser(description=summary)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", nargs="+", choices=tuple(SHAPES), default=list(SHAPES))
    given = parser.parse_args(arguments)
    robot = Baxter.load()
    manipulators = {side: Manipulator.of(robot, side) for side in LIMBS}
    drawn = tasks(given.kinds, manipulators, np.random.default_rng(given.seed))
    found: list[tuple[float, float, float]] = []
    certified = executed = contradicted = 0
    for number, (kind, task, state) in enumerate(islice(drawn, given.count), 1):
        begin_s = time.process_time()
        plan = plan_handover(task, manipulators, state)
        cpu_s = time.process_time() - begin_s
        label = f"{number:3} {kind:6} {task.giver:5} {cpu_s:5.1f} s CPU"
        if plan.proof is None:
            print(f"{label}: {plan.failure}", flush=True)
            continue
        certificate = verify_both(plan)
        world = World.from_state(state, robot)
        outcome = Simulation(world).execute(plan, certificate=certificate)
        off_m = np.linalg.norm(
            world.body(kind).T_base_body.translation - task.T_base_goal.translation
        )
        is_done = outcome.is_success and not outcome.hits and off_m <= ENDED_M
        wrong = check_two_arm_plan(plan, apart_m=plan.proof.proven_m)
        certified, executed = certified + certificate.is_valid, executed + is_done
        contradicted += bool(wrong)
        found.append((cpu_s, plan.duration_s, plan.proof.proven_m))
        print(
            f"{label}, {plan.duration_s:5.2f} s, {1e3 * plan.proof.proven_m:5.1f} mm apart, "
            f"{'certified' if certificate.is_valid else certificate.verdict}, "
            f"{'executed' if is_done else outcome}"
            + "".join(f"\n    CONTRADICTED: {each}" for each in wrong[:SHOWN]),
            flush=True,
        )
    if found:
        cpu_s, duration_s, apart_m = np.median(found, axis=0).tolist()
        print(
            f"\n{len(found)} of {given.count} planned, {certified} certified, {executed} executed, "
            f"{contradicted} contradicted; "
            f"medians: {cpu_s:.2f} s of CPU, {duration_s:.2f} s, {1e3 * apart_m:.1f} mm apart"
        )
    return int(min(len(found), certified, executed) < given.count or contradicted > 0)


if __name__ == "__main__":
    sys.exit(main())
