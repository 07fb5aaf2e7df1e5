"""Garbage collection that does not hold up a stream.

With the planner loaded, a full collection takes 0.1 s, in which every thread stands still. What
exists before a stream begins is not looked at again until it ends.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def short_collections() -> Iterator[None]:
    """Within, collections look only at what was made since; a former freeze stays as it was."""
    was_frozen = gc.get_freeze_count() > 0
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        if not was_frozen:
            gc.unfreeze()
