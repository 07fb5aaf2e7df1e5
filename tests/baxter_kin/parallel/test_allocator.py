"""The allocator of Dask's workers."""

from __future__ import annotations

import platform

import numpy as np

from baxter_kin.parallel.allocator import keep_freed_memory


def test_glibc_is_told_and_still_allocates() -> None:
    assert keep_freed_memory() == (platform.libc_ver()[0] == "glibc")
    assert np.zeros(10**6).sum() == 0.0
