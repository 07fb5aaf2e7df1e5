"""One thread for every numerical library.

OpenMP and the BLAS libraries read these variables once, when they are loaded, which happens when
NumPy or a solver is first imported. So they are set before, and are of no use later.
"""

from __future__ import annotations

import os
import sys

_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
)


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
