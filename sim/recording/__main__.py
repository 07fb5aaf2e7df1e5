"""`python -m sim.recording compare PLAN RECORDING`: numbers for how well a plan was executed.

Exit status: 0 done; 1 they cannot be compared; 2 wrong usage, or a file that cannot be read; 130
stopped by Ctrl-C.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from baxter_kin.command_line import (
    EXIT_INTERRUPTED,
    EXIT_USAGE,
    command,
    number_within,
    option,
    parse,
    run_process,
    subcommands,
    urdf_option,
)

NAME, EXIT_DONE, EXIT_FAILED = "sim.recording", 0, 1


@command(
    None,
    "How far an arm was from its plan: RMS and worst of each joint and of the tip, lag taken out.",
    examples=(
        "python -m sim.recording compare plan.json run.mcap",
        "python -m sim.recording compare plan.json run.csv --speed 0.3 --plot off.png",
    ),
)
@dataclass(frozen=True, slots=True, kw_only=True)
class CompareOptions:
    """What to compare."""

    plan: str = option(metavar="PLAN", help="a plan that save_plan or the demo saved")
    recording: str = option(metavar="RECORDING", help="of its execution: .mcap, .csv or .bag")
    speed: float = option(
        "--speed",
        type=number_within(0.01, 1.0, ""),
        default=1.0,
        metavar="RATIO",
        help="of the execution, where the recording does not say it, as .csv and .bag do not",
    )
    plot: str | None = option(
        "--plot", metavar="FILE", help="draw the differences, in a format of Matplotlib"
    )
    urdf: str | None = urdf_option()


@command(
    f"python -m {NAME}",
    "Work with recordings.",
    examples=(
        "python -m sim.recording compare plan.json run.mcap",
        "python -m sim.recording compare plan.json run.csv --speed 0.3",
    ),
    end="Exit status: 0 done; 1 no comparison; 2 wrong usage, or an unreadable file; 130 Ctrl-C.",
)
@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingOptions:
    """What to do."""

    chosen: CompareOptions = subcommands({"compare": CompareOptions}, metavar="COMMAND")


def main(argv: Sequence[str] | None = None) -> int:
    """Do what the arguments say; returns the exit status."""
    options = parse(RecordingOptions, argv).chosen
    try:
        return _compared(options)
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED


def _compared(options: CompareOptions) -> int:
    from baxter_kin import Baxter, BaxterError  # noqa: PLC0415
    from planner import load_plan  # noqa: PLC0415
    from sim.recording.comparison import compare_run  # noqa: PLC0415
    from sim.recording.plot import plot_comparison  # noqa: PLC0415
    from sim.recording.record_file import read_recording  # noqa: PLC0415

    try:
        robot = Baxter.load() if options.urdf is None else Baxter.load(urdf=options.urdf)
        plan = load_plan(options.plan)
        recording, notes = read_recording(options.recording, robot)
    except BaxterError as error:
        return _complained(error, EXIT_USAGE)
    for note in notes:
        print(f"note: {note}")
    try:
        found = compare_run(plan, recording, robot=robot, speed=options.speed)
        print(found)
        if options.plot is not None:
            plot_comparison(found).savefig(Path(options.plot))
    except (BaxterError, OSError, ValueError) as error:
        return _complained(error, EXIT_FAILED)
    return EXIT_DONE


def _complained(error: Exception, status: int) -> int:
    print(f"{NAME}: {error}", file=sys.stderr)
    return status


if __name__ == "__main__":
    run_process(main, NAME, failed=EXIT_USAGE)
