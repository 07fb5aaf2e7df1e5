"""The allocator of a Dask worker, as every other process has it.

Dask starts workers with `MALLOC_TRIM_THRESHOLD_` at 64 KB, so that freed memory goes back to the
system at once. To glibc this also means that every array of 128 KB or more is mapped anew, page by
page: a reach map took a third more processor time.
"""

from __future__ import annotations

import ctypes
from functools import lru_cache

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # of glibc's malloc.h

LARGEST_KEPT = 32 * 2**20
"""Bytes of one allocation: up to where glibc moves its own thresholds by itself (mallopt(3))."""


@lru_cache(maxsize=1)
def keep_freed_memory() -> bool:
    """Let this process use freed memory again; gives whether its C library can be told so."""
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):  # another C library than glibc
        return False
    is_told = [
        mallopt(_M_MMAP_THRESHOLD, LARGEST_KEPT),
        mallopt(_M_TRIM_THRESHOLD, 2 * LARGEST_KEPT),
    ]
    return all(is_told)
