"""`python -m planner.atlas COMMAND`: maps of what Baxter can reach."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from baxter_kin import BaxterError
from baxter_kin.command_line import (
    EXIT_INTERRUPTED,
    EXIT_USAGE,
    UsageError,
    command,
    parse,
    subcommands,
)
from planner.atlas.commands.console import EXIT_FAILED, EXIT_STATUS, NAME, complain
from planner.atlas.commands.maps import Build, Info, Redundancy, Verify
from planner.atlas.commands.questions import Plot, Query

SUBCOMMANDS = {
    "build": Build,
    "info": Info,
    "verify": Verify,
    "query": Query,
    "plot": Plot,
    "redundancy": Redundancy,
}
"""In the order of the help text."""


@command(
    f"python -m {NAME}",
    "Maps of what Baxter can reach: a pose is reachable, with a witness (joint angles that reach "
    "it), or proven out of reach, or undecided.",
    examples=(
        "python -m planner.atlas build coarse.zarr --step-m 0.1 --hopf 0",
        "python -m planner.atlas info coarse.zarr",
        "python -m planner.atlas verify coarse.zarr",
    ),
    end=EXIT_STATUS.format(also=""),
)
@dataclass(frozen=True, slots=True, kw_only=True)
class AtlasOptions:
    """The sub-command that is given, with its options."""

    command: Build | Info | Verify | Query | Plot | Redundancy = subcommands(
        SUBCOMMANDS, metavar="COMMAND", title="commands"
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Run the sub-command of the arguments, or the command line; returns the exit status."""
    options = parse(AtlasOptions, argv)
    try:
        return options.command.run()
    except BaxterError as cause:
        complain(str(cause))
        return EXIT_USAGE if isinstance(cause, UsageError) else EXIT_FAILED
    except KeyboardInterrupt:
        complain("stopped by Ctrl-C")
        return EXIT_INTERRUPTED
