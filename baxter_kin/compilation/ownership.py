"""Who else could have written a file: folders and files in which this user alone has a say.

Machine code that another user could put in place would run with this user's rights. A folder is
this user's own when it belongs to them, nobody else may write into it, and nobody else may put
another one in its place: every folder above it belongs to this user or to root, and is either
closed to other writers or sticky, as `/tmp` is. What lies there changes only through this user and
root, so it may be looked at first and used afterwards.
"""

from __future__ import annotations

import errno
import os
import stat
from contextlib import suppress
from pathlib import Path

from baxter_kin.errors import FileError

ROOT = 0
"""Who may do anything anyway."""

OTHER_WRITERS = stat.S_IWGRP | stat.S_IWOTH
"""The permissions that let group and others write. An access control list shows in them, too."""


def make_own_folder(path: Path) -> Path:
    """A folder of this user's own; what is missing of it is made, open to this user alone (0700).

    Nothing is made where it would not be safe.

    Args:
        path: absolute. Links on the way to it are followed, but it must not be one itself.

    Returns:
        The same folder, reached without links: use this path only.

    Raises:
        FileError: when it cannot be made, or when others could change what lies in it.
    """
    folder = Path(os.path.realpath(path.parent), path.name)
    for place in (*reversed(folder.parents), folder):  # downwards, each is safe before the next
        try:
            objection = _objection(_made(place), is_last=place == folder)
        except OSError as cause:
            objection = cause.strerror
        if objection is not None:
            where = "" if place == folder else f"{place}: "
            raise FileError("use", folder, f"{where}{objection}")
    return folder


def read_own_file(path: Path) -> bytes:
    """What a regular file of this user's own holds.

    Args:
        path: in a folder of this user's own.

    Raises:
        OSError: when there is none that can be read.
        FileError: when it is a link, no regular file, or one that others wrote or may write.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError as cause:
        if cause.errno == errno.ELOOP:
            raise FileError("use", path, "it is a symbolic link") from cause
        raise
    with open(descriptor, "rb") as stream:
        status = os.fstat(descriptor)
        objection = _common_objection(status, {os.geteuid()})
        if not stat.S_ISREG(status.st_mode):
            objection = "it is no regular file"
        if objection is not None:
            raise FileError("use", path, objection)
        return stream.read()


def _made(place: Path) -> os.stat_result:
    """What the system knows of a folder, which is made if there is none."""
    try:
        return os.lstat(place)
    except FileNotFoundError:
        with suppress(FileExistsError):  # as another process has just made it
            os.mkdir(place, 0o700)
        return os.lstat(place)


def _objection(status: os.stat_result, *, is_last: bool) -> str | None:
    """Why others have a say in a folder, or in one above it; None when they have not."""
    if not hasattr(os, "geteuid"):
        return "this system does not tell whose it is"
    if stat.S_ISLNK(status.st_mode):
        return "it is a symbolic link"
    if not stat.S_ISDIR(status.st_mode):
        return "it is no folder"
    if is_last:
        return _common_objection(status, {os.geteuid()})
    if status.st_mode & stat.S_ISVTX:  # others may add to it, but not take away
        return _common_objection(status, {os.geteuid(), ROOT}, forbidden=0)
    return _common_objection(status, {os.geteuid(), ROOT})


def _common_objection(
    status: os.stat_result, owners: set[int], *, forbidden: int = OTHER_WRITERS
) -> str | None:
    if status.st_uid not in owners:
        return f"it belongs to another user (number {status.st_uid})"
    if status.st_mode & forbidden:
        mode = stat.S_IMODE(status.st_mode)
        return f"other users may write to it (mode {mode:04o}; chmod go-w closes it)"
    return None
