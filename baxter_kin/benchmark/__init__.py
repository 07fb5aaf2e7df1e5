"""The IK benchmark: `python -m baxter_kin.benchmark`.

How often, and how fast, do IK solvers find joint angles for this arm? Our own and every peer that
is installed solve the same poses in one process, in turns, with the numerical libraries held to one
thread. Every answer is checked by Pinocchio on the whole robot's URDF, whatever its solver says.

Exit status: 0 measured; 1 a file could not be written, or a library is missing; 2 wrong usage; 130
stopped by Ctrl-C. NumPy must not be loaded before `__main__` has limited its threads, so nothing is
imported here that would load it.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from baxter_kin.command_line import EXIT_INTERRUPTED
from baxter_kin.errors import FileError, MissingLibraryError

__all__ = ["EXIT_INTERRUPTED", "main"]

EXIT_FAILED = 1


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark with those arguments, or the command line's; returns the exit status."""
    try:
        import baxter_kin.kinematics.pinocchio_loading  # noqa: F401, PLC0415 - may be told as missing
        from baxter_kin.benchmark.options import parse_options  # noqa: PLC0415 - may be stopped
        from baxter_kin.benchmark.run import run_benchmark  # noqa: PLC0415 - loads every library

        run_benchmark(parse_options(argv))
    except (FileError, MissingLibraryError) as error:
        print(f"baxter_kin.benchmark: {error}", file=sys.stderr)
        return EXIT_FAILED
    except KeyboardInterrupt:
        print("stopped by Ctrl-C", file=sys.stderr)
        return EXIT_INTERRUPTED
    return 0
