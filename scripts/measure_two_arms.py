"""Measure motions of both arms: free moves among obstacles, and bodies carried by both hands.

Usage:
    measure_two_arms.py free PROBLEMS.json [--first N] [--last N] [--out OUT.json]
    measure_two_arms.py trays [--count N] [--seed S] [--out OUT.json]
    measure_two_arms.py carries [--count N] [--seed S] [--out OUT.json]

`free` solves problems of MotionBenchMaker (Chamzas et al., "MotionBenchMaker: A tool to generate
and benchmark motion planning datasets", IEEE RA-L 7(2), 2022), in the form of `problems` in the
file: `start` and `goal` by names of joints, and `obstacles`, each with a name, type, dimensions,
position and quaternion in base. Both hands have narrow fingers in slot 3, because stock fingers are
inside the cans at most goals. `trays` moves random trays up, sideways and forward. `carries` lets
both hands pick random bars up from the table, carry them, and put them down; the referee judges
these plans (`scripts/referee/both_arms.py`), and the exit status is 1 when one is contradicted.
What is certified is a bound of the checker (`planner.certificate`) at every instant. CPU times are
of this process.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator, Mapping
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin
from referee.both_arms import check_two_arm_plan

from baxter_kin import Baxter, IKService, JointLimits, pose_from_quaternion
from baxter_kin.description.hands import ElectricGripper
from baxter_kin.ik import sample_solutions
from baxter_kin.ik.reach.bound import ReachBound
from baxter_kin.validation import FloatArray
from planner import (
    Attachment,
    Body,
    Box,
    Cylinder,
    Manipulator,
    PairCarry,
    PairMove,
    Part,
    Scene,
    Sphere,
    State,
    Trajectory,
    load_object,
    plan_free_move,
    plan_pair_carry,
    plan_pair_move,
    verify_both,
)
from planner.certificate.intervals import Pose
from planner.certificate.motion import Polynomials
from planner.certificate.robot import Robot
from planner.certificate.timeline.both_arms import HandToHand
from planner.certificate.timeline.tip import relative_deviation
from planner.errors import MotionError
from planner.manipulator import context_of_both, limits_of_both
from planner.motion import free_search, rrt
from planner.motion.joint_move import plan_joint_move
from sim import Simulation, World

Found = dict[str, Any]

TABLE_Z_M = -0.155

R_BAR_TIP = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""A hand that takes a bar from above."""


