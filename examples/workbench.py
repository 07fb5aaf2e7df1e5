"""What the examples share: Baxter at a table, blocks on it, and one task after the other.

Every task is planned, verified by other code, executed, and measured: how far from its place the
block ended. What cannot be done is noted with its reason, and the next task goes on.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from baxter_kin import Baxter, BaxterError, pose_from_quaternion
from baxter_kin.command_line import add_hands, add_urdf, hands_of
from baxter_kin.description import HandMount
from planner import (
    Manipulator,
    PickAndPlace,
    Plan,
    load_object,
    make_block,
    overhead_grasp,
    plan_pick_and_place,
    plan_start_move,
    verify,
)
from sim import Recorder, Simulation, World, save_recording, write_replay

TABLE_Z_M = -0.155
"""The table's top, in base."""

SIDES = ("left", "right")
CELLS_M = tuple((x, y) for x in (-0.065, 0.065) for y in (-0.13, 0.0, 0.13))
"""Where blocks are scattered, seen from the middle of them: one near each x and y."""
JITTER_M = 0.015
"""How far from there; so two blocks are at least 0.10 m apart, centre to centre."""
PLACED_WITHIN_M = 0.003
"""A block farther from its place is misplaced."""


@dataclass(frozen=True, slots=True)
class Task:
    """What came of one task; the columns of the table that is printed."""

    block: str
    arm: str
    motion_s: float
    planning_s: float
    off_m: float
    verdict: str
    is_done: bool

    def __str__(self) -> str:
        off = "-" if np.isnan(self.off_m) else f"{1e3 * self.off_m:.3f} mm"
        numbers = f"{self.motion_s:6.2f} s {self.planning_s:8.2f} s {off:>10}"
        return f"{self.block:8} {self.arm:6} {numbers}   {self.verdict}"


class Workbench:
    """Baxter at a table, both arms in neutral: beside the table, clear of it.

    Attributes:
        world: robot, table and blocks as they are now.
        simulation: executes plans in it.
        recorder: keeps all of it.
        tasks: what came of each task so far.
        motion_s: how long the arms have moved so far.
    """

    def __init__(
        self, urdf: Path | None = None, hands: Mapping[str, HandMount] | None = None
    ) -> None:
        """Robot and table, no blocks.

        Args:
            urdf: the robot's own description, if there is one.
            hands: what is on its flanges, by side; else as it is described.
        """
        self.robot = Baxter.load(urdf, hands=hands)
        self.world = World(self.robot)
        self.recorder = Recorder(self.robot)
        self.simulation = Simulation(self.world, [self.recorder])
        self.tasks: list[Task] = []
        self.motion_s = 0.0
        self._arms = {side: Manipulator.of(self.robot, side) for side in SIDES}
        table = pose_from_quaternion((1.0, 0.0, -0.93), (0.0, 0.0, 0.0, 1.0))
        self.simulation.spawn(load_object("table", table))

    def add_block(
        self, name: str, x_m: float, y_m: float, edge_m: float, colour: str, *, yaw_rad: float = 0.0
    ) -> None:
        """Put a cube on the table."""
        T_base_block = pin.SE3(
            pin.utils.rotate("z", yaw_rad), on_table(x_m, y_m, edge_m).translation
        )
        self.simulation.spawn(make_block(name, T_base_block, edge_m=edge_m, colour=colour))

    def arm(self, side: str) -> Manipulator:
        """An arm as planning needs it: the other one in the way where it stands now."""
        return replace(self._arms[side], q_others=self.world.q)

    def plan(self, side: str, block: str, T_base_goal: pin.SE3) -> Plan:
        """How an arm brings a block to a pose, grasped from above."""
        arm, body = self.arm(side), self.world.body(block)
        pick = overhead_grasp(arm.hand, body)
        place = T_base_goal * body.T_base_body.inverse() * pick
        task = PickAndPlace(block, pick, place)
        return plan_pick_and_place(
            task, arm, self.world.scene, self.world.arm_q(side), held=self.world.held
        )

    def carry(self, sides: Sequence[str], block: str, T_base_goal: pin.SE3) -> bool:
        """Bring a block to a pose with the arm that needs the least motion; whether it is there."""
        began = time.perf_counter()
        plans = [self.plan(side, block, T_base_goal) for side in sides]
        planning_s = time.perf_counter() - began
        plan = min(plans, key=lambda plan: (not plan.is_valid, plan.motion_time_s))
        if not plan.is_valid:
            reasons = "; ".join(f"{plan.limb} arm, {plan.failure}" for plan in plans)
            self.tasks.append(
                Task(block, "-", 0.0, planning_s, np.nan, f"refused: {reasons}", False)
            )
            return False
        verdict, is_done = self.execute(plan, f"{block}: {plan.limb} arm, ")
        off_m = self._off_m(block, T_base_goal)
        is_done &= off_m <= PLACED_WITHIN_M
        motion_s = plan.motion_time_s
        self.tasks.append(Task(block, plan.limb, motion_s, planning_s, off_m, verdict, is_done))
        return is_done

    def withdraw(self, side: str) -> bool:
        """Bring an empty arm back beside the table, out of the other's way; whether it is there."""
        arm = self.arm(side)
        q_now, q_rest = self.world.arm_q(side), arm.arm.neutral
        if np.array_equal(q_now, q_rest):
            return True
        plan = plan_start_move(arm, self.world.scene, q_now, q_rest, held=self.world.held)
        verdict, is_done = self.execute(plan, f"{side} arm goes back, ")
        if not is_done:
            self.tasks.append(Task("-", side, plan.motion_time_s, 0.0, np.nan, verdict, False))
        return is_done

    def execute(self, plan: Plan, title: str) -> tuple[str, bool]:
        """Verify a plan, then execute it; what came of it, and whether all went well."""
        certificate = verify(plan, description=self.robot.description)
        if not certificate.is_valid:
            return f"refused: {certificate.verdict}", False
        outcome = self.simulation.execute(plan, title)
        self.motion_s += plan.motion_time_s
        return outcome.failure or f"verified, {len(certificate.checks)} checks", outcome.is_success

    def _off_m(self, block: str, T_base_goal: pin.SE3) -> float:
        T_base_block = self.world.body(block).T_base_body
        return float(np.linalg.norm(T_base_block.translation - T_base_goal.translation))


