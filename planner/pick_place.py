"""Pick and place as stages, planned into one checked `Plan`.

```
pick    open - approach - descend - close - retract
place   approach - descend - open - retract
```

The tip comes down to a pose and rises from it along a straight line, and moves sideways only
`clear_m` above it and higher; there it does not stop, it passes. It stops to grasp, to release, and
`hover_m` above the place, where the cycle ends. While it is moved sideways, what is carried may
touch nothing, its supports included. Each move is proven free of collision at every instant
(`planner.swept`). Of all pairs of IK solutions at pick and place, the one is chosen that makes the
cycle shortest (`planner.choice`); when it collides, others are tried.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin.arrays import Vector, positive_scalar
from baxter_kin.errors import expect
from baxter_kin.frames import checked_pose
from planner.choice import Choice, choices
from planner.cycle import Cycle, Cycles, UnreachableLineError
from planner.draft import Draft, NoSolutionError
from planner.errors import MotionError, SceneError, TaskError
from planner.lines import Lines
from planner.manipulator import Manipulator
from planner.plan import GripperAction, Plan
from planner.scene import Scene
from planner.situation import Situation

COMPARED, MOST_TRIED = 3, 12
"""Pairs of IK solutions that are planned exactly to find the shortest cycle, and in all, where
these collide."""


@dataclass(frozen=True, slots=True, eq=False)
class PickAndPlace:
    """One pick and one place.

    Attributes:
        body: name of the body to carry.
        T_base_pick: tip pose when the fingers close.
        T_base_place: tip pose when they open again.
        hover_m: height above the place where the arm ends, above zero.
        clear_m: height above pick and place from which it may move sideways, above zero; the hover
            distance where that is less.

    Raises:
        TaskError: when `body` is no name, or a height is not a number above zero.
        PoseError: when a pose is none.
    """

    body: str
    T_base_pick: pin.SE3
    T_base_place: pin.SE3
    hover_m: float = 0.15
    clear_m: float = 0.05

    def __post_init__(self) -> None:
        """Check and copy."""
        expect(self.body, str, "name of the body", TaskError)
        positive_scalar(self.hover_m, "hover distance", TaskError)
        positive_scalar(self.clear_m, "clear height", TaskError)
        for name in ("T_base_pick", "T_base_place"):
            object.__setattr__(self, name, checked_pose(getattr(self, name)))

    @property
    def lines(self) -> Lines:
        """Where it leads the tip."""
        clear_m = min(self.clear_m, self.hover_m)
        return Lines(self.T_base_pick, self.T_base_place, clear_m, self.hover_m)


def plan_pick_and_place(
    task: PickAndPlace, manipulator: Manipulator, scene: Scene, q_start: ArrayLike
) -> Plan:
    """Every step from `q_start` until the arm has retracted from the placed body.

    Args:
        task: what goes where.
        manipulator: the arm and its hand.
        scene: all bodies, the one to carry among them.
        q_start: where the arm stands, shape (7,), rad.

    Returns:
        A plan; when a step has no solution, an invalid one that says which and why.

    Raises:
        SceneError: when the body is not in the scene.
        TaskError: when it cannot be moved.
        ConfigurationError: when `q_start` is malformed or outside the limits.
    """
    expect(task, PickAndPlace, "task", TaskError)
    expect(manipulator, Manipulator, "manipulator", TaskError)
    expect(scene, Scene, "scene", SceneError)
    if not scene[task.body].is_movable:
        raise TaskError(f"{task.body!r} is not movable, so it cannot be picked")
    now = manipulator.arm.limits.check(q_start, "q_start")
    looked = _drafted(manipulator, scene, now, lambda draft: _look(draft, task))
    return _shortest(task, manipulator, scene, now) if looked.is_valid else looked


def plan_start_move(
    manipulator: Manipulator,
    scene: Scene,
    q_now: ArrayLike,
    q_start: ArrayLike | None = None,
) -> Plan:
    """The way to where a task starts, then an open gripper.

    Args:
        manipulator: the arm and its hand, which is empty.
        scene: all bodies.
        q_now: where the arm stands, shape (7,), rad.
        q_start: where it shall stand; every joint at zero when not given.

    Returns:
        A plan; when the way collides, an invalid one that says with what.

    Raises:
        ConfigurationError: when a configuration is malformed or outside the limits.
    """
    expect(manipulator, Manipulator, "manipulator", TaskError)
    expect(scene, Scene, "scene", SceneError)
    goal = np.zeros(7) if q_start is None else q_start
    now = manipulator.arm.limits.check(q_now, "q_now")
    checked_goal = manipulator.arm.limits.check(goal, "q_start")

    def steps(draft: Draft) -> None:
        draft.move_joints("move to start", checked_goal)
        draft.grip("open", GripperAction.OPEN)

    return _drafted(manipulator, scene, now, steps)


def _drafted(
    manipulator: Manipulator, scene: Scene, q_start: Vector, steps: Callable[[Draft], None]
) -> Plan:
    """The plan of some steps, or of those before the first that has no solution."""
    draft, failure = Draft(manipulator, scene, q_start), None
    try:
        steps(draft)
    except NoSolutionError as stop:
        failure = stop.failure
    situation = Situation.of(manipulator, scene)
    return Plan(manipulator.arm.side, q_start, tuple(draft.steps), failure, situation)


def _look(draft: Draft, task: PickAndPlace) -> None:
    """Whether every waypoint can be reached at all; nothing moves."""
    lines = task.lines
    draft.reach("pick: approach", lines.T_base_above_pick)
    draft.reach("pick: descend", lines.T_base_pick)
    draft.reach("place: approach", lines.T_base_above_place)
    draft.reach("place: descend", lines.T_base_place)
    draft.reach("place: retract", lines.T_base_end)


def _shortest(task: PickAndPlace, manipulator: Manipulator, scene: Scene, q_start: Vector) -> Plan:
    """The plan of the shortest cycle that is free of collision, or the nearest miss."""
    failed: list[Plan] = []
    for cycle in _cycles(task, manipulator, q_start):
        steps = partial(_pick_and_place, task=task, cycle=cycle)
        plan = _drafted(manipulator, scene, q_start, steps)
        if plan.failure is None or plan.failure.is_certain:
            return plan
        failed.append(plan)
    return _nearest_miss(failed)


def _cycles(
    task: PickAndPlace, manipulator: Manipulator, q_start: Vector
) -> Iterator[Cycle | MotionError]:
    """Motions for choices of solutions; of the first few, the shortest first."""
    lines, cycles = task.lines, Cycles(manipulator, q_start, task.lines)
    pairs = choices(manipulator.ik, manipulator.limits, q_start, lines)
    compared = [_cycle(cycles, choice) for choice in islice(pairs, COMPARED)]
    yield from sorted(compared, key=_duration_s)
    for choice in islice(pairs, MOST_TRIED - COMPARED):
        yield _cycle(cycles, choice)


def _cycle(cycles: Cycles, choice: Choice) -> Cycle | MotionError:
    try:
        return cycles.of(choice)
    except MotionError as cause:
        return cause


def _duration_s(cycle: Cycle | MotionError) -> float:
    return cycle.duration_s if isinstance(cycle, Cycle) else np.inf


def _nearest_miss(failed: list[Plan]) -> Plan:
    """The plan that got farthest, with what came of the others."""
    best = max(failed, key=lambda plan: len(plan.steps))
    failures = tuple(plan.failure for plan in failed if plan.failure is not None)
    if best.failure is None or len(failures) < 2:
        return best
    stages = Counter(failure.stage for failure in failures)
    counts = ", ".join(f"{count} at {stage!r}" for stage, count in stages.most_common())
    reason = (
        f"{best.failure.reason} (the nearest miss of {len(failures)} pairs of IK solutions: "
        f"{counts})"
    )
    failure = replace(best.failure, reason=reason, tried=failures)
    return replace(best, failure=failure)


def _pick_and_place(draft: Draft, task: PickAndPlace, cycle: Cycle | MotionError) -> None:
    if isinstance(cycle, MotionError):
        stage = cycle.stage if isinstance(cycle, UnreachableLineError) else "pick: approach"
        raise NoSolutionError(stage, str(cycle)) from cycle
    lines, body = task.lines, draft.body(task.body)
    draft.refuse_wide("pick: open", task.T_base_pick, body)
    draft.grip("pick: open", GripperAction.OPEN)
    draft.pass_by("pick: approach", cycle.to_pick, lines.T_base_above_pick)
    draft.descend("pick: descend", cycle.down_to_pick, lines.T_base_pick)
    draft.grasp("pick: close", body, lines.T_base_pick, lines.T_base_place)
    draft.rise("pick: retract", cycle.up_from_pick, lines.T_base_above_pick)
    draft.pass_by("place: approach", cycle.to_place, lines.T_base_above_place)
    draft.descend("place: descend", cycle.down_to_place, lines.T_base_place)
    draft.release("place: open", lines.T_base_place)
    draft.rise("place: retract", cycle.up_from_place, lines.T_base_end)
