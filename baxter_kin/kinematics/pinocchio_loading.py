"""Imports Pinocchio, or raises an error that names the missing system library.

The wheel of Pinocchio needs one library of the system, the OpenMP runtime of GCC, which a minimal
system does not have. Import this module before any other that imports Pinocchio.
"""

from __future__ import annotations

from baxter_kin.errors import MissingLibraryError

OPENMP = "libgomp.so.1"

try:
    import pinocchio  # noqa: F401 - only to check that it loads
except ImportError as cause:
    if OPENMP not in str(cause):
        raise
    raise MissingLibraryError(
        f"Pinocchio needs {OPENMP}, which this system lacks; "
        "install it: apt-get install libgomp1 (Debian, Ubuntu) or dnf install libgomp (Fedora)"
    ) from cause
