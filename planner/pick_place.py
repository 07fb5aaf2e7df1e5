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

from baxter_kin import IKResult, SeedType
from baxter_kin.arrays import Vector, positive_scalar
from baxter_kin.errors import expect
from baxter_kin.frames import checked_pose
from baxter_kin.ik import Tolerance
from planner.choice import Choice, choices
from planner.collision import ClearanceChecker, Held
from planner.contact import stands, touching
from planner.cycle import Cycle, Cycles, UnreachableLineError
from planner.errors import MotionError, SceneError, TaskError
from planner.hand import Grasp
from planner.lines import Lines
from planner.manipulator import Manipulator
from planner.plan import Grip, GripperAction, Move, Plan, PlanFailure, Step
from planner.scene import Body, Scene
from planner.situation import Situation
from planner.swept import prove_clear
from planner.swept_result import SweptContact, SweptProof
from planner.timing import plan_joint_move
from planner.trajectory import Trajectory

COMPARED, MOST_TRIED = 3, 12
"""Pairs of IK solutions that are planned exactly to find the shortest cycle, and in all, where
these collide."""

LONGEST_DROP_M = 0.01
"""From how high above its support a body may be let go."""


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

    def steps(draft: _Draft) -> None:
        draft.move_joints("move to start", checked_goal)
        draft.grip("open", GripperAction.OPEN)

    return _drafted(manipulator, scene, now, steps)


def _drafted(
    manipulator: Manipulator, scene: Scene, q_start: Vector, steps: Callable[[_Draft], None]
) -> Plan:
    """The plan of some steps, or of those before the first that has no solution."""
    draft, failure = _Draft(manipulator, scene, q_start), None
    try:
        steps(draft)
    except _NoSolutionError as stop:
        failure = stop.failure
    situation = Situation.of(manipulator, scene)
    return Plan(manipulator.arm.side, q_start, tuple(draft.steps), failure, situation)


def _look(draft: _Draft, task: PickAndPlace) -> None:
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


def _pick_and_place(draft: _Draft, task: PickAndPlace, cycle: Cycle | MotionError) -> None:
    if isinstance(cycle, MotionError):
        stage = cycle.stage if isinstance(cycle, UnreachableLineError) else "pick: approach"
        raise _NoSolutionError(stage, str(cycle)) from cycle
    lines, body = task.lines, draft.body(task.body)
    draft.refuse_wide("pick: open", task.T_base_pick, body)
    draft.grip("pick: open", GripperAction.OPEN)
    draft.pass_by("pick: approach", cycle.to_pick, lines.T_base_above_pick)
    draft.descend("pick: descend", cycle.down_to_pick, lines.T_base_pick)
    draft.grasp("pick: close", task, body)
    draft.rise("pick: retract", cycle.up_from_pick, lines.T_base_above_pick)
    draft.pass_by("place: approach", cycle.to_place, lines.T_base_above_place)
    draft.descend("place: descend", cycle.down_to_place, lines.T_base_place)
    draft.release("place: open", lines.T_base_place)
    draft.rise("place: retract", cycle.up_from_place, lines.T_base_end)


class _NoSolutionError(Exception):
    """Ends the drafting of a plan; becomes `Plan.failure`."""

    def __init__(
        self, stage: str, reason: str, ik: IKResult | None = None, *, is_certain: bool = False
    ) -> None:
        self.failure = PlanFailure(stage, reason, ik, is_certain=is_certain)
        super().__init__(str(self.failure))


