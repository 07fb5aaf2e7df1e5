"""What the demo prints while it runs."""

from __future__ import annotations

import sys

from baxter_kin.frames import Frame
from baxter_kin.ik import IKResult
from planner import Move
from sim import Event, EventKind, Observer
from sim.demo.report import Totals

_TABLE = "  {stage:<17} {seed:<44} {residual:<20} {duration}"

_LEGEND = (
    "A row is a move of the arm. IK seed: the joint angles from which inverse kinematics found the",
    "pose; optimised by: how far a joint then went on, to the solution of the same pose that makes",
    "the motion fastest. Residual: how far the answer is off the pose. See docs/concepts/ik.md",
)


class Narrator(Observer):
    """Prints a line for every step as it begins, on standard output."""

    def __init__(self, verbosity: int) -> None:
        self._verbosity = verbosity
        self._is_explained = False

    def say(self, text: str) -> None:
        """Print one line, unless quiet."""
        if self._verbosity > 0:
            print(text, flush=True)

    def complain(self, text: str) -> None:
        """Print one line on standard error, always."""
        print(text, file=sys.stderr, flush=True)

    def start_cycle(
        self, number: int, pick_m: tuple[float, ...], place_m: tuple[float, ...]
    ) -> None:
        """Print the heading of a cycle and of its table."""
        if not self._is_explained:
            self._is_explained = True
            for line in _LEGEND:
                self.say(line)
        ends = f"pick at {_point(pick_m)}, place at {_point(place_m)}"
        self.say(f"cycle {number}: {ends} m in {Frame.BASE.value}")
        heading = {"stage": "stage", "seed": "IK seed", "residual": "residual"}
        self.say(_TABLE.format(**heading, duration="time"))

    def on_event(self, event: Event) -> None:
        """Print a line for a move; for other events when verbose, or when a block is concerned."""
        if event.move is not None:
            self.say(_row(event.move))
        elif event.kind in _NOTABLE or self._verbosity > 1:
            self.say(f"  {event.text}")

    def finish(self, totals: Totals) -> None:
        """Print the summary."""
        begin, end = totals.block_start_m, totals.block_final_m
        if begin is not None and end is not None:
            self.say(f"block: from {_point(begin)} to {_point(end)} m in {Frame.BASE.value}")
        cycle = f"; one pick and place {totals.cycle_time_s:.2f} s, gripper included"
        self.say(
            f"time: planning {totals.planning_time_s:.2f} s, arm motion {totals.motion_time_s:.2f} "
            f"s, wall clock {totals.wall_time_s:.2f} s{cycle if totals.cycles_done else ''}"
        )
        if totals.transfer_ratio is not None:
            self.say(
                f"from grasp to release: {totals.transfer_ratio:.2f} times as long as the fastest "
                "direct joint motion, which heeds\n"
                "  neither lines nor obstacles (see docs/concepts/motion_program.md)"
            )
        if totals.min_clearance_m is not None:
            self.say(
                f"clearance: {1e3 * totals.min_clearance_m:.1f} mm where the arm came nearest to "
                "what it is not meant to touch"
            )


_NOTABLE = {EventKind.GRASPED, EventKind.RELEASED, EventKind.MISSED, EventKind.HIT}


def _row(move: Move) -> str:
    return _TABLE.format(
        stage=move.label,
        seed=move.seed_label,
        residual="" if move.ik is None else _residual(move.ik),
        duration=f"{move.trajectory.duration:.3f} s",
    )


def _residual(ik: IKResult) -> str:
    return f"{ik.position_error_m:.0e} m, {ik.orientation_error_rad:.0e} rad"


def _point(point_m: tuple[float, ...]) -> str:
    """Coordinates as text; zero has no sign."""
    return f"({', '.join(f'{round(value, 4) + 0.0:.4f}' for value in point_m)})"
