"""The demo's report: all plans and their outcomes, as JSON."""

from __future__ import annotations

import json
import math
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

from baxter_kin.files import replace_file
from baxter_kin.ik import IKResult
from planner import GripperAction, Move, Plan
from sim import Event, Observer, Outcome
from sim.demo.options import DemoOptions

MAX_CYCLES, MAX_EVENTS = 100, 1000
"""A report keeps the last ones; a run with --forever soon has more."""

Json: TypeAlias = dict[str, Any]
Point: TypeAlias = tuple[float, ...]


@dataclass(slots=True)
class Totals:
    """Sums over the whole run.

    Attributes:
        cycles_done: cycles that succeeded.
        motion_time_s: durations of the arm's moves, those to the start pose left out.
        simulated_s: simulated time of all successful cycles, gripper included.
        transfer_s: time of their moves from grasp to release.
        transfer_bound_s: least time that these take.
        planning_time_s: wall time spent planning.
        wall_time_s: wall time of the run.
        min_clearance_m: smallest clearance of all plans, None before the first.
        block_start_m: centre of the block in base once it had settled.
        block_final_m: the same at the end.
    """

    cycles_done: int = 0
    motion_time_s: float = 0.0
    simulated_s: float = 0.0
    transfer_s: float = 0.0
    transfer_bound_s: float = 0.0
    planning_time_s: float = 0.0
    wall_time_s: float = 0.0
    min_clearance_m: float | None = None
    block_start_m: Point | None = None
    block_final_m: Point | None = None

    @property
    def cycle_time_s(self) -> float:
        """Mean simulated time of one pick and place, gripper included; 0 before the first."""
        return self.simulated_s / self.cycles_done if self.cycles_done else 0.0

    @property
    def transfer_ratio(self) -> float | None:
        """Time from grasp to release over its bound; None before the first."""
        return _ratio(self.transfer_s, self.transfer_bound_s)

    def add(self, plan: Plan, outcome: Outcome, bound_s: float) -> None:
        """Add an executed cycle, and the least time from its grasp to its release."""
        self.motion_time_s += plan.motion_time_s
        if plan.clearance is not None:
            least = plan.clearance.distance_m
            known = self.min_clearance_m
            self.min_clearance_m = least if known is None else min(known, least)
        if outcome.is_success:
            self.cycles_done += 1
            self.simulated_s += outcome.duration_s
            self.transfer_s += _transfer_s(plan)
            self.transfer_bound_s += bound_s


@dataclass(slots=True)
class Report(Observer):
    """An observer that collects the report while the demo runs.

    Attributes:
        options: what was asked for.
        totals: sums over the run.
        failure: why the run ended early, None once all is done.
    """

    options: DemoOptions
    totals: Totals = field(default_factory=Totals)
    failure: str | None = "it did not finish"
    _cycles: deque[Json] = field(default_factory=lambda: deque(maxlen=MAX_CYCLES))
    _events: deque[Event] = field(default_factory=lambda: deque(maxlen=MAX_EVENTS))

    def on_event(self, event: Event) -> None:
        """Store an event."""
        self._events.append(event)

    def add_cycle(
        self, number: int, poses_m: tuple[Point, Point], plan: Plan, bound_s: float
    ) -> Json:
        """Add a planned cycle; returns its entry, which is completed after its execution.

        Args:
            number: counted from 1.
            poses_m: pick and place in base.
            plan: what was planned, or why not.
            bound_s: least time from grasp to release, infinite where the poses are unreachable.
        """
        entry: Json = {
            "cycle": number,
            "pick_m": poses_m[0],
            "place_m": poses_m[1],
            "picks": _grips(plan, GripperAction.CLOSE),
            "places": _grips(plan, GripperAction.OPEN),
            "waypoints": _waypoints(plan),
            "moves": [_move(move) for move in plan.moves],
            **_transfer(plan, bound_s),
            "planned": plan.is_valid,
            "success": False,
            "failure": None if plan.failure is None else str(plan.failure),
        }
        self._cycles.append(entry)
        return entry

    def as_json(self) -> Json:
        """JSON-serialisable representation."""
        totals = self.totals
        return {
            "limb": self.options.limb,
            "hover_distance_m": self.options.hover_m,
            "speed_ratio": self.options.speed_ratio,
            "limits": self.options.limits,
            "margin_m": self.options.margin_m,
            "line_tolerance": dict(
                zip(("position_m", "rotation_rad"), self.options.line_tolerance, strict=True)
            ),
            "noise": _noise(self.options),
            "obstacles_m": [list(obstacle) for obstacle in self.options.obstacles_m],
            "block_poses": [list(pose) for pose in self.options.poses_m],
            "cycles": list(self._cycles),
            "cycles_done": totals.cycles_done,
            "block": {"start_m": totals.block_start_m, "final_m": totals.block_final_m},
            "min_clearance_m": totals.min_clearance_m,
            "motion_time_s": totals.motion_time_s,
            "cycle_time_s": totals.cycle_time_s,
            "planning_time_s": totals.planning_time_s,
            "wall_time_s": totals.wall_time_s,
            "events": [_event(event) for event in self._events],
            "success": self.failure is None,
            "failure": self.failure,
        }

    def write(self, path: Path) -> None:
        """Write the report as JSON."""
        text = json.dumps(self.as_json(), indent=1, allow_nan=False) + "\n"
        replace_file(path, text.encode())


