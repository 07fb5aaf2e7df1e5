"""How the command ends."""

from __future__ import annotations

from baxter_kin.errors import BaxterError

EXIT_DONE, EXIT_FAILED, EXIT_USAGE = 0, 1, 2

TOLD = (
    "Exit status: 0 done; {also}1 the map or what computes it failed, in one sentence on stderr; "
    "2 wrong usage; 130 Ctrl-C."
)
"""End of the help texts."""


class UsageError(BaxterError):
    """What was asked for makes no sense; nothing was done."""
