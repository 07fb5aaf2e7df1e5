"""The demo's report: its numbers, printed while it runs and written as JSON.

`COLUMNS` and `SUMMARY` are the phrases in which numbers are printed.
"""

from __future__ import annotations

import json
import math
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from string import Formatter
from typing import Any, TypeAlias

from baxter_kin.files import replace_file
from baxter_kin.ik import IKResult
from planner import GripperAction, Move, Plan
from sim import Event, EventKind, Observer, Outcome
from sim.demo.options import DemoOptions, Point
from sim.demo.scene import BLOCK

MAX_CYCLES, MAX_EVENTS = 100, 1000
"""Maximum number of cycles and events kept; older ones are dropped."""

Json: TypeAlias = dict[str, Any]

LEGEND = """\
A row is a move of the arm. IK seed: the joint angles from which inverse kinematics found the
pose; optimised by: largest joint change from that solution to the one with the fastest motion.
Residual: pose error of the solution. See docs/concepts/ik.md"""

COLUMNS = (
    ("stage", 17, "{label}"),
    ("IK seed", 44, "{seed_label}"),
    ("residual", 20, "{position_error_m:.0e} m, {orientation_error_rad:.0e} rad"),
    ("time", 0, "{duration_s:.3f} s"),
)
"""Columns of a move's row: heading, width, format."""

SUMMARY = (
    (
        "time: planning {planning_time_s:.2f} s, arm motion {motion_time_s:.2f} s, wall clock "
        "{wall_time_s:.2f} s",
        "; one pick and place {cycle_time_s:.2f} s, gripper included",
    ),
    (
        "from grasp to release: {transfer_ratio:.2f} times as long as the fastest direct joint "
        "motion, which ignores\n  straight lines and obstacles "
        "(see docs/concepts/motion_program.md)",
    ),
    (
        "planned clearance: {min_clearance_mm:.1f} mm to the nearest thing that the arm is not "
        "meant to touch",
    ),
)
"""Lines at the end of a run; a phrase is left out where one of its numbers is not known."""

MOVED = "{name}: from {start_m} to {final_m} m in base"
"""The first lines at the end, one for each block."""

CYCLE = "cycle {cycle}: pick at {pick_m}, place at {place_m} m in base"

_NOTABLE = {EventKind.GRASPED, EventKind.RELEASED, EventKind.MISSED, EventKind.HIT}


