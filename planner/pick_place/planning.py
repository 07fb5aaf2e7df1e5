"""Pick and place as stages, planned into one checked `Plan`.

```
pick    open - approach - descend - close - retract
place   approach - descend - open - retract
```

The tip descends to a pose and retracts from it along straight lines, and moves freely only beyond
them, without a stop in between. By default the lines are vertical: it moves sideways only `clear_m`
above a pose and higher, and, at the knots of the motion between both poses, it is above the lower
of these two heights. It stops to grasp, to release, `hover_m` above the place, where the cycle
ends, and between the lines of a retreat that has several. Beyond the line that leads away from its
support, a carried body may touch nothing. Each move is proven free of collision at every instant
(`planner.collision.proof`). The motions of a cycle are one nonlinear program, and are
together as fast as limits and lines allow (`planner.motion`); where they collide, they are led
around obstacles, and where that fails, other pairs of IK solutions are tried, with a stop above
both and free moves in between, which keep no height (`planner.pick_place.cycle_search`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin.fields import evolve
from baxter_kin.validation import expect, expect_all
from planner.clearance import checked_margin_m
from planner.errors import ResponseError, SceneError, TaskError
from planner.manipulator import Manipulator
from planner.motion.joint_move import ROUNDING_RAD, checked_start
from planner.motion.paths.straight_line import (
    DEFAULT_TOLERANCE,
    LineTolerance,
    checked_line_tolerance,
)
from planner.motion.response import Response
from planner.motion.upright import Upright
from planner.pick_place.cycle_search import CycleSearch, leaning_failure
from planner.pick_place.plan_builder import NoSolutionError, PlanBuilder
from planner.pick_place.task import (
    UP,
    Line,
    Lines,
    PickAndPlace,
    PlanRequest,
    checked_height_m,
    checked_lines,
)
from planner.pick_place.tracking import planned_for
from planner.plan import Plan, PlanFailure
from planner.scene.bodies import Attachment, Scene
from planner.state import State

WIDER = (2.0, 4.0)
"""How many times wider cones are tried where no upright plan is found."""


def plan_pick_and_place(
    task: PickAndPlace,
    manipulator: Manipulator,
    scene: Scene | None = None,
    q_start: ArrayLike | None = None,
    *,
    state: State | None = None,
    margin_m: float = 0.0,
    held: Sequence[Attachment] = (),
    line_tolerance: LineTolerance = DEFAULT_TOLERANCE,
    response: Response | None = None,
    clip_start: bool = False,
) -> Plan:
    """Plan every step from `q_start` until the arm has retracted from the placed body.

    Args:
        task: what goes where.
        manipulator: the arm and its hand.
        scene: all bodies, the one to carry among them.
        q_start: initial configuration of the arm, shape (7,), rad.
        state: robot and bodies, such as `World.state`, in place of `scene`, `q_start`, `held` and
            the manipulator's `q_others`.
        margin_m: distance that is proven to be kept from everything at all times, except for
            intended contacts, the hand from what it grasps, and links up to two joints apart;
            not negative.
        held: what the other hand holds, as in `World.held`.
        line_tolerance: maximum deviation of the tip from its straight lines, by which `verify`
            judges the plan: 0.1 mm and 0.02 deg by default.
        response: how a real arm follows its set-points. The plan is the same as for any other arm,
            but it states the greatest speed, up to the response's, at which every path that the
            joints may take is proven to keep the margin (`prove_tracking`, `Plan.response`). The
            whole plan is sent at one speed.
        clip_start: whether a start up to 0.1 rad outside the limits is moved to them, with a
            warning in the log, instead of refused; a start outside by at most 1e-6 rad always is,
            without a warning.

    Returns:
        A plan; when a step has no solution, an invalid one that says which and why; likewise when
        the other hand holds the body, or no speed is found at which the plan is clear on an arm
        of that response.

    Raises:
        SceneError: when the body is not in the scene.
        TaskError: when the body cannot be moved, or an argument has the wrong type.
        ConfigurationError: when `q_start` is malformed or outside the limits.
        MotionError: when the margin is not a number, or negative, or `line_tolerance` is not a
            `LineTolerance`.
        ResponseError: when the response has the wrong type.
    """
    expect(task, PickAndPlace, "task", TaskError)
    if response is not None:
        expect(response, Response, "response", ResponseError)
    request = _requested(
        manipulator,
        scene,
        q_start,
        held,
        state,
        margin_m=margin_m,
        line_tolerance=line_tolerance,
        clip_start=clip_start,
    )
    if not request.scene[task.body].is_movable:
        raise TaskError(f"{task.body!r} is not movable, so it cannot be picked")
    for holding in request.held:
        if holding.body == task.body:
            reason = f"{task.body} is in the {holding.side} hand"
            return PlanBuilder(request).plan(PlanFailure("pick: close", reason, is_certain=True))
    plan = _planned(request, task)
    if response is None:
        return plan
    return planned_for(plan, response, request.manipulator, margin_m=request.margin_m)


def _planned(request: PlanRequest, task: PickAndPlace) -> Plan:
    """The plan of a checked task; without its upright axis where that need not be kept."""
    return searched(request, task)[0]


def searched(request: PlanRequest, task: PickAndPlace) -> tuple[Plan, CycleSearch]:
    """`plan_pick_and_place` for checked arguments, and the search that found the plan."""
    search = CycleSearch(request, task)
    plan, upright = search.shortest(), task.upright
    if upright is None or plan.failure is None:
        return plan, search
    is_other = plan.failure.is_certain and leaning_failure(request, task) is None
    if not upright.is_required and not is_other:
        search = CycleSearch(request, evolve(task, upright=None))
        return search.shortest(), search
    if plan.failure.is_certain:
        return plan, search
    failure = _with_wider_cone(request, task, upright, plan.failure)
    return evolve(plan, failure=failure), search


def _with_wider_cone(
    request: PlanRequest, task: PickAndPlace, upright: Upright, failure: PlanFailure
) -> PlanFailure:
    """The failure of a task that keeps a body upright, with a cone in which a plan is found."""
    none_found = f"none found at {math.degrees(upright.max_tilt_rad):g} deg"
    for times in WIDER:
        wide_rad = min(times * upright.max_tilt_rad, math.pi)
        wider = evolve(task, upright=Upright(upright.axis, wide_rad))
        if CycleSearch(request, wider).shortest().is_valid:
            none_found += f"; {math.degrees(wide_rad):g} deg would do"
            break
    return evolve(failure, reason=f"{none_found}: {failure.reason}")


def plan_start_move(
    manipulator: Manipulator,
    scene: Scene | None = None,
    q_now: ArrayLike | None = None,
    q_start: ArrayLike | None = None,
    *,
    state: State | None = None,
    margin_m: float = 0.0,
    held: Sequence[Attachment] = (),
    clip_start: bool = False,
) -> Plan:
    """Plan a move to the start of a task, around obstacles, and open the gripper.

    Args:
        manipulator: the arm and its hand, which is empty.
        scene: all bodies.
        q_now: current configuration of the arm, shape (7,), rad.
        q_start: its goal; every joint at zero when not given.
        state: robot and bodies, such as `World.state`, in place of `scene`, `q_now`, `held` and the
            manipulator's `q_others`.
        margin_m: distance that is proven to be kept from everything, except between links up to two
            joints apart; not negative.
        held: what the other hand holds, as in `World.held`.
        clip_start: whether a start up to 0.1 rad outside the limits is moved to them, with a
            warning in the log, instead of refused; a start outside by at most 1e-6 rad always is,
            without a warning.

    Returns:
        A plan; when none is found, an invalid one that says what blocks the way.

    Raises:
        ConfigurationError: when a configuration is malformed or outside the limits.
        MotionError: when the margin is not a number, or negative.
    """
    request = _requested(
        manipulator,
        scene,
        q_now,
        held,
        state,
        margin_m=margin_m,
        q_name="q_now",
        clip_start=clip_start,
    )
    manipulator = request.manipulator
    q_goal = np.zeros(7) if q_start is None else q_start
    goal = manipulator.arm.limits.check(q_goal, "q_start", ROUNDING_RAD)

    def add_steps(builder: PlanBuilder) -> None:
        context = manipulator.context(request.scene, margin_m=request.margin_m)
        builder.add_free_move("move to start", goal, context)
        builder.add_open("open", manipulator.hand.stroke_m)

    return _built(request, add_steps)


def plan_retract(
    manipulator: Manipulator,
    scene: Scene | None = None,
    q_now: ArrayLike | None = None,
    height_m: float = math.nan,
    *,
    state: State | None = None,
    margin_m: float = 0.0,
    held: Sequence[Attachment] = (),
    line_tolerance: LineTolerance = DEFAULT_TOLERANCE,
    clip_start: bool = False,
    retreat: Lines = (),
) -> Plan:
    """Open the fingers, and rise straight up from the current pose, or retreat along other lines.

    For example after a missed grasp: leave the missed body out of the scene, as its pose is
    unknown.

    Args:
        manipulator: the arm and its hand, which is empty.
        scene: all bodies that must not be touched.
        q_now: current configuration of the arm, shape (7,), rad.
        height_m: height of the rise, above zero; not given with `retreat`.
        state: robot and bodies, such as `World.state`, in place of `scene`, `q_now`, `held` and the
            manipulator's `q_others`.
        margin_m: distance that is proven to be kept from everything, except between links up to two
            joints apart; not negative.
        held: what the other hand holds, as in `World.held`.
        line_tolerance: maximum deviation of the tip from its straight lines, by which `verify`
            judges the plan: 0.1 mm and 0.02 deg by default.
        clip_start: whether a start up to 0.1 rad outside the limits is moved to them, with a
            warning in the log, instead of refused; a start outside by at most 1e-6 rad always is,
            without a warning.
        retreat: one line or several, in place of the rise.

    Returns:
        A plan; when the retreat is impossible, an invalid one that says why.

    Raises:
        ConfigurationError: when `q_now` is malformed or outside the limits.
        TaskError: when the height is not a number above zero, or is beyond `MAX_DISTANCE_M`, both
            it and `retreat` are given, or none of them, or that is not of type `Line`.
        MotionError: when the margin is not a number, or negative, or a tolerance has the wrong
            type.
    """
    request = _requested(
        manipulator,
        scene,
        q_now,
        held,
        state,
        margin_m=margin_m,
        line_tolerance=line_tolerance,
        q_name="q_now",
        clip_start=clip_start,
    )
    lines = checked_lines(retreat)
    if not lines:
        if isinstance(height_m, float) and math.isnan(height_m):
            raise TaskError("give height_m or retreat")
        lines = (Line(UP, checked_height_m(height_m, "height_m", TaskError)),)
    elif not math.isnan(height_m):
        raise TaskError("give either height_m or retreat=, not both")
    opening_m = request.manipulator.hand.stroke_m

    def add_steps(builder: PlanBuilder) -> None:
        builder.add_open("open", opening_m)
        context = request.manipulator.context(
            request.scene, finger_m=opening_m, margin_m=request.margin_m
        )
        builder.add_retreat("retract", lines, context)

    return _built(request, add_steps)


def _requested(
    manipulator: Manipulator,
    scene: Scene | None,
    q: Any,
    held: Sequence[Attachment],
    state: State | None,
    *,
    margin_m: float,
    line_tolerance: LineTolerance = DEFAULT_TOLERANCE,
    q_name: str = "q_start",
    clip_start: bool,
) -> PlanRequest:
    """Check the arguments that all planning functions share.

    A state stands for scene, configuration `q` and held bodies, and for the manipulator's
    `q_others`. `q_name` is the name of `q` in messages.
    """
    expect(manipulator, Manipulator, "manipulator", TaskError)
    attachments = expect_all(held, Attachment, "what the hands hold", TaskError)
    if state is not None:
        expect(state, State, "state", TaskError)
        if scene is not None or q is not None or attachments:
            raise TaskError("give state= alone, or the scene, the arm's position and `held`")
        others = manipulator.robot.configuration(dict(state.joints))
        manipulator = evolve(manipulator, q_others=others)
        scene, q = state.scene, state.q(manipulator.arm.joint_names)
        attachments = state.attachments
    elif scene is None and q is None:
        raise TaskError("give the scene and the arm's position, or state=")
    bodies = expect(scene, Scene, "scene", SceneError)
    checked_line_tolerance(line_tolerance)
    arm = manipulator.arm
    for holding in attachments:
        if holding.side == arm.side:
            raise TaskError(
                f"the {holding.side} hand holds {holding.body!r}; it must be empty at first: open "
                "it first"
            )
    q_start = checked_start(q, arm.limits, q_name, clip_start=clip_start)
    margin_m = checked_margin_m(margin_m)
    return PlanRequest(manipulator, bodies, q_start, margin_m, attachments, line_tolerance)


def _built(request: PlanRequest, add_steps: Callable[[PlanBuilder], None]) -> Plan:
    """The plan of some steps, up to the first one without a solution."""
    builder = PlanBuilder(request)
    try:
        add_steps(builder)
    except NoSolutionError as stop:
        return builder.plan(stop.failure)
    return builder.plan()
