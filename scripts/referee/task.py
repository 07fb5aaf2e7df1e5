"""Whether a plan does what was asked, so that one that does nothing is not counted as right."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from referee.findings import Finding
from referee.motion import arm_joints
from referee.solids import Array
from referee.urdf import load_robot

REACHED = 1e-5
"""How far entries of a tip pose or joint angles may be from what was asked; m, rad."""


def task_faults(plan: Any, task: Any, q_goal: Array | None) -> Iterator[Finding]:
    """What is missing of a pick and place, or of a free move."""
    if task is None:
        q = _last(plan.steps, np.array(plan.q_start))
        off = float(np.abs(q - np.array(q_goal)).max())
        if off > REACHED:
            yield Finding("does not reach its goal", "the end", 0.0, plan.limb, "", off)
        return
    asked = (("close", task.T_base_pick), ("open", task.T_base_place))
    grips = [i for i, s in enumerate(plan.steps) if getattr(s, "body", None) == task.body]
    done = [str(plan.steps[i].action.value) for i in grips]
    if done != [action for action, _ in asked]:
        yield Finding("does not carry it", "the plan", 0.0, task.body, "", np.nan, f"but {done}")
        return
    for i, (action, pose) in zip(grips, asked, strict=True):
        q = _last(plan.steps[:i], np.array(plan.q_start))
        joints = {j.name: 0.0 for j in load_robot().joints if not j.is_fixed}
        joints |= dict(zip(arm_joints(plan.limb), q.tolist(), strict=True))
        tip = load_robot().poses(joints)[f"{plan.limb}_gripper"]
        off = float(np.abs(tip - pose.homogeneous).max())
        if off > REACHED:
            yield Finding("is not where it was asked to be", action, 0.0, "tip", "", off)


def _last(steps: Any, q: Array) -> Array:
    """Where the arm stands after some steps."""
    for step in steps:
        if hasattr(step, "trajectory"):
            q = np.array(step.trajectory.q)[-1]
    return q