def _noise(options: DemoOptions) -> Json | None:
    """Noise of the perceived poses; None when the demo plans with the true ones."""
    if not options.is_closed_loop:
        return None
    return {
        "position_m": options.noise_m,
        "yaw_rad": options.noise_rad,
        "retries": options.retries,
        "seed": options.seed,
    }


def _grips(plan: Plan, action: GripperAction) -> list[Json]:
    """The picks (closes on a body) or places (opens that release one) of a plan."""
    return [
        {"label": step.label, "body": step.body}
        for step in plan
        if not isinstance(step, Move) and step.action is action and step.body is not None
    ]


def _waypoints(plan: Plan) -> list[Json]:
    """The IK result of every waypoint, that of a failed one last."""
    answers = [(move.label, move.ik, move.moved_rad) for move in plan.moves if move.ik is not None]
    if plan.failure is not None and plan.failure.ik is not None:
        answers.append((plan.failure.stage, plan.failure.ik, 0.0))
    return [_waypoint(*answer) for answer in answers]


def _waypoint(label: str, ik: IKResult, moved_rad: float) -> Json:
    return {
        "waypoint": label,
        "seed_type": ik.seed_type.name,
        "seed_label": ik.label,
        "moved_rad": moved_rad,
        "position_error_m": ik.position_error_m,
        "orientation_error_rad": ik.orientation_error_rad,
        "joints": ik.joints,
        "failure": None if ik.failure is None else str(ik.failure),
    }


def _move(move: Move) -> Json:
    ratios = move.trajectory.peak_ratios()
    return {
        "label": move.label,
        "duration_s": move.trajectory.duration,
        "peak_velocity_ratio": ratios.velocity,
        "peak_acceleration_ratio": ratios.acceleration,
        "peak_jerk_ratio": ratios.jerk,
        "clearance_m": None if move.clearance is None else move.clearance.distance_m,
        "proven_clearance_m": None if move.proof is None else move.proof.proven_m,
        "is_straight": move.is_straight,
    }


def _transfer(plan: Plan, bound_s: float) -> Json:
    """Time from grasp to release, its lower bound, and their quotient."""
    time_s = _transfer_s(plan) if plan.is_valid else None
    return {
        "transfer_time_s": time_s,
        "transfer_bound_s": bound_s if math.isfinite(bound_s) else None,
        "transfer_ratio": None if time_s is None else _ratio(time_s, bound_s),
    }


def _transfer_s(plan: Plan) -> float:
    """Duration of the moves with closed fingers."""
    moved_s, is_closed = 0.0, False
    for step in plan:
        if not isinstance(step, Move):
            is_closed = step.action is GripperAction.CLOSE
        elif is_closed:
            moved_s += step.trajectory.duration
    return moved_s


def _ratio(time_s: float, bound_s: float) -> float | None:
    """None for a bound of 0, when the place is where the pick was."""
    return time_s / bound_s if bound_s > 0.0 else None


def _event(event: Event) -> Json:
    return {
        "time_s": event.time_s,
        "kind": event.kind.value,
        "text": event.text,
        "side": event.side,
        "body": None if event.body is None else event.body.name,
    }
