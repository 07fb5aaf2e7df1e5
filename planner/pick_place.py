"""Pick and place as stages, planned into one checked `Plan`.

```
pick    open - approach - descend - close - retract
place   approach - descend - open - retract
```

The tip comes down to a pose and rises from it along a straight line, and moves sideways only
`clear_m` above it and higher; there it does not stop, it passes. On the way between both it is, at
the knots of the motion, above the lower of these two heights. It stops to grasp, to release, and
`hover_m` above the place, where the cycle ends. While it is moved sideways, what is carried may
touch nothing, its supports included. Each move is proven free of collision at every instant
(`planner.swept`). The motions of a cycle are one nonlinear program, and as fast together as the
limits and lines allow (`planner.motion`); where they collide, they are led around what is there,
and where that fails, other pairs of IK solutions at pick and place are tried, with a stop above
both and free moves in between, which keep no height (`planner.cycle_search`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin.arrays import Vector
from baxter_kin.display import OneLine, phrase, position
from baxter_kin.errors import expect
from baxter_kin.frames import checked_pose
from planner.context import CollisionContext
from planner.cycle_search import CycleSearch
from planner.errors import SceneError, TaskError, expect_all
from planner.lines import Lines, checked_height_m
from planner.manipulator import Manipulator
from planner.plan import Plan
from planner.plan_builder import NoSolutionError, PlanBuilder
from planner.scene import Scene
from planner.situation import Holding
from planner.straight_line import LineTolerance, checked_tolerance
from planner.swept import checked_margin_m


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PickAndPlace(OneLine):
    """One pick and one place.

    Attributes:
        body: name of the body to carry.
        T_base_pick: tip pose when the fingers close.
        T_base_place: tip pose when they open again.
        hover_m: height above the place where the arm ends, above zero.
        clear_m: height above pick and place from which it may move sideways, above zero; the hover
            distance where that is less.

    Raises:
        TaskError: when `body` is no name, or a height is not a number above zero, or beyond
            `FARTHEST_M`.
        PoseError: when a pose is none.
    """

    body: str
    T_base_pick: pin.SE3
    T_base_place: pin.SE3
    hover_m: float = 0.15
    clear_m: float = 0.05

    def __post_init__(self) -> None:
        expect(self.body, str, "name of the body", TaskError)
        checked_height_m(self.hover_m, "hover distance", TaskError)
        checked_height_m(self.clear_m, "clear height", TaskError)
        for name in ("T_base_pick", "T_base_place"):
            object.__setattr__(self, name, checked_pose(getattr(self, name)))

    @property
    def lines(self) -> Lines:
        """Where it leads the tip."""
        clear_m = min(self.clear_m, self.hover_m)
        return Lines(self.T_base_pick, self.T_base_place, clear_m, self.hover_m)

    def _facts(self) -> tuple[str, ...]:
        way = f"from {position(self.T_base_pick)} to {position(self.T_base_place)}"
        return phrase(self.body), way, f"hover {self.hover_m:g} m"


def plan_pick_and_place(
    task: PickAndPlace,
    manipulator: Manipulator,
    scene: Scene,
    q_start: ArrayLike,
    *,
    margin_m: float = 0.0,
    held: Sequence[Holding] = (),
    line_tolerance: LineTolerance | None = None,
) -> Plan:
    """Every step from `q_start` until the arm has retracted from the placed body.

    Args:
        task: what goes where.
        manipulator: the arm and its hand.
        scene: all bodies, the one to carry among them.
        q_start: where the arm stands, shape (7,), rad.
        margin_m: distance that is proven to be kept from everything at all times, contacts on
            purpose left out, the hand from what it grasps, and links up to two joints apart; not
            negative.
        held: what the other hand holds, as `World.held` says.
        line_tolerance: how far the tip may be off its straight lines, for which `verify` judges the
            plan by it; 0.1 mm and 0.02 deg when not given.

    Returns:
        A plan; when a step has no solution, an invalid one that says which and why.

    Raises:
        SceneError: when the body is not in the scene.
        TaskError: when it cannot be moved.
        ConfigurationError: when `q_start` is malformed or outside the limits.
        MotionError: when the margin is not a number, or negative.
    """
    expect(task, PickAndPlace, "task", TaskError)
    expect(manipulator, Manipulator, "manipulator", TaskError)
    expect(scene, Scene, "scene", SceneError)
    if not scene[task.body].is_movable:
        raise TaskError(f"{task.body!r} is not movable, so it cannot be picked")
    now = manipulator.arm.limits.check(q_start, "q_start")
    margin_m = checked_margin_m(margin_m)
    search = CycleSearch(
        task.body,
        task.lines,
        manipulator,
        scene,
        now,
        margin_m=margin_m,
        held=_of_others(held, manipulator),
        line_tolerance=checked_tolerance(line_tolerance),
    )
    return search.shortest()


def plan_start_move(
    manipulator: Manipulator,
    scene: Scene,
    q_now: ArrayLike,
    q_start: ArrayLike | None = None,
    *,
    margin_m: float = 0.0,
    held: Sequence[Holding] = (),
) -> Plan:
    """The way to where a task starts, around what is in the way, then an open gripper.

    Args:
        manipulator: the arm and its hand, which is empty.
        scene: all bodies.
        q_now: where the arm stands, shape (7,), rad.
        q_start: where it shall stand; every joint at zero when not given.
        margin_m: distance that is proven to be kept from everything, links up to two joints apart
            left out; not negative.
        held: what the other hand holds, as `World.held` says.

    Returns:
        A plan; when there is no way, an invalid one that says what is in it.

    Raises:
        ConfigurationError: when a configuration is malformed or outside the limits.
        MotionError: when the margin is not a number, or negative.
    """
    expect(manipulator, Manipulator, "manipulator", TaskError)
    expect(scene, Scene, "scene", SceneError)
    goal = np.zeros(7) if q_start is None else q_start
    now = manipulator.arm.limits.check(q_now, "q_now")
    checked_goal = manipulator.arm.limits.check(goal, "q_start")
    builder = _builder(manipulator, scene, now, margin_m, held)
    around = CollisionContext.of(manipulator, scene, margin_m=margin_m)

    def steps() -> None:
        builder.add_free_move("move to start", checked_goal, around)
        builder.add_open("open", manipulator.hand.stroke_m)

    return _built(builder, steps)


def plan_retract(
    manipulator: Manipulator,
    scene: Scene,
    q_now: ArrayLike,
    height_m: float,
    *,
    margin_m: float = 0.0,
    held: Sequence[Holding] = (),
    line_tolerance: LineTolerance | None = None,
) -> Plan:
    """Open the fingers, and rise straight up from where the arm stands.

    After a miss, say: leave the body that was missed out of the scene, as nobody knows where it is.

    Args:
        manipulator: the arm and its hand, which is empty.
        scene: all bodies that must not be touched.
        q_now: where the arm stands, shape (7,), rad.
        height_m: how far to rise, above zero.
        margin_m: distance that is proven to be kept from everything, links up to two joints apart
            left out; not negative.
        held: what the other hand holds, as `World.held` says.
        line_tolerance: how far the tip may be off its straight lines, for which `verify` judges the
            plan by it; 0.1 mm and 0.02 deg when not given.

    Returns:
        A plan; when there is no way up, an invalid one that says why.

    Raises:
        ConfigurationError: when `q_now` is malformed or outside the limits.
        TaskError: when the height is not a number above zero, or is beyond `FARTHEST_M`.
        MotionError: when the margin is not a number, or negative, or a tolerance is none.
    """
    expect(manipulator, Manipulator, "manipulator", TaskError)
    expect(scene, Scene, "scene", SceneError)
    now = manipulator.arm.limits.check(q_now, "q_now")
    rise_m = checked_height_m(height_m, "height_m", TaskError)
    builder = _builder(manipulator, scene, now, margin_m, held, line_tolerance=line_tolerance)
    opening_m = manipulator.hand.stroke_m

    def steps() -> None:
        builder.add_open("open", opening_m)
        around = CollisionContext.of(manipulator, scene, finger_m=opening_m, margin_m=margin_m)
        builder.add_rise("retract", rise_m, around)

    return _built(builder, steps)


def _builder(
    manipulator: Manipulator,
    scene: Scene,
    q_now: Vector,
    margin_m: float,
    held: Sequence[Holding],
    *,
    line_tolerance: LineTolerance | None = None,
) -> PlanBuilder:
    return PlanBuilder(
        manipulator,
        scene,
        q_now,
        margin_m=checked_margin_m(margin_m),
        held=_of_others(held, manipulator),
        line_tolerance=line_tolerance,
    )


def _of_others(held: Sequence[Holding], manipulator: Manipulator) -> tuple[Holding, ...]:
    """What hands hold, if the hand that plans is empty.

    Raises:
        TaskError: when it is not.
    """
    checked = expect_all(held, Holding, "what the hands hold", TaskError)
    for holding in checked:
        if holding.side == manipulator.arm.side:
            raise TaskError(
                f"the {holding.side} hand holds {holding.body!r}; it must be empty to begin with: "
                "open it first"
            )
    return checked


def _built(builder: PlanBuilder, steps: Callable[[], None]) -> Plan:
    """The plan of some steps, or of those before the first that has no solution."""
    try:
        steps()
    except NoSolutionError as stop:
        return builder.plan(stop.failure)
    return builder.plan()
