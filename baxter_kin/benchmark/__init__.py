"""The IK benchmark: `python -m baxter_kin.benchmark`.

How often, and how fast, do IK solvers find joint angles for this arm? Our own and every peer that
is installed solve the same poses in one process, in turns, with the numerical libraries held to one
thread. Every answer is checked by Pinocchio on the whole robot's URDF, whatever its solver says.

Exit status: 0 measured; 1 a file could not be written, a library is missing, or workers are lost;
2 wrong usage; 130 stopped by Ctrl-C. NumPy must not be loaded before `__main__` has limited its
threads, so nothing is imported here that would load it.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

from baxter_kin.command_line import EXIT_INTERRUPTED, parse
from baxter_kin.errors import BaxterError

__all__ = ["EXIT_INTERRUPTED", "are_threads_limited", "limit_threads", "main"]

EXIT_FAILED = 1

_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
)
"""OpenMP and the BLAS libraries read these once, when NumPy or a solver is first imported."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark with those arguments, or the command line's; returns the exit status."""
    try:
        import baxter_kin.kinematics.pinocchio_loading  # noqa: F401, PLC0415 - may be missing
        from baxter_kin.benchmark.command import (  # noqa: PLC0415 - loads every library
            BenchmarkOptions,
            run_benchmark,
        )

        run_benchmark(parse(BenchmarkOptions, argv))
    except BaxterError as error:
        print(f"baxter_kin.benchmark: {error}", file=sys.stderr)
        return EXIT_FAILED
    except KeyboardInterrupt:
        print("stopped by Ctrl-C", file=sys.stderr)
        return EXIT_INTERRUPTED
    return 0


def limit_threads() -> None:
    """Ask for one thread per library.

    Raises:
        RuntimeError: when NumPy is loaded already, which is too late.
    """
    if "numpy" in sys.modules:
        raise RuntimeError("threads must be limited before NumPy is imported; it is loaded already")
    os.environ.update(dict.fromkeys(_VARIABLES, "1"))


def are_threads_limited() -> bool:
    """Whether every library has been asked for one thread."""
    return all(os.environ.get(variable) == "1" for variable in _VARIABLES)