class _Draft:
    """A plan while it is being made: the steps so far, and the situation after them."""

    def __init__(self, manipulator: Manipulator, scene: Scene, q_start: Vector) -> None:
        self.steps: list[Step] = []
        self._manipulator = manipulator
        self._q = q_start
        self._scene = scene
        self._finger_m = manipulator.hand.stroke_m
        self._held: Held | None = None
        self._touchable: str | None = None
        self._checkers: dict[bool, ClearanceChecker] = {}

    def refuse_wide(self, stage: str, T_base_tip: pin.SE3, body: Body) -> None:
        """Stop here when the hand cannot open wide enough for the body."""
        hand = self._manipulator.hand
        width = hand.width_across_m(T_base_tip, body)
        if width > hand.open_gap_m:
            raise _NoSolutionError(
                stage,
                f"{body.name} measures {1e3 * _least_width_m(body):.1f} mm, "
                f"{1e3 * width:.1f} mm across the hand as it lies, but the {hand.side} hand opens "
                f"only {1e3 * hand.open_gap_m:.1f} mm",
                is_certain=True,
            )
        self._touchable = body.name
        self._checkers.clear()

    def grip(self, label: str, action: GripperAction, body: str | None = None) -> None:
        """Add a gripper action."""
        self.steps.append(Grip(label, action, body))

    def body(self, name: str) -> Body:
        """A body as it stands at this point."""
        return self._scene[name]

    def reach(self, label: str, T_base_tip: pin.SE3) -> IKResult:
        """The IK result for a pose, from where the arm stands; it is there afterwards."""
        ik = self._manipulator.ik.solve(T_base_tip, current=self._q)
        if not ik.is_valid:
            raise _NoSolutionError(label, str(ik.failure), ik, is_certain=True)
        self._q = ik.q
        return ik

    def pass_by(self, label: str, trajectory: Trajectory, T_base_tip: pin.SE3) -> None:
        """Add a move in joint space to where a line begins; nothing held may touch anything."""
        ik = self._answer(trajectory, T_base_tip, SeedType.CURRENT)
        self._move(label, trajectory, T_base_tip, ik, free=True)

    def descend(self, label: str, trajectory: Trajectory, T_base_tip: pin.SE3) -> None:
        """Add a straight move to a chosen solution."""
        ik = self._answer(trajectory, T_base_tip, SeedType.NS_MAP)
        self._move(label, trajectory, T_base_tip, ik, straight=True)

    def rise(self, label: str, trajectory: Trajectory, T_base_tip: pin.SE3) -> None:
        """Add a straight move away from a pose."""
        ik = self._answer(trajectory, T_base_tip, SeedType.CURRENT)
        self._move(label, trajectory, T_base_tip, ik, straight=True)

    def move_joints(self, label: str, q_goal: Vector) -> None:
        """Add the move to a configuration."""
        try:
            trajectory = plan_joint_move(self._q, q_goal, self._manipulator.limits)
        except MotionError as cause:
            raise _NoSolutionError(label, str(cause)) from cause
        self._move(label, trajectory)

    def _answer(self, trajectory: Trajectory, T_base_tip: pin.SE3, seed_type: SeedType) -> IKResult:
        """Where a trajectory ends, as the answer for a pose: a sample, or what follows from one."""
        arm, q = self._manipulator.arm, trajectory.q_goal
        errors = Tolerance().excess(T_base_tip, arm.T_base_tip(q))
        return IKResult(arm.joint_names, q, seed_type, *errors)

    def _move(
        self,
        label: str,
        trajectory: Trajectory,
        T_base_tip: pin.SE3 | None = None,
        ik: IKResult | None = None,
        *,
        straight: bool = False,
        free: bool = False,
    ) -> None:
        proof = self._proven(label, trajectory, free=free)
        self.steps.append(
            Move(label, trajectory, T_base_tip, ik, proof.nearest, proof, is_straight=straight)
        )
        self._q = trajectory.q_goal

    def grasp(self, label: str, task: PickAndPlace, body: Body) -> None:
        """Add the closing of the fingers around the body."""
        T_base_tip, T_base_place = task.T_base_pick, task.T_base_place
        grasp = self._manipulator.hand.grasp(T_base_tip, body, self._finger_m)
        if grasp is None:
            raise _NoSolutionError(label, _miss(T_base_tip, body), is_certain=True)
        self.grip(label, GripperAction.CLOSE, body.name)
        self._hold(body, grasp, T_base_place)

    def release(self, label: str, T_base_tip: pin.SE3) -> None:
        """Add the opening of the fingers, which leaves the body where it is."""
        if self._held is None:
            raise TaskError("nothing is held, so nothing can be released")
        body = self._held.body.at(T_base_tip * self._held.T_tip_body)
        if not stands(body, self._scene, LONGEST_DROP_M):
            raise _NoSolutionError(
                label,
                f"{body.name} would fall: nothing is within {1e3 * LONGEST_DROP_M:.0f} mm below it",
                is_certain=True,
            )
        self.grip(label, GripperAction.OPEN, body.name)
        self._scene, self._touchable = self._scene.with_body(body), body.name
        self._held = None
        self._checkers.clear()
        self._finger_m = self._manipulator.hand.stroke_m

    def _hold(self, body: Body, grasp: Grasp, T_base_place: pin.SE3) -> None:
        self._scene, self._touchable = self._scene.without(body.name), None
        placed = body.at(T_base_place * grasp.T_tip_body)
        supports = touching(body, self._scene) | touching(placed, self._scene)
        self._held = Held(body, grasp.T_tip_body, supports)
        self._checkers.clear()
        self._finger_m = grasp.finger_m

    def _proven(self, label: str, trajectory: Trajectory, *, free: bool) -> SweptProof:
        others = next(self._manipulator.configurations(trajectory.q[:1], self._finger_m))
        result = prove_clear(self._checker(free=free), trajectory, others)
        if isinstance(result, SweptContact):
            raise _NoSolutionError(label, str(result))
        return result

    def _checker(self, *, free: bool) -> ClearanceChecker:
        """The present situation; with what is held free of its supports, or on them."""
        if free not in self._checkers:
            held = self._held
            if held is not None and free:
                held = replace(held, supports=frozenset())
            self._checkers[free] = ClearanceChecker(
                self._manipulator.shapes,
                self._manipulator.arm,
                self._scene,
                touchable=self._touchable,
                held=held,
            )
        return self._checkers[free]


def _miss(T_base_tip: pin.SE3, body: Body) -> str:
    offset = T_base_tip.actInv(body.centre_base)
    across = 1e3 * float(np.hypot(offset[0], offset[1]))
    return (
        f"the fingers would close on nothing: {body.name} is {across:.0f} mm beside the tip and "
        f"{1e3 * offset[2]:.0f} mm ahead of it"
    )


def _least_width_m(body: Body) -> float:
    """The narrowest of the body's three extents along its own axes."""
    spans = [body.extent_m(axis) for axis in body.T_base_body.rotation.T]
    return min(high - low for low, high in spans)