def on_table(x_m: float, y_m: float, edge_m: float, *, above_m: float = 0.0) -> pin.SE3:
    """Where the centre of a cube on the table is, or of one so far above it; seen from base."""
    return pin.SE3(np.eye(3), np.array([x_m, y_m, TABLE_Z_M + above_m + edge_m / 2]))


def scattered(
    rng: np.random.Generator, count: int, middle_m: tuple[float, float]
) -> list[tuple[float, float, float]]:
    """Places for at most six blocks around a point of the table: x and y in base, m, yaw in rad."""
    cells = rng.permutation(CELLS_M)[:count] + middle_m
    cells += rng.uniform(-JITTER_M, JITTER_M, cells.shape)
    return [(x, y, rng.uniform(-np.pi / 4, np.pi / 4)) for x, y in cells.tolist()]


def play(
    argv: Sequence[str] | None,
    about: str,
    story: Callable[[Workbench, np.random.Generator], None],
    *,
    is_random: bool = False,
    hands: Mapping[str, HandMount] | None = None,
) -> int:
    """Run an example as a program; returns its exit status, 0 when every task was done.

    `hands` are those of the story, where the command line does not say others.
    """
    options = _options(argv, about, is_random=is_random)
    try:
        bench = Workbench(options.urdf, {**(hands or {}), **hands_of(options)})
        story(bench, np.random.default_rng(options.seed))
        bench.simulation.finish()
        _tell(bench)
        recording = bench.recorder.recording()
        if options.html is not None:
            write_replay(options.html, recording, bench.robot, title=about.splitlines()[0])
        if options.record is not None:
            save_recording(recording, options.record)
    except BaxterError as error:
        print(error, file=sys.stderr)
        return 1
    return 0 if all(task.is_done for task in bench.tasks) else 1


def _tell(bench: Workbench) -> None:
    print("block    arm      motion   planning      off by   outcome")
    print(*bench.tasks, sep="\n")
    print(f"{bench.motion_s:.2f} s of motion in {bench.simulation.time_s:.2f} s of simulated time")


def _options(argv: Sequence[str] | None, about: str, *, is_random: bool) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=about.splitlines()[0])
    add_urdf(parser)
    add_hands(parser)
    parser.add_argument("--html", type=Path, metavar="FILE", help="write a replay to open and send")
    parser.add_argument("--record", type=Path, metavar="FILE", help="write all that happens, .npz")
    parser.set_defaults(seed=0)
    if is_random:
        parser.add_argument("--seed", type=int, metavar="N", help="another arrangement (default 0)")
    return parser.parse_args(argv)