class Report(Observer):
    """Collects the numbers of a run, and prints them.

    Attributes:
        options: what the user requested.
        failure: why the run ended early; None once all is done.
        planning_time_s: wall time spent planning.
        wall_time_s: wall time of the run.
        blocks_start_m: centre of each block in base once it had settled.
        blocks_final_m: the same at the end.
    """

    def __init__(self, options: DemoOptions) -> None:
        self.options = options
        self.failure: str | None = "the run did not finish"
        self.planning_time_s = self.wall_time_s = 0.0
        self.blocks_start_m: dict[str, Point] = {}
        self.blocks_final_m: dict[str, Point] = {}
        self._cycles: deque[Json] = deque(maxlen=MAX_CYCLES)
        self._events: deque[Event] = deque(maxlen=MAX_EVENTS)
        self._cycles_done = 0
        self._min_clearance_m: float | None = None
        self._motion_s = self._simulated_s = self._transfer_s = self._bound_s = 0.0
        self._has_printed_legend = False

    def say(self, text: str) -> None:
        """Print one line, unless quiet."""
        if not self.options.is_quiet:
            print(text, flush=True)

    def on_event(self, event: Event) -> None:
        """Print a row for a move, and other events when verbose, or when a block is concerned."""
        self._events.append(event)
        if event.move is not None:
            self.say(self._row(event.move))
        elif event.kind in _NOTABLE or self.options.is_verbose:
            self.say(f"  {event.text}")

    def start_cycle(self, cycle: int, pick_m: Point, place_m: Point) -> None:
        """Print the heading of a cycle and of its rows."""
        if not self._has_printed_legend:
            self._has_printed_legend = True
            self.say(LEGEND)
        self.say(CYCLE.format(cycle=cycle, pick_m=_point(pick_m), place_m=_point(place_m)))
        self.say(_aligned([heading for heading, _, _ in COLUMNS]))

    def add_plan(
        self, cycle: int, pick_m: Point, place_m: Point, plan: Plan, bound_s: float
    ) -> None:
        """Add a planned cycle, or another attempt at it.

        Args:
            cycle: its number, from 1.
            pick_m: where the tip picks, in base.
            place_m: where it places.
            plan: what was planned, or why not.
            bound_s: least time from grasp to release, infinite where the poses are unreachable.
        """
        time_s = transfer_s(plan)
        self._cycles.append(
            {
                "cycle": cycle,
                "pick_m": pick_m,
                "place_m": place_m,
                "picks": _grips(plan, GripperAction.CLOSE),
                "places": _grips(plan, GripperAction.OPEN),
                "waypoints": _waypoints(plan),
                "moves": [_move(move) for move in plan.moves],
                "transfer_time_s": time_s,
                "transfer_bound_s": bound_s if math.isfinite(bound_s) else None,
                "transfer_ratio": None if time_s is None else _ratio(time_s, bound_s),
                "planned": plan.is_valid,
                "success": False,
                "failure": None if plan.failure is None else str(plan.failure),
            }
        )

    def end_cycle(self, plan: Plan, outcome: Outcome, block_m: Point | None) -> None:
        """Complete the cycle that was added last.

        Args:
            plan: its last plan.
            outcome: of its execution.
            block_m: centre of the block in base.
        """
        self._complete(self._cycles[-1], plan, outcome, block_m)

    def _complete(self, entry: Json, plan: Plan, outcome: Outcome, block_m: Point | None) -> None:
        entry |= {"success": outcome.is_success, "failure": outcome.failure}
        entry |= {"duration_s": outcome.duration_s, "block_m": block_m}
        self._motion_s += plan.motion_time_s
        if plan.clearance is not None:
            least_m, known_m = plan.clearance.distance_m, self._min_clearance_m
            self._min_clearance_m = least_m if known_m is None else min(least_m, known_m)
        if outcome.is_success:
            self._cycles_done += 1
            self._simulated_s += outcome.duration_s
            if entry["transfer_bound_s"] is not None:
                self._transfer_s += entry["transfer_time_s"]
                self._bound_s += entry["transfer_bound_s"]

    def finish(self) -> None:
        """Print the summary."""
        least_m = self._min_clearance_m
        numbers = {
            **self._totals(),
            "min_clearance_mm": None if least_m is None else 1e3 * least_m,
        }
        for name, start_m in self.blocks_start_m.items():
            if name in self.blocks_final_m:
                final_m = _point(self.blocks_final_m[name])
                self.say(MOVED.format(name=name, start_m=_point(start_m), final_m=final_m))
        for phrases in SUMMARY:
            line = "".join(_filled(phrase, numbers) for phrase in phrases)
            if line:
                self.say(line)

    def as_json(self) -> Json:
        """JSON-serialisable representation."""
        options = self.options
        position_m, rotation_rad = options.line_tolerance
        return {
            "limb": options.limb,
            "hover_distance_m": options.hover_m,
            "speed_ratio": options.speed_ratio,
            "limits": options.limits,
            "margin_m": options.margin_m,
            "line_tolerance": {"position_m": position_m, "rotation_rad": rotation_rad},
            "noise": _noise(options),
            "obstacles_m": [list(obstacle) for obstacle in options.obstacles_m],
            "block_poses": [list(pose) for pose in options.poses_m],
            "cycles": list(self._cycles),
            "block": self._block(BLOCK),
            **self._totals(),
            "events": [
                {
                    "time_s": event.time_s,
                    "kind": event.kind.value,
                    "text": event.text,
                    "side": event.side,
                    "body": None if event.body is None else event.body.name,
                }
                for event in self._events
            ],
            "success": self.failure is None,
            "failure": self.failure,
        }

    def write(self, path: Path) -> None:
        """Write the report as JSON."""
        text = json.dumps(self.as_json(), indent=1, allow_nan=False) + "\n"
        replace_file(path, text.encode())

    def _row(self, move: Move) -> str:
        """The row of a move that begins."""
        return format_move(move)

    def _block(self, name: str) -> Json:
        """Where a block was and is."""
        return {
            "start_m": self.blocks_start_m.get(name),
            "final_m": self.blocks_final_m.get(name),
        }

    def _totals(self) -> Json:
        """Sums and means over the whole run."""
        done = self._cycles_done
        return {
            "cycles_done": done,
            "min_clearance_m": self._min_clearance_m,
            "motion_time_s": self._motion_s,
            "cycle_time_s": self._simulated_s / done if done else None,
            "transfer_ratio": _ratio(self._transfer_s, self._bound_s),
            "planning_time_s": self.planning_time_s,
            "wall_time_s": self.wall_time_s,
        }