def main() -> int:
    """Measure, print each result as a line of JSON, and a summary."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=["free", "trays", "carries"])
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
        found = trays(given) if given.what == "trays" else carries(given)
    results = []
    for each in found:
        rounded = {k: round(v, 6) if isinstance(v, float) else v for k, v in each.items()}
        print(json.dumps(rounded), flush=True)
        results.append(each)
        if given.out:
            given.out.write_text(json.dumps(results))
    summarise(results)
    return int(any(each.get("contradicted") for each in results))


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
    judged = [each["contradicted"] for each in results if "contradicted" in each]
    if judged:
        print(f"the referee contradicts {sum(map(bool, judged))} of {len(judged)} plans")


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
    """Move random trays up, sideways and forward, each any way and on a straight line."""
    robot = Baxter.load()
    arms = {side: Manipulator.of(robot, side) for side in ("left", "right")}
    limits, rng = limits_of_both(arms), np.random.default_rng(given.seed)
    table = load_object("table", pose_from_quaternion((1.0, 0.0, -0.93), (0, 0, 0, 1)))
    ways = {"up": (0.0, 0.0, 1.0), "sideways": (0.0, 1.0, 0.0), "forward": (1.0, 0.0, 0.0)}
    for number in range(given.count):
        name, drawn, state = list(ways)[number % len(ways)], 0, None
        while state is None:
            drawn += 1
            way = rng.uniform(0.1, 0.3) * np.array(ways[name])
            state, T_goal = random_tray(arms, table, limits, way, rng)
        for is_straight in (False, True):
            found: Found = {"way": name, "number": number, "is_straight": is_straight}
            found |= {"length_m": float(np.linalg.norm(way)), "drawn": drawn}
            started = time.process_time()
            try:
                move = plan_pair_move(arms, state, T_goal, is_straight=is_straight)
            except MotionError as cause:
                found["failure"] = str(cause)
            found["cpu_s"] = time.process_time() - started
            if "failure" not in found:
                ends = plan_joint_move(*move.trajectory.q[[0, -1]], limits)
                found |= {"duration_s": move.duration_s, "bound_s": ends.duration}
                found |= {"proven_um": 1e6 * move.deviation.position_m}
                found |= {"proven_deg": float(np.degrees(move.deviation.rotation_rad))}
                off_um, off_deg = sampled_deviation(arms, move.trajectory, number)
                certified_m, certified_rad = certified_deviation(robot, move)
                found |= {"certified_um": 1e6 * certified_m}
                found |= {"certified_deg": float(np.degrees(certified_rad))}
                found |= {"sampled_um": off_um, "sampled_deg": off_deg}
                found |= {"clear_mm": 1e3 * move.proof.proven_m}
            yield found


def certified_deviation(robot: Baxter, move: PairMove) -> tuple[float, float]:
    """The checker's bound on how far the hands leave their relative pose at the start, m and rad.

    By its own model of the robot, from the knots of the motion alone.
    """
    chain = HandToHand.of(*(Robot(robot.description.text, side) for side in ("left", "right")))
    motion, joints = move.trajectory, range(len(move.trajectory.limits.names))
    signs = np.where(np.array(joints) < len(joints) // 2, -1.0, 1.0)
    along = [*joints[len(joints) // 2 - 1 :: -1], *joints[len(joints) // 2 :]]
    q, v, a, j = ((signs * x)[:, along] for x in (motion.q, motion.v, motion.a, motion.j))
    own = Polynomials.of_knots(motion.knots_s, (q, v, a), j, "the motion")
    T = chain.tips(own.at(np.zeros(1)))
    return relative_deviation(chain, own, Pose(T.R[0], T.p[0]), "the motion")


def carries(given: argparse.Namespace) -> Iterator[Found]:
    """Pick up random bars with both hands, carry them any way or straight, and put them down."""
    robot = Baxter.load()
    arms = {side: Manipulator.of(robot, side) for side in ("left", "right")}
    rng = np.random.default_rng(given.seed)
    table = load_object("table", pose_from_quaternion((1.0, 0.0, -0.93), (0, 0, 0, 1)))
    limits = limits_of_both(arms)
    for number in range(given.count):
        thick_m, y_m = rng.uniform(0.015, 0.045), rng.uniform(0.12, 0.25)
        ends = []
        for _ in range(2):
            x, y, turn = rng.uniform((0.62, -0.15, -0.3), (0.78, 0.15, 0.3))
            place = np.array([x, y, TABLE_Z_M + thick_m / 2.0])
            ends.append(pin.SE3(pin.utils.rotate("z", turn), place))
        part = Part(Box((thick_m, 2.0 * y_m + 0.1, thick_m)), pin.SE3.Identity())
        bar = Body("bar", (part,), ends[0], is_movable=True)
        tips = {
            side: pin.SE3(R_BAR_TIP, np.array([0.0, sign * y_m, 0.0]))
            for side, sign in (("left", 1.0), ("right", -1.0))
        }
        state = State.of(arms["left"], Scene.of([table, bar]))
        joints = dict(state.joints)
        for arm in arms.values():
            joints |= arm.arm.joints(arm.arm.start) | arm.hand.finger_joints(arm.hand.stroke_m)
        state = State(state.scene, joints)
        task = PairCarry("bar", tips, ends[1], is_straight=bool(number % 2))
        found: Found = {"number": number, "is_straight": task.is_straight}
        started = time.process_time()
        plan = plan_pair_carry(task, arms, state)
        found["cpu_s"] = time.process_time() - started
        if plan.failure is not None:
            found["failure"] = str(plan.failure)
            yield found
            continue
        started = time.process_time()
        certificate = verify_both(plan)
        found |= {"check_s": time.process_time() - started, "is_certified": certificate.is_valid}
        if not certificate.is_valid:
            found["refusal"] = certificate.verdict
        else:
            distance, turn = certificate.checks
            found |= {"certified_um": 1e6 * distance.value}
            found |= {"certified_deg": float(np.degrees(turn.value))}
        q = np.concatenate([plan.plans[side].q_start for side in ("left", "right")])
        q_end = np.concatenate(
            [plan.plans[side].steps[-1].trajectory.q_goal for side in plan.plans]
        )
        bound_s = plan_joint_move(q, q_end, limits).duration
        found |= {"duration_s": plan.duration_s, "bound_s": bound_s}
        world = World.from_state(state, robot)
        outcome = Simulation(world).execute(plan, unverified=True)
        found |= {"is_executed": outcome.is_success, "hits": len(outcome.hits)}
        off = world.body("bar").T_base_body.translation - ends[1].translation
        found["off_mm"] = 1e3 * float(np.linalg.norm(off))
        apart_m = 0.0 if plan.proof is None else plan.proof.proven_m
        found["contradicted"] = [str(each) for each in check_two_arm_plan(plan, apart_m=apart_m)]
        yield found


def random_tray(
    arms: Mapping[str, Manipulator],
    table: Body,
    limits: JointLimits,
    way: FloatArray,
    rng: np.random.Generator,
) -> tuple[State | None, pin.SE3]:
    """A random tray in both hands, which point at each other, and its goal.

    The state is None where both hands cannot hold it, or the goal is proven out of reach.
    """
    half_m = rng.uniform(0.15, 0.3)
    x, y, z = rng.uniform((0.4, -0.15, -0.05), (0.75, 0.15, 0.3))
    T = pin.SE3(pin.utils.rotate("z", rng.uniform(-0.3, 0.3)), np.array([x, y, z]))
    T_goal = pin.SE3(T.rotation, T.translation + (way if y <= 0.0 or way[1] == 0.0 else -way))
    R_left = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    R_right = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    T_body_tips = [
        pin.SE3(R, np.array([0.0, sign * half_m, 0.0])) for R, sign in ((R_left, 1), (R_right, -1))
    ]
    sizes = (rng.uniform(0.1, 0.3), 2.0 * half_m + 0.06, 0.02)
    for side, T_body_tip in zip(("left", "right"), T_body_tips, strict=True):
        if ReachBound(arms[side].arm).proof(T_goal * T_body_tip) is not None:
            return None, T_goal
    tray = Body("tray", (Part(Box(sizes), pin.SE3.Identity()),), T)
    tips = [arms[side].arm.tip_frame for side in ("left", "right")]
    held = [
        Attachment("tray", tip, T_body_tip.inverse())
        for tip, T_body_tip in zip(tips, T_body_tips, strict=True)
    ]
    state = State.of(arms["left"], Scene.of([table, tray]), held)
    context, middle = context_of_both(arms, state), (limits.q_min + limits.q_max) / 2.0
    solutions = []
    for side, T_body_tip, q in zip(
        ("left", "right"), T_body_tips, np.split(middle, 2), strict=True
    ):
        found = sample_solutions(IKService(arms[side].arm), T * T_body_tip)
        solutions.append(found[np.argsort(np.abs(found - q).max(axis=1))][:20])
    for left, right in product(*solutions):
        q = np.concatenate([left, right])
        if context.is_free(q):
            joints = dict(zip(limits.names, q.tolist(), strict=True))
            return state.moved(arms["left"].robot, joints), T_goal
    return None, T_goal


def sampled_deviation(
    arms: Mapping[str, Manipulator], motion: Trajectory, seed: int
) -> tuple[float, float]:
    """Maximum deviation of the relative pose at 2,000 random instants, by Pinocchio: um and deg."""
    left, right = (arms[side].arm for side in ("left", "right"))
    times = np.append(0.0, np.random.default_rng(seed).uniform(0.0, motion.duration, 2000))
    T = [left.T_base_tip(q[:7]).actInv(right.T_base_tip(q[7:])) for q in motion.sample(times).q]
    errors = [T[0].actInv(each) for each in T]
    off_m = max(float(np.linalg.norm(each.translation)) for each in errors)
    off_rad = max(float(np.linalg.norm(pin.log3(each.rotation))) for each in errors)
    return 1e6 * off_m, float(np.degrees(off_rad))


if __name__ == "__main__":
    sys.exit(main())
