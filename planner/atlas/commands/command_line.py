"""`python -m planner.atlas COMMAND`: maps of what Baxter can reach."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from types import ModuleType

from baxter_kin import BaxterError
from baxter_kin.command_line import EXIT_INTERRUPTED, OneSentenceParser, examples
from planner.atlas.commands import build, info, plot, query, redundancy, verify
from planner.atlas.commands.exit_status import EXIT_FAILED, EXIT_USAGE, TOLD, UsageError
from planner.atlas.commands.reports import NAME, complain

SUB_COMMANDS: dict[str, ModuleType] = {
    "build": build,
    "info": info,
    "verify": verify,
    "query": query,
    "plot": plot,
    "redundancy": redundancy,
}
"""All of them, in the order of the help text: what is added here is wired."""


def main(argv: Sequence[str] | None = None) -> int:
    """Do what the arguments, or the command line, say; returns the exit status."""
    arguments = options(argv)
    try:
        return int(SUB_COMMANDS[arguments.command].run(arguments))
    except BaxterError as cause:
        complain(str(cause))
        return EXIT_USAGE if isinstance(cause, UsageError) else EXIT_FAILED
    except KeyboardInterrupt:
        complain("stopped by Ctrl-C")
        return EXIT_INTERRUPTED


def options(argv: Sequence[str] | None = None) -> argparse.Namespace:
    """The arguments, read; ends the program where they are wrong."""
    parser = OneSentenceParser(
        prog=f"python -m {NAME}",
        description="Maps of what Baxter can reach: a pose is reachable, with a witness (joint "
        "angles that reach it), or proven out of reach, or undecided.",
        epilog=examples(
            "python -m planner.atlas build coarse.zarr --step-m 0.1 --hopf 0",
            "python -m planner.atlas info coarse.zarr",
            "python -m planner.atlas verify coarse.zarr",
            end=TOLD.format(also=""),
        ),
        allow_abbrev=False,
    )
    commands = parser.add_subparsers(
        title="commands", dest="command", metavar="COMMAND", required=True
    )
    for name, module in SUB_COMMANDS.items():
        command = commands.add_parser(
            name,
            help=module.HELP,
            description=module.HELP,
            epilog=module.EXAMPLES,
            allow_abbrev=False,
        )
        module.add_arguments(command)
    return parser.parse_args(argv)
