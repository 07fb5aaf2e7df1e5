"""Workbench: Baxter at a table, and tasks of one line.

```python
bench = Workbench()
bench.add_block("red", 0.70, 0.15)
print(bench.carry("red", to=(0.75, 0.0)))
bench.replay()
```

Each task is planned, verified by other code, executed, and measured: how far from its place the
block ended.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from baxter_kin import Baxter
from baxter_kin.display import OneLine, count, listing, phrase, quoted
from baxter_kin.fields import evolve, field, frozen
from baxter_kin.frames import PoseLike, checked_pose
from baxter_kin.ik.reach.bound import ReachBound
from baxter_kin.kinematics.arm import LIMBS, other_than
from baxter_kin.kinematics.robot import given_or_stock
from baxter_kin.validation import expect, expect_all, finite_scalar, positive_scalar
from planner import (
    Body,
    Cylinder,
    Grip,
    Handover,
    LineTolerance,
    Manipulator,
    Part,
    PickAndPlace,
    Plan,
    TwoArmPlan,
    Upright,
    make_block,
    overhead_grasp,
    plan_handover,
    plan_pick_and_place,
    plan_start_move,
    plan_together,
    tilt_of,
    verify,
    verify_both,
)
from planner.errors import MotionError, SceneError
from planner.motion.upright import DEFAULT_TILT_RAD
from planner.scene.contact import depth_m
from planner.scene.objects import resolve_colour
from planner.scene.support import lifted_out
from sim.errors import SimulationError
from sim.events import Observer
from sim.recording.recorder import Recorder
from sim.recording.recording import Recording
from sim.simulation import Simulation, Strokes
from sim.view.replay import Replay
from sim.workbench import tabletop
from sim.workbench.drawing import (
    PEN_M,
    TOLERANCE,
    Drawing,
    Stroke,
    plan_drawing,
    points_of,
    strokes_of,
)
from sim.world.world import World

_LOG = logging.getLogger(__name__)

EDGE_M = 0.05
"""Default edge of a block: what the hands hold best."""

PLACED_WITHIN_M = 0.003
"""Maximum distance of a placed block from its goal."""

MIN_UPRIGHT_DEG = 0.06
"""Minimum of `upright_deg`, just above that of `Upright.max_tilt_rad`."""


@frozen(error=SimulationError, eq=True)
class TaskResult:
    """The result of one task, readable as a sentence.

    Attributes:
        task: the task, such as "carry red".
        block: name of its block; empty for an arm alone.
        arm: "left" or "right"; empty when no arm could.
        motion_s: planned duration of the arm's moves.
        planning_s: wall time of planning.
        off_m: distance of the block from its goal at the end, m; None when it was not carried.
        verdict: how it ended: what was verified, or why it was refused or failed.
        is_done: whether everything is as requested.
        plan: the plan that was executed, or the best of those refused; None without any.
    """

    task: str
    block: str
    arm: str
    motion_s: float
    planning_s: float
    off_m: float | None
    verdict: str
    is_done: bool
    plan: Plan | None = field(default=None, eq=False)

    @classmethod
    def refused(
        cls, block: str, reason: str, planning_s: float = 0.0, plan: Plan | None = None
    ) -> TaskResult:
        """The result for a block that is not carried."""
        task, verdict = f"carry {block}", f"refused: {reason}"
        return cls(task, block, "", 0.0, planning_s, None, verdict, False, plan)

    def __str__(self) -> str:
        if not self.is_done:
            return f"{self.task}: {self.verdict}"
        off = "" if self.off_m is None else f", {1e3 * self.off_m:.3f} mm off its place"
        return (
            f"{self.task}: done by the {self.arm} arm in {self.motion_s:.2f} s of motion{off} "
            f"({self.verdict})"
        )

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:  # noqa: ARG002 - IPython's
        """The whole sentence where a notebook shows it, however long."""
        printer.text(str(self))

    def _facts(self) -> tuple[str, ...]:
        return (phrase(self),)


class Workbench(OneLine):
    """Baxter at a table, both arms in neutral: beside the table, clear of it.

    Attributes:
        robot: the robot.
        world: robot, table and blocks as they are now.
        simulation: executes plans in it.
        recorder: records all of it.
        tasks: the results of all blocks to be carried, and of arms that could not withdraw.
        motion_s: total duration of the arms' moves so far.
    """

    def __init__(self, robot: Baxter | None = None, observers: Iterable[Observer] = ()) -> None:
        """Start with robot and table, without blocks.

        Args:
            robot: the robot; `Baxter.load()` when not given.
            observers: are notified of what happens, such as a `Viewer` of the same robot.

        Raises:
            SimulationError: when an argument has the wrong type.
        """
        self.robot = given_or_stock(robot, SimulationError)
        watching = expect_all(observers, Observer, "the observers", SimulationError)
        self.world = World(self.robot)
        self.recorder = Recorder(self.robot)
        self.simulation = Simulation(self.world, [self.recorder, *watching])
        self.tasks: list[TaskResult] = []
        self.motion_s = 0.0
        self._arms = {side: Manipulator.of(self.robot, side) for side in self.world.hands}
        self.simulation.spawn(tabletop.table())

    def add_block(
        self,
        name: str,
        x_m: float,
        y_m: float,
        *,
        edge_m: float = EDGE_M,
        colour: str | None = None,
        yaw_rad: float = 0.0,
    ) -> None:
        """Put a cube on the table.

        Args:
            name: its name, such as "red".
            x_m: x of its middle in base.
            y_m: y of its middle.
            edge_m: its edge.
            colour: such as "red"; the colour of its name when not given, or grey.
            yaw_rad: its angle about the vertical.

        Raises:
            SceneError: when an argument is invalid, the name is taken, or there is no space for it:
                beside the table, or where something stands.
        """
        edge = positive_scalar(edge_m, "edge_m", SceneError)
        self._put(name, (x_m, y_m, yaw_rad), (edge, edge, edge), colour, is_movable=True)

    def add_box(
        self,
        name: str,
        x_m: float,
        y_m: float,
        *,
        size_m: Sequence[float],
        colour: str | None = None,
        yaw_rad: float = 0.0,
    ) -> None:
        """Put a cuboid on the table that can be carried, as a block can.

        Args:
            name: its name, such as "book".
            x_m: x of its middle in base.
            y_m: y of its middle.
            size_m: its edges along x, y and z, before it is turned.
            colour: such as "red"; the colour of its name when not given, or grey.
            yaw_rad: its angle about the vertical.

        Raises:
            SceneError: as for a block.
        """
        size = tabletop.checked_size(size_m)
        self._put(name, (x_m, y_m, yaw_rad), size, colour, is_movable=True)

    def add_cylinder(
        self,
        name: str,
        x_m: float,
        y_m: float,
        *,
        radius_m: float,
        length_m: float,
        colour: str | None = None,
    ) -> None:
        """Put an upright cylinder on the table that can be carried, such as a tin.

        Args:
            name: its name, such as "tin".
            x_m: x of its axis in base.
            y_m: y of its axis.
            radius_m: its radius.
            length_m: its height.
            colour: such as "red"; the colour of its name when not given, or grey.

        Raises:
            SceneError: as for a block.
        """
        shape = Cylinder(radius_m, length_m)
        part = Part(shape, pin.SE3.Identity(), resolve_colour(colour, name))
        place = tabletop.turned_on_table(x_m, y_m, 0.0, height_m=length_m)
        self._add(Body(name, (part,), place, is_movable=True))

    def add_body(self, body: Body) -> None:
        """Put a body of any shape where its `T_base_body` is, on the table or elsewhere.

        A movable one comes to rest on what is below it, and can be carried; any other stays where
        it is, even in the air, and arms go around it.

        Args:
            body: one or several shapes, such as a mug or a shelf.
        """
        self._spawn(expect(body, Body, "body", SceneError))

    def add_obstacle(
        self,
        name: str,
        x_m: float,
        y_m: float,
        *,
        size_m: Sequence[float],
        colour: str | None = None,
        yaw_rad: float = 0.0,
    ) -> None:
        """Put a box on the table that stays there, such as a wall; arms go around it.

        The arguments are those of `add_box`.
        """
        size = tabletop.checked_size(size_m)
        self._put(name, (x_m, y_m, yaw_rad), size, colour, is_movable=False)

    def carry(
        self,
        block: str,
        *,
        to: tuple[float, float] | PoseLike | None = None,
        onto: str | None = None,
        arm: str | None = None,
        upright_deg: float | None = None,
    ) -> TaskResult:
        """Bring a block somewhere, grasped from above.

        Where only the other arm is in the way, and its hand is empty, it withdraws first, as by
        `withdraw`. Where it is proven that no arm reaches both the block and the place, one hand
        gives it to the other in the air, unless `arm` or `upright_deg` is given. The verdict of the
        result says so.

        On its way the block leans by at most 10 deg from how it stands, if a plan is found; if not,
        the verdict says by how much it leans.

        Args:
            block: its name.
            to: the place: x and y in base, m, on the table, straight; or its pose seen from base.
            onto: instead of `to`, the name of a block whose middle it is to stand on.
            arm: "left" or "right"; when not given, the one that needs the least motion.
            upright_deg: by how much the block may lean; where no plan is found, it is not carried.

        Returns:
            The result; where it cannot be done, with the reason.

        Raises:
            SceneError: when there is no such block, it cannot be carried, or the place is invalid.
            SimulationError: when not one of `to` and `onto` is given, or the arm has no fingers.
            MotionError: when `upright_deg` is not a number from 0.06 to 180.
        """
        body = self._movable(block)
        T_base_goal = tabletop.goal(self.world, body, to, onto)
        sides = tuple(self._arms) if arm is None else (self._side(arm),)
        upright = _upright(body, upright_deg)
        reason = self._hindrance(body, T_base_goal)
        refused = TaskResult.refused(body.name, reason) if reason else None
        result = refused or self._carried(body, T_base_goal, sides, upright)
        if not (result.is_done or reason or upright.is_required) and len(sides) == len(LIMBS):
            giver = self._giver(body, T_base_goal)
            if giver is not None:
                result = self._handed_over(body, T_base_goal, giver, result.planning_s)
        self.tasks.append(result)
        return result

    def draw(
        self,
        drawing: Drawing,
        *,
        height_m: float = PEN_M,
        tolerance: LineTolerance = TOLERANCE,
        arm: str | None = None,
    ) -> TaskResult:
        """Draw on the table with a pen that reaches down from the tip.

        The hand points down. It draws stroke after stroke and rises by 5 mm in between, in one
        motion without stops, or in several where none is found; corners are rounded within the
        tolerance. The replay shows the ink.

        Args:
            drawing: a text, a path or several (`Polyline`, `Arc`, `Curve`; their x and y count), a
                stroke as an array of x and y in base, m, or several strokes.
            height_m: height of the tip above the table while it draws: the length of the pen.
            tolerance: maximum deviation of the tip from its path. `LineTolerance.about("z", ...)`
                lets the hand turn about the pen.
            arm: "left" or "right"; when not given, the one on whose side most of the drawing is, or
                else the other one.

        Returns:
            The result; where it cannot be done, with the reason.

        Raises:
            SimulationError: when the drawing is malformed, or the arm has no fingers.
            MotionError: when a path or the tolerance is invalid.
            MissingLibraryError: when a text is given, and Hershey-Fonts is not installed.
        """
        height = positive_scalar(height_m, "height_m", SimulationError)
        expect(tolerance, LineTolerance, "tolerance", MotionError)
        strokes = strokes_of(drawing, tabletop.TABLE_Z_M + height)
        sides = (self._side(arm),) if arm is not None else self._sides_of(strokes)
        result = self._drawn(strokes, tolerance, sides)
        if isinstance(drawing, str):
            result = evolve(result, task=f"draw {quoted(drawing)}")
        self.tasks.append(result)
        return result

    def carry_together(
        self,
        left: tuple[str, tuple[float, float] | PoseLike],
        right: tuple[str, tuple[float, float] | PoseLike],
    ) -> tuple[TaskResult, TaskResult]:
        """Bring two blocks somewhere, one with each arm, both at the same time.

        The blocks may lean on their way. If no motion of both at once is found, the arms take
        turns, and the verdict says why.

        Args:
            left: name of the left arm's block, and its place as in `carry`.
            right: likewise of the right arm.

        Returns:
            The results of the left and the right arm.

        Raises:
            SceneError: when there is no such block, it cannot be carried, or a place is invalid.
            SimulationError: when an arm has no fingers.
            TaskError: when both are the same block.
        """
        bodies = {
            side: self._movable(name) for side, (name, _) in zip(LIMBS, (left, right), strict=True)
        }
        goals = {
            side: tabletop.goal(self.world, bodies[side], to, None)
            for side, (_, to) in zip(LIMBS, (left, right), strict=True)
        }
        arms = {side: self.arm(self._side(side)) for side in LIMBS}
        began = time.perf_counter()
        tasks = {side: self._task(arms[side], bodies[side], goals[side]) for side in LIMBS}
        plan = plan_together(tasks, arms, self.world.state)
        planning_s = time.perf_counter() - began
        verdict, is_done = self._executed_together(plan)
        results = []
        for side, body in bodies.items():
            off_m = self._off_m(body.name, goals[side]) if plan.is_valid else None
            is_there = off_m is not None and off_m <= PLACED_WITHIN_M
            if is_done and not is_there:
                verdict = f"it ended {1e3 * (off_m or 0.0):.1f} mm from its place"
            own = plan.plans[side]
            results.append(
                TaskResult(
                    f"carry {body.name}",
                    body.name,
                    side if plan.is_valid else "",
                    own.motion_time_s,
                    planning_s,
                    off_m,
                    verdict,
                    is_done and is_there,
                    own,
                )
            )
        self.tasks += results
        return results[0], results[1]

    def withdraw(self, arm: str) -> TaskResult:
        """Bring an empty arm back beside the table, out of the other's way."""
        side, task = self._side(arm), f"withdraw the {arm} arm"
        manipulator = self.arm(side)
        q_now, q_rest = self.world.arm_q(side), manipulator.arm.neutral
        if np.array_equal(q_now, q_rest):
            return TaskResult(task, "", side, 0.0, 0.0, None, "it was there already", True)
        began = time.perf_counter()
        plan = plan_start_move(manipulator, q_start=q_rest, state=self.world.state)
        planning_s = time.perf_counter() - began
        verdict, is_done = self.execute(plan, f"{side} arm goes back, ")
        motion_s = plan.motion_time_s
        result = TaskResult(task, "", side, motion_s, planning_s, None, verdict, is_done, plan)
        if not is_done:
            self.tasks.append(result)
        return result

    def arm(self, side: str) -> Manipulator:
        """An arm for planning, with the other one where it stands now."""
        return evolve(self._arms[self._side(side)], q_others=self.world.q)

    def plan(self, side: str, block: str, T_base_goal: PoseLike) -> Plan:
        """Plan how an arm brings a block to a pose, grasped from above; nothing moves."""
        body = self._movable(block)
        return self._planned(self.arm(side), body, checked_pose(T_base_goal), _upright(body, None))

    def execute(self, plan: Plan, title: str = "") -> tuple[str, bool]:
        """Verify a plan, then execute it.

        Args:
            plan: any plan for this world as it is.
            title: put before the captions of the view.

        Returns:
            A verdict, and whether all went well.

        Raises:
            SimulationError: when it has the wrong type, is for another robot, or starts elsewhere.
        """
        expect(plan, Plan, "plan", SimulationError)
        return self._verified_and_executed(plan, title)

    def _verified_and_executed(
        self, plan: Plan, title: str, strokes: Strokes | None = None
    ) -> tuple[str, bool]:
        certificate = verify(plan, description=self.robot.description)
        if not certificate.is_valid:
            return f"refused: {certificate.verdict}{self._withdrawal_hint(plan)}", False
        outcome = self.simulation.execute(plan, title, certificate=certificate, strokes=strokes)
        self.motion_s += plan.motion_time_s
        return outcome.failure or f"verified, {len(certificate.checks)} checks", outcome.is_success

    def recording(self) -> Recording:
        """The recording of all that has happened."""
        self.simulation.finish()
        return self.recorder.recording()

    def replay(self) -> Replay:
        """A replay of it, which shows itself in a notebook."""
        return Replay(self.recording(), self.robot)

    def _facts(self) -> tuple[str, ...]:
        return listing(self.world.scene.bodies, "body"), count(len(self.tasks), "task")

    def _put(
        self,
        name: str,
        where: tuple[float, float, float],
        size_m: tuple[float, float, float],
        colour: str | None,
        *,
        is_movable: bool,
    ) -> None:
        T_base_body = tabletop.turned_on_table(*where, height_m=size_m[2])
        body = make_block(name, T_base_body, edge_m=size_m, colour=colour, is_movable=is_movable)
        self._add(body)

    def _add(self, body: Body) -> None:
        """Put a body on the table, if there is space for it."""
        tabletop.check_space(body, self.world.scene)
        self._spawn(body)

    def _spawn(self, body: Body) -> None:
        """Add a body; a movable one that is inside something is lifted out, with a warning."""
        scene = self.world.scene
        raised_body = lifted_out(body, scene) if body.is_movable else body
        rise_m = float(raised_body.T_base_body.translation[2] - body.T_base_body.translation[2])
        if rise_m > 0.0:
            below = max(scene, key=lambda other: depth_m(body, other))
            _LOG.warning(
                "%s would be %.1f mm inside %s; it is put %.1f mm higher",
                body.name,
                1e3 * depth_m(body, below),
                below.name,
                1e3 * rise_m,
            )
        self.simulation.spawn(raised_body)

    def _planned(
        self, arm: Manipulator, body: Body, T_base_goal: pin.SE3, upright: Upright
    ) -> Plan:
        task = evolve(self._task(arm, body, T_base_goal), upright=upright)
        q_start = self.world.arm_q(arm.arm.side)
        return plan_pick_and_place(task, arm, self.world.scene, q_start, held=self.world.held)

    def _task(self, arm: Manipulator, body: Body, T_base_goal: pin.SE3) -> PickAndPlace:
        """The task of bringing a body to a pose, grasped from above between its neighbours."""
        others = [other for other in self.world.scene if other.name != body.name]
        T_pick_goal = body.T_base_body * T_base_goal.inverse()  # moves the goal's neighbours there
        at_goal = [other.at(T_pick_goal * other.T_base_body) for other in others]
        pick = overhead_grasp(arm.hand, body, neighbours=[*others, *at_goal])
        place = T_base_goal * body.T_base_body.inverse() * pick
        return PickAndPlace(body.name, pick, place)

    def _executed_together(self, plan: TwoArmPlan) -> tuple[str, bool]:
        """Verify a plan of both arms, then execute it; a verdict, and whether all went well."""
        if plan.failure is not None:
            return f"refused: {plan.failure}", False
        certificate = verify_both(plan, description=self.robot.description)
        if not certificate.is_valid:
            return f"refused: {certificate.verdict}", False
        outcome = self.simulation.execute(plan, certificate=certificate)
        self.motion_s += _moving_s(plan)
        order = f"in turn: {plan.in_turn}" if plan.in_turn else "at the same time"
        return outcome.failure or f"verified, both arms {order}", outcome.is_success

    def _carried(
        self, body: Body, T_base_goal: pin.SE3, sides: tuple[str, ...], upright: Upright
    ) -> TaskResult:
        began = time.perf_counter()
        plans = [self._planned(self.arm(side), body, T_base_goal, upright) for side in sides]
        plan = min(plans, key=_preference)
        if plan.is_valid:
            return self._executed(plan, body, T_base_goal, time.perf_counter() - began)
        reasons = []
        for each in plans:
            reason, idle = f"{each.limb} arm, {each.failure}", self._idle_arm_in_way(each)
            if idle is not None:
                alone = self._planned(self._without(idle, each.limb), body, T_base_goal, upright)
                if alone.is_valid:
                    planning_s = time.perf_counter() - began
                    return self._carried_after_withdrawal(
                        (idle, each.limb), body, T_base_goal, upright, planning_s
                    )
                reason += f"; with the {idle} arm withdrawn, {alone.failure}"
            reasons.append(reason)
        planning_s = time.perf_counter() - began
        return TaskResult.refused(body.name, "; ".join(reasons), planning_s, plan)

    def _giver(self, body: Body, T_base_goal: pin.SE3) -> str | None:
        """The arm that reaches a body, where it is proven that no arm reaches it and its place."""
        beyond = {}
        for side, arm in self._arms.items():
            task, bound = self._task(arm, body, T_base_goal), ReachBound(arm.arm)
            beyond[side] = [bound.proof(T) for T in (task.T_base_pick, task.T_base_place)]
        if not all(any(each) for each in beyond.values()):
            return None
        return next(
            (side for side in beyond if not beyond[side][0] and not beyond[other_than(side)][1]),
            None,
        )

    def _handed_over(
        self, body: Body, T_base_goal: pin.SE3, giver: str, planning_s: float
    ) -> TaskResult:
        """Carry a body by both arms, from hand to hand."""
        began, arms = time.perf_counter(), {side: self.arm(side) for side in LIMBS}
        plan = plan_handover(Handover(body.name, T_base_goal, giver), arms, self.world.state)
        planning_s += time.perf_counter() - began
        taker = other_than(giver)
        verdict, is_done = self._executed_together(plan)
        off_m = self._off_m(body.name, T_base_goal) if plan.is_valid else None
        if is_done and off_m is not None and off_m > PLACED_WITHIN_M:
            verdict, is_done = f"it ended {1e3 * off_m:.1f} mm from its place", False
        motion_s, why = _moving_s(plan), f"its place is out of the {giver} arm's reach"
        verdict += f"; from the {giver} to the {taker} hand, as {why}"
        task, side = f"carry {body.name}", taker if plan.is_valid else ""
        own = plan.plans[taker]
        return TaskResult(task, body.name, side, motion_s, planning_s, off_m, verdict, is_done, own)

    def _drawn(
        self, strokes: Sequence[Stroke], tolerance: LineTolerance, sides: Sequence[str]
    ) -> TaskResult:
        """Draw with the first arm that can."""
        table, began = self.world.body(tabletop.TABLE), time.perf_counter()
        places = (pin.SE3(np.eye(3), point) for point in points_of(strokes))
        reasons = list(filter(None, (tabletop.beside(place, table) for place in places)))[:1]
        for side in () if reasons else sides:
            manipulator = self.arm(side)
            try:
                found = plan_drawing(manipulator, self.world.state, strokes, tolerance)
            except MotionError as failure:
                reasons.append(f"{side} arm, {failure}")
                continue
            planning_s = time.perf_counter() - began
            ink = Strokes(tabletop.TABLE, found.times_s)
            verdict, is_done = self._verified_and_executed(found.plan, f"{side} arm, ", ink)
            motion_s, plan = found.plan.motion_time_s, found.plan
            return TaskResult("draw", "", side, motion_s, planning_s, None, verdict, is_done, plan)
        verdict, planning_s = f"refused: {'; '.join(reasons)}", time.perf_counter() - began
        return TaskResult("draw", "", "", 0.0, planning_s, None, verdict, False)

    def _sides_of(self, strokes: Sequence[Stroke]) -> tuple[str, ...]:
        """The arms, the one first on whose side most of the strokes are."""
        is_left = float(points_of(strokes)[:, 1].mean()) >= 0.0
        return tuple(sorted(self._arms, reverse=not is_left))

    def _carried_after_withdrawal(
        self,
        arms: tuple[str, str],
        body: Body,
        T_base_goal: pin.SE3,
        upright: Upright,
        planning_s: float,
    ) -> TaskResult:
        """Withdraw an idle arm, then carry with the other."""
        idle, side = arms
        withdrawn = self.withdraw(idle)
        if not withdrawn.is_done:
            reason = f"the {idle} arm is in the way and cannot withdraw, {withdrawn.verdict}"
            return TaskResult.refused(body.name, reason, planning_s, withdrawn.plan)
        result = self._carried(body, T_base_goal, (side,), upright)
        return evolve(
            result,
            motion_s=withdrawn.motion_s + result.motion_s,
            planning_s=planning_s + withdrawn.planning_s + result.planning_s,
            verdict=f"{result.verdict}; the {idle} arm withdrew first",
        )

    def _executed(
        self, plan: Plan, body: Body, T_base_goal: pin.SE3, planning_s: float
    ) -> TaskResult:
        """Carry a body by a valid plan, and measure where it ends."""
        verdict, is_done = self.execute(plan, f"{body.name}: {plan.limb} arm, ")
        off_m = self._off_m(body.name, T_base_goal)
        if is_done and off_m > PLACED_WITHIN_M:
            verdict, is_done = f"it ended {1e3 * off_m:.1f} mm from its place", False
        tilt_rad = tilt_of(plan, manipulator=self._arms[plan.limb])
        if tilt_rad > DEFAULT_TILT_RAD:
            verdict += f"; it leant by up to {math.degrees(tilt_rad):.0f} deg"
        task, motion_s = f"carry {body.name}", plan.motion_time_s
        return TaskResult(
            task, body.name, plan.limb, motion_s, planning_s, off_m, verdict, is_done, plan
        )

    def _without(self, idle: str, side: str) -> Manipulator:
        """An arm for planning, with the other one where it would be after it withdrew."""
        joints, q = self.robot.arm(idle), self.world.q
        q[list(self.robot.indices(joints.joint_names))] = joints.neutral
        return evolve(self._arms[side], q_others=q)

    def _movable(self, name: str) -> Body:
        """The body of that name, which must be movable."""
        body = self.world.body(name)
        if not body.is_movable:
            known = ", ".join(each.name for each in self.world.scene if each.is_movable)
            raise SceneError(
                f"{quoted(name)} is not a block to carry; there are: {known or 'none yet'}"
            )
        return body

    def _hindrance(self, body: Body, T_base_goal: pin.SE3) -> str:
        """Why a body cannot be carried to a goal, as far as no plan is needed to know; or ""."""
        riders = self.world.riders(body.name)
        if riders:
            too = ", too" if len(self.world.supports[riders[0]]) > 1 else ""
            return f"{riders[0]} stands on {body.name}{too}; carry that away first"
        beside = tabletop.beside(T_base_goal, self.world.body(tabletop.TABLE))
        return f"nothing to stand on, {beside}" if beside else ""

    def _idle_arm_in_way(self, plan: Plan) -> str | None:
        """The side of the other arm where it is in a plan's way and can withdraw, or None.

        It can when its hand has fingers and is empty, and it is not withdrawn already.
        """
        (other,) = set(LIMBS) - {plan.limb}
        arm, shapes = self.robot.arm(other), self.world.shapes
        links = {shapes.links[index] for index in shapes.of_arm(arm)}
        if plan.failure is None or links.isdisjoint(plan.failure.colliding):
            return None
        is_idle = other in self.world.hands and self.world.holding(other) is None
        return (
            other if is_idle and not np.array_equal(self.world.arm_q(other), arm.neutral) else None
        )

    def _withdrawal_hint(self, plan: Plan) -> str:
        """The hint of a refusal where the other arm can withdraw, or ""."""
        other = self._idle_arm_in_way(plan)
        if other is None:
            return ""
        return (
            f"; the {other} arm is in the way: withdraw({other!r}) brings it back beside the table"
        )

    def _side(self, arm: str) -> str:
        side = self.robot.arm(arm).side
        self.world.hand(side)
        return side

    def _off_m(self, block: str, T_base_goal: pin.SE3) -> float:
        T_base_block = self.world.body(block).T_base_body
        return float(np.linalg.norm(T_base_block.translation - T_base_goal.translation))


def _moving_s(plan: TwoArmPlan) -> float:
    """How long at least one arm moves."""
    moving_s = end_s = 0.0
    for timed in plan.steps:
        if not isinstance(timed.step, Grip):
            moving_s += max(timed.end_s - max(timed.begin_s, end_s), 0.0)
            end_s = max(end_s, timed.end_s)
    return moving_s


def _preference(plan: Plan) -> tuple[bool, float]:
    return not plan.is_valid, plan.motion_time_s


def _upright(body: Body, max_deg: float | None) -> Upright:
    """What is required of a block on its way, or preferred where nothing is."""
    if max_deg is None:
        return Upright.of(body, DEFAULT_TILT_RAD, is_required=False)
    angle_deg, min_deg = finite_scalar(max_deg, "upright_deg", MotionError), MIN_UPRIGHT_DEG
    if not min_deg <= angle_deg <= 180.0:
        raise MotionError(f"upright_deg must be from {min_deg:g} to 180, got {angle_deg:g}")
    return Upright.of(body, math.radians(angle_deg))
