"""The exercises of notebook 5: a tower, a plan for slow joints, and its file for a real Baxter."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from lessons.answers import Mistake, exercise, instance, shown, stock_robot
from planner import Move, Plan
from sim.recording.formats.rsdk_csv import read_csv
from sim.workbench.workbench import Workbench

TOWER = ("red", "green", "blue")
"""From the table up."""

BACK_BASE = (0.70, 0.27, -0.13)
"""Where the red block goes back to, its centre, m."""

RATIO = 0.25
"""Of a joint's velocity limit that may be used."""

NEAR_M = 0.003
"""How far a block may be off its place."""

READ_OFF = 0.02
"""A file's speeds are differences of its rows, so they may be off by so large a share."""


@exercise("build the tower on a Workbench, and set `answer` to that workbench")
def check_tower(answer: Any) -> str:
    """A tower of three blocks on a workbench: red, on it green, on it blue.

    Args:
        answer: a `Workbench` after its tasks.
    """
    bench = instance(answer, Workbench, "Workbench()")
    world = bench.world
    missing = [name for name in TOWER if name not in world.scene.bodies]
    if missing:
        raise Mistake(f"the workbench lacks a block named {missing[0]}: bench.add_block(...)")
    wanted = dict(zip(TOWER, ("table", *TOWER), strict=False))
    for name, support in wanted.items():
        stands_on = world.supports.get(name, ())
        if stands_on != (support,):
            refused = [str(task) for task in bench.tasks if not task.is_done]
            why = f"; {refused[-1]}" if refused else ""
            on = " and ".join(stands_on) or "nothing"
            raise Mistake(f"{name} stands on {on}, and it should stand on {support}{why}")
    return f"{', '.join(TOWER)}, from the table up, in {bench.motion_s:.1f} s of motion"


@exercise("set `answer` to the plan")
def check_way_back(answer: Any) -> str:
    """A plan that brings the red block back, with joints at a quarter of their speed.

    Args:
        answer: a `Plan` for the notebook's world as it is after its own plan.
    """
    plan = instance(answer, Plan, "plan_pick_and_place")
    if not plan.is_valid:
        raise Mistake(f"this plan is refused: {plan.failure}")
    goal = _goal(plan)
    if np.linalg.norm(goal - BACK_BASE) > NEAR_M:
        raise Mistake(
            f"in this plan red goes to {shown(goal)} m, not to {shown(BACK_BASE)} in base"
        )
    limits = stock_robot().arm(plan.limb).limits
    peak = max(move.trajectory.peak_ratios(limits).velocity for move in plan.moves)
    if peak > RATIO + 1e-6:
        raise Mistake(
            f"a joint goes up to {peak:.0%} of its velocity limit; make the planning hand by "
            f"Manipulator.of(robot, {plan.limb!r}, speed_ratio={RATIO})"
        )
    return f"{plan.motion_time_s:.1f} s of motion, no joint above {peak:.0%} of its velocity limit"


@exercise("set `answer` to the name of the file that you wrote")
def check_file(answer: Any) -> str:
    """The file of that plan, as Rethink's player takes it.

    Args:
        answer: the path of a CSV file.
    """
    if not isinstance(answer, (str, Path)):
        raise Mistake(f"this should be the name of a file, and is of class {type(answer).__name__}")
    if not Path(answer).is_file():
        raise Mistake(
            f"there is no file {str(answer)!r}; write_csv(plan, {str(answer)!r}) writes it"
        )
    if Path(answer).suffix == ".json":
        raise Mistake("that is a plan as save_plan writes it; Baxter's player reads CSV: write_csv")
    recording, _ = read_csv(Path(answer), stock_robot())
    speeds = {side: _ratio(recording, side) for side in ("left", "right")}
    side = max(speeds, key=lambda each: speeds[each])
    if speeds[side] > RATIO * (1.0 + READ_OFF):
        raise Mistake(
            f"in this file a joint of the {side} arm goes up to {speeds[side]:.0%} of its velocity "
            "limit; write the slow plan"
        )
    if speeds[side] == 0.0:
        raise Mistake("in this file nothing moves")
    return f"{recording.duration_s:.1f} s in {len(recording.times_s)} rows, slow enough for Baxter"


def _goal(plan: Plan) -> Any:
    """Where the plan brings the centre of the red block, m in base."""
    if "red" not in plan.start.scene.bodies:
        raise Mistake("the plan has no block named red; plan in world.scene")
    poses = {step.label: step.T_base_tip for step in plan if isinstance(step, Move)}
    pick, place = poses.get("pick: descend"), poses.get("place: descend")
    carried = {step.body for step in plan if not isinstance(step, Move)} - {None}
    if pick is None or place is None or carried != {"red"}:
        raise Mistake("asked for is one pick and one place of the red block")
    start = plan.start.scene["red"].centre_base
    if start[2] < BACK_BASE[2] + NEAR_M:
        raise Mistake("in this plan red stands on the table at first; plan in world.scene as it is")
    return place.act(pick.actInv(start))


def _ratio(recording: Any, side: str) -> float:
    """The largest share of a velocity limit that an arm uses in a recording."""
    motion = recording.motion(side)
    v = np.diff(motion.q, axis=0) / np.diff(motion.times_s)[:, None]
    return float((np.abs(v) / stock_robot().arm(side).limits.v_max).max())
