"""The pick-and-place demo: `python -m baxter_kin.demo`.

The composition root: it may import every layer, and no module imports it. Exit status: 0 all picked
and placed; 1 a pick or place failed; 2 wrong usage; 130 stopped by Ctrl-C.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from baxter_kin.command_line import EXIT_INTERRUPTED, parse
from baxter_kin.errors import MissingLibraryError
from sim.demo.interrupt import interruptible
from sim.demo.options import DemoOptions

__all__ = ["EXIT_INTERRUPTED", "main"]

EXIT_FAILED = 1


def main(argv: Sequence[str] | None = None) -> int:
    """Run the demo with those arguments, or the command line's; returns the exit status."""
    try:
        with interruptible() as interrupt:
            options = parse(DemoOptions, argv)
            with interrupt.deferred():  # some libraries crash when interrupted while loading
                import baxter_kin.kinematics.pinocchio_loading  # noqa: F401, PLC0415 - may be missing
                from sim.demo.run import run_demo  # noqa: PLC0415 - loads every library
            return run_demo(options, interrupt)
    except MissingLibraryError as error:
        print(f"baxter-demo: {error}", file=sys.stderr)
        return EXIT_FAILED
    except KeyboardInterrupt:
        print("stopped by Ctrl-C", file=sys.stderr)
        return EXIT_INTERRUPTED
