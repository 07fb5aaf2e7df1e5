"""The one error of the checker."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


class NotCertifiedError(Exception):
    """The plan is not certified; the message is one sentence that says why."""


def require(condition: ArrayLike, reason: str) -> None:
    """Refuse the plan unless all of a condition holds.

    Conditions are comparisons that are false for NaN, so a NaN is refused as well.
    """
    if not np.all(condition):
        raise NotCertifiedError(reason)
