"""Whether a build may go on with a map that is there: one of the same, by the same software."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from baxter_kin.display import shown_path
from baxter_kin.distribution.software import difference, versions
from planner.errors import AtlasError


def check_continued(
    path: Path, is_same: Mapping[str, bool], software: Mapping[str, str], *, is_complete: bool
) -> None:
    """Refuse to go on with a map that is of something else, or was begun with other software.

    Where nothing is missing there is nothing that other software would compute.

    Args:
        path: the map's folder, for the message.
        is_same: of each thing that the map is of, whether it is the one that is asked for.
        software: versions by name that the map was begun with; empty where it does not name them.
        is_complete: whether all its blocks are stored.
    """
    other = [what for what, same in is_same.items() if not same]
    if other:
        raise AtlasError(
            f"the map at {shown_path(path)} is of another {' and another '.join(other)}; nothing "
            "was changed; choose another path"
        )
    differs = difference(software, versions()) if software else "versions that it does not name"
    if differs and not is_complete:
        raise AtlasError(
            f"the map at {shown_path(path)} was begun with other software: {differs}; nothing was "
            "changed; install that to go on, or choose another path"
        )
