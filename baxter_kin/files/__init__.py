"""Files: opened and replaced safely, and values as JSON."""

from baxter_kin.files.replacing import (
    MAX_LINKS,
    Destination,
    PathLike,
    open_to_read,
    open_to_write,
    replace_file,
)

__all__ = [
    "MAX_LINKS",
    "Destination",
    "PathLike",
    "open_to_read",
    "open_to_write",
    "replace_file",
]