def format_move(move: Move) -> str:
    """Return the row of a move, formatted by `COLUMNS`."""
    numbers = {**_move(move), "seed_label": move.seed_label}
    if move.ik is not None:
        numbers = {**_waypoint(move.label, move.ik, move.moved_rad), **numbers}
    return _aligned([_filled(text, numbers) for _, _, text in COLUMNS])


def transfer_s(plan: Plan) -> float | None:
    """Duration of the moves with closed fingers; None for a plan that failed."""
    if not plan.is_valid:
        return None
    moved_s, is_closed = 0.0, False
    for step in plan:
        if not isinstance(step, Move):
            is_closed = step.action is GripperAction.CLOSE
        elif is_closed:
            moved_s += step.trajectory.duration
    return moved_s


def _grips(plan: Plan, action: GripperAction) -> list[Json]:
    """The picks (closes on a body) or places (opens that release one) of a plan."""
    return [
        {"label": step.label, "body": step.body}
        for step in plan
        if not isinstance(step, Move) and step.action is action and step.body is not None
    ]


def _waypoints(plan: Plan) -> list[Json]:
    """The IK result of every waypoint, that of a failed one last."""
    results = [(move.label, move.ik, move.moved_rad) for move in plan.moves if move.ik is not None]
    if plan.failure is not None and plan.failure.ik is not None:
        results.append((plan.failure.stage, plan.failure.ik, 0.0))
    return [_waypoint(*result) for result in results]


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


def _noise(options: DemoOptions) -> Json | None:
    """Noise of the perceived poses; None when the demo plans with the true ones."""
    if options.retries is None:
        return None
    return {
        "position_m": options.noise_m,
        "yaw_rad": options.noise_rad,
        "retries": options.retries,
        "seed": options.seed,
    }


def _ratio(time_s: float, bound_s: float) -> float | None:
    """None for a bound of 0, when the place is where the pick was, and for an infinite one."""
    return time_s / bound_s if 0.0 < bound_s < math.inf else None


def _filled(phrase: str, numbers: Mapping[str, Any]) -> str:
    """A phrase with its numbers; empty where one is not known."""
    names = [name for _, name, _, _ in Formatter().parse(phrase) if name]
    is_known = all(numbers.get(name) is not None for name in names)
    return phrase.format_map(numbers) if is_known else ""


def _aligned(texts: list[str]) -> str:
    columns = (text.ljust(width) for text, (_, width, _) in zip(texts, COLUMNS, strict=True))
    return f"  {' '.join(columns)}"


def _point(point_m: Point) -> str:
    """Coordinates as text; zero has no sign."""
    return f"({', '.join(f'{round(value, 4) + 0.0:.4f}' for value in point_m)})"
