"""`python -m planner.atlas`."""

from __future__ import annotations

from typing import NoReturn

from baxter_kin.command_line import run_process
from planner.atlas.commands.command_line import main
from planner.atlas.commands.console import EXIT_FAILED, NAME


def run() -> NoReturn:
    """Run as a program of its own."""
    run_process(main, NAME, failed=EXIT_FAILED)


if __name__ == "__main__":
    run()
