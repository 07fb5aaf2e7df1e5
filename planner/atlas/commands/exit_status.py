"""How the command ends."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from baxter_kin.errors import BaxterError, PoseError, UnknownNameError
from planner.errors import AtlasError

EXIT_DONE, EXIT_FAILED, EXIT_USAGE = 0, 1, 2

TOLD = (
    "Exit status: 0 done; {also}1 the map or what computes it failed, in one sentence on stderr; "
    "2 wrong usage; 130 Ctrl-C."
)
"""End of the help texts."""


class UsageError(BaxterError):
    """What was asked for makes no sense; nothing was done."""


@contextmanager
def asked_for() -> Iterator[None]:
    """What is refused meanwhile was asked for wrongly: nothing else may be done there.

    Raises:
        UsageError: in place of what was raised.
    """
    try:
        yield
    except (AtlasError, PoseError, UnknownNameError) as cause:
        raise UsageError(str(cause)) from cause
