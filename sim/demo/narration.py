"""What the demo prints while it works."""

from __future__ import annotations

import sys

from baxter_kin.frames import Frame
from baxter_kin.ik import IKResult
from planner import Move
from sim import Event, EventKind, Observer
from sim.demo.report import Totals

_TABLE = "  {stage:<17} {seed:<40} {residual:<22} {duration}"


class Narrator(Observer):
    """Tells the story on standard output, a line for every step as it begins."""

    def __init__(self, verbosity: int) -> None:
        self._verbosity = verbosity

    def say(self, text: str) -> None:
        """One line, unless quiet."""
        if self._verbosity > 0:
            print(text, flush=True)

    def complain(self, text: str) -> None:
        """One line on standard error, always."""
        print(text, file=sys.stderr, flush=True)

    def start_cycle(
        self, number: int, pick_m: tuple[float, ...], place_m: tuple[float, ...]
    ) -> None:
        """The heading of a cycle and of its table."""
        self.say(f"cycle {number}: pick at {_point(pick_m)}, place at {_point(place_m)}")
        heading = {"stage": "stage", "seed": "IK seed", "residual": "residual"}
        self.say(_TABLE.format(**heading, duration="move"))

    def on_event(self, event: Event) -> None:
        """A line for a move; for other events only when verbose or when something happened."""
        if event.move is not None:
            self.say(_row(event.move))
        elif event.kind in _TOLD or self._verbosity > 1:
            self.say(f"  {event.text}")

    def finish(self, totals: Totals) -> None:
        """The summary."""
        self.say(f"block: from {_point(totals.block_start_m)} to {_point(totals.block_final_m)}")
        clearance = totals.min_clearance_m
        nearest = "" if clearance is None else f", nearest approach {1e3 * clearance:.1f} mm"
        ratio = totals.transfer_ratio
        transfer = "" if ratio is None else f", grasp to release {ratio:.2f} times its bound"
        self.say(
            f"time: planning {totals.planning_time_s:.2f} s, motion {totals.motion_time_s:.2f} s, "
            f"one pick and place {totals.cycle_time_s:.2f} s, wall {totals.wall_time_s:.2f} s"
            f"{transfer}{nearest}"
        )


_TOLD = {EventKind.GRASPED, EventKind.RELEASED, EventKind.MISSED, EventKind.HIT}


def _row(move: Move) -> str:
    return _TABLE.format(
        stage=move.label,
        seed=move.seed_label,
        residual="" if move.ik is None else _residual(move.ik),
        duration=f"{move.trajectory.duration:.3f} s",
    )


def _residual(ik: IKResult) -> str:
    return f"{ik.position_error_m:.0e} m, {ik.orientation_error_rad:.0e} rad"


def _point(point_m: tuple[float, ...] | None) -> str:
    if point_m is None:
        return "nowhere"
    return f"({', '.join(f'{value:.4f}' for value in point_m)}) m in {Frame.BASE.value}"
